//! `--timing`: keys that are pressed by the clock while the eye turns, and how long pictures took.

use viewer_core::{Button, Event, Key, State};

use crate::CLOCK;

/// Keys that are pressed after parts of the time: the strategy on the left twice, and the scene.
const SCRIPT: [(f64, char); 3] = [(0.3, '1'), (0.45, '1'), (0.6, 'n')];
/// Waits that are printed, the longest.
const PRINTED: usize = 5;
/// Where the mouse is held, as parts of the picture, and pixels that it goes to either side in 60
/// pictures.
const HELD: [f32; 2] = [0.7, 0.5];
const SWAY: f32 = 12.0;

/// A wait in seconds, and what was done in it.
type Wait = (f64, String);

/// A timed run.
pub(crate) struct Timing {
    seconds: f64,
    /// The size of the picture in pixels.
    size: (u32, u32),
    /// When the first picture of a scene was there, by [`CLOCK`].
    first: Option<f64>,
    /// Keys of the script that were pressed.
    pressed: usize,
    /// What the last picture was, of which frame, and seconds since that frame came.
    before: (String, usize, f64),
    /// From the start of each picture to that of the next, and from the first picture of a frame to
    /// that of the next.
    pictures: Vec<Wait>,
    frames: Vec<Wait>,
}

impl Timing {
    pub(crate) fn new(seconds: f64, size: (u32, u32)) -> Self {
        let before = (String::new(), usize::MAX, 0.0);
        Self { seconds, size, first: None, pressed: 0, before, pictures: Vec::new(), frames: Vec::new() }
    }

    /// Notes that a picture was shown, `wait` seconds after the one before, presses what is due,
    /// and ends.
    pub(crate) fn shown(&mut self, state: &mut State, wait: f64) {
        let Some((frame, _)) = state.frame() else { return };
        let [step, trace, rest] = state.picture_ms();
        let left = state.settings().left.name();
        let what = format!("{left}, frame {frame}: step {step:.0}, trace {trace:.0}, rest {rest:.0} ms");
        let (before, frame_before, since) = std::mem::replace(&mut self.before, (what, frame, 0.0));
        let [x, y] = [HELD[0] * self.size.0 as f32, HELD[1] * self.size.1 as f32];
        let Some(first) = self.first else {
            self.first = Some(CLOCK());
            state.apply(Event::Pointer(x, y));
            state.apply(Event::Button(Button::Left, true));
            return;
        };
        if frame == frame_before {
            self.before.2 = since + wait;
        } else {
            self.frames.push((since + wait, self.before.0.clone()));
        }
        self.pictures.push((wait, before));
        let turn = self.pictures.len() as f32 / 60.0 * std::f32::consts::TAU;
        state.apply(Event::Pointer(x + SWAY * turn.sin(), y));
        let part = (CLOCK() - first) / self.seconds;
        while let Some((_, key)) = SCRIPT.get(self.pressed).filter(|(at, _)| part >= *at) {
            state.apply(Event::Key(Key::Char(*key), true));
            state.apply(Event::Key(Key::Char(*key), false));
            self.pressed += 1;
        }
        if part >= 1.0 {
            state.apply(Event::Key(Key::Escape, true));
        }
    }

    pub(crate) fn print(self) {
        let Some(first) = self.first else { return println!("no picture") };
        println!("first picture after {first:.2} s");
        for (name, mut waits) in [("pictures", self.pictures), ("frames of the animation", self.frames)] {
            let sum = waits.iter().map(|wait| wait.0).sum::<f64>();
            waits.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (count, median) = (waits.len(), waits.get(waits.len() / 2).map_or(0.0, |wait| wait.0));
            println!(
                "{count} {name}, {:.1} a second, half of them after at most {:.0} ms",
                count as f64 / sum,
                1e3 * median
            );
            for (wait, what) in waits.iter().take(PRINTED) {
                println!("  {:.0} ms, {what}", 1e3 * wait);
            }
        }
    }
}
