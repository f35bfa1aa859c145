//! Primitives as builders move them about: box and number in 32 bytes, and hulls of many in SIMD lanes.

use bvh_core::glam::{Vec4, Vec4Swizzles};
use bvh_core::{Aabb, Primitives};
use rayon::prelude::*;

/// A primitive's box and number.
///
/// The fourth lane of `min` is the number with bit 30 set: as an `f32` it is then an ordinary one, neither
/// NaN nor denormal, so that arithmetic on whole vectors never stumbles over it.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(crate) struct Item {
    min: [f32; 4],
    max: [f32; 4],
}

const MARK: u32 = 1 << 30;

impl Item {
    #[inline]
    fn new(aabb: Aabb, number: usize) -> Self {
        let (min, max) = (aabb.min, aabb.max);
        Self {
            min: [min.x, min.y, min.z, f32::from_bits(number as u32 | MARK)],
            max: [max.x, max.y, max.z, 0.0],
        }
    }

    #[inline]
    pub(crate) fn number(&self) -> u32 {
        self.min[3].to_bits() & !MARK
    }

    #[inline]
    pub(crate) fn hull(&self) -> Hull {
        Hull { min: Vec4::from_array(self.min), max: Vec4::from_array(self.max) }
    }

    /// Half the centre of the box, which keeps differences of centres within the range of `f32`; the fourth
    /// lane is of no meaning.
    #[inline]
    pub(crate) fn center(&self) -> Vec4 {
        Vec4::from_array(self.min) * 0.25 + Vec4::from_array(self.max) * 0.25
    }

    /// One coordinate of [`center`](Self::center), with the same bits.
    #[inline]
    pub(crate) fn center_on(&self, axis: usize) -> f32 {
        self.min[axis & 3] * 0.25 + self.max[axis & 3] * 0.25
    }
}

/// A box in SIMD lanes; the fourth lanes are of no meaning.
#[derive(Clone, Copy)]
pub(crate) struct Hull {
    pub(crate) min: Vec4,
    pub(crate) max: Vec4,
}

impl Hull {
    pub(crate) const EMPTY: Self = Self { min: Vec4::INFINITY, max: Vec4::NEG_INFINITY };

    #[inline]
    pub(crate) fn of(items: &[Item]) -> Self {
        items.iter().fold(Self::EMPTY, |hull, item| hull.union(item.hull()))
    }

    #[inline]
    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub(crate) fn with_point(self, p: Vec4) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Half the surface area with all lengths multiplied by `unit`. Not for empty hulls.
    #[inline]
    pub(crate) fn half_area(&self, unit: f32) -> f32 {
        let e = self.max * unit - self.min * unit;
        let p = e * e.yzxw();
        (p.x + p.y) + p.z
    }

    /// The power of two that brings the longest edge near 1, so that areas of and within this hull neither
    /// overflow nor vanish.
    #[inline]
    pub(crate) fn unit(&self) -> f32 {
        let exponent = (self.max * 0.5 - self.min * 0.5).truncate().max_element().to_bits() >> 23;
        f32::from_bits((253 - exponent.min(252)) << 23)
    }

    #[inline]
    pub(crate) fn aabb(&self) -> Aabb {
        Aabb::new(self.min.truncate(), self.max.truncate())
    }
}

/// Copies the primitives: those with a box, then those that are dropped, each in the order of their numbers.
pub(crate) fn gather<P: Primitives + ?Sized>(primitives: &P, parallel: bool) -> (Vec<Item>, Vec<Item>) {
    let n = primitives.len();
    let item = |i| Item::new(primitives.aabb(i), i);
    let items: Vec<Item> = if parallel {
        (0..n).into_par_iter().with_min_len(1024).map(item).collect()
    } else {
        (0..n).map(item).collect()
    };
    let dropped = |item: &Item| item.hull().aabb().is_empty();
    if items.iter().any(dropped) {
        items.into_iter().partition(|item| !dropped(item))
    } else {
        (items, Vec::new())
    }
}
