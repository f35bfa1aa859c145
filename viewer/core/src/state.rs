//! The state of the viewer: what events do to it, and its picture.

use bvh_core::{Aabb, TriangleTest, closest_hit};
use bvh_update::Strategy;
use rayon::prelude::*;
use rt_cpu::{Camera, Image, Output, RenderOptions, SrgbTable, StageTimes, render};
use scenes::LightEffects;
use stage::Stage;

use crate::boxes::TypicalCost;
use crate::canvas::{Canvas, Rect};
use crate::controls::{CONTROLS, Control, Settings, default_samples};
use crate::eye::Eye;
use crate::side::Side;
use crate::{Clock, Ready};

/// Frames a second that animations are made for.
const FRAME_RATE: f64 = 24.0;
/// Milliseconds that a picture may take while something moves, and the least of them for tracing: 25 frames a second,
/// and 12 in a browser, which has one thread.
const PICTURE_BUDGET: f64 = if cfg!(target_family = "wasm") { 75.0 } else { 36.0 };
const TRACE_BUDGET: f64 = 10.0;
/// Greatest width of the picture that triangle tests are compared on.
const PROBE: u32 = 96;
/// What the mouse does: radians for a pixel, factor of the distance for a notch of the wheel, and pixels that a click may
/// stray. Flying: distances to the target in a second.
const TURN: f32 = 0.008;
const NOTCH: f32 = 0.88;
const CLICK: f32 = 4.0;
const FLIGHT: f64 = 0.7;

/// A key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// A letter, a digit or a space; capital with the shift key.
    Char(char),
    /// The next frame.
    Right,
    /// The frame before.
    Left,
    /// Back to the first frame, with fresh trees.
    Home,
    /// The end.
    Escape,
}

/// A button of the mouse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Turns about the target, picks a triangle, and sets forwards.
    Left,
    /// Looks around, and sets backwards.
    Right,
}

/// What happens to a viewer.
pub enum Event {
    /// A key goes down or up.
    Key(Key, bool),
    /// The mouse is at a pixel.
    Pointer(f32, f32),
    /// A button goes down or up.
    Button(Button, bool),
    /// The wheel turns up by a number of notches.
    Wheel(f32),
    /// The picture has another size in pixels.
    Resize(u32, u32),
    /// A number of seconds has passed.
    Tick(f64),
    /// A scene is there, to be shown in the place of the present one.
    Scene(Box<Ready>),
    /// The SAH cost of a fresh tree at a frame.
    Fresh(usize, f64),
    /// A line for the user.
    Message(String),
    /// Why the scene that was asked for cannot be loaded.
    Failed(String),
    /// The settings are to be these.
    Settings(Settings),
}

/// What a viewer asks its shell to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Load the scene of this name or path.
    Load(String),
    /// Save the picture.
    Save,
    /// Begin or end to record pictures.
    Record(bool),
    /// End.
    Quit,
}

/// What holds a button of the mouse down.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    /// On the scene, after a number of pixels.
    Eye(Button, f32),
    Timeline,
    Slider(Control),
    Nothing,
}

/// A scene that is shown.
pub(crate) struct Shown {
    pub(crate) stage: Stage,
    pub(crate) typical: TypicalCost,
    pub(crate) hottest: u32,
    pub(crate) sides: Vec<Side>,
    /// Costs of fresh trees by frame, in order.
    fresh: Vec<(usize, f64)>,
    pub(crate) frame: usize,
    /// Whether normals are those of the present pose.
    is_smooth: bool,
}

impl Shown {
    pub(crate) fn frames(&self) -> usize {
        self.stage.scene.frames.max(1)
    }

    /// The cost of a fresh tree at a frame, from the frames around it; `None` before the first is known.
    pub(crate) fn fresh_cost(&self, frame: usize) -> Option<f64> {
        let after = self.fresh.partition_point(|&(at, _)| at < frame);
        let right = self.fresh.get(after).or(self.fresh.last())?;
        let left = if after > 0 { &self.fresh[after - 1] } else { right };
        let part = (frame as f64 - left.0 as f64) / (right.0 as f64 - left.0 as f64).max(1.0);
        Some(left.1 + (right.1 - left.1) * part.clamp(0.0, 1.0))
    }

    /// The box of the triangle that was picked.
    pub(crate) fn triangle(&self, primitive: u32) -> Aabb {
        let triangles = self.stage.triangles();
        triangles
            .indices
            .get(primitive as usize)
            .map_or(Aabb::EMPTY, |_| Aabb::around(&triangles.corners(primitive as usize)))
    }
}

/// A triangle test beside that in double precision, on a small picture of a view that stands still.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    test: TriangleTest,
    /// Nanoseconds a ray with either.
    pub(crate) ns: f64,
    pub(crate) exact_ns: f64,
    /// Pixels that differ, and all of them.
    pub(crate) differ: usize,
    pub(crate) pixels: usize,
}

/// A viewer.
pub struct State {
    clock: Clock,
    /// What is set by hand.
    pub(crate) settings: Settings,
    scenes: Vec<String>,
    /// The scene that is being loaded.
    loading: Option<String>,
    pub(crate) message: String,
    pub(crate) shown: Option<Shown>,
    pub(crate) eye: Eye,
    pub(crate) picked: Option<u32>,
    pub(crate) playing: bool,
    /// Frames that are due.
    due: f64,
    pub(crate) recording: bool,
    pub(crate) pointer: (f32, f32),
    drag: Drag,
    /// Keys of flight that are down.
    held: Vec<char>,
    pub(crate) probe: Option<Probe>,
    pub(crate) requests: Vec<Request>,
    /// Whether what is seen has moved since the last picture.
    moved: bool,
    /// Whether something has changed that is drawn.
    stale: bool,
    table: SrgbTable,
    picture: Canvas,
    canvas: Canvas,
    /// Milliseconds that the last step of the animation took with its updates.
    step_ms: f64,
    /// Milliseconds that the last picture took without tracing, that step included.
    other_ms: f64,
}

impl State {
    /// Makes a viewer of pictures of a size in pixels. It knows some scenes by name or path, and asks for the first.
    #[must_use]
    pub fn new(width: u32, height: u32, scenes: Vec<String>, clock: Clock) -> Self {
        let mut state = Self {
            clock,
            // The panel takes a fourth of a small picture.
            settings: Settings { overlay: if width < 800 { 1 } else { 2 }, ..Settings::default() },
            loading: None,
            message: String::new(),
            shown: None,
            eye: Eye::default(),
            picked: None,
            playing: true,
            due: 0.0,
            recording: false,
            pointer: (0.0, 0.0),
            drag: Drag::Nothing,
            held: Vec::new(),
            probe: None,
            requests: Vec::new(),
            moved: false,
            stale: true,
            table: SrgbTable::new(),
            picture: Canvas::new(width.max(1), height.max(1)),
            canvas: Canvas::default(),
            step_ms: 0.0,
            other_ms: 0.0,
            scenes,
        };
        let first = state.scenes.first().cloned();
        first.into_iter().for_each(|name| state.load(name));
        state
    }

    /// Hands over what the shell is asked to do.
    pub fn take_requests(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.requests)
    }

    /// What is set by hand.
    #[must_use]
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// The frame that is shown and the number of frames; `None` without a scene.
    #[must_use]
    pub fn frame(&self) -> Option<(usize, usize)> {
        self.shown.as_ref().map(|shown| (shown.frame, shown.frames()))
    }

    /// Whether the picture stays as it is until the next event.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let samples = self.samples();
        let is_done = self.shown.iter().flat_map(|shown| &shown.sides).all(|side| side.is_done(samples));
        is_done && !self.plays() && !self.moved && !self.stale && self.held.is_empty()
    }

    /// Seconds until the animation's next frame is due, if there is nothing to draw before; 0 if there is.
    #[must_use]
    pub fn idle_seconds(&self) -> f64 {
        let is_idle = self.plays() && !self.moved && !self.stale && self.held.is_empty();
        if is_idle { (1.0 - self.due).max(0.0) / (FRAME_RATE * self.settings.speed) } else { 0.0 }
    }

    /// Milliseconds that the last picture took: the step of the animation, tracing, and the rest.
    #[must_use]
    pub fn picture_ms(&self) -> [f64; 3] {
        let traced = self.shown.iter().flat_map(|shown| &shown.sides).map(|side| side.trace_ms).sum();
        [self.step_ms, traced, self.other_ms - self.step_ms]
    }

    fn plays(&self) -> bool {
        self.playing && self.frame().is_some_and(|(_, frames)| frames > 1)
    }

    /// Takes note of what has happened.
    pub fn apply(&mut self, event: Event) {
        self.stale = true;
        match event {
            Event::Key(key, down) => self.key(key, down),
            Event::Pointer(x, y) => self.pointer_to((x, y)),
            Event::Button(button, true) => self.press(button),
            Event::Button(_, false) => self.release(),
            Event::Wheel(notches) => {
                self.move_eye(|eye, view| eye.zoom(view, NOTCH.powf(notches.clamp(-50.0, 50.0))));
            }
            Event::Resize(width, height) => {
                self.picture = Canvas::new(width.clamp(1, 16384), height.clamp(1, 16384));
                self.settings_changed();
            }
            Event::Tick(seconds) => self.tick(seconds.clamp(0.0, 1.0)),
            Event::Scene(ready) => self.show(*ready),
            Event::Fresh(frame, cost) => {
                if let Some(shown) = &mut self.shown {
                    let at = shown.fresh.partition_point(|&(known, _)| known < frame);
                    shown.fresh.insert(at, (frame, cost));
                }
            }
            Event::Message(message) => self.message = message,
            Event::Failed(message) => (self.message, self.loading) = (message, None),
            Event::Settings(settings) => {
                self.settings = settings;
                self.settings_changed();
            }
        }
    }

    fn show(&mut self, ready: Ready) {
        let Ready { stage, typical, hottest, .. } = ready;
        self.message = stage.scene.notes.first().cloned().unwrap_or_default();
        self.shown = Some(Shown {
            sides: Vec::new(),
            fresh: Vec::new(),
            frame: 0,
            is_smooth: false,
            stage,
            typical,
            hottest,
        });
        (self.loading, self.picked, self.due) = (None, None, 0.0);
        (self.settings.light, self.settings.samples) = (None, None);
        self.eye.reset();
        self.settings_changed();
        self.moved = true;
    }

    fn load(&mut self, name: String) {
        self.requests.push(Request::Load(name.clone()));
        self.message.clear();
        self.loading = Some(name);
    }

    /// The name of the scene that is shown, or will be.
    pub(crate) fn scene_name(&self) -> &str {
        let shown = self.shown.as_ref().map(|shown| shown.stage.scene.name.as_str());
        self.loading.as_deref().or(shown).unwrap_or("none")
    }

    /// Whether a scene was asked for that is not there yet.
    #[must_use]
    pub fn is_loading(&self) -> bool {
        self.loading.is_some()
    }

    /// What the user should know now.
    pub(crate) fn hint(&self) -> String {
        match &self.loading {
            Some(name) if self.message.is_empty() => format!("loading {name} ..."),
            None if self.message.is_empty() => "cost 1.00 x fresh: as good as new".to_owned(),
            _ => self.message.clone(),
        }
    }

    /// Asks for the next scene of the list; not while one is loading.
    pub(crate) fn next_scene(&mut self, back: bool) {
        let count = self.scenes.len();
        if self.loading.is_none() && count > 0 {
            let at = self.scenes.iter().position(|name| name == self.scene_name()).unwrap_or(count - 1);
            self.load(self.scenes[(at + if back { count - 1 } else { 1 }) % count].clone());
        }
    }

    /// Starts the picture again, with a tree for each strategy that is set.
    pub(crate) fn settings_changed(&mut self) {
        let wanted: Vec<Strategy> = std::iter::once(self.settings.left).chain(self.settings.right).collect();
        let Some(shown) = &mut self.shown else { return };
        shown.sides.truncate(wanted.len());
        for (i, strategy) in wanted.into_iter().enumerate() {
            match shown.sides.get_mut(i) {
                Some(side) => side.strategy = strategy,
                None => {
                    // Where the animation stands, a tree of another frame has to be brought to it.
                    let mut side = Side::new(&shown.stage, strategy);
                    side.update(&shown.stage, shown.frame, self.settings.period, false, self.clock);
                    shown.sides.push(side);
                }
            }
        }
        shown.sides.iter_mut().for_each(|side| side.count = 0);
        self.stale = true;
    }

    /// Gives all trees back the structure of the first, at the first frame.
    pub(crate) fn restart_trees(&mut self) {
        if let Some(shown) = &mut self.shown {
            shown.sides.clear();
        }
        self.go_to(0);
        self.settings_changed();
    }

    /// Moves the animation to a frame and updates the trees once.
    fn go_to(&mut self, frame: usize) {
        let start = (self.clock)();
        let Some(shown) = &mut self.shown else { return };
        let frames = shown.frames();
        shown.frame = frame.min(frames - 1);
        shown.stage.pose(shown.stage.time_of(shown.frame, frames));
        shown.is_smooth = false;
        for side in &mut shown.sides {
            side.update(&shown.stage, shown.frame, self.settings.period, self.settings.flash, self.clock);
        }
        self.step_ms = 1e3 * ((self.clock)() - start);
        self.moved = true;
    }

    fn key(&mut self, key: Key, down: bool) {
        if let Key::Char(letter) = key
            && "wasdqe".contains(letter.to_ascii_lowercase())
        {
            let letter = letter.to_ascii_lowercase();
            self.held.retain(|&held| held != letter);
            self.held.extend(down.then_some(letter));
        } else if down {
            let frame = self.frame().map_or(0, |(frame, _)| frame);
            match key {
                Key::Char(letter) => {
                    let found = CONTROLS.iter().find(|(key, ..)| *key == letter.to_ascii_lowercase());
                    found.into_iter().for_each(|&(.., control)| self.step(control, letter.is_uppercase()));
                }
                Key::Right => self.stop_at(frame + 1),
                Key::Left => self.stop_at(frame.saturating_sub(1)),
                Key::Home => self.restart_trees(),
                Key::Escape => self.requests.push(Request::Quit),
            }
        }
    }

    fn stop_at(&mut self, frame: usize) {
        self.playing = false;
        self.go_to(frame);
    }

    fn tick(&mut self, seconds: f64) {
        let by = (seconds * FLIGHT) as f32;
        for letter in self.held.clone() {
            let direction = match letter {
                'w' => [0.0, 0.0, by],
                's' => [0.0, 0.0, -by],
                'a' => [-by, 0.0, 0.0],
                'd' => [by, 0.0, 0.0],
                'q' => [0.0, -by, 0.0],
                _ => [0.0, by, 0.0],
            };
            self.move_eye(|eye, view| eye.fly(view, direction));
        }
        let Some((frame, frames)) = self.frame().filter(|_| self.plays()) else { return };
        // Every frame is shown: where drawing takes long, the animation runs slower.
        self.due = (self.due + seconds * FRAME_RATE * self.settings.speed).min(2.0);
        if self.due >= 1.0 {
            self.due -= 1.0;
            self.go_to((frame + 1) % frames);
        }
    }

    fn move_eye(&mut self, change: impl FnOnce(&mut Eye, anim::View)) {
        if let Some(shown) = &mut self.shown {
            change(&mut self.eye, shown.stage.view());
            shown.sides.iter_mut().for_each(|side| side.count = 0);
            (self.moved, self.stale) = (true, true);
        }
    }

    fn pointer_to(&mut self, to: (f32, f32)) {
        let (dx, dy) = (to.0 - self.pointer.0, to.1 - self.pointer.1);
        self.pointer = to;
        match self.drag {
            Drag::Eye(button, far) => {
                let far = far + dx.abs() + dy.abs();
                self.drag = Drag::Eye(button, far);
                if far > CLICK {
                    self.move_eye(|eye, view| match button {
                        Button::Left => eye.orbit(view, dx * TURN, dy * TURN),
                        Button::Right => eye.look(view, dx * TURN, dy * TURN),
                    });
                }
            }
            Drag::Timeline => self.scrub(),
            Drag::Slider(control) => self.slide_to_pointer(control),
            Drag::Nothing => {}
        }
    }

    fn press(&mut self, button: Button) {
        let at = self.pointer;
        let track = |row| Self::track(row).contains(at) && button == Button::Left;
        if let Some((_, control)) =
            self.control_at(at).filter(|&(row, control)| track(row) && self.slider(control).is_some())
        {
            self.drag = Drag::Slider(control);
            self.slide_to_pointer(control);
        } else if let Some((_, control)) = self.control_at(at) {
            self.step(control, button == Button::Right);
        } else if self.timeline().contains(at) {
            self.drag = Drag::Timeline;
            self.scrub();
        } else {
            self.drag = Drag::Eye(button, 0.0);
        }
    }

    fn release(&mut self) {
        if let Drag::Eye(Button::Left, far) = self.drag
            && far <= CLICK
        {
            self.pick();
        }
        self.drag = Drag::Nothing;
    }

    /// Moves a slider to where the pointer is.
    fn slide_to_pointer(&mut self, control: Control) {
        let (track, count) = (Self::track(Self::row(0)), self.slider(control).map_or(1, |(_, count)| count));
        let part = (self.pointer.0 - track.x as f32) / track.width as f32;
        self.slide(control, (part.clamp(0.0, 1.0) * count as f32) as usize);
    }

    /// Goes to the frame at the pointer.
    fn scrub(&mut self) {
        let (line, frames) = (self.timeline(), self.frame().map_or(1, |(_, frames)| frames));
        let part = (self.pointer.0 - line.x as f32) / line.width.max(1) as f32;
        let frame = (part.clamp(0.0, 1.0) * (frames - 1) as f32).round() as usize;
        if self.frame().is_some_and(|(now, _)| now != frame) || self.playing {
            self.stop_at(frame);
        }
    }

    /// Picks the triangle at the pointer, or none where there is none.
    fn pick(&mut self) {
        let found = self.ports().into_iter().zip(0..).find(|(port, _)| port.contains(self.pointer));
        let (Some((port, i)), Some(shown)) = (found, &self.shown) else { return };
        let camera = self.camera(shown, port, 1);
        let ray =
            camera.ray((self.pointer.0 - port.x as f32) as u32, (self.pointer.1 - port.y as f32) as u32);
        let hit = shown.sides.get(i).and_then(|side: &Side| {
            closest_hit(&side.tree, &shown.stage.triangles(), &ray, f32::INFINITY, self.settings.test)
        });
        self.picked = hit.map(|hit| hit.primitive);
    }

    /// The parts of the canvas that show a tree each.
    pub(crate) fn ports(&self) -> Vec<Rect> {
        let (width, height) = (self.picture.width as i32, self.picture.height as i32);
        let all = Rect { x: 0, y: 0, width, height };
        match self.settings.right {
            Some(_) => vec![
                Rect { width: (width / 2).max(1), ..all },
                Rect { x: width / 2, width: width - width / 2, ..all },
            ],
            None => vec![all],
        }
    }

    pub(crate) fn camera(&self, shown: &Shown, port: Rect, coarse: u32) -> Camera {
        let anim::View { eye, target, up, fov_y } = self.eye.view(shown.stage.view());
        let size = |pixels: i32| (pixels as u32).div_ceil(coarse).max(1);
        Camera::look_at(eye, target, up, fov_y, size(port.width), size(port.height))
    }

    pub(crate) fn light_effects(&self) -> LightEffects {
        let scenes = self.shown.as_ref().map_or(LightEffects::NONE, |shown| shown.stage.scene.effects.light);
        self.settings.light.unwrap_or(scenes)
    }

    /// Samples of a pixel that the picture is to have once it stands still.
    pub(crate) fn samples(&self) -> u32 {
        if self.settings.heat {
            1
        } else {
            self.settings.samples.unwrap_or(default_samples(&self.light_effects()))
        }
    }

    pub(crate) fn samples_done(&self) -> u32 {
        let sides = self.shown.iter().flat_map(|shown| &shown.sides);
        sides.map(|side| side.count).min().unwrap_or(0)
    }

    /// What the stages of the last picture took, all trees and threads together.
    pub(crate) fn stage_times(&self) -> StageTimes {
        let mut times = StageTimes::default();
        self.shown.iter().flat_map(|shown| &shown.sides).for_each(|side| times += side.stats.times);
        times
    }

    /// Draws the viewer as it is now. While something moves, the picture of each tree is as coarse as it has to be to keep
    /// its pace, with as much time for either. Once nothing does, each call adds a sample, until the picture is that of `xtask render`, pixel for pixel.
    pub fn draw(&mut self) -> &Canvas {
        let start = (self.clock)();
        let (light, samples, plays) = (self.light_effects(), self.samples(), self.plays());
        let mut shown = self.shown.take();
        let did_trace = shown.as_mut().is_some_and(|shown| self.trace(shown, &light, samples, plays));
        self.shown = shown;
        self.canvas.clone_from(&self.picture);
        self.draw_overlay();
        self.stale = false;
        let traced: f64 = self.shown.iter().flat_map(|shown| &shown.sides).map(|side| side.trace_ms).sum();
        if did_trace {
            self.other_ms = (self.step_ms + 1e3 * ((self.clock)() - start) - traced).max(0.0);
        }
        &self.canvas
    }

    /// Hands the canvas to the overlay.
    pub(crate) fn on_canvas(&mut self, draw: impl FnOnce(&Self, &mut Canvas)) {
        let mut canvas = std::mem::take(&mut self.canvas);
        draw(self, &mut canvas);
        self.canvas = canvas;
    }

    /// Traces a picture or another sample of it, if there is need, and returns whether there was.
    fn trace(&mut self, shown: &mut Shown, light: &LightEffects, samples: u32, plays: bool) -> bool {
        let moves = std::mem::take(&mut self.moved);
        let done = shown.sides.iter().map(|side| side.count).min().unwrap_or(0);
        // Between two frames of the animation the picture stays, and once nothing moves it becomes finer.
        let waits = plays && done > 0 || shown.sides.iter().all(|side| side.is_done(samples));
        if !moves && waits {
            return false;
        }
        let smooth = !self.settings.heat;
        if smooth && !shown.is_smooth {
            shown.stage.smooth();
            shown.is_smooth = true;
        }
        let output =
            if self.settings.heat { Output::NodesVisited { most: shown.hottest } } else { Output::Shaded };
        let options = RenderOptions {
            triangle_test: self.settings.test,
            output,
            timed: !cfg!(target_family = "wasm"),
            ..shown.stage.options_with(light)
        };
        for (i, port) in self.ports().into_iter().enumerate() {
            // One tree may be done before the other.
            let Some(side) = shown.sides.get_mut(i).filter(|side| moves || !side.is_done(samples)) else {
                continue;
            };
            side.choose_coarse(moves, plays);
            let coarse = side.coarse_now;
            let camera = self.camera(shown, port, coarse);
            let Some(side) = shown.sides.get_mut(i) else { continue };
            side.trace(&shown.stage, shown.frame, &camera, &options, self.clock);
            if samples > 1 && coarse == 1 {
                side.estimate_noise();
            }
            self.copy(side, port, coarse);
        }
        let is_fine = shown.sides.first().is_some_and(|side| side.coarse_now == 1);
        if moves {
            self.probe = None;
        } else if smooth && is_fine && self.probe.is_none_or(|probe| probe.test != self.settings.test) {
            self.probe = self.compare_tests(shown, &options);
        }
        if moves {
            let budget = (PICTURE_BUDGET - self.other_ms).max(TRACE_BUDGET) / shown.sides.len().max(1) as f64;
            shown.sides.iter_mut().for_each(|side| side.adapt(budget));
        }
        true
    }

    /// Traces a small picture with the triangle test that is set, and with that in double precision.
    fn compare_tests(&self, shown: &Shown, options: &RenderOptions) -> Option<Probe> {
        let (port, side) = (self.ports()[0], shown.sides.first()?);
        let camera = self.camera(shown, port, (port.width as u32).div_ceil(PROBE).max(1));
        let (mesh, light) = (shown.stage.mesh(), shown.stage.light());
        let (width, height) = (camera.width(), camera.height());
        let traced = |triangle_test| {
            let options = RenderOptions { triangle_test, timed: false, ..*options };
            let mut image = Image::new(width, height);
            let start = (self.clock)();
            let stats = render(&side.tree, &mesh, &camera, Some(&light), &options, &mut image);
            (1e9 * ((self.clock)() - start) / stats.rays().max(1) as f64, image)
        };
        let ((ns, ours), (exact_ns, exact)) = (traced(options.triangle_test), traced(TriangleTest::Double));
        let seen = |pixel: &[f32; 3]| pixel.map(|c| self.table.encode(c));
        let differ = ours.pixels().iter().zip(exact.pixels()).filter(|(a, b)| seen(a) != seen(b)).count();
        Some(Probe { test: options.triangle_test, ns, exact_ns, differ, pixels: ours.pixels().len() })
    }

    /// Copies a traced picture to its part of the whole, in sRGB.
    fn copy(&mut self, side: &Side, port: Rect, coarse: u32) {
        let (width, factor) = (self.picture.width as usize, 1.0 / side.count.max(1) as f32);
        let (coarse, source) = (coarse as usize, side.sum.width().max(1) as usize);
        let encode = |&[r, g, b]: &[f32; 3]| [r, g, b].map(|c| self.table.encode(c * factor));
        let rows = self.picture.rgba.par_chunks_mut(4 * width).enumerate();
        rows.skip(port.y as usize).take(port.height as usize).for_each(|(y, row)| {
            let row = &mut row[4 * port.x as usize..][..4 * port.width as usize];
            let from = &side.sum.pixels()[y / coarse * source..][..source];
            for (to, pixel) in row.chunks_mut(4 * coarse).zip(from) {
                let [r, g, b] = encode(pixel);
                to.chunks_exact_mut(4).for_each(|to| to.copy_from_slice(&[r, g, b, 255]));
            }
        });
    }

    /// The row of the panel that is at a pixel, with its control.
    fn control_at(&self, at: (f32, f32)) -> Option<(Rect, Control)> {
        let rows = CONTROLS.iter().enumerate().filter(|_| self.settings.overlay == 2);
        rows.map(|(i, &(.., control))| (Self::row(i), control)).find(|(row, _)| row.contains(at))
    }
}
