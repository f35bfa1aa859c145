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

/// Rays that share their origin.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct Bundle {
    pub(crate) direction: Coordinates,
    pub(crate) origin: Vec3,
    pub(crate) count: usize,
    pub(crate) t_max: f32,
}

/// The hits of a bundle; without one, the number of the primitive is [`Hits::NONE`].
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct Hits {
    pub(crate) t: [f32; RAYS],
    pub(crate) u: [f32; RAYS],
    pub(crate) v: [f32; RAYS],
    pub(crate) primitive: [u32; RAYS],
}

/// Rays from one origin and what became of them.
#[derive(Zeroable)]
pub(crate) struct Wave {
    pub(crate) rays: Bundle,
    pub(crate) hits: Hits,
    /// Inner nodes that each ray visited; of rays that went one by one only.
    pub(crate) nodes: [u32; RAYS],
}

impl Bundle {
    /// Makes it an empty bundle of rays from `origin`.
    pub(crate) fn start(&mut self, origin: Vec3, t_max: f32) {
        (self.origin, self.t_max, self.count) = (origin, t_max, 0);
    }

    pub(crate) fn ray(&self, i: usize) -> Ray {
        Ray::new(self.origin, at(&self.direction, i))
    }
}

impl Wave {
    /// Vectors may reach beyond the last ray, where there is no hit.
    #[inline(always)]
    pub(crate) fn end(&mut self) {
        let count = self.rays.count;
        self.hits.primitive[count..count.next_multiple_of(PACKET)].fill(Hits::NONE);
    }
}

impl Hits {
    pub(crate) const NONE: u32 = u32::MAX;

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

    /// Mask of the rays that hit something, of a vector of them from `at` on; behind the last ray
    /// there is nothing ([`Wave::end`]).
    #[inline(always)]
    pub(crate) fn lanes<S: Simd>(&self, simd: S, at: usize) -> u64 {
        let primitives = S::u32s::from_slice(simd, &self.primitive[at..at + S::u32s::LEN]);
        primitives.simd_ne(Self::NONE).to_bitmask()
    }
}
