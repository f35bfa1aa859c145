//! Box and triangle tests in lanes: of many rays at once, which share their origin, the signs of
//! their directions and the axis along which these are longest, or of one ray and many triangles.

use bvh_core::triangle::{DET_RANGE, Double, MollerTrumbore, Test, Watertight};
use bvh_core::{Node, Ray, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x8};

use crate::simd::{Lanes, cross, dot, load3, max, min, splat3};

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
    /// The origin along these axes.
    pub(crate) origin_along: Vec3,
    /// The direction of one of the rays: children are visited in their order along it.
    pub(crate) along: Vec3,
}

impl RayOctant {
    /// `along` is the direction of one of the rays, `negative` says along which axes they go
    /// backwards, `longest` along which they are longest.
    #[inline(always)]
    pub(crate) fn new(origin: Vec3, along: Vec3, negative: [bool; 3], longest: usize) -> Self {
        let first = [0, 1, 2].map(|k| if negative[k] { k + 4 } else { k });
        let axes = [(longest + 1) % 3, (longest + 2) % 3, longest];
        let origin_along = Vec3::new(origin[axes[0]], origin[axes[1]], origin[axes[2]]);
        Self { origin, first, last: first.map(|k| k ^ 4), axes, origin_along, along }
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

/// Rays in lanes, many or the same in all, and what triangle tests need of them.
#[derive(Clone, Copy)]
pub(crate) struct Rays<V> {
    pub(crate) octant: RayOctant,
    pub(crate) direction: [V; 3],
    /// Of [`Watertight`]: slopes along the first two of the octant's axes, and minus one over the
    /// extent along the last.
    pub(crate) shear: [V; 3],
}

/// A ray in all lanes.
#[inline(always)]
pub(crate) fn in_all_lanes<S: Simd, V: Lanes<S>>(simd: S, ray: &Ray) -> Rays<V> {
    let (direction, Watertight { axes, shear, .. }) = (ray.direction(), Watertight::new(ray));
    let negative = [0, 1, 2].map(|k| direction[k].is_sign_negative());
    let octant = RayOctant::new(ray.origin(), direction, negative, axes[2]);
    let shear = splat3(simd, Vec3::new(shear.x, shear.y, -shear.z));
    Rays { octant, direction: splat3(simd, direction), shear }
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

/// A triangle test in lanes, with the bits of [`Test::test`].
pub(crate) trait WideTest: Test {
    /// The axes in whose order [`wide`](Self::wide) takes coordinates of corners. Where a test
    /// sorts them by octant, this happens while they are loaded: vectors by an index that is not
    /// known before cannot stay in registers.
    #[inline(always)]
    fn axes(_: &RayOctant) -> [usize; 3] {
        [0, 1, 2]
    }

    /// Tests the lanes in `active` against triangles with these [`corners`], laid out for the rays'
    /// octant. It `may_end` once all of them have missed, or go on: the branch pays where that is
    /// mostly so, and elsewhere the processor cannot guess it.
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        corners: &[[V; 3]; 3],
        active: u64,
        may_end: bool,
    ) -> Found<V>;
}

/// Corners as a test takes them. Coordinates are one for each lane, or one for all.
#[inline(always)]
pub(crate) fn corners<S: Simd, T: WideTest, V: Lanes<S>, const N: usize>(
    simd: S,
    octant: &RayOctant,
    corners: [&[[f32; N]; 3]; 3],
) -> [[V; 3]; 3] {
    let mut loaded = [splat3(simd, Vec3::ZERO); 3];
    for (to, from) in loaded.iter_mut().zip(corners) {
        for (to, axis) in to.iter_mut().zip(T::axes(octant)) {
            *to = match from[axis][..] {
                [number] => V::simd_from(simd, number),
                ref numbers => V::from_slice(simd, numbers),
            };
        }
    }
    loaded
}

impl WideTest for Watertight {
    #[inline(always)]
    fn axes(octant: &RayOctant) -> [usize; 3] {
        octant.axes
    }

    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        corners: &[[V; 3]; 3],
        active: u64,
        may_end: bool,
    ) -> Found<V> {
        let zero = V::simd_from(simd, 0.0);
        let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
        // All of it negated, and the reciprocal too, which changes nothing but the signs of zeros:
        // what is subtracted may come straight from memory.
        let [ox, oy, oz]: [V; 3] = splat3(simd, rays.octant.origin_along);
        for (i, corner) in corners.iter().enumerate() {
            z[i] = oz - corner[2];
            x[i] = ox - corner[0] - rays.shear[0] * z[i];
            y[i] = oy - corner[1] - rays.shear[1] * z[i];
        }
        let wa = x[2] * y[1] - y[2] * x[1];
        let wb = x[0] * y[2] - y[0] * x[2];
        let wc = x[1] * y[0] - y[1] * x[0];
        let least = min(min(wa, wb), wc);
        let greatest = max(max(wa, wb), wc);
        // Negative where signs differ, positive where all are the same. With a zero, or where it
        // underflows, it is 0 or NaN: such lanes are unsure.
        let signs = least * greatest;
        let inside = !signs.simd_lt(zero).to_bitmask() & active;
        if may_end && inside == 0 {
            return Found { lanes: 0, unsure: 0, t: zero, u: zero, v: zero };
        }
        let det = wa + wb + wc;
        let size = det.abs();
        let plain = size.simd_ge(DET_RANGE.0) & size.simd_le(DET_RANGE.1) & signs.simd_gt(zero);
        let inv_det = V::simd_from(simd, 1.0) / det;
        let (u, v) = (wb * inv_det, wc * inv_det);
        let unit = rays.shear[2];
        let t = wa * inv_det * (unit * z[0]) + u * (unit * z[1]) + v * (unit * z[2]);
        let plain = (plain & t.is_finite()).to_bitmask();
        Found { lanes: inside & plain & t.simd_ge(zero).to_bitmask(), unsure: inside & !plain, t, u, v }
    }
}

impl WideTest for MollerTrumbore {
    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        corners: &[[V; 3]; 3],
        active: u64,
        _: bool,
    ) -> Found<V> {
        let mut s = splat3(simd, rays.octant.origin);
        let (mut e1, mut e2) = (s, s);
        for k in 0..3 {
            let [a, b, c] = [corners[0][k], corners[1][k], corners[2][k]];
            e1[k] = b - a;
            e2[k] = c - a;
            s[k] -= a;
        }
        let (p, q) = (cross(rays.direction, e2), cross(s, e1));
        let inv_det = V::simd_from(simd, 1.0) / dot(e1, p);
        let (u, v, t) = (dot(s, p) * inv_det, dot(rays.direction, q) * inv_det, dot(e2, q) * inv_det);
        let inside = u.simd_ge(0.0) & v.simd_ge(0.0) & (u + v).simd_le(1.0);
        let ahead = t.simd_ge(0.0) & t.simd_lt(f32::INFINITY);
        Found { lanes: (inside & ahead).to_bitmask() & active, unsure: 0, t, u, v }
    }
}

/// Eight numbers from `at` on in double precision, or the last of them where there are fewer.
#[inline(always)]
fn widen<S: Simd>(simd: S, numbers: &[f32], at: usize) -> f64x8<S> {
    let mut wide = [0.0; 8];
    for (i, to) in wide.iter_mut().enumerate() {
        *to = f64::from(numbers[(at + i).min(numbers.len() - 1)]);
    }
    f64x8::from_slice(simd, &wide)
}

impl WideTest for Double {
    #[inline(always)]
    fn axes(octant: &RayOctant) -> [usize; 3] {
        octant.axes
    }

    #[inline(always)]
    fn wide<S: Simd, V: Lanes<S>>(
        simd: S,
        rays: &Rays<V>,
        corners: &[[V; 3]; 3],
        active: u64,
        _: bool,
    ) -> Found<V> {
        let ([kx, ky, kz], origin) = (rays.octant.axes, rays.octant.origin_along.as_dvec3());
        let zero = f64x8::splat(simd, 0.0);
        const { assert!(V::LEN <= 16) };
        let (mut hit, mut found) = (0, [[0.0; 16]; 3]);
        for at in (0..V::LEN).step_by(8) {
            let along = widen(simd, rays.direction[kz].as_slice(), at);
            let shear_x = widen(simd, rays.direction[kx].as_slice(), at) / along;
            let shear_y = widen(simd, rays.direction[ky].as_slice(), at) / along;
            let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
            for (i, corner) in corners.iter().enumerate() {
                z[i] = widen(simd, corner[2].as_slice(), at) - origin.z;
                x[i] = widen(simd, corner[0].as_slice(), at) - origin.x - shear_x * z[i];
                y[i] = widen(simd, corner[1].as_slice(), at) - origin.y - shear_y * z[i];
            }
            let wa = x[2] * y[1] - y[2] * x[1];
            let wb = x[0] * y[2] - y[0] * x[2];
            let wc = x[1] * y[0] - y[1] * x[0];
            let left = wa.simd_ge(zero) & wb.simd_ge(zero) & wc.simd_ge(zero);
            let right = wa.simd_le(zero) & wb.simd_le(zero) & wc.simd_le(zero);
            let det = wa + wb + wc;
            let inside = (left | right) & det.simd_ne(zero);
            if !inside.any_true() {
                continue;
            }
            let inverse = f64x8::splat(simd, 1.0) / along;
            let (u, v) = (wb / det, wc / det);
            let t = wa / det * (inverse * z[0]) + u * (inverse * z[1]) + v * (inverse * z[2]);
            // Even beyond `f32`.
            hit |= (inside & t.simd_ge(zero)).to_bitmask() << at;
            for (to, from) in found.iter_mut().zip([t, u, v]) {
                for (to, from) in to[at..at + 8].iter_mut().zip(*from) {
                    *to = from as f32;
                }
            }
        }
        let [t, u, v]: [V; 3] = load3(simd, &found, 0);
        // Zeros without signs, whatever signs they come from.
        let (u, v) = (u + 0.0, v + 0.0);
        Found { lanes: hit & t.simd_lt(f32::INFINITY).to_bitmask() & active, unsure: 0, t, u, v }
    }
}
