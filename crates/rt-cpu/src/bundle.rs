//! The rays of a tile from one origin, and what they hit.

use bvh_core::{Ray, Vec3};

use crate::Hit;

/// Rays of a tile.
pub(crate) const RAYS: usize = 4096;

/// Rays that share their origin.
#[repr(C, align(64))]
pub(crate) struct Bundle {
    pub(crate) direction: [[f32; RAYS]; 3],
    pub(crate) origin: Vec3,
    pub(crate) count: usize,
    pub(crate) t_max: f32,
}

/// The hits of a bundle; without one, the number of the primitive is [`Hits::NONE`].
#[repr(C, align(64))]
pub(crate) struct Hits {
    pub(crate) t: [f32; RAYS],
    pub(crate) u: [f32; RAYS],
    pub(crate) v: [f32; RAYS],
    pub(crate) primitive: [u32; RAYS],
}

impl Bundle {
    pub(crate) fn new() -> Self {
        Self { direction: [[0.0; RAYS]; 3], origin: Vec3::ZERO, count: 0, t_max: 0.0 }
    }

    /// Makes it an empty bundle of rays from `origin`.
    pub(crate) fn start(&mut self, origin: Vec3, t_max: f32) {
        (self.origin, self.t_max, self.count) = (origin, t_max, 0);
    }

    /// Adds a ray. The bundle must not be full.
    #[inline(always)]
    pub(crate) fn push(&mut self, direction: Vec3) {
        for (to, from) in self.direction.iter_mut().zip(direction.to_array()) {
            to[self.count] = from;
        }
        self.count += 1;
    }

    pub(crate) fn ray(&self, i: usize) -> Ray {
        Ray::new(self.origin, Vec3::new(self.direction[0][i], self.direction[1][i], self.direction[2][i]))
    }
}

impl Hits {
    pub(crate) const NONE: u32 = u32::MAX;

    pub(crate) fn new() -> Self {
        Self { t: [0.0; RAYS], u: [0.0; RAYS], v: [0.0; RAYS], primitive: [Self::NONE; RAYS] }
    }

    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> Option<Hit> {
        let primitive = self.primitive[i];
        (primitive != Self::NONE).then(|| Hit { t: self.t[i], u: self.u[i], v: self.v[i], primitive })
    }

    pub(crate) fn set(&mut self, i: usize, hit: Option<Hit>) {
        self.primitive[i] = hit.map_or(Self::NONE, |h| h.primitive);
        if let Some(h) = hit {
            (self.t[i], self.u[i], self.v[i]) = (h.t, h.u, h.v);
        }
    }

    /// Mask of the rays that hit something among `n` from `at` on.
    #[inline(always)]
    pub(crate) fn lanes(&self, at: usize, n: usize) -> u64 {
        let hit = |m, (i, &p): (usize, &u32)| m | u64::from(p != Self::NONE) << i;
        self.primitive[at..at + n].iter().enumerate().fold(0, hit)
    }
}
