//! What a triangle test finds in lanes, and the end of the watertight one: the same for many rays and one triangle as for
//! one ray and many triangles.

use bvh_core::triangle::{DET_RANGE, Watertight};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::simd::{Lanes, bits, max, min};

/// The lanes that hit, and where.
pub(crate) struct Found<V> {
    pub(crate) lanes: u64,
    pub(crate) t: V,
    pub(crate) u: V,
    pub(crate) v: V,
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
