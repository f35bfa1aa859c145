//! Primitives as builders move them about: box and number in 32 bytes, and hulls of many in SIMD lanes.

use bvh_core::glam::{Vec4, Vec4Swizzles};
use bvh_core::{Aabb, Primitives};
use rayon::prelude::*;

/// A primitive's box and number.
///
/// The fourth lane of `min` is the number with bit 30 set: as an `f32` it is then an ordinary one, neither
/// NaN nor denormal, so that arithmetic on whole vectors never stumbles over it. That of `max` is -infinity, so
/// that a maximum with it changes nothing.
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
            max: [max.x, max.y, max.z, f32::NEG_INFINITY],
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

    /// Twice the centre of the box; the fourth lane is of no meaning.
    #[inline]
    pub(crate) fn center(&self) -> Vec4 {
        Vec4::from_array(self.min) + Vec4::from_array(self.max)
    }

    /// One coordinate of [`center`](Self::center), with the same bits.
    #[inline]
    pub(crate) fn center_on(&self, axis: usize) -> f32 {
        self.min[axis & 3] + self.max[axis & 3]
    }

    #[inline]
    fn scale(&mut self, unit: f32) {
        for axis in 0..3 {
            self.min[axis] *= unit;
            self.max[axis] *= unit;
        }
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
    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub(crate) fn with_point(self, p: Vec4) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Half the surface area; not for empty hulls.
    #[inline]
    pub(crate) fn half_area(&self) -> f32 {
        let e = self.max - self.min;
        let p = e * e.yzxw();
        (p.x + p.y) + p.z
    }

    #[inline]
    pub(crate) fn aabb(&self) -> Aabb {
        Aabb::new(self.min.truncate(), self.max.truncate())
    }
}

/// Greatest absolute coordinate; infinite if any box is empty or not finite.
fn largest(items: &[Item]) -> f32 {
    let start = (Vec4::ZERO, Vec4::ZERO.cmple(Vec4::ZERO));
    let (size, ordered) = items.iter().fold(start, |(size, ordered), item| {
        let Hull { min, max } = item.hull();
        (size.max(min.abs()).max(max.abs()), ordered & min.cmple(max))
    });
    if ordered.bitmask() & 7 == 7 { size.truncate().max_element() } else { f32::INFINITY }
}

/// The primitives as builders want them, each list in the order of the numbers.
pub(crate) struct Items {
    /// Those with a box.
    pub(crate) boxed: Vec<Item>,
    /// Those that are dropped.
    pub(crate) dropped: Vec<Item>,
    /// Whether the boxes are those of the primitives, and not scaled.
    pub(crate) exact: bool,
}

/// Coordinates up to this are neither so large nor, if the largest is above its inverse, so small that areas leave
/// the range of `f32`.
const LARGE: f32 = (1u64 << 40) as f32;

/// Copies the primitives. Where all coordinates are tiny or some huge, they are scaled by a power of two, which
/// changes no decision but those that would drown in overflow or underflow.
pub(crate) fn gather<P: Primitives + ?Sized>(primitives: &P, parallel: bool) -> Items {
    let n = primitives.len();
    let item = |i| Item::new(primitives.aabb(i), i);
    let (mut boxed, mut size): (Vec<Item>, f32);
    if parallel {
        boxed = (0..n).into_par_iter().with_min_len(1024).map(item).collect();
        size = boxed.par_chunks(1024).map(largest).reduce(|| 0.0, f32::max);
    } else {
        boxed = (0..n).map(item).collect();
        size = largest(&boxed);
    }
    let mut dropped = Vec::new();
    if size == f32::INFINITY {
        (boxed, dropped) = boxed.into_iter().partition(|item| !item.hull().aabb().sanitized().is_empty());
        size = largest(&boxed);
    }
    let exact = size == 0.0 || (1.0 / LARGE..LARGE).contains(&size);
    if !exact {
        // The reciprocal of the power of two below `size`, or the largest there is.
        let unit = f32::from_bits((254 - (size.to_bits() >> 23)).clamp(1, 253) << 23);
        boxed.iter_mut().for_each(|item| item.scale(unit));
    }
    Items { boxed, dropped, exact }
}
