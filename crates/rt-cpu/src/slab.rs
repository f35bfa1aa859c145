//! The conservative test of a ray against a box, written so that it means the same one ray at a time and many.

use bvh_core::{Aabb, Ray};

/// How much later than computed a ray leaves a box: 1 + 16 u, where u = 2^-24 bounds one rounding.
///
/// Entry and exit carry three roundings each (Ize, *Robust BVH Ray Traversal*, 2013), and the watertight
/// triangle test moves a vertex close to the ray by up to four in each of two axes; 15 u in all with the
/// rounding of this product itself.
pub(crate) const WIDEN: f32 = 1.0 + 1.0 / (1 << 20) as f32;

/// The greater; `b` if either is NaN.
#[inline]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lesser; `b` if either is NaN.
#[inline]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Where a valid ray enters a box between 0 and `t_max`, never -0; `None` if it does not.
///
/// A ray in the plane of a side has 0 * inf = NaN there; `max` and `min` then ignore just that side.
#[inline]
pub(crate) fn enters(ray: &Ray, aabb: &Aabb, t_max: f32) -> Option<f32> {
    let (origin, inverse) = (ray.origin(), ray.inverse());
    let (mut near, mut far) = (0.0, t_max);
    for axis in 0..3 {
        let (mut first, mut last) = (aabb.min[axis], aabb.max[axis]);
        if inverse[axis].is_sign_negative() {
            (first, last) = (last, first);
        }
        near = max((first - origin[axis]) * inverse[axis], near);
        far = min((last - origin[axis]) * inverse[axis] * WIDEN, far);
    }
    (near <= far).then_some(near)
}
