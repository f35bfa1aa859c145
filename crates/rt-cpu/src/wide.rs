//! Box and triangle tests of many rays at once. All rays share their origin, the signs of their
//! directions and the axis along which these are longest.

use bvh_core::triangle::{DET_RANGE, Double, MollerTrumbore, Test, Watertight};
use bvh_core::{Node, Ray, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x8};

use crate::simd::{Lanes, max, min};

/// Rays that are tested at once.
pub(crate) type V<S> = fearless_simd::f32x16<S>;

/// What rays that are tested together have in common.
#[derive(Clone, Copy)]
pub(crate) struct RayOctant {
    pub(crate) origin: Vec3,
    /// Where in a [`Node`]'s words the planes are that the rays meet first along each axis, and
    /// those that they meet last.
    first: [usize; 3],
    last: [usize; 3],
    /// The axis along which all directions are longest, after the two that follow it.
    pub(crate) axes: [usize; 3],
    /// The direction of one of the rays: children are visited in their order along it.
    pub(crate) along: Vec3,
}

impl RayOctant {
    /// `along` is the direction of one of the rays, `negative` says along which axes they go
    /// backwards, `longest` along which they are longest.
    #[inline(always)]
    pub(crate) fn new(origin: Vec3, along: Vec3, negative: [bool; 3], longest: usize) -> Self {
        let first = [0, 1, 2].map(|k| if negative[k] { k + 4 } else { k });
        Self {
            origin,
            first,
            last: first.map(|k| k ^ 4),
            axes: [(longest + 1) % 3, (longest + 2) % 3, longest],
            along,
        }
    }
}

/// The planes of a box, in the order in which rays meet them, subtracted from the rays' origin:
/// what is subtracted comes from memory straight into all lanes.
#[derive(Clone, Copy)]
pub(crate) struct Slab<S, V> {
    simd: S,
    first: [V; 3],
    last: [V; 3],
}

impl<S: Simd, V: Lanes<S>> Slab<S, V> {
    /// The box of a node.
    #[inline(always)]
    pub(crate) fn of(simd: S, node: &Node, octant: &RayOctant) -> Self {
        Self::between(simd, bytemuck::cast_ref(node), octant)
    }

    /// The box of a triangle whose corners are finite.
    ///
    /// Trees make negative zeros in boxes positive. Here they may stay: they change but the signs
    /// of zeros, which no comparison sees and which [`max`] does not take from where it starts, a
    /// positive zero.
    #[inline(always)]
    pub(crate) fn around(simd: S, corners: &[Vec3; 3], octant: &RayOctant) -> Self {
        let [a, b, c] = corners;
        let (min, max) = (a.min(*b).min(*c), a.max(*b).max(*c));
        Self::between(simd, &[min.x, min.y, min.z, 0.0, max.x, max.y, max.z, 0.0], octant)
    }

    #[inline(always)]
    fn between(simd: S, planes: &[f32; 8], octant: &RayOctant) -> Self {
        let origin = [octant.origin.x, octant.origin.y, octant.origin.z];
        let zero = V::simd_from(simd, 0.0);
        let mut slab = Self { simd, first: [zero; 3], last: [zero; 3] };
        for k in 0..3 {
            let origin = V::simd_from(simd, origin[k]);
            // With the mask the compiler knows that the index is in range.
            slab.first[k] = origin - V::simd_from(simd, planes[octant.first[k] & 7]);
            slab.last[k] = origin - V::simd_from(simd, planes[octant.last[k] & 7]);
        }
        slab
    }

    /// Where rays enter, and whether they do before `t_max`; see
    /// [`enters`](bvh_core::slab::enters). `inverse` is minus one over the direction: both signs
    /// together change nothing but those of zeros.
    #[inline(always)]
    pub(crate) fn enter(&self, inverse: [V; 3], t_max: V) -> (V, V::Mask) {
        let mut near = V::simd_from(self.simd, 0.0);
        let mut far = V::simd_from(self.simd, f32::INFINITY);
        for (k, inverse) in inverse.into_iter().enumerate() {
            near = max(self.first[k] * inverse, near);
            far = min(self.last[k] * inverse, far);
        }
        // Widening the least gives the least of the widened: rounding is monotonic.
        (near, near.simd_le(min(far * Ray::WIDEN, t_max)))
    }
}

/// Rays in lanes, and what triangle tests need of them.
#[derive(Clone, Copy)]
pub(crate) struct Rays<'a, S: Simd> {
    pub(crate) octant: &'a RayOctant,
    pub(crate) direction: [V<S>; 3],
    /// Of [`Watertight`]: slopes along the two axes after the longest, and minus one over the
    /// extent along that.
    pub(crate) shear: [V<S>; 3],
}

/// A triangle test of many rays at once, with the bits of [`Test::test`];
/// [`BlockTest`](crate::bvh8::BlockTest) is of one ray and several triangles.
pub(crate) trait WideTest: Test {
    /// Tests the lanes in `active`.
    fn wide<S: Simd>(simd: S, rays: &Rays<'_, S>, corners: [&Vec3; 3], active: u64) -> Found<V<S>>;
}

impl WideTest for Watertight {
    #[inline(always)]
    fn wide<S: Simd>(simd: S, rays: &Rays<'_, S>, corners: [&Vec3; 3], active: u64) -> Found<V<S>> {
        let octant = rays.octant;
        let [kx, ky, kz] = octant.axes;
        let origin: &[f32; 3] = octant.origin.as_ref();
        let zero = V::splat(simd, 0.0);
        let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
        // All of it negated, and the reciprocal too, which changes nothing but the signs of zeros:
        // corners get from memory straight into all lanes to be subtracted.
        let (ox, oy) = (V::splat(simd, origin[kx]), V::splat(simd, origin[ky]));
        let oz = V::splat(simd, origin[kz]);
        for (i, p) in corners.into_iter().enumerate() {
            let p: &[f32; 3] = p.as_ref();
            z[i] = oz - V::splat(simd, p[kz]);
            x[i] = ox - V::splat(simd, p[kx]) - rays.shear[0] * z[i];
            y[i] = oy - V::splat(simd, p[ky]) - rays.shear[1] * z[i];
        }
        weigh(simd, x, y, z, rays.shear[2], active)
    }
}

impl WideTest for MollerTrumbore {
    #[inline(always)]
    fn wide<S: Simd>(simd: S, rays: &Rays<'_, S>, [&a, &b, &c]: [&Vec3; 3], active: u64) -> Found<V<S>> {
        let (e1, e2) = (b - a, c - a);
        let s = rays.octant.origin - a;
        let q = s.cross(e1);
        let d = rays.direction;
        let p = [d[1] * e2.z - d[2] * e2.y, d[2] * e2.x - d[0] * e2.z, d[0] * e2.y - d[1] * e2.x];
        let inv_det = V::splat(simd, 1.0) / dot(p, e1);
        let u = dot(p, s) * inv_det;
        let v = dot(d, q) * inv_det;
        let t = inv_det * e2.dot(q);
        let inside = u.simd_ge(0.0) & v.simd_ge(0.0) & (u + v).simd_le(1.0);
        let ahead = t.simd_ge(0.0) & t.simd_lt(f32::INFINITY);
        Found { lanes: (inside & ahead).to_bitmask() & active, unsure: 0, t, u, v }
    }
}

#[inline(always)]
fn dot<S: Simd>(a: [V<S>; 3], b: Vec3) -> V<S> {
    a[0] * b.x + a[1] * b.y + a[2] * b.z
}

impl WideTest for Double {
    #[inline(always)]
    fn wide<S: Simd>(simd: S, rays: &Rays<'_, S>, corners: [&Vec3; 3], active: u64) -> Found<V<S>> {
        let &Rays { octant, direction: d, .. } = rays;
        let [kx, ky, kz] = octant.axes;
        let (x, y, z) = (simd.widen_f32x16(d[kx]), simd.widen_f32x16(d[ky]), simd.widen_f32x16(d[kz]));
        let (low, [t0, u0, v0]) = double(simd, [x.0, y.0, z.0], corners, octant);
        let (high, [t1, u1, v1]) = double(simd, [x.1, y.1, z.1], corners, octant);
        let t = simd.narrow_f64x8(t0, t1);
        // Zeros without signs, whatever signs they come from.
        let (u, v) = (simd.narrow_f64x8(u0, u1) + 0.0, simd.narrow_f64x8(v0, v1) + 0.0);
        let near = t.simd_lt(f32::INFINITY).to_bitmask();
        Found { lanes: (low | high << 8) & near & active, unsure: 0, t, u, v }
    }
}

/// [`Double`] for rays along the directions `d`, the longest axis last: the lanes with t >= 0, even
/// beyond `f32`, and t, u and v.
#[inline(always)]
fn double<S: Simd>(
    simd: S,
    d: [f64x8<S>; 3],
    corners: [&Vec3; 3],
    octant: &RayOctant,
) -> (u64, [f64x8<S>; 3]) {
    let [kx, ky, kz] = octant.axes;
    let origin = octant.origin.as_dvec3();
    let shear = [d[0] / d[2], d[1] / d[2]];
    let zero = f64x8::splat(simd, 0.0);
    let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
    for (i, p) in corners.into_iter().enumerate() {
        let p = p.as_dvec3() - origin;
        z[i] = f64x8::splat(simd, p[kz]);
        x[i] = f64x8::splat(simd, p[kx]) - shear[0] * z[i];
        y[i] = f64x8::splat(simd, p[ky]) - shear[1] * z[i];
    }
    let wa = x[2] * y[1] - y[2] * x[1];
    let wb = x[0] * y[2] - y[0] * x[2];
    let wc = x[1] * y[0] - y[1] * x[0];
    let left = wa.simd_ge(zero) & wb.simd_ge(zero) & wc.simd_ge(zero);
    let right = wa.simd_le(zero) & wb.simd_le(zero) & wc.simd_le(zero);
    let det = wa + wb + wc;
    let inside = (left | right) & det.simd_ne(zero);
    if !inside.any_true() {
        return (0, [zero; 3]);
    }
    let inverse = f64x8::splat(simd, 1.0) / d[2];
    let (u, v) = (wb / det, wc / det);
    let t = wa / det * (inverse * z[0]) + u * (inverse * z[1]) + v * (inverse * z[2]);
    ((inside & t.simd_ge(zero)).to_bitmask(), [t, u, v])
}

/// The lanes that hit, and where.
pub(crate) struct Found<V> {
    pub(crate) lanes: u64,
    /// Other lanes that may hit: [`Test::test`] has to tell.
    pub(crate) unsure: u64,
    pub(crate) t: V,
    pub(crate) u: V,
    pub(crate) v: V,
}

/// [`Watertight`] for corners at `x` and `y` beside the ray, `z` along its longest axis, one over
/// which is `inverse`.
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
        return Found { lanes: 0, unsure: 0, t: zero, u: zero, v: zero };
    }
    let det = wa + wb + wc;
    let size = det.abs();
    let plain = size.simd_ge(DET_RANGE.0) & size.simd_le(DET_RANGE.1);
    // Inside, a zero is the least or the greatest.
    let plain = plain & least.simd_ne(zero) & greatest.simd_ne(zero);
    for z in &mut z {
        *z = inverse * *z;
    }
    let inv_det = V::simd_from(simd, 1.0) / det;
    let (u, v) = (wb * inv_det, wc * inv_det);
    let t = wa * inv_det * z[0] + u * z[1] + v * z[2];
    let ahead = t.simd_ge(zero) & t.simd_lt(f32::INFINITY);
    let plain = plain.to_bitmask();
    Found { lanes: inside & plain & ahead.to_bitmask(), unsure: inside & !plain, t, u, v }
}
