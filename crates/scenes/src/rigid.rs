//! Playback of rigid bodies: triangles fixed to bodies, bodies placed by key frames.
//!
//! Key frames hold one transform per body instead of one position per vertex, which is far smaller
//! and keeps every body's shape at all times, between key frames too.

use std::iter::repeat_n;

use anim::{Animation, Motion, PoseStats, Topology};
use glam::{Quat, Vec3};
use rayon::prelude::*;

use crate::shape::Assembly;

/// Where a body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub(crate) position: Vec3,
    pub(crate) rotation: Quat,
}

impl Placement {
    /// The place of a point of the body.
    pub(crate) fn of(&self, point: Vec3) -> Vec3 {
        self.position + self.rotation * point
    }

    /// Straight between positions, along the shorter arc between rotations.
    fn blend(self, to: Self, s: f32) -> Self {
        Self { position: self.position.lerp(to.position, s), rotation: self.rotation.lerp(to.rotation, s) }
    }
}

/// The rotation about a unit axis by an angle in radians.
///
/// Unlike the standard library's, its sines are the same on every machine.
pub(crate) fn rotation(axis: Vec3, angle: f32) -> Quat {
    let (sin, cos) = libm::sincosf(0.5 * angle);
    Quat::from_vec4((axis * sin).extend(cos))
}

/// Number of floats of a [`Placement`] in a record.
pub(crate) const WORDS: usize = 7;

/// Appends a placement to a recorded array.
pub(crate) fn record(out: &mut Vec<f32>, placement: &Placement) {
    out.extend(placement.position.to_array());
    out.extend(placement.rotation.to_array());
}

/// Vertices numbered per body, bodies placed per key frame.
pub(crate) struct RigidBodies {
    topology: Topology,
    /// Positions relative to the body's placement; of still vertices, in the world.
    local: Vec<Vec3>,
    /// Normal of each vertex, relative to its body's placement.
    pub(crate) normals: Vec<Vec3>,
    /// Body of each vertex that moves; the still vertices come after them.
    body: Vec<u32>,
    bodies: usize,
    /// Recorded placements, `bodies` for each key frame.
    pub(crate) keys: Vec<f32>,
    seconds: f64,
}

impl RigidBodies {
    /// The moving parts of `assembly`, which come before the still ones, a body each.
    pub(crate) fn new(assembly: Assembly, normals: Vec<Vec3>, keys: Vec<f32>, seconds: f64) -> Self {
        let Assembly { topology, positions: local } = assembly;
        let moving = topology.parts.iter().filter(|part| part.motion.rigid);
        let bodies = moving.clone().count();
        let body = (0..).zip(moving).flat_map(|(i, part)| repeat_n(i, part.vertices.len())).collect();
        Self { topology, local, normals, body, bodies, keys, seconds }
    }

    fn key_count(&self) -> usize {
        self.keys.len() / (WORDS * self.bodies)
    }

    fn key(&self, frame: usize, body: usize) -> Placement {
        let at = (frame * self.bodies + body) * WORDS;
        let k = &self.keys[at..at + WORDS];
        Placement { position: Vec3::from_slice(&k[..3]), rotation: Quat::from_slice(&k[3..]) }
    }

    /// Where each body is.
    fn placements(&self, time: f64) -> Vec<Placement> {
        let (frame, s) = key_at(time / self.seconds, self.key_count());
        let next = (frame + 1).min(self.key_count() - 1);
        (0..self.bodies).map(|b| self.key(frame, b).blend(self.key(next, b), s)).collect()
    }

    /// Writes the vertices of all bodies and gives their number.
    fn place(&self, time: f64, positions: &mut [Vec3]) -> usize {
        let placed = self.placements(time);
        let moving = self.body.len();
        (&mut positions[..moving], &self.local[..moving], &self.body)
            .into_par_iter()
            .with_min_len(8192)
            .for_each(|(p, &local, &body)| {
                *p = placed[body as usize].of(local);
            });
        moving
    }
}

impl Animation for RigidBodies {
    fn topology(&self) -> &Topology {
        &self.topology
    }

    fn duration(&self) -> f64 {
        self.seconds
    }

    fn rest(&self) -> Vec<Vec3> {
        let mut positions = self.local.clone();
        self.pose(0.0, &mut positions);
        positions
    }

    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        assert_eq!(positions.len(), self.topology.vertex_count, "one position per vertex");
        let mut stats = PoseStats::default();
        if kinds.rigid {
            stats.rigid.add(|| self.place(time, positions));
        }
        stats
    }

    fn normals(&self, time: f64, normals: &mut [Vec3]) {
        normals.copy_from_slice(&self.normals);
        let placed = self.placements(time);
        for (normal, &body) in normals.iter_mut().zip(&self.body) {
            *normal = placed[body as usize].rotation * *normal;
        }
    }
}

/// The key frame at or before a fraction of the loop, and the fraction of the way to the next.
///
/// Fractions outside of 0 to 1 are clamped, NaN is 0.
pub(crate) fn key_at(fraction: f64, keys: usize) -> (usize, f32) {
    let fraction = if fraction > 0.0 { fraction.min(1.0) } else { 0.0 };
    let at = fraction * (keys - 1) as f64;
    let frame = (at as usize).min(keys.saturating_sub(2));
    (frame, (at - frame as f64) as f32)
}
