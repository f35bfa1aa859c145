//! The conservative test of a ray against a box, written so that it means the same one ray at a
//! time and many.

use crate::{Aabb, Ray};

/// Returns the greater; `b` if either is NaN.
#[inline]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the lesser; `b` if either is NaN.
#[inline]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns where a valid ray enters a box between 0 and `t_max`, never -0; `None` if it does not.
/// It leaves the box `widen` times as late as computed: [`Ray::WIDEN`] makes up for rounding.
///
/// A ray in the plane of a side has 0 * inf = NaN there; `max` and `min` then ignore just that
/// side.
#[inline]
pub fn enters(ray: &Ray, aabb: &Aabb, t_max: f32, widen: f32) -> Option<f32> {
    let (origin, inverse) = (ray.origin(), ray.inverse());
    let (mut near, mut far) = (0.0, t_max);
    for axis in 0..3 {
        let (mut first, mut last) = (aabb.min[axis], aabb.max[axis]);
        if inverse[axis].is_sign_negative() {
            (first, last) = (last, first);
        }
        near = max((first - origin[axis]) * inverse[axis], near);
        far = min((last - origin[axis]) * inverse[axis] * widen, far);
    }
    (near <= far).then_some(near)
}

impl Ray {
    /// Returns the distance at which the ray enters `aabb` between 0 and `t_max`, or `None`: always
    /// so for [`Aabb::EMPTY`], an invalid ray, and a `t_max` that is negative or NaN.
    ///
    /// Conservative by [`WIDEN`](Self::WIDEN): rounding never turns a hit into a miss, not even one
    /// at `t_max`. The exceptions lie at the ends of the range of `f32`. A component of the
    /// direction that is not zero, but less than 2.9e-39 in magnitude, counts as zero, since one
    /// over it is infinite. A box may be missed at a distance below 1.2e-38, or if it is so far
    /// from the origin that the difference is infinite.
    #[must_use]
    #[inline]
    pub fn enters(&self, aabb: &Aabb, t_max: f32) -> Option<f32> {
        enters(self, aabb, t_max * Self::WIDEN, Self::WIDEN).filter(|_| self.is_valid())
    }
}
