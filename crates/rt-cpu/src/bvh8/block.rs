//! Four triangles, and one ray against all of them.

use bvh_core::{Primitives, Ray, Triangles, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4};

use crate::Hit;
use crate::simd::{bits, load};
use crate::surface::dot;
use bvh_core::slab::WIDEN;
use bvh_core::triangle::{Double, MollerTrumbore, Test, Watertight, in_box};

use crate::weigh::{Found, weigh};

/// Triangles of a block.
pub(super) const SIZE: usize = 4;

/// Up to four triangles, corner by corner and axis by axis.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Block {
    corners: [[[f32; SIZE]; 3]; 3],
    primitive: [u32; SIZE],
}

impl Block {
    /// A block of those of the primitives that can be hit: that are there and finite. Gives their number, too.
    pub(super) fn new(triangles: &Triangles<'_>, primitives: &[u32]) -> (Self, usize) {
        let mut block = Self::default();
        let mut count = 0;
        for &primitive in primitives.iter().take(SIZE).filter(|&&p| (p as usize) < triangles.len()) {
            let corners = triangles.corners(primitive as usize);
            for (to, from) in block.corners.iter_mut().zip(&corners) {
                for axis in 0..3 {
                    to[axis][count] = from[axis];
                }
            }
            block.primitive[count] = primitive;
            count += usize::from(corners.iter().all(|c| c.is_finite()));
        }
        (block, count)
    }

    #[cfg(test)]
    pub(super) fn bytes(&self) -> impl Iterator<Item = &u8> {
        bytemuck::bytes_of(&self.corners).iter().chain(bytemuck::bytes_of(&self.primitive))
    }

    #[inline(always)]
    fn corners(&self, i: usize) -> [Vec3; 3] {
        let at = |corner: &[[f32; SIZE]; 3]| Vec3::new(corner[0][i], corner[1][i], corner[2][i]);
        [at(&self.corners[0]), at(&self.corners[1]), at(&self.corners[2])]
    }

    /// The closest of what a triangle test found that comes before `best` and not after `t_max`, and that `counts` is
    /// true for; else `best`.
    #[inline(always)]
    pub(super) fn closest<S: Simd>(
        &self,
        ray: &Ray,
        found: &Found<f32x4<S>>,
        mut t_max: f32,
        mut best: Option<Hit>,
        counts: &impl Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        if found.lanes == 0 {
            return best;
        }
        let near = found.lanes & found.t.simd_le(t_max).to_bitmask();
        for i in bits(near) {
            let at = (found.t.as_slice()[i], found.u.as_slice()[i], found.v.as_slice()[i]);
            let hit = in_box(ray, at, &self.corners(i), self.primitive[i], t_max, WIDEN);
            if let Some(hit) = hit.filter(|h| best.is_none_or(|b| h.is_before(b.t, b.primitive)) && counts(h))
            {
                (best, t_max) = (Some(hit), hit.t);
            }
        }
        best
    }
}

/// A triangle test of one ray against four triangles, with the bits of [`Test::test`].
pub(crate) trait BlockTest: Test {
    /// The ray in all lanes.
    type Lanes<S: Simd>;

    fn lanes<S: Simd>(simd: S, ray: &Ray) -> Self::Lanes<S>;

    /// Tests the triangles in `active`.
    fn block<S: Simd>(simd: S, ray: &Self::Lanes<S>, block: &Block, active: u64) -> Found<f32x4<S>>;
}

type Lanes3<S> = [f32x4<S>; 3];

#[inline(always)]
fn splat<S: Simd>(simd: S, a: Vec3) -> Lanes3<S> {
    [f32x4::splat(simd, a.x), f32x4::splat(simd, a.y), f32x4::splat(simd, a.z)]
}

/// Coordinates of corner `i`.
#[inline(always)]
fn corner<S: Simd>(simd: S, block: &Block, i: usize) -> Lanes3<S> {
    let [x, y, z] = &block.corners[i];
    [load(simd, x, 0), load(simd, y, 0), load(simd, z, 0)]
}

#[inline(always)]
fn minus<S: Simd>(a: Lanes3<S>, b: Lanes3<S>) -> Lanes3<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross<S: Simd>(a: Lanes3<S>, b: Lanes3<S>) -> Lanes3<S> {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

/// The ray of [`Watertight`]: its origin and shear along the axes, whose numbers come last.
pub(crate) struct Sheared<S: Simd> {
    origin: Lanes3<S>,
    shear: Lanes3<S>,
    axes: [usize; 3],
}

impl BlockTest for Watertight {
    type Lanes<S: Simd> = Sheared<S>;

    #[inline(always)]
    fn lanes<S: Simd>(simd: S, ray: &Ray) -> Sheared<S> {
        let Self { origin, axes, shear } = Self::new(ray);
        Sheared { origin: splat(simd, origin), shear: splat(simd, shear), axes }
    }

    #[inline(always)]
    fn block<S: Simd>(simd: S, ray: &Sheared<S>, block: &Block, active: u64) -> Found<f32x4<S>> {
        let zero = f32x4::splat(simd, 0.0);
        let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
        for (i, corner) in block.corners.iter().enumerate() {
            let along = |k: usize| load::<S, f32x4<S>, SIZE>(simd, &corner[ray.axes[k]], 0) - ray.origin[k];
            z[i] = along(2);
            x[i] = along(0) - ray.shear[0] * z[i];
            y[i] = along(1) - ray.shear[1] * z[i];
        }
        weigh(simd, x, y, z, ray.shear[2], active)
    }
}

impl BlockTest for MollerTrumbore {
    type Lanes<S: Simd> = [Lanes3<S>; 2];

    #[inline(always)]
    fn lanes<S: Simd>(simd: S, ray: &Ray) -> [Lanes3<S>; 2] {
        [splat(simd, ray.origin()), splat(simd, ray.direction())]
    }

    #[inline(always)]
    fn block<S: Simd>(
        simd: S,
        &[origin, direction]: &[Lanes3<S>; 2],
        block: &Block,
        active: u64,
    ) -> Found<f32x4<S>> {
        let a = corner(simd, block, 0);
        let (e1, e2) = (minus(corner(simd, block, 1), a), minus(corner(simd, block, 2), a));
        let p = cross(direction, e2);
        let inv_det = f32x4::splat(simd, 1.0) / dot(e1, p);
        let s = minus(origin, a);
        let q = cross(s, e1);
        let (u, v, t) = (dot(s, p) * inv_det, dot(direction, q) * inv_det, dot(e2, q) * inv_det);
        let inside = u.simd_ge(0.0) & v.simd_ge(0.0) & (u + v).simd_le(1.0);
        let ahead = t.simd_ge(0.0) & t.simd_lt(f32::INFINITY);
        Found { lanes: (inside & ahead).to_bitmask() & active, t, u, v }
    }
}

impl BlockTest for Double {
    type Lanes<S: Simd> = Self;

    #[inline(always)]
    fn lanes<S: Simd>(_: S, ray: &Ray) -> Self {
        Self::new(ray)
    }

    /// One by one: a reference need not be fast.
    #[inline(always)]
    fn block<S: Simd>(simd: S, ray: &Self, block: &Block, active: u64) -> Found<f32x4<S>> {
        let zero = f32x4::splat(simd, 0.0);
        let mut found = Found { lanes: 0, t: zero, u: zero, v: zero };
        for i in bits(active) {
            if let Some(hit) = ray.test(&block.corners(i)) {
                (found.t[i], found.u[i], found.v[i]) = hit;
                found.lanes |= 1 << i;
            }
        }
        found
    }
}
