//! Positions that know their time, and what it took to move them there.

use std::time::{Duration, Instant};

use glam::Vec3;

use crate::{Animation, Motion};

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

/// The vertices of an animation at a time.
#[derive(Clone, Debug)]
pub struct Pose {
    positions: Vec<Vec3>,
    time: f64,
    kinds: Motion,
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

impl Pose {
    /// Makes the animation at time 0, to be moved by these kinds of motion only.
    #[must_use]
    pub fn new(kinds: Motion, animation: &dyn Animation) -> Self {
        Self { positions: animation.rest(), time: 0.0, kinds }
    }

    /// Returns all vertices as they are now.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Returns the time that the positions are at, in seconds.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Moves the animation this is a pose of to `time` (seconds; clamped to 0 ..= duration, NaN is
    /// 0).
    ///
    /// Nothing is done at the time it is at already: all work is zero then, as it is where nothing
    /// moves.
    ///
    /// # Panics
    /// If it is the pose of an animation with another number of vertices.
    pub fn advance(&mut self, animation: &dyn Animation, time: f64) -> PoseStats {
        let vertices = animation.topology().vertex_count;
        assert_eq!(self.positions.len(), vertices, "positions are those of another animation");
        let time = animation.model().clamp(time);
        if time == self.time {
            return PoseStats::default();
        }
        self.time = time;
        animation.pose_by(self.kinds, time, &mut self.positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LoadOptions, parse};
    use std::path::Path;

    #[test]
    fn a_mesh_that_stands_still_is_never_posed() {
        let bytes = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let mesh = parse(Path::new("a.obj"), bytes, &LoadOptions::default()).unwrap();
        let mut pose = Pose::new(Motion::all(), &*mesh);
        for time in [0.0, 1.0, f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(pose.advance(&*mesh, time), PoseStats::default());
            assert_eq!((pose.time(), pose.positions().len()), (0.0, 3));
        }
    }
}
