//! `--timing`: keys that are pressed by the clock, and how long pictures took.

use viewer_core::{Event, Key, State};

use crate::CLOCK;

/// Keys that are pressed after parts of the time: the strategy on the left twice, and the scene.
const SCRIPT: [(f64, char); 3] = [(0.3, '1'), (0.45, '1'), (0.6, 'n')];
/// Waits that are printed, the longest.
const PRINTED: usize = 5;

/// A timed run.
pub(crate) struct Timing {
    seconds: f64,
    /// When the first picture of a scene was there, by [`CLOCK`].
    first: Option<f64>,
    /// Keys of the script that were pressed.
    pressed: usize,
    /// What the last picture was.
    before: String,
    /// Seconds from the start of each picture to that of the next, and what was done in them.
    pictures: Vec<(f64, String)>,
}

impl Timing {
    pub(crate) fn new(seconds: f64) -> Self {
        Self { seconds, first: None, pressed: 0, before: String::new(), pictures: Vec::new() }
    }

    /// Notes that a picture was shown, `wait` seconds after the one before, presses what is due, and ends.
    pub(crate) fn shown(&mut self, state: &mut State, wait: f64) {
        let Some((frame, _)) = state.frame() else { return };
        let [step, trace, rest] = state.picture_ms();
        let left = state.settings().left.name();
        let what = format!("{left}, frame {frame}: step {step:.0}, trace {trace:.0}, rest {rest:.0} ms");
        let before = std::mem::replace(&mut self.before, what);
        let Some(first) = self.first else {
            self.first = Some(CLOCK());
            return;
        };
        self.pictures.push((wait, before));
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

    pub(crate) fn print(mut self) {
        let Some(first) = self.first else { return println!("no picture") };
        println!("first picture after {first:.2} s");
        let sum = self.pictures.iter().map(|picture| picture.0).sum::<f64>();
        self.pictures.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (count, median) = (self.pictures.len(), self.pictures.get(self.pictures.len() / 2));
        let (rate, wait) = (count as f64 / sum, 1e3 * median.map_or(0.0, |picture| picture.0));
        println!("{count} pictures, {rate:.1} a second, half of them after at most {wait:.0} ms");
        for (wait, what) in self.pictures.iter().take(PRINTED) {
            println!("{:.0} ms, {what}", 1e3 * wait);
        }
    }
}
