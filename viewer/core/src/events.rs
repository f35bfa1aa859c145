//! Events: what happens to a viewer, and what keys and the mouse change.

use bvh_core::closest_hit;

use crate::Ready;
use crate::canvas::{Canvas, Rect};
use crate::controls::{CONTROLS, Control, Settings};
use crate::eye::Eye;
use crate::side::Side;
use crate::state::{FRAME_RATE, State};
use crate::step::Step;

/// What the mouse does: radians for a pixel, factor of the distance for a notch of the wheel, and
/// pixels that a click may stray. Flying: distances to the target in a second.
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
    /// A step was made that was taken by [`State::take_step`].
    Stepped(Box<Step>),
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
pub(crate) enum Drag {
    /// On the scene, after a number of pixels.
    Eye(Button, f32),
    Timeline,
    Slider(Control),
    Nothing,
}

impl State {
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
                self.moved = true;
                self.settings_changed();
            }
            Event::Tick(seconds) => self.tick(seconds.clamp(0.0, 1.0)),
            Event::Scene(ready) => self.show(*ready),
            Event::Stepped(step) => self.stepped(*step),
            Event::Fresh(frame, cost) => {
                self.shown.iter_mut().for_each(|shown| shown.add_fresh(frame, cost));
            }
            Event::Message(message) => self.message = message,
            Event::Failed(message) => (self.message, self.loading) = (message, None),
            Event::Settings(settings) => {
                self.settings = settings;
                self.settings_changed();
            }
        }
    }

    fn key(&mut self, key: Key, down: bool) {
        if let Key::Char(letter) = key
            && "wasdqe".contains(letter.to_ascii_lowercase())
        {
            let letter = letter.to_ascii_lowercase();
            self.held.retain(|&held| held != letter);
            self.held.extend(down.then_some(letter));
        } else if down {
            let frame = self.shown.as_ref().map_or(0, |shown| shown.target);
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
        let Some((_, frames)) = self.frame().filter(|_| self.plays()) else { return };
        // Every frame is shown: where drawing takes long, the animation runs slower.
        self.due = (self.due + seconds * FRAME_RATE * self.settings.speed).min(2.0);
        if let Some(shown) = self.shown.as_ref().filter(|shown| self.due >= 1.0 && !shown.is_behind()) {
            let next = (shown.target + 1) % frames;
            self.due -= 1.0;
            self.go_to(next);
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
        if self.shown.as_ref().is_some_and(|shown| shown.target != frame) || self.playing {
            self.stop_at(frame);
        }
    }

    /// Picks the triangle at the pointer, or none where there is none.
    fn pick(&mut self) {
        let found = self.ports().into_iter().zip(0..).find(|(port, _)| port.contains(self.pointer));
        let (Some((port, i)), Some(shown)) = (found, &self.shown) else { return };
        let camera = self.camera(&shown.stage, port, 1);
        let ray =
            camera.ray((self.pointer.0 - port.x as f32) as u32, (self.pointer.1 - port.y as f32) as u32);
        let hit = shown.sides.get(i).filter(|side| side.frame == shown.frame).and_then(|side: &Side| {
            closest_hit(&side.tree, &shown.stage.triangles(), &ray, f32::INFINITY, self.settings.test)
        });
        self.picked = hit.map(|hit| hit.primitive);
    }

    /// The row of the panel that is at a pixel, with its control.
    fn control_at(&self, at: (f32, f32)) -> Option<(Rect, Control)> {
        let rows = CONTROLS.iter().enumerate().filter(|_| self.settings.overlay == 2);
        rows.map(|(i, &(.., control))| (Self::row(i), control)).find(|(row, _)| row.contains(at))
    }
}
