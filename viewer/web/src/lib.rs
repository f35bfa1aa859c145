//! What the page's worker calls: numbers in, numbers out. It hands over events, and shows the
//! pixels.
#![cfg(target_os = "wasi")]
#![expect(unsafe_code, reason = "exported names are global")]

use std::cell::RefCell;
use std::path::Path;
use std::sync::LazyLock;
use std::time::Instant;

use scenes::{Scene, SceneOptions};
use stage::Stage;
use viewer_core::{Button, Event, FreshCosts, Key, Ready, Request, State};

/// The scenes of the page, made when they are asked for. Key frames of the last one are in a file
/// beside the page.
const SCENES: [&str; 3] = ["toys", "bart-museum", "exploding-dragon"];

/// What the page is to do, as bits: save the picture, and fetch the key frames.
const SAVE: u32 = 1;
const FETCH: u32 = 2;

/// What lives as long as the page.
#[derive(Default)]
struct Page {
    state: Option<State>,
    /// A file that the page hands over: its name, and behind that its bytes.
    inbox: Vec<u8>,
    /// Costs of fresh trees that are still to be found.
    fresh: Option<FreshCosts>,
    /// The scene that is being made.
    making: Option<Making>,
}

/// How far a scene is that was asked for. Pictures are drawn between one step and the next.
enum Making {
    Asked(String),
    /// It waits for its key frames.
    Fetching(String),
    Scene(Box<Scene>),
    Stage(Box<Stage>),
}

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
}

/// Seconds since the start.
fn clock() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

fn apply(event: Event) {
    PAGE.with_borrow_mut(|page| {
        if let Some(state) = &mut page.state {
            state.apply(event);
        }
    });
}

fn set_making(making: Option<Making>) {
    PAGE.with_borrow_mut(|page| page.making = making);
}

/// Takes the next step towards the scene that was asked for. Gives [`FETCH`] if that needs its key
/// frames.
fn make() -> u32 {
    let made = match PAGE.with_borrow_mut(|page| page.making.take()) {
        None => Ok(None),
        Some(Making::Asked(name)) if name == SCENES[2] => {
            set_making(Some(Making::Fetching(name)));
            return FETCH;
        }
        Some(waiting @ Making::Fetching(_)) => Ok(Some(waiting)),
        Some(Making::Asked(name)) => named(&name, &[]).map(Some),
        Some(Making::Scene(scene)) => staged(*scene).map(Some),
        Some(Making::Stage(stage)) => {
            show(Ready::of(*stage));
            Ok(None)
        }
    };
    go_on(made);
    0
}

fn go_on(made: Result<Option<Making>, String>) {
    match made {
        Ok(making) => set_making(making),
        Err(error) => apply(Event::Failed(error)),
    }
}

fn staged(scene: Scene) -> Result<Making, String> {
    Stage::new(scene).map(|stage| Making::Stage(Box::new(stage))).map_err(|error| error.to_string())
}

fn show(mut ready: Ready) {
    let fresh = ready.take_fresh_costs();
    PAGE.with_borrow_mut(|page| page.fresh = fresh);
    apply(Event::Scene(Box::new(ready)));
}

/// A scene of the page. One that is simulated takes its key frames from `record`, if they are
/// there.
fn named(name: &str, record: &[u8]) -> Result<Making, String> {
    let scene = if name == SCENES[0] {
        parsed("toys.glb", &scenes::toys_glb()).map(|scene| Scene { name: name.to_owned(), ..scene })
    } else {
        let options = SceneOptions { record: Some(record), ..SceneOptions::for_page() };
        scenes::load(name, None, &options).map_err(|error| error.to_string())
    };
    scene.map(|scene| Making::Scene(Box::new(scene)))
}

fn parsed(name: &str, bytes: &[u8]) -> Result<Scene, String> {
    let path = Path::new(name);
    let animation = anim::parse(path, bytes, &Default::default());
    animation.map(|animation| scenes::scene_of(path, animation)).map_err(|error| error.to_string())
}

/// Begins, with pictures of a size in pixels, on a number of threads. This thread is one of them.
#[unsafe(no_mangle)]
pub extern "C" fn start(width: u32, height: u32, threads: u32) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1) as usize).use_current_thread();
    if let Err(error) = pool.build_global() {
        eprintln!("one thread: {error}");
    }
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

fn take_inbox() -> Vec<u8> {
    PAGE.with_borrow_mut(|page| std::mem::take(&mut page.inbox))
}

/// Shows the file in the inbox, whose name has this number of bytes.
#[unsafe(no_mangle)]
pub extern "C" fn open_file(name: usize) {
    let file = take_inbox();
    let (name, bytes) = file.split_at(name.min(file.len()));
    let scene = parsed(&String::from_utf8_lossy(name), bytes);
    go_on(scene.map(|scene| Some(Making::Scene(Box::new(scene)))));
}

/// Goes on with the scene that waits for its key frames, which are in the inbox. If that is empty,
/// it is simulated, which takes seconds.
#[unsafe(no_mangle)]
pub extern "C" fn keys() {
    let record = take_inbox();
    match PAGE.with_borrow_mut(|page| page.making.take()) {
        Some(Making::Fetching(name)) => go_on(named(&name, &record).map(Some)),
        other => set_making(other),
    }
}

/// A number of seconds has passed: draws, and gives the place of the pixels, four bytes each. 0
/// before the start.
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

/// Seconds in which there is nothing to draw, but for events.
#[unsafe(no_mangle)]
pub extern "C" fn idle() -> f64 {
    PAGE.with_borrow(|page| page.state.as_ref().map_or(0.0, State::idle_seconds))
}

/// Whether a scene was asked for that is not there yet.
#[unsafe(no_mangle)]
pub extern "C" fn is_loading() -> u32 {
    PAGE.with_borrow(|page| {
        u32::from(page.making.is_some() || page.state.as_ref().is_none_or(State::is_loading))
    })
}

/// Does what the viewer asks for. A scene is made in steps, one a call. Gives what the page is to
/// do: [`SAVE`], [`FETCH`].
#[unsafe(no_mangle)]
pub extern "C" fn serve() -> u32 {
    let requests =
        PAGE.with_borrow_mut(|page| page.state.iter_mut().flat_map(State::take_requests).collect::<Vec<_>>());
    let mut todo = 0;
    for request in requests {
        match request {
            Request::Load(name) => set_making(Some(Making::Asked(name))),
            Request::Save => todo |= SAVE,
            Request::Record(_) => apply(Event::Message("only the window records".to_owned())),
            Request::Quit => {}
        }
    }
    todo | make()
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
