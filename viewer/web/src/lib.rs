//! What the page calls: numbers in, numbers out. The page gives a clock and events, and shows the pixels.
#![cfg(target_family = "wasm")]
#![expect(unsafe_code, reason = "exported names are global, and the page's clock is a foreign function")]

use std::cell::RefCell;
use std::path::Path;

use scenes::{Scene, SceneOptions};
use viewer_core::{Button, Event, FreshCosts, Key, Ready, Request, State};

/// The scenes of the page. They are made when they are asked for, so the page holds none.
const SCENES: [&str; 3] = ["toys", "bart-museum", "exploding-dragon"];

/// Part of the triangles of simulated scenes, and their key frames: of the dragon 91,046 and 48.
const DETAIL: (f32, usize) = (0.36, 48);

/// What lives as long as the page.
#[derive(Default)]
struct Page {
    state: Option<State>,
    /// A file that the page hands over: its name, and behind that its bytes.
    inbox: Vec<u8>,
    /// Costs of fresh trees that are still to be found.
    fresh: Option<FreshCosts>,
}

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
}

mod host {
    #[link(wasm_import_module = "page")]
    unsafe extern "C" {
        /// Seconds since any moment.
        pub(crate) safe fn now() -> f64;
    }
}

fn clock() -> f64 {
    host::now()
}

fn apply(event: Event) {
    PAGE.with_borrow_mut(|page| {
        if let Some(state) = &mut page.state {
            state.apply(event);
        }
    });
}

fn show(scene: Result<Scene, String>) {
    match scene.and_then(|scene| Ready::new(scene).map_err(|error| error.to_string())) {
        Ok(mut ready) => {
            let fresh = ready.take_fresh_costs();
            PAGE.with_borrow_mut(|page| page.fresh = fresh);
            apply(Event::Scene(Box::new(ready)));
        }
        Err(error) => apply(Event::Failed(error)),
    }
}

fn named(name: &str) -> Result<Scene, String> {
    if name == SCENES[0] {
        return parsed("toys.glb", &scenes::toys_glb()).map(|scene| Scene { name: name.to_owned(), ..scene });
    }
    let options =
        SceneOptions { detail: Some(DETAIL.0), key_frames: Some(DETAIL.1), ..SceneOptions::default() };
    scenes::load(name, None, &options).map_err(|error| error.to_string())
}

fn parsed(name: &str, bytes: &[u8]) -> Result<Scene, String> {
    let path = Path::new(name);
    let is_gltf =
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"));
    let animation: Result<Box<dyn anim::Animation>, _> = if is_gltf {
        anim::parse_gltf(path, bytes, None).map(|animation| Box::new(animation) as _)
    } else {
        anim::parse_mesh(path, bytes).map(|mesh| Box::new(mesh) as _)
    };
    animation.map(|animation| scenes::scene_of(path, animation)).map_err(|error| error.to_string())
}

/// Begins, with pictures of a size in pixels.
#[unsafe(no_mangle)]
pub extern "C" fn start(width: u32, height: u32) {
    let state = State::new(width, height, SCENES.map(str::to_owned).to_vec(), clock);
    PAGE.with_borrow_mut(|page| page.state = Some(state));
}

/// A key goes down or up: the number of its character, or -1 for left, -2 for right, -3 for home.
#[unsafe(no_mangle)]
pub extern "C" fn key(code: i32, down: u32) {
    let key = match code {
        -1 => Some(Key::Left),
        -2 => Some(Key::Right),
        -3 => Some(Key::Home),
        code => u32::try_from(code).ok().and_then(char::from_u32).map(Key::Char),
    };
    key.into_iter().for_each(|key| apply(Event::Key(key, down != 0)));
}

/// The pointer is at a pixel.
#[unsafe(no_mangle)]
pub extern "C" fn pointer(x: f32, y: f32) {
    apply(Event::Pointer(x, y));
}

/// The left button, 0, or another goes down or up.
#[unsafe(no_mangle)]
pub extern "C" fn button(which: u32, down: u32) {
    apply(Event::Button(if which == 0 { Button::Left } else { Button::Right }, down != 0));
}

/// The wheel turns up by a number of notches.
#[unsafe(no_mangle)]
pub extern "C" fn wheel(notches: f32) {
    apply(Event::Wheel(notches));
}

/// The picture has another size.
#[unsafe(no_mangle)]
pub extern "C" fn resize(width: u32, height: u32) {
    apply(Event::Resize(width, height));
}

/// Room for a file of `bytes` bytes, its name included.
#[unsafe(no_mangle)]
pub extern "C" fn inbox(bytes: usize) -> *mut u8 {
    PAGE.with_borrow_mut(|page| {
        page.inbox = vec![0; bytes];
        page.inbox.as_mut_ptr()
    })
}

/// Shows the file in the inbox, whose name has this number of bytes.
#[unsafe(no_mangle)]
pub extern "C" fn open(name: usize) {
    let file = PAGE.with_borrow_mut(|page| std::mem::take(&mut page.inbox));
    let (name, bytes) = file.split_at(name.min(file.len()));
    show(parsed(&String::from_utf8_lossy(name), bytes));
}

/// A number of seconds has passed: draws, and gives the place of the pixels, four bytes each. 0 before the start.
#[unsafe(no_mangle)]
pub extern "C" fn draw(seconds: f64) -> *const u8 {
    apply(Event::Tick(seconds));
    PAGE.with_borrow_mut(|page| {
        page.state.as_mut().map_or(std::ptr::null(), |state| state.draw().rgba.as_ptr())
    })
}

/// Whether the picture stays as it is until the next event.
#[unsafe(no_mangle)]
pub extern "C" fn is_at_rest() -> u32 {
    PAGE.with_borrow(|page| page.state.as_ref().map_or(1, |state| u32::from(state.is_at_rest())))
}

/// Whether a scene was asked for that is not there yet.
#[unsafe(no_mangle)]
pub extern "C" fn is_loading() -> u32 {
    PAGE.with_borrow(|page| page.state.as_ref().map_or(1, |state| u32::from(state.is_loading())))
}

/// Does what the viewer asks for: makes a scene, which may take seconds. Gives 1 if the page is to save the picture.
#[unsafe(no_mangle)]
pub extern "C" fn serve() -> u32 {
    let requests =
        PAGE.with_borrow_mut(|page| page.state.iter_mut().flat_map(State::take_requests).collect::<Vec<_>>());
    let mut saves = 0;
    for request in requests {
        match request {
            Request::Load(name) => show(named(&name)),
            Request::Save => saves = 1,
            Request::Record(_) => apply(Event::Message("only the window records".to_owned())),
            Request::Quit => {}
        }
    }
    saves
}

/// Finds the cost of one fresh tree; 0 once all are known. Up to 0.3 s.
#[unsafe(no_mangle)]
pub extern "C" fn fresh() -> u32 {
    let found = PAGE.with_borrow_mut(|page| page.fresh.as_mut().and_then(Iterator::next));
    found.is_some_and(|(frame, cost)| {
        apply(Event::Fresh(frame, cost));
        true
    }) as u32
}
