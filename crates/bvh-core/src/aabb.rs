//! Axis-aligned boxes.

use glam::Vec3;

/// An axis-aligned box, both ends inclusive.
///
/// A box is empty if `min > max` on any axis. Boxes in a tree are [`sanitized`](Self::sanitized):
/// finite and without negative zeros, or [`EMPTY`](Self::EMPTY).
///
/// ```
/// use bvh_core::{Aabb, Vec3};
///
/// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
/// let both = unit.union(Aabb::around(&[Vec3::splat(2.0), Vec3::splat(3.0)]));
/// assert_eq!(both.extent(), Vec3::splat(3.0));
/// assert_eq!(unit.half_area(), 3.0);
/// assert!(unit.overlaps(&both) && both.contains(&unit));
/// assert_eq!(unit.distance_squared(Vec3::new(3.0, 0.5, 0.5)), 4.0);
/// ```
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

    /// Makes the box between two corners.
    #[must_use]
    pub const fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// Makes the smallest box around `points`, sanitised. It is [`EMPTY`](Self::EMPTY) if there are
    /// no points or if any point has a NaN or infinite coordinate.
    #[must_use]
    #[inline]
    pub fn around(points: &[Vec3]) -> Self {
        let with_point = |b: Self, &p: &Vec3| Self { min: b.min.min(p), max: b.max.max(p) };
        if points.iter().all(|p| p.is_finite()) {
            points.iter().fold(Self::EMPTY, with_point).sanitized()
        } else {
            Self::EMPTY
        }
    }

    /// Returns the box as trees store it: [`EMPTY`](Self::EMPTY) unless it is finite and `min <=
    /// max` on every axis. Negative zeros become positive, so that minima and maxima have the same
    /// bits in any order and at any SIMD level.
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

    /// Returns whether no point is inside.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Returns the smallest box around both boxes.
    #[must_use]
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Returns the extent along each axis; 0 where `min` is above `max`.
    #[must_use]
    #[inline]
    pub fn extent(&self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// Returns half the surface area, `xy + yz + zx` of the extents; 0 for [`EMPTY`](Self::EMPTY).
    ///
    /// The area is infinite if it exceeds the range of `f32` (extents above about 1e19). It is NaN
    /// if one extent exceeds that range and another is 0. For such boxes use
    /// [`half_area_f64`](Self::half_area_f64).
    ///
    /// The order of operations is part of the contract: every SIMD level computes these bits.
    #[must_use]
    #[inline]
    pub fn half_area(&self) -> f32 {
        let e = self.extent();
        (e.x * e.y + e.y * e.z) + e.z * e.x
    }

    /// Returns half the surface area in double precision; finite for every finite box.
    #[must_use]
    #[inline]
    pub fn half_area_f64(&self) -> f64 {
        let e = (self.max.as_dvec3() - self.min.as_dvec3()).max(glam::DVec3::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// Returns the centre; each coordinate is finite for every finite box.
    #[must_use]
    #[inline]
    pub fn center(&self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Returns whether the boxes share a point (touching counts); false if either is empty.
    ///
    /// A NaN in `other` makes it false, too; a NaN in `self` counts for nothing.
    #[must_use]
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.max(other.min).cmple(self.max.min(other.max)).all()
    }

    /// Returns whether every point of `other` is inside; true if `other` is empty.
    #[must_use]
    #[inline]
    pub fn contains(&self, other: &Self) -> bool {
        other.is_empty() || (self.min.cmple(other.min).all() && other.max.cmple(self.max).all())
    }

    /// Returns the point of the box nearest to `point`: `point` itself if it is inside. Not finite
    /// if the box is [`EMPTY`](Self::EMPTY).
    #[must_use]
    #[inline]
    pub fn closest_point(&self, point: Vec3) -> Vec3 {
        point.max(self.min).min(self.max)
    }

    /// Returns the squared distance from `point` to the box: 0 inside, infinite from a finite point
    /// to [`EMPTY`](Self::EMPTY), NaN if `point` has a NaN.
    #[must_use]
    #[inline]
    pub fn distance_squared(&self, point: Vec3) -> f32 {
        point.distance_squared(self.closest_point(point))
    }

    /// Returns the box with each side moved outwards by `margin`, inwards if `margin` is negative:
    /// what a sphere of that radius must touch to touch the box.
    #[must_use]
    #[inline]
    pub fn grown(self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
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
    fn distances_are_those_to_the_closest_point() {
        let b = Aabb::new(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0));
        for (p, closest) in [
            (Vec3::new(0.5, 1.0, 2.0), Vec3::new(0.5, 1.0, 2.0)),
            (Vec3::new(-2.0, 1.0, 4.0), Vec3::new(0.0, 1.0, 3.0)),
            (Vec3::splat(9.0), b.max),
        ] {
            assert_eq!(b.closest_point(p), closest);
            assert_eq!(b.distance_squared(p), p.distance_squared(closest));
            assert_eq!(Aabb::EMPTY.distance_squared(p), f32::INFINITY);
        }
        assert!(b.distance_squared(Vec3::NAN).is_nan());
        assert_eq!(b.grown(1.0), Aabb::new(Vec3::splat(-1.0), Vec3::new(2.0, 3.0, 4.0)));
        assert!(b.grown(-0.6).is_empty() && Aabb::EMPTY.grown(5.0).is_empty());
    }

    #[test]
    fn a_point_that_is_not_finite_makes_the_box_empty() {
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
