//! Playback of vertex positions blended linearly between evenly spaced key frames.

use anim::{Animation, Topology};
use glam::Vec3;
use rayon::prelude::*;

use crate::rigid::key_at;

/// Key frames of a mesh that moves as a whole.
pub(crate) struct KeyFrames {
    pub(crate) topology: Topology,
    /// Coordinates, three per vertex, key frame after key frame; at least one key frame.
    pub(crate) keys: Vec<f32>,
    pub(crate) seconds: f64,
}

impl Animation for KeyFrames {
    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn duration(&self) -> f64 {
        self.seconds
    }

    fn rest(&self) -> Vec<Vec3> {
        bytemuck::cast_slice(&self.keys[..3 * self.topology.vertex_count]).to_vec()
    }

    fn pose(&self, time: f64, positions: &mut [Vec3]) {
        let count = self.topology.vertex_count;
        assert_eq!(positions.len(), count, "one position per vertex");
        let keys: &[Vec3] = bytemuck::cast_slice(&self.keys);
        let (frame, s) = key_at(time / self.seconds, keys.len() / count);
        let from = &keys[frame * count..][..count];
        let to = &keys[((frame + 1) * count).min(keys.len() - count)..][..count];
        (positions, from, to)
            .into_par_iter()
            .with_min_len(8192)
            .for_each(|(p, from, &to)| *p = from.lerp(to, s));
    }
}
