//! The rays of a tile from one origin, and what they hit.

use bvh_core::{Ray, Vec3};
use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Hit;

/// Rays of a tile.
pub(crate) const RAYS: usize = 4096;

/// Rays of a packet: 8 x 8.
pub(crate) const PACKET: usize = 64;

/// Three coordinates for each ray or pixel of a tile, an array for each axis.
pub(crate) type Coordinates = [[f32; RAYS]; 3];

/// The coordinates at place `i`.
#[inline(always)]
pub(crate) fn at(a: &Coordinates, i: usize) -> Vec3 {
    Vec3::new(a[0][i], a[1][i], a[2][i])
}

/// Sets the coordinates at place `i`.
#[inline(always)]
pub(crate) fn set(a: &mut Coordinates, i: usize, v: Vec3) {
    for (axis, v) in a.iter_mut().zip(v.to_array()) {
        axis[i] = v;
    }
}

/// Rays from one origin, unless the paths have their own (`wavefront.rs`), and what became of them.
/// The primitive of a ray that hits nothing is [`Wave::NO_HIT`].
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct Wave {
    pub(crate) direction: Coordinates,
    pub(crate) t: [f32; RAYS],
    pub(crate) u: [f32; RAYS],
    pub(crate) v: [f32; RAYS],
    pub(crate) primitive: [u32; RAYS],
    /// Inner nodes that each ray visited; of rays that went one by one only.
    pub(crate) nodes: [u32; RAYS],
    pub(crate) origin: Vec3,
    pub(crate) t_max: f32,
    pub(crate) count: usize,
}

impl Wave {
    pub(crate) const NO_HIT: u32 = u32::MAX;

    /// Makes it a wave without rays, for those from `origin`.
    pub(crate) fn start(&mut self, origin: Vec3, t_max: f32) {
        (self.origin, self.t_max, self.count) = (origin, t_max, 0);
    }

    /// Vectors may reach beyond the last ray, where there is no hit.
    #[inline(always)]
    pub(crate) fn end(&mut self) {
        self.primitive[self.count..self.count.next_multiple_of(PACKET)].fill(Self::NO_HIT);
    }

    pub(crate) fn ray(&self, i: usize) -> Ray {
        Ray::new(self.origin, at(&self.direction, i))
    }

    #[inline(always)]
    pub(crate) fn hit(&self, i: usize) -> Option<Hit> {
        let primitive = self.primitive[i];
        (primitive != Self::NO_HIT).then(|| Hit { t: self.t[i], u: self.u[i], v: self.v[i], primitive })
    }

    pub(crate) fn set_hit(&mut self, i: usize, hit: Option<Hit>) {
        self.primitive[i] = hit.map_or(Self::NO_HIT, |h| h.primitive);
        if let Some(h) = hit {
            (self.t[i], self.u[i], self.v[i]) = (h.t, h.u, h.v);
        }
    }

    /// Mask of the rays that hit something, of a vector of them from `at` on; behind the last ray
    /// there is nothing ([`Wave::end`]).
    #[inline(always)]
    pub(crate) fn hit_lanes<S: Simd>(&self, simd: S, at: usize) -> u64 {
        let primitives = S::u32s::from_slice(simd, &self.primitive[at..at + S::u32s::LEN]);
        primitives.simd_ne(Self::NO_HIT).to_bitmask()
    }
}
