//! What it took to move an animation.

use std::time::{Duration, Instant};

/// Work of one stage of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// How often the stage did what it does.
    pub count: u64,
    /// Time that took; zero where `count` is.
    pub time: Duration,
}

/// What moving an animation to a time took, by the kind of motion: zero for each that is not called
/// for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseStats {
    /// Vertices blended between key frames.
    pub key_frames: Work,
    /// Displacements added: a vertex counts once for each morph target with a weight that moves it.
    pub morph: Work,
    /// Vertices skinned.
    pub skin: Work,
    /// Vertices moved with a whole part.
    pub rigid: Work,
}

impl Work {
    /// Does `work`, which gives how often it did it, and adds that and its time. In a browser,
    /// where the standard library has no clock, the time stays zero.
    pub fn add(&mut self, work: impl FnOnce() -> usize) {
        let start = (!cfg!(all(target_family = "wasm", target_os = "unknown"))).then(Instant::now);
        let count = work();
        if count > 0 {
            self.count += count as u64;
            self.time += start.map_or(Duration::ZERO, |start| start.elapsed());
        }
    }

    /// Does `work`, and adds it if it `counts`: beside what is called for there is what stays the
    /// same but has to be done again, as under a still node.
    pub(crate) fn add_if(&mut self, counts: bool, work: impl FnOnce() -> usize) {
        self.add(|| work() * usize::from(counts));
    }
}
