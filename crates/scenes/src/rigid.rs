//! Playback of rigid bodies: triangles fixed to bodies, bodies placed by key frames.
//!
//! Key frames hold one transform per body instead of one position per vertex, which is far smaller
//! and keeps every body's shape at all times, between key frames too.

use std::iter::repeat_n;

use anim::{Animation, Model, Motion, PoseStats};
use glam::{DQuat, Mat3, Quat, Vec3};
use rayon::prelude::*;

use crate::shape::Assembly;

/// Where a body is. `glam` computes with quaternions of `f64` in the same way on every machine, and
/// with those of `f32` by whatever SIMD there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub(crate) position: Vec3,
    pub(crate) rotation: DQuat,
}

impl Placement {
    /// As it is recorded.
    pub(crate) fn key(&self) -> Key {
        (self.position.to_array(), self.rotation.as_quat().to_array())
    }

    /// A direction of the body, in the world.
    pub(crate) fn turned(&self, direction: Vec3) -> Vec3 {
        rotated(self.rotation, direction)
    }

    /// A direction in the world, of the body.
    pub(crate) fn turned_back(&self, direction: Vec3) -> Vec3 {
        rotated(self.rotation.conjugate(), direction)
    }
}

/// A vector after a rotation.
pub(crate) fn rotated(rotation: DQuat, vector: Vec3) -> Vec3 {
    (rotation * vector.as_dvec3()).as_vec3()
}

/// The rotation about a unit axis by an angle in radians.
///
/// Unlike the standard library's, its sines are the same on every machine.
pub(crate) fn rotation(axis: Vec3, angle: impl Into<f64>) -> DQuat {
    let (sin, cos) = libm::sincos(0.5 * angle.into());
    DQuat::from_vec4((axis.as_dvec3() * sin).extend(cos))
}

/// A [`Placement`] as it is recorded: position and rotation.
pub(crate) type Key = ([f32; 3], [f32; 4]);

/// Vertices numbered per body, bodies placed per key frame.
pub(crate) struct RigidBodies {
    model: Model,
    /// Positions relative to the body's placement; of still vertices, in the world.
    local: Vec<Vec3>,
    /// Normal of each vertex, relative to its body's placement.
    pub(crate) normals: Vec<Vec3>,
    /// Body of each vertex that moves; the still vertices come after them.
    body: Vec<u32>,
    /// Key frames, at least two, each with a key for each body.
    keys: Vec<Vec<Key>>,
}

impl RigidBodies {
    /// The moving parts of `assembly`, which come before the still ones, a body each.
    pub(crate) fn new(assembly: Assembly, normals: Vec<Vec3>, keys: Vec<Vec<Key>>, seconds: f64) -> Self {
        let Assembly { topology, positions: local } = assembly;
        let moving = topology.parts.iter().filter(|part| part.motion.contains(Motion::RIGID));
        let body = (0..).zip(moving).flat_map(|(i, part)| repeat_n(i, part.vertices.len())).collect();
        let mut rest = local.clone();
        let model = Model { topology, duration: seconds, ..Model::default() };
        let mut animation = Self { model, local, normals, body, keys };
        animation.place(0.0, &mut rest);
        animation.model.rest = rest;
        animation
    }

    /// Position and rotation of each body: straight between positions of key frames, along the
    /// shorter arc between rotations.
    fn placements(&self, time: f64) -> Vec<(Vec3, Mat3)> {
        let last = self.keys.len() - 1;
        let at = self.model.clamp(time) / self.model.duration * last as f64;
        let frame = (at as usize).min(last - 1);
        let s = (at - frame as f64) as f32;
        let blend = |(&(from, from_turn), &(to, to_turn)): (&Key, &Key)| {
            let [a, b] = [from_turn, to_turn].map(|turn| Quat::from_array(turn).as_dquat());
            (Vec3::from(from).lerp(to.into(), s), Mat3::from_quat(a.lerp(b, s.into()).as_quat()))
        };
        self.keys[frame].iter().zip(&self.keys[frame + 1]).map(blend).collect()
    }

    /// Writes the vertices of all bodies and gives their number.
    fn place(&self, time: f64, positions: &mut [Vec3]) -> usize {
        let placed = self.placements(time);
        let moving = self.body.len();
        let vertices = (&mut positions[..moving], &self.local[..moving], &self.body).into_par_iter();
        vertices.with_min_len(8192).for_each(|(p, &local, &body)| {
            let (position, matrix) = placed[body as usize];
            *p = position + matrix * local;
        });
        moving
    }
}

impl Animation for RigidBodies {
    fn model(&self) -> &Model {
        &self.model
    }

    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        assert_eq!(positions.len(), self.model.topology.vertex_count, "one position per vertex");
        let mut stats = PoseStats::default();
        if kinds.contains(Motion::RIGID) {
            stats.rigid.add(|| self.place(time, positions));
        }
        stats
    }

    fn normals(&self, time: f64, normals: &mut [Vec3]) {
        normals.copy_from_slice(&self.normals);
        let placed = self.placements(time);
        for (normal, &body) in normals.iter_mut().zip(&self.body) {
            let (_, rotation) = placed[body as usize];
            *normal = rotation * *normal;
        }
    }
}
