//! A viewer that is driven by events, without a window.

mod common;

use common::{SIZE, at_rest, clock, press, rendered, toys, viewer};
use viewer_core::{Button, Event, Key, Ready, Request, Settings, State};

fn drag(state: &mut State, button: Button, from: (f32, f32), to: (f32, f32)) {
    state.apply(Event::Pointer(from.0, from.1));
    state.apply(Event::Button(button, true));
    state.apply(Event::Pointer(to.0, to.1));
    state.apply(Event::Button(button, false));
}

#[test]
fn pictures_at_rest_are_those_of_render_whatever_the_strategy() {
    let mut state = viewer();
    for frame in 0..4 {
        assert_eq!(state.frame(), Some((frame, 49)));
        assert!(at_rest(&mut state).rgba == rendered(frame), "frame {frame}");
        press(&mut state, '1');
        state.apply(Event::Key(Key::Right, true));
    }
    state.apply(Event::Key(Key::Left, true));
    assert!(at_rest(&mut state).rgba == rendered(3));
}

#[test]
fn pictures_are_coarse_while_something_moves_and_fine_at_rest() {
    fn slow() -> f64 {
        // Each look at the clock is 60 ms later, more than the tracer's budget.
        60.0 * clock()
    }
    let mut state = State::new(SIZE.0, SIZE.1, vec!["toys".to_owned()], slow);
    state.apply(Event::Scene(Box::new(Ready::new(toys()).expect("few triangles"))));
    state.apply(Event::Settings(Settings { right: None, overlay: 0, ..Settings::default() }));
    for _ in 0..3 {
        state.apply(Event::Tick(0.05));
        state.draw();
    }
    let canvas = state.draw().clone();
    assert_eq!(canvas.rgba[..4], canvas.rgba[4..8], "neighbours are one square");
    let (now, _) = state.frame().expect("a scene");
    press(&mut state, ' ');
    assert!(!state.is_at_rest());
    assert!(at_rest(&mut state).rgba == rendered(now));
}

#[test]
fn playing_shows_every_frame_and_begins_again() {
    let mut state = viewer();
    press(&mut state, ' ');
    let mut seen = Vec::new();
    for _ in 0..60 {
        state.apply(Event::Tick(1.0));
        state.draw();
        seen.push(state.frame().expect("a scene").0);
    }
    assert_eq!(seen[..48], (1..49).collect::<Vec<_>>()[..]);
    assert_eq!(seen[48..50], [0, 1]);
    press(&mut state, ' ');
    state.apply(Event::Tick(1.0));
    assert_eq!(state.frame().map(|(frame, _)| frame), seen.last().copied());
}

#[test]
fn mouse_and_keys_move_the_camera_and_c_brings_it_back() {
    let mut state = viewer();
    let first = at_rest(&mut state);
    let mut check = |change: &dyn Fn(&mut State)| {
        change(&mut state);
        assert!(at_rest(&mut state) != first);
        press(&mut state, 'c');
        assert!(at_rest(&mut state) == first);
    };
    check(&|state| drag(state, Button::Left, (100.0, 100.0), (140.0, 120.0)));
    check(&|state| drag(state, Button::Right, (100.0, 100.0), (80.0, 120.0)));
    check(&|state| state.apply(Event::Wheel(2.0)));
    check(&|state| {
        state.apply(Event::Key(Key::Char('w'), true));
        assert!(!state.is_at_rest());
        state.apply(Event::Tick(0.5));
        state.apply(Event::Key(Key::Char('w'), false));
    });
}

#[test]
fn a_click_picks_a_triangle_and_a_click_beside_all_lets_go() {
    let mut state = viewer();
    let first = at_rest(&mut state);
    let click = |state: &mut State, x: f32, y: f32| drag(state, Button::Left, (x, y), (x + 1.0, y));
    click(&mut state, 160.0, 200.0);
    let picked = at_rest(&mut state);
    let differ = picked.rgba.chunks(4).zip(first.rgba.chunks(4)).filter(|(a, b)| a != b).count();
    assert!(differ > 300, "boxes from the root to the leaf: {differ} pixels");
    click(&mut state, 160.0, 2.0);
    assert!(at_rest(&mut state) == first);
}

#[test]
fn settings_change_the_picture_and_back() {
    let mut state = viewer();
    let first = at_rest(&mut state);
    for key in ['h', 'b', 'l'] {
        press(&mut state, key);
        assert!(at_rest(&mut state) != first, "{key}");
        press(&mut state, key.to_ascii_uppercase());
        assert!(at_rest(&mut state) == first, "{key} and back");
    }
    for key in ['t', 'r', 'm'] {
        press(&mut state, key);
        at_rest(&mut state);
    }
    assert_ne!(state.settings(), Settings { right: None, overlay: 0, ..Settings::default() });
    assert!(at_rest(&mut state).width == SIZE.0);
}

#[test]
fn nodes_that_rotate_flash() {
    let mut state = viewer();
    let set =
        Settings { left: "refit+rotate".parse().unwrap(), right: None, overlay: 0, ..Settings::default() };
    let mut pictures = [false, true].map(|flash| {
        state.apply(Event::Settings(Settings { flash, ..set }));
        state.apply(Event::Key(Key::Home, true));
        (0..12).for_each(|_| state.apply(Event::Key(Key::Right, true)));
        at_rest(&mut state).rgba
    });
    let [calm, flashing] = &mut pictures;
    assert!(calm != flashing && *calm == rendered(12));
}

#[test]
fn the_panel_and_the_timeline_take_clicks() {
    let mut state = viewer();
    state.apply(Event::Settings(Settings::default()));
    state.apply(Event::Resize(640, 360));
    at_rest(&mut state);
    // The row of the left strategy.
    drag(&mut state, Button::Left, (30.0, 45.0), (30.0, 45.0));
    assert_eq!(state.settings().left.name(), "refit+rotate");
    drag(&mut state, Button::Right, (30.0, 45.0), (30.0, 45.0));
    assert_eq!(state.settings().left.name(), "refit");
    // The track of the rotation budget, from its middle to its left end and beyond its right one.
    drag(&mut state, Button::Left, (180.0, 130.0), (138.0, 200.0));
    assert_eq!(state.settings().period, 16);
    drag(&mut state, Button::Left, (138.0, 130.0), (600.0, 130.0));
    assert_eq!(state.settings().period, 1);
    drag(&mut state, Button::Left, (222.0, 106.0), (138.0, 106.0));
    assert_eq!(state.settings().test.name(), "fast");
    drag(&mut state, Button::Left, (138.0, 154.0), (165.0, 154.0));
    assert_eq!(state.settings().samples, Some(4));
    drag(&mut state, Button::Left, (10.0, 355.0), (639.0, 355.0));
    assert_eq!(state.frame(), Some((48, 49)));
}

#[test]
fn requests_go_to_the_shell_and_errors_into_the_picture() {
    let mut state = viewer();
    for key in ['p', 'y', 'y', 'n', 'n'] {
        press(&mut state, key);
    }
    state.apply(Event::Key(Key::Escape, true));
    let load = Request::Load("others".to_owned());
    let all = [Request::Save, Request::Record(true), Request::Record(false), load.clone(), Request::Quit];
    assert_eq!(state.take_requests(), all, "while a scene is loading no other is asked for");
    state.apply(Event::Failed("not there".to_owned()));
    press(&mut state, 'n');
    assert_eq!(state.take_requests(), [load]);
    at_rest(&mut state);
}

#[test]
fn without_the_panel_too_messages_are_shown() {
    let mut state = viewer();
    state.apply(Event::Settings(Settings { right: None, overlay: 1, ..Settings::default() }));
    let first = at_rest(&mut state);
    state.apply(Event::Message("saved".to_owned()));
    assert!(at_rest(&mut state) != first);
    state.apply(Event::Message(String::new()));
    assert!(at_rest(&mut state) == first);
}

#[test]
fn pictures_become_finer_only_once_a_scene_is_loaded() {
    let mut state = viewer();
    state.apply(Event::Key(Key::Right, true));
    press(&mut state, 'n');
    state.draw();
    assert!(state.is_loading() && state.is_at_rest());
    assert!(state.draw().rgba != rendered(1));
    state.apply(Event::Failed("not there".to_owned()));
    assert!(at_rest(&mut state).rgba == rendered(1));
}

#[test]
fn no_size_and_no_scene_are_no_reason_to_fail() {
    let mut state = State::new(0, 0, Vec::new(), clock);
    state.draw();
    state.apply(Event::Key(Key::Home, true));
    state.draw();
    assert!(state.is_at_rest());
    let mut state = viewer();
    state.apply(Event::Settings(Settings { boxes: Some(12), flash: true, ..Settings::default() }));
    for (width, height) in [(0, 0), (1, 1), (2, 700), (33, 9), (700, 3)] {
        state.apply(Event::Resize(width, height));
        drag(&mut state, Button::Left, (-5.0, 1e9), (f32::NAN, 0.0));
        press(&mut state, 'u');
        let canvas = at_rest(&mut state);
        assert_eq!(canvas.rgba.len(), 4 * width.max(1) as usize * height.max(1) as usize);
    }
}
