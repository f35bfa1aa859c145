//! Rays and the conservative test of a ray against a box.

use glam::Vec3;

use crate::Aabb;

/// A ray with what box tests need precomputed.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
}

impl Ray {
    /// A ray from `origin` along `direction`, which need not have unit length: distances along the ray are in
    /// multiples of its length. A ray with a NaN or infinite component, or of zero direction, hits nothing.
    #[must_use]
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let valid = origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO;
        let origin = if valid { origin } else { Vec3::NAN };
        Self { origin, direction, inverse: direction.recip() }
    }

    /// Where it starts; NaN for a ray that hits nothing.
    #[must_use]
    #[inline]
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Where it goes.
    #[must_use]
    #[inline]
    pub fn direction(&self) -> Vec3 {
        self.direction
    }

    /// One over each component of the direction; infinite, with the sign of the zero, where it is zero.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Vec3 {
        self.inverse
    }

    /// Whether the ray can hit anything at all.
    #[must_use]
    #[inline]
    pub fn is_valid(&self) -> bool {
        !self.origin.is_nan()
    }

    /// The distance at which the ray enters `aabb` between 0 and `t_max`, or `None`.
    ///
    /// Conservative (Ize, *Robust BVH Ray Traversal*, 2013): rounding never turns a hit into a miss.
    #[must_use]
    #[inline]
    pub fn enters(&self, aabb: &Aabb, t_max: f32) -> Option<f32> {
        // Nearest by the direction's sign, not by the lesser product: a ray inside the plane of a side has
        // 0 * inf = NaN there, and `max` and `min` then ignore just that side.
        let (mut near, mut far) = (0.0f32, t_max);
        for axis in 0..3 {
            let (first, last) = if self.inverse[axis].is_sign_negative() {
                (aabb.max[axis], aabb.min[axis])
            } else {
                (aabb.min[axis], aabb.max[axis])
            };
            near = near.max((first - self.origin[axis]) * self.inverse[axis]);
            // 1 + 2 gamma(3), rounded up: covers the rounding of both ends (Ize 2013, section 3).
            far = far.min((last - self.origin[axis]) * self.inverse[axis] * 1.000_000_4);
        }
        (near <= far && self.is_valid()).then_some(near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: Aabb = Aabb::new(Vec3::ZERO, Vec3::ONE);

    #[test]
    fn rays_in_the_plane_of_a_side_enter() {
        for zero in [0.0, -0.0] {
            for x in [0.0, 1.0] {
                let ray = Ray::new(Vec3::new(x, 0.5, -1.0), Vec3::new(zero, zero, 1.0));
                assert_eq!(ray.enters(&CUBE, f32::INFINITY), Some(1.0));
                assert_eq!(ray.enters(&CUBE, 0.5), None);
            }
            let ray = Ray::new(Vec3::new(1.5, 0.5, -1.0), Vec3::new(zero, zero, 1.0));
            assert_eq!(ray.enters(&CUBE, f32::INFINITY), None);
        }
        let flat = Aabb::new(Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0));
        let along = Ray::new(Vec3::new(-1.0, 0.0, 0.5), Vec3::X);
        assert_eq!(along.enters(&flat, f32::INFINITY), Some(1.0));
    }

    #[test]
    fn empty_boxes_and_invalid_rays_never_meet_anything() {
        let ray = Ray::new(Vec3::splat(0.5), Vec3::X);
        assert_eq!(ray.enters(&Aabb::EMPTY, f32::INFINITY), None);
        for bad in [Vec3::NAN, Vec3::splat(f32::INFINITY), Vec3::ZERO] {
            let ray = Ray::new(Vec3::splat(0.5), bad);
            assert_eq!(ray.enters(&CUBE, f32::INFINITY), None);
        }
        let ray = Ray::new(Vec3::NAN, Vec3::X);
        assert_eq!(ray.enters(&CUBE, f32::INFINITY), None);
    }
}
