//! Axis-aligned boxes.

use glam::Vec3;

/// An axis-aligned box, both ends inclusive.
///
/// A box is empty if `min > max` on any axis. Boxes of finite primitives have finite corners, and none of
/// their coordinates is a negative zero (see [`Aabb::sanitized`]).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Aabb {
    /// Least corner.
    pub min: Vec3,
    /// Greatest corner.
    pub max: Vec3,
}

impl Aabb {
    /// The empty box, neutral under [`union`](Self::union).
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box between two corners.
    #[must_use]
    pub const fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// The smallest box around `points`, sanitised: [`EMPTY`](Self::EMPTY) if there is none or if any has a
    /// NaN or infinite coordinate.
    #[must_use]
    #[inline]
    pub fn around(points: &[Vec3]) -> Self {
        let hull = |b: Self, &p: &Vec3| Self { min: b.min.min(p), max: b.max.max(p) };
        if points.iter().all(|p| p.is_finite()) {
            points.iter().fold(Self::EMPTY, hull).sanitized()
        } else {
            Self::EMPTY
        }
    }

    /// The box as trees store it: [`EMPTY`](Self::EMPTY) unless finite and `min <= max` on every axis, and
    /// with negative zeros made positive, so that minima and maxima have the same bits in any order and at
    /// any SIMD level.
    #[must_use]
    #[inline]
    pub fn sanitized(self) -> Self {
        // Each comparison is false if either side is NaN.
        if self.min.cmple(self.max).all() && self.min.is_finite() && self.max.is_finite() {
            Self { min: self.min + Vec3::ZERO, max: self.max + Vec3::ZERO }
        } else {
            Self::EMPTY
        }
    }

    /// Whether no point is inside.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The smallest box around both.
    #[must_use]
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Extent along each axis; 0 along those where `min` is above `max`, so that of [`EMPTY`](Self::EMPTY) is 0.
    #[must_use]
    #[inline]
    pub fn extent(&self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// Half the surface area, `xy + yz + zx` of the extents; 0 for [`EMPTY`](Self::EMPTY), infinite if it exceeds the
    /// range of `f32` (extents above about 1e19), NaN if an extent exceeds that range and another is 0. See
    /// [`half_area_f64`](Self::half_area_f64) for such boxes.
    ///
    /// The order of operations is part of the contract: every SIMD level computes these bits.
    #[must_use]
    #[inline]
    pub fn half_area(&self) -> f32 {
        let e = self.extent();
        (e.x * e.y + e.y * e.z) + e.z * e.x
    }

    /// Half the surface area in double precision; finite for all finite boxes.
    #[must_use]
    #[inline]
    pub fn half_area_f64(&self) -> f64 {
        let e = (self.max.as_dvec3() - self.min.as_dvec3()).max(glam::DVec3::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// The centre; each coordinate is finite for every finite box.
    #[must_use]
    #[inline]
    pub fn center(&self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Whether the boxes share a point (touching counts); false if either is empty.
    #[must_use]
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.max(other.min).cmple(self.max.min(other.max)).all()
    }

    /// Whether every point of `other` is inside; true if `other` is empty.
    #[must_use]
    #[inline]
    pub fn contains(&self, other: &Self) -> bool {
        other.is_empty() || (self.min.cmple(other.min).all() && other.max.cmple(self.max).all())
    }
}

impl Default for Aabb {
    fn default() -> Self {
        Self::EMPTY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_is_neutral_and_has_no_area() {
        let b = Aabb::new(Vec3::new(-1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0));
        assert_eq!(b.union(Aabb::EMPTY), b);
        assert_eq!(Aabb::EMPTY.union(b), b);
        assert_eq!(Aabb::EMPTY.half_area().to_bits(), 0);
        assert_eq!(Aabb::EMPTY.half_area_f64(), 0.0);
        assert!(Aabb::EMPTY.is_empty() && !b.is_empty());
        assert!(!Aabb::EMPTY.overlaps(&b) && !b.overlaps(&Aabb::EMPTY));
        assert_eq!(b.half_area(), 15.0 + 9.0 + 15.0);
    }

    #[test]
    fn non_finite_points_give_the_empty_box_wherever_they_stand() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for corner in 0..3 {
                for axis in 0..3 {
                    let mut points = [Vec3::ZERO, Vec3::X, Vec3::Y];
                    points[corner][axis] = bad;
                    assert_eq!(Aabb::around(&points), Aabb::EMPTY);
                    let mut b = Aabb::new(Vec3::ZERO, Vec3::ONE);
                    b.min[axis] = bad;
                    assert_eq!(b.sanitized(), Aabb::EMPTY);
                }
            }
        }
        assert_eq!(Aabb::around(&[]), Aabb::EMPTY);
    }

    #[test]
    fn negative_zeros_are_made_positive() {
        let b = Aabb::around(&[Vec3::splat(-0.0), Vec3::splat(-0.0)]);
        assert_eq!(b.min.to_array().map(f32::to_bits), [0; 3]);
        assert_eq!(b.max.to_array().map(f32::to_bits), [0; 3]);
    }

    #[test]
    fn huge_boxes_overflow_to_infinite_area_not_nan() {
        let b = Aabb::new(Vec3::splat(-1e38), Vec3::splat(1e38));
        assert_eq!(b.half_area(), f32::INFINITY);
        assert!((b.half_area_f64() / 12e76 - 1.0).abs() < 1e-6);
        assert!(b.center().is_finite());
    }
}
