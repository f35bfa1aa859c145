//! How long the frames of all scenes will take yet.

use std::time::Instant;

use crate::progress::{Progress, about};

/// The run's work, in triangles times frames times strategies, or thereabouts.
pub(super) struct Pace {
    total: f64,
    done: f64,
    /// Work of a step at present.
    step: f64,
    /// When measuring began, and time spent in between on what is not measured: making scenes.
    working: f64,
    since: Option<Instant>,
    steps_done: u64,
    progress: Option<Progress>,
}

/// Triangles that take as long as what every frame takes.
const FIXED: f64 = 60_000.0;

/// The work of a step.
pub(super) fn work(triangles: usize, strategies: usize) -> f64 {
    (FIXED + triangles as f64) * strategies as f64
}

impl Pace {
    /// For so much work in all.
    pub(super) fn new(total: f64) -> Self {
        Self { total, done: 0.0, step: 0.0, working: 0.0, since: None, steps_done: 0, progress: None }
    }

    /// Starts on `steps` steps of `step` work each.
    pub(super) fn begin(&mut self, what: String, steps: usize, step: f64) {
        self.pause();
        (self.step, self.steps_done) = (step, 0);
        self.since = Some(Instant::now());
        self.progress = Some(Progress::new(what, steps as u64));
    }

    /// Work elsewhere begins, which does not count.
    pub(super) fn pause(&mut self) {
        self.progress = None;
        self.working += self.since.take().map_or(0.0, |since| since.elapsed().as_secs_f64());
    }

    /// A step is done; it was work only if it was `measured`.
    pub(super) fn step(&mut self, measured: bool) {
        self.steps_done += 1;
        if measured {
            self.done += self.step;
        } else {
            self.total -= self.step;
        }
        if let Some(progress) = &self.progress {
            progress.at_with(self.steps_done, || self.left());
        }
    }

    /// Work that is not to be done after all.
    pub(super) fn skip(&mut self, work: f64) {
        self.total -= work;
    }

    /// What is left of the whole run, in words; nothing as long as that is a guess.
    fn left(&self) -> String {
        let spent = self.working + self.since.map_or(0.0, |since| since.elapsed().as_secs_f64());
        let left = spent / self.done * (self.total - self.done).max(0.0);
        match std::time::Duration::try_from_secs_f64(left) {
            Ok(left) if self.steps_done > 1 => format!("; {} left for all frames", about(left)),
            _ => String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replayed_and_skipped_work_takes_no_time() {
        let mut pace = Pace::new(40.0);
        pace.begin("a scene".to_owned(), 3, 10.0);
        assert_eq!(pace.left(), "");
        pace.step(false);
        pace.step(true);
        pace.skip(10.0);
        assert_eq!((pace.done, pace.total), (10.0, 20.0));
        pace.working = 3600.0;
        assert_eq!(pace.left(), "; 60 min left for all frames");
        pace.step(true);
        assert_eq!(pace.left(), "; 0 s left for all frames");
    }
}
