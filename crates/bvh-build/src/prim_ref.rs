//! Primitives as builders move them about: box and number in 32 bytes, and boxes of many in SIMD
//! lanes.

use bvh_core::glam::{Vec4, Vec4Swizzles};
use bvh_core::{Aabb, Primitives, Vec3};
use rayon::prelude::*;

/// A primitive's box and number.
///
/// The fourth lane of `min` is the number with bit 30 set: as an `f32` it is then an ordinary one,
/// neither NaN nor denormal, so that arithmetic on whole vectors never stumbles over it. That of
/// `max` is -infinity, so that a maximum with it changes nothing.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(crate) struct PrimRef {
    min: Vec4,
    max: Vec4,
}

const MARK: u32 = 1 << 30;

impl PrimRef {
    /// Fills memory that is yet to be used.
    pub(crate) const NOTHING: Self = Self { min: Vec4::ZERO, max: Vec4::ZERO };

    /// With the corners of the box in the first three lanes each.
    #[inline]
    fn new([min, max]: [Vec4; 2], number: usize) -> Self {
        Self { min: min.with_w(f32::from_bits(number as u32 | MARK)), max: max.with_w(f32::NEG_INFINITY) }
    }

    /// A primitive; its box is infinite where it has none.
    #[inline]
    fn of<P: Primitives + ?Sized>(primitives: &P, i: usize) -> Self {
        let [min, max, validity] = primitives.aabb_lanes(i);
        // Zero times a number that is not finite is NaN.
        if (validity * 0.0).is_nan_mask().bitmask() & 0b111 == 0 {
            return Self::new([min, max], i);
        }
        let aabb = primitives.aabb(i);
        let none = aabb.is_empty();
        let corner =
            |v: Vec3, sign: f32| if none { Vec4::splat(sign * f32::INFINITY) } else { v.extend(0.0) };
        Self::new([corner(aabb.min, -1.0), corner(aabb.max, 1.0)], i)
    }

    /// A cluster of up to 32 primitives, with their number in the fourth lane of `max`. As a float
    /// that is far below 1, so a sum or maximum of counts in that lane does not see it.
    #[inline]
    pub(crate) fn cluster(bounds: Bounds, number: u32, size: u32) -> Self {
        Self {
            min: bounds.min.with_w(f32::from_bits(number | MARK)),
            max: bounds.max.with_w(f32::from_bits(size)),
        }
    }

    /// Number of primitives in a cluster.
    #[inline]
    pub(crate) fn size(&self) -> u32 {
        self.max.w.to_bits()
    }

    #[inline]
    pub(crate) fn number(&self) -> u32 {
        self.min.w.to_bits() & !MARK
    }

    #[inline]
    pub(crate) fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max }
    }

    /// Twice the centre of the box; the fourth lane is of no meaning.
    #[inline]
    pub(crate) fn center(&self) -> Vec4 {
        self.min + self.max
    }

    /// One coordinate of [`center`](Self::center), with the same bits.
    #[inline]
    pub(crate) fn center_on(&self, axis: usize) -> f32 {
        let [min, max]: [&[f32; 4]; 2] = [self.min.as_ref(), self.max.as_ref()];
        min[axis & 3] + max[axis & 3]
    }

    #[inline]
    fn scale(&mut self, unit: f32) {
        let scale = |v: Vec4| (v * unit).with_w(v.w);
        (self.min, self.max) = (scale(self.min), scale(self.max));
    }
}

/// A box in SIMD lanes; the fourth lanes are of no meaning.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) min: Vec4,
    pub(crate) max: Vec4,
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { min: Vec4::INFINITY, max: Vec4::NEG_INFINITY };

    #[inline]
    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub(crate) fn with_point(self, p: Vec4) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Half the surface area; not for empty boxes.
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

/// What a builder needs to know of all primitives.
#[derive(Clone, Copy)]
struct Summary {
    /// Bounds of the origin and of all boxes; infinite if any of these is.
    all: Bounds,
    /// Bounds of the centres.
    centers: Bounds,
}

impl Summary {
    const NOTHING: Self = Self { all: Bounds { min: Vec4::ZERO, max: Vec4::ZERO }, centers: Bounds::EMPTY };

    #[inline]
    fn with(self, prim: &PrimRef) -> Self {
        Self { all: self.all.union(prim.bounds()), centers: self.centers.with_point(prim.center()) }
    }

    fn and(self, other: Self) -> Self {
        Self { all: self.all.union(other.all), centers: self.centers.union(other.centers) }
    }

    fn of(prims: &[PrimRef]) -> Self {
        prims.iter().fold(Self::NOTHING, Self::with)
    }

    /// Greatest absolute coordinate.
    fn largest(&self) -> f32 {
        self.all.min.abs().max(self.all.max.abs()).truncate().max_element()
    }
}

/// The primitives as builders want them, each list in the order of the numbers.
pub(crate) struct Gathered {
    /// Bounds of the centres of those that have a box.
    pub(crate) centers: Bounds,
    /// Whether the boxes are those of the primitives, and not scaled.
    pub(crate) exact: bool,
}

/// Coordinates up to this are neither so large nor, if the largest is above its inverse, so small
/// that areas leave the range of `f32`.
const LARGE: f32 = (1u64 << 40) as f32;

/// Fewest primitives for a task to copy.
// Half and double: docs/TUNING.md.
const PART: usize = 4096;

/// Copies the primitives: to `boxed` those with a box, to `dropped` the others. Where all
/// coordinates are tiny or some huge, they are scaled by a power of two, which changes no decision
/// but those that would drown in overflow or underflow.
pub(crate) fn gather<P: Primitives + ?Sized>(
    primitives: &P,
    n: usize,
    boxed: &mut Vec<PrimRef>,
    dropped: &mut Vec<PrimRef>,
    threads: usize,
) -> Gathered {
    dropped.clear();
    crate::lists::make_room(boxed, n, PrimRef::NOTHING, threads);
    let mut all = if threads > 1 && n > PART {
        let parts = boxed.par_chunks_mut(PART).enumerate();
        parts.map(|(i, part)| copy(primitives, i * PART, part)).reduce(|| Summary::NOTHING, Summary::and)
    } else {
        copy(primitives, 0, boxed)
    };
    if all.largest() == f32::INFINITY {
        boxed.retain(|prim| {
            let drop = prim.bounds().aabb().sanitized().is_empty();
            if drop {
                dropped.push(PrimRef::new([Bounds::EMPTY.min, Bounds::EMPTY.max], prim.number() as usize));
            }
            !drop
        });
        all = Summary::of(boxed);
    }
    let size = all.largest();
    let exact = size == 0.0 || (1.0 / LARGE..LARGE).contains(&size);
    if !exact {
        // The reciprocal of the power of two below `size`, or the largest there is.
        let unit = f32::from_bits((254 - (size.to_bits() >> 23)).clamp(1, 253) << 23);
        boxed.iter_mut().for_each(|prim| prim.scale(unit));
        all = Summary::of(boxed);
    }
    Gathered { centers: all.centers, exact }
}

/// Copies as many primitives as there are primitives, from number `first` on.
// Not inlined into what shares it out, where the compiler keeps less of it in registers.
#[inline(never)]
fn copy<P: Primitives + ?Sized>(primitives: &P, first: usize, prims: &mut [PrimRef]) -> Summary {
    let mut all = Summary::NOTHING;
    for (prim, i) in prims.iter_mut().zip(first..) {
        *prim = PrimRef::of(primitives, i);
        all = all.with(prim);
    }
    all
}
