//! Where a ray meets a triangle.

use std::ops::{Add, Mul};

/// Where a ray meets a triangle with corners A, B and C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in multiples of the length of the ray's direction, at least 0 and finite.
    pub t: f32,
    /// Weight of B: the point is `(1 - u - v) A + u B + v C`.
    pub u: f32,
    /// Weight of C.
    pub v: f32,
    /// Number of the triangle.
    pub primitive: u32,
}

impl Hit {
    /// Returns the barycentric weights of A, B and C. Their sum is 1 up to rounding.
    #[must_use]
    #[inline]
    pub fn weights(&self) -> [f32; 3] {
        [1.0 - self.u - self.v, self.u, self.v]
    }

    /// Interpolates values given at A, B and C: positions, normals, texture coordinates, colours.
    ///
    /// ```
    /// use bvh_core::{Hit, Vec3};
    ///
    /// let hit = Hit { t: 2.0, u: 0.25, v: 0.5, primitive: 0 };
    /// assert_eq!(hit.weights(), [0.25, 0.25, 0.5]);
    /// assert_eq!(hit.interpolate([Vec3::ZERO, Vec3::X * 4.0, Vec3::Y]), Vec3::new(1.0, 0.5, 0.0));
    /// assert_eq!(hit.interpolate([0.0, 4.0, 8.0]), 5.0);
    /// ```
    #[must_use]
    #[inline]
    pub fn interpolate<T: Mul<f32, Output = T> + Add<Output = T>>(&self, [a, b, c]: [T; 3]) -> T {
        let [wa, wb, wc] = self.weights();
        a * wa + b * wb + c * wc
    }

    /// Returns whether this hit comes before one at `t`: nearer, or as near and of a lower number.
    #[must_use]
    #[inline]
    pub fn is_before(&self, t: f32, primitive: u32) -> bool {
        self.t < t || (self.t == t && self.primitive < primitive)
    }
}
