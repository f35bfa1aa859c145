//! Positions that know their time.

use glam::Vec3;

use crate::{Animation, Motion, PoseStats};

/// The vertices of an animation at a time.
#[derive(Clone, Debug)]
pub struct Pose {
    positions: Vec<Vec3>,
    time: f64,
    kinds: Motion,
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
