//! A viewer of the toys, and its pictures.
#![allow(dead_code, reason = "each test file uses a part")]

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use bvh_core::Bvh;
use rt_cpu::{Image, render, srgb};
use stage::Stage;
use viewer_core::{Canvas, Event, Key, Ready, Request, Settings, State};

/// A clock that is a millisecond later each time.
pub(crate) fn clock() -> f64 {
    static CALLS: AtomicU32 = AtomicU32::new(0);
    f64::from(CALLS.fetch_add(1, Ordering::Relaxed)) * 1e-3
}

pub(crate) fn toys() -> scenes::Scene {
    let toys = Path::new("toys.glb");
    let animation = anim::parse(toys, &scenes::toys_glb(), &Default::default()).expect("a glTF file");
    scenes::Scene { name: "toys".to_owned(), ..scenes::scene_of(toys, animation) }
}

pub(crate) const SIZE: (u32, u32) = (320, 240);

/// A viewer of the toys at rest in frame 0, with one tree and nothing over the picture.
pub(crate) fn viewer() -> State {
    let mut state = State::new(SIZE.0, SIZE.1, vec!["toys".to_owned(), "others".to_owned()], clock);
    assert_eq!(state.take_requests(), [Request::Load("toys".to_owned())]);
    state.apply(Event::Scene(Box::new(Ready::new(toys()).expect("few triangles"))));
    state.apply(Event::Settings(Settings { right: None, overlay: 0, ..Settings::default() }));
    press(&mut state, ' ');
    state
}

pub(crate) fn press(state: &mut State, key: char) {
    state.apply(Event::Key(Key::Char(key), true));
    state.apply(Event::Key(Key::Char(key), false));
}

/// The picture once it stays as it is.
pub(crate) fn at_rest(state: &mut State) -> Canvas {
    for _ in 0..100 {
        let canvas = state.draw().clone();
        if state.is_at_rest() {
            return canvas;
        }
    }
    panic!("the picture does not come to rest");
}

/// The picture of a frame, as `xtask render` makes it.
pub(crate) fn rendered(frame: usize) -> Vec<u8> {
    let mut stage = Stage::new(toys()).expect("few triangles");
    stage.pose(stage.time_of(frame, stage.scene.frames));
    stage.smooth();
    let mut tree = Bvh::clone(&stage.first_tree);
    bvh_update::refit(&mut tree, &stage.triangles()).expect("same count");
    let mut image = Image::new(SIZE.0, SIZE.1);
    let camera = stage.camera(SIZE.0, SIZE.1);
    render(&tree, &stage.mesh(), &camera, Some(&stage.light()), &stage.render_options(), &mut image);
    image.pixels().iter().flat_map(|pixel| [srgb(pixel[0]), srgb(pixel[1]), srgb(pixel[2]), 255]).collect()
}
