//! Rays and hits of one tile, coordinate by coordinate, as packets want them.

use bvh_core::{Ray, Vec3};
use bytemuck::Zeroable;
use rt_cpu::Hit;

/// Most rays at a time: a tile of 16 x 16 pixels. Rays and hits fit into the first level of cache.
pub const RAYS: usize = 256;

/// Up to [`RAYS`] rays. `t` counts in multiples of the direction's length and starts at 0.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub struct Rays {
    /// Where each starts: all x, all y, all z.
    pub origin: [[f32; RAYS]; 3],
    /// Where each goes, of any length.
    pub direction: [[f32; RAYS]; 3],
    /// Where each ends.
    pub t_max: [f32; RAYS],
    count: usize,
}

impl Rays {
    /// Adds a ray.
    ///
    /// # Panics
    /// If there are [`RAYS`] already.
    pub fn push(&mut self, origin: Vec3, direction: Vec3, t_max: f32) {
        for axis in 0..3 {
            self.origin[axis][self.count] = origin[axis];
            self.direction[axis][self.count] = direction[axis];
        }
        self.t_max[self.count] = t_max;
        self.count += 1;
    }

    /// Says how many of the coordinates, all written, are rays.
    pub(crate) fn set_len(&mut self, count: usize) {
        self.count = count.min(RAYS);
    }

    /// Returns the number of rays.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Returns whether there are no rays.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns where ray `i` starts.
    #[must_use]
    #[inline]
    pub fn origin(&self, i: usize) -> Vec3 {
        Vec3::from(self.origin.each_ref().map(|o| o[i]))
    }

    /// Returns where ray `i` goes.
    #[must_use]
    #[inline]
    pub fn direction(&self, i: usize) -> Vec3 {
        Vec3::from(self.direction.each_ref().map(|d| d[i]))
    }

    /// Returns ray `i` with what box tests need.
    #[must_use]
    #[inline]
    pub fn ray(&self, i: usize) -> Ray {
        Ray::new(self.origin(i), self.direction(i))
    }
}

impl Default for Rays {
    /// No rays.
    fn default() -> Self {
        Self::zeroed()
    }
}

/// What rays hit, ray by ray.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub struct Hits {
    /// Where along the ray.
    pub t: [f32; RAYS],
    /// Weight of the triangle's second corner.
    pub u: [f32; RAYS],
    /// Weight of its third.
    pub v: [f32; RAYS],
    /// Normal of the triangle, of any length, from those who [give
    /// it](crate::Contestant::gives_normals).
    pub normal: [[f32; RAYS]; 3],
    /// The triangle, or [`Hits::NONE`]; `t`, `u` and `v` have no meaning then.
    pub primitive: [u32; RAYS],
}

impl Hits {
    /// In place of a triangle's number: nothing is hit.
    pub const NONE: u32 = u32::MAX;

    /// Returns what ray `i` hits.
    #[must_use]
    #[inline]
    pub fn get(&self, i: usize) -> Option<Hit> {
        let (t, u, v, primitive) = (self.t[i], self.u[i], self.v[i], self.primitive[i]);
        (primitive != Self::NONE).then_some(Hit { t, u, v, primitive })
    }

    /// Sets what ray `i` hits.
    #[inline]
    pub fn set(&mut self, i: usize, hit: Option<Hit>) {
        let none = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: Self::NONE };
        let hit = hit.unwrap_or(none);
        (self.t[i], self.u[i], self.v[i], self.primitive[i]) = (hit.t, hit.u, hit.v, hit.primitive);
    }
}

impl Default for Hits {
    /// No hits.
    fn default() -> Self {
        Self { primitive: [Self::NONE; RAYS], ..Self::zeroed() }
    }
}
