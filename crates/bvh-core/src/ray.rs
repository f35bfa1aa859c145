//! Rays.

use glam::Vec3;

/// A ray with what box tests need precomputed.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
}

impl Ray {
    /// How much later than computed a ray leaves a box: 1 + 16 u, where u = 2^-24 bounds one
    /// rounding.
    ///
    /// Entry and exit carry three roundings each (Ize, *Robust BVH Ray Traversal*, 2013), and a
    /// watertight triangle test (Woop, Benthin, Wald 2013) moves a vertex close to the ray by up to
    /// four in each of two axes; 15 u in all with the rounding of this product itself.
    pub const WIDEN: f32 = 1.0 + 1.0 / (1 << 20) as f32;

    /// Makes a ray from `origin` along `direction`, which need not have unit length: distances
    /// along the ray are in multiples of its length. A ray with a NaN or infinite component, or of
    /// zero direction, hits nothing.
    #[must_use]
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let valid = origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO;
        let origin = if valid { origin } else { Vec3::NAN };
        Self { origin, direction, inverse: direction.recip() }
    }

    /// Returns where the ray starts; NaN for a ray that hits nothing.
    #[must_use]
    #[inline]
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Returns the direction as given.
    #[must_use]
    #[inline]
    pub fn direction(&self) -> Vec3 {
        self.direction
    }

    /// Returns one over each component of the direction; infinite, with the component's sign, where
    /// it is zero or less than 2.9e-39 in magnitude.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Vec3 {
        self.inverse
    }

    /// Returns whether the ray can hit anything at all.
    #[must_use]
    #[inline]
    pub fn is_valid(&self) -> bool {
        !self.origin.is_nan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Aabb;

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
    fn rounding_loses_no_box_at_t_max() {
        let mut by_rounding = 0;
        for i in 0..100_000u32 {
            let direction = Vec3::new(0.0, 0.0, 1.0 + i as f32 * 1.3e-5);
            // The plane that the ray reaches at 3, as exactly as there is one.
            let z = 3.0 * direction.z;
            let ray = Ray::new(Vec3::ZERO, direction);
            let aabb = Aabb::new(Vec3::new(-1.0, -1.0, z), Vec3::new(1.0, 1.0, z));
            let entry = ray.enters(&aabb, 3.0).expect("reached");
            by_rounding += u32::from(entry > 3.0);
        }
        assert!(by_rounding > 1000, "{by_rounding}");
        assert_eq!(Ray::new(Vec3::ZERO, Vec3::Z).enters(&CUBE, f32::NAN), None);
        assert_eq!(Ray::new(Vec3::ZERO, Vec3::Z).enters(&CUBE, -1.0), None);
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
