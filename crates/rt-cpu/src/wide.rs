//! Box and triangle tests of many rays at once. All rays share their origin, and the signs of their directions.

use bvh_core::{Aabb, Ray, Triangles, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::bvh8::BlockTest;
use crate::simd::{Lanes, bits, max, min};
use crate::slab::WIDEN;
use crate::triangle::{DET_RANGE, Double, MollerTrumbore, Test, Watertight};

/// The planes of a box relative to the rays' origin, in the order in which the rays meet them.
#[derive(Clone, Copy)]
pub(crate) struct Slab {
    first: [f32; 3],
    last: [f32; 3],
}

impl Slab {
    /// `negative` says along which axes the rays go backwards.
    #[inline(always)]
    pub(crate) fn new(aabb: &Aabb, origin: Vec3, negative: [bool; 3]) -> Self {
        let (min, max) = (aabb.min - origin, aabb.max - origin);
        let mut slab = Self { first: min.to_array(), last: max.to_array() };
        for (k, negative) in negative.into_iter().enumerate() {
            if negative {
                (slab.first[k], slab.last[k]) = (max[k], min[k]);
            }
        }
        slab
    }

    /// Where rays enter, and whether they do before `t_max`; see [`enters`](crate::slab::enters).
    #[inline(always)]
    pub(crate) fn enter<S: Simd, V: Lanes<S>>(&self, simd: S, inverse: [V; 3], t_max: V) -> (V, V::Mask) {
        let mut near = V::simd_from(simd, 0.0);
        let mut far = V::simd_from(simd, f32::INFINITY);
        for (k, inverse) in inverse.into_iter().enumerate() {
            near = max(V::simd_from(simd, self.first[k]) * inverse, near);
            far = min(V::simd_from(simd, self.last[k]) * inverse, far);
        }
        // Widening the least gives the least of the widened: rounding is monotonic.
        let far = min(far * WIDEN, t_max);
        (near, near.simd_le(far))
    }
}

/// Rays in lanes, and what tests need of them.
#[derive(Clone, Copy)]
pub(crate) struct Rays<V> {
    pub(crate) direction: [V; 3],
    pub(crate) inverse: [V; 3],
    /// Of [`Watertight`]: slopes along the two axes after the longest.
    pub(crate) shear: [V; 2],
}

/// A triangle and its corners relative to the rays' origin.
pub(crate) struct Corners {
    pub(crate) origin: Vec3,
    pub(crate) corners: [Vec3; 3],
    pub(crate) relative: [Vec3; 3],
}

impl Corners {
    #[inline(always)]
    pub(crate) fn new(triangles: &Triangles<'_>, i: u32, origin: Vec3) -> Self {
        let [a, b, c] = triangles.indices[i as usize];
        // Spelt out because `array::map` is a call.
        let at = |v: u32| triangles.positions.get(v as usize).copied().unwrap_or(Vec3::NAN);
        let (a, b, c) = (at(a), at(b), at(c));
        Self { origin, corners: [a, b, c], relative: [a - origin, b - origin, c - origin] }
    }
}

/// The lanes that hit, and where.
pub(crate) struct Found<V> {
    pub(crate) lanes: u64,
    pub(crate) t: V,
    pub(crate) u: V,
    pub(crate) v: V,
}

/// A triangle test of many rays at once, with the bits of [`Test::test`]; [`BlockTest`] is of one ray and several triangles.
pub(crate) trait WideTest: BlockTest {
    /// Tests the lanes in `active`, whose directions are longest along `axis`.
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        triangle: &Corners,
        axis: usize,
        active: u64,
    ) -> Found<V>;
}

impl WideTest for Watertight {
    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        triangle: &Corners,
        axis: usize,
        active: u64,
    ) -> Found<V> {
        let [kx, ky, kz] = [(axis + 1) % 3, (axis + 2) % 3, axis];
        let zero = V::simd_from(simd, 0.0);
        let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
        for (i, p) in triangle.relative.iter().enumerate() {
            z[i] = V::simd_from(simd, p[kz]);
            x[i] = V::simd_from(simd, p[kx]) - rays.shear[0] * z[i];
            y[i] = V::simd_from(simd, p[ky]) - rays.shear[1] * z[i];
        }
        weigh(simd, x, y, z, rays.inverse[kz], active)
    }
}

/// [`Watertight`] for corners at `x` and `y` beside the ray, `z` along its longest axis, one over which is `inverse`.
#[inline(always)]
pub(crate) fn weigh<S: Simd, V: Lanes<S>>(
    simd: S,
    x: [V; 3],
    y: [V; 3],
    mut z: [V; 3],
    inverse: V,
    active: u64,
) -> Found<V> {
    let zero = V::simd_from(simd, 0.0);
    let wa = x[2] * y[1] - y[2] * x[1];
    let wb = x[0] * y[2] - y[0] * x[2];
    let wc = x[1] * y[0] - y[1] * x[0];
    let least = min(min(wa, wb), wc);
    let greatest = max(max(wa, wb), wc);
    let outside = least.simd_lt(zero) & greatest.simd_gt(zero);
    let inside = !outside.to_bitmask() & active;
    if inside == 0 {
        return Found { lanes: 0, t: zero, u: zero, v: zero };
    }
    let det = wa + wb + wc;
    let size = max(det, -det);
    let plain = size.simd_ge(DET_RANGE.0) & size.simd_le(DET_RANGE.1);
    // Inside, a zero is the least or the greatest.
    let plain = plain & least.simd_ne(zero) & greatest.simd_ne(zero);
    for z in &mut z {
        *z = inverse * *z;
    }
    let inv_det = V::simd_from(simd, 1.0) / det;
    let (mut u, mut v) = (wb * inv_det, wc * inv_det);
    let mut t = wa * inv_det * z[0] + u * z[1] + v * z[2];
    let ahead = t.simd_ge(zero) & t.simd_lt(f32::INFINITY);
    let plain = plain.to_bitmask();
    let mut lanes = inside & plain & ahead.to_bitmask();
    for i in bits(inside & !plain) {
        let lane = |a: &[V; 3]| [a[0].as_slice()[i], a[1].as_slice()[i], a[2].as_slice()[i]];
        if let Some(found) = Watertight::exactly(lane(&x), lane(&y), lane(&z)) {
            (t[i], u[i], v[i]) = found;
            lanes |= 1 << i;
        }
    }
    Found { lanes, t, u, v }
}

impl WideTest for MollerTrumbore {
    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        triangle: &Corners,
        _axis: usize,
        active: u64,
    ) -> Found<V> {
        let [a, b, c] = triangle.corners;
        let (e1, e2) = (b - a, c - a);
        let s = triangle.origin - a;
        let q = s.cross(e1);
        let d = rays.direction;
        let p = [d[1] * e2.z - d[2] * e2.y, d[2] * e2.x - d[0] * e2.z, d[0] * e2.y - d[1] * e2.x];
        let inv_det = V::simd_from(simd, 1.0) / dot(p, e1);
        let u = dot(p, s) * inv_det;
        let v = dot(d, q) * inv_det;
        let t = inv_det * e2.dot(q);
        let inside = u.simd_ge(0.0) & v.simd_ge(0.0) & (u + v).simd_le(1.0);
        let ahead = t.simd_ge(0.0) & t.simd_lt(f32::INFINITY);
        Found { lanes: (inside & ahead).to_bitmask() & active, t, u, v }
    }
}

#[inline(always)]
fn dot<S: Simd, V: Lanes<S>>(a: [V; 3], b: Vec3) -> V {
    a[0] * b.x + a[1] * b.y + a[2] * b.z
}

impl WideTest for Double {
    /// One by one: a reference need not be fast.
    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        triangle: &Corners,
        _axis: usize,
        active: u64,
    ) -> Found<V> {
        let zero = V::simd_from(simd, 0.0);
        let mut found = Found { lanes: 0, t: zero, u: zero, v: zero };
        for i in bits(active) {
            let ray = Ray::new(
                triangle.origin,
                Vec3::new(rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]),
            );
            if let Some(hit) = Self::new(&ray).test(&triangle.corners) {
                (found.t[i], found.u[i], found.v[i]) = hit;
                found.lanes |= 1 << i;
            }
        }
        found
    }
}
