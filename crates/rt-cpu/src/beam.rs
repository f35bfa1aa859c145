//! Rays from one origin as a bundle: what none of them can meet.

use bvh_core::{Aabb, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::simd::{Lanes, max, min};

/// An axis along which all rays of a bundle go the same way, and the coordinates that go with it: `z` along it, in
/// the direction of the rays, `x` and `y` along the two others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) origin: Vec3,
    axes: [usize; 3],
    negative: bool,
    /// Reciprocal of the greatest extent of a direction along the axis.
    least_inverse: f32,
}

/// Bounds on the slopes of rays in a [`Frame`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    pub(crate) x: [f32; 2],
    pub(crate) y: [f32; 2],
}

/// A box in a [`Frame`], relative to its origin.
///
/// Widened by far more than the rounding of any ray's own box test, relative to all that goes into it; so a
/// beam that misses it has no ray that enters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outline {
    pub(crate) x: [f32; 2],
    pub(crate) y: [f32; 2],
    pub(crate) z: [f32; 2],
}

const SLACK: f32 = 1.0 / (1 << 17) as f32;

impl Frame {
    /// For directions with these least and greatest coordinates: the best axis, if there is any.
    pub(crate) fn new(origin: Vec3, least: Vec3, greatest: Vec3) -> Option<Self> {
        let nearest = |k: usize| f32::max(least[k], -greatest[k]);
        let k = (0..3).max_by(|&a, &b| nearest(a).total_cmp(&nearest(b)))?;
        let negative = greatest[k] < 0.0;
        let reach = if negative { -least[k] } else { greatest[k] };
        // Slopes must not be so steep that their rounding matters.
        (nearest(k) > 1e-3 * greatest.max(-least).max_element()).then(|| Self {
            origin,
            axes: [(k + 1) % 3, (k + 2) % 3, k],
            negative,
            least_inverse: 1.0 / reach,
        })
    }

    /// Slopes of directions.
    #[inline(always)]
    pub(crate) fn slopes<S: Simd, V: Lanes<S>>(&self, direction: [V; 3]) -> [V; 2] {
        let [x, y, z] = self.axes;
        let z = if self.negative { -direction[z] } else { direction[z] };
        [direction[x] / z, direction[y] / z]
    }

    /// A box in this frame, for beams within `beam`.
    #[inline(always)]
    pub(crate) fn outline(&self, aabb: &Aabb, beam: &Beam) -> Outline {
        let (least, greatest) = (aabb.min - self.origin, aabb.max - self.origin);
        let [x, y, z] = self.axes;
        let [x, y, z] = [[least[x], greatest[x]], [least[y], greatest[y]], [least[z], greatest[z]]];
        let z = if self.negative { [-z[1], -z[0]] } else { z };
        let widen = |x: [f32; 2], slopes: [f32; 2]| {
            let steepest = f32::max(-slopes[0], slopes[1]).max(1.0);
            let slack = SLACK * (z[1].abs() * steepest + (x[0].abs() + x[1].abs()));
            [x[0] - slack, x[1] + slack]
        };
        Outline { x: widen(x, beam.x), y: widen(y, beam.y), z }
    }

    /// A lower bound on where rays enter the box; what they compute themselves is no less.
    #[inline(always)]
    pub(crate) fn enters(&self, outline: &Outline) -> f32 {
        outline.z[0].max(0.0) * self.least_inverse
    }
}

impl Beam {
    pub(crate) const NONE: Self =
        Self { x: [f32::INFINITY, f32::NEG_INFINITY], y: [f32::INFINITY, f32::NEG_INFINITY] };

    #[inline(always)]
    pub(crate) fn union(&self, other: &Self) -> Self {
        let hull = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self { x: hull(self.x, other.x), y: hull(self.y, other.y) }
    }

    /// False only if no ray enters.
    #[inline(always)]
    pub(crate) fn meets(&self, outline: &Outline) -> bool {
        let z = [outline.z[0].max(0.0), outline.z[1]];
        // False where something is NaN.
        let misses = |slopes: [f32; 2], x: [f32; 2]| {
            let least = f32::min(z[0] * slopes[0], z[1] * slopes[0]);
            let greatest = f32::max(z[0] * slopes[1], z[1] * slopes[1]);
            (x[1] < least) | (x[0] > greatest)
        };
        (outline.z[1] >= 0.0) & !misses(self.x, outline.x) & !misses(self.y, outline.y)
    }

    /// [`meets`](Self::meets) for boxes in lanes: the bits of those that may be met.
    #[inline(always)]
    pub(crate) fn meets_lanes<S: Simd, V: Lanes<S>>(&self, simd: S, x: [V; 2], y: [V; 2], z: [V; 2]) -> u64 {
        let near = max(z[0], V::simd_from(simd, 0.0));
        let behind = z[1].simd_lt(0.0);
        (!(behind | misses(self.x, x, near, z[1]) | misses(self.y, y, near, z[1]))).to_bitmask()
    }
}

#[inline(always)]
fn misses<S: Simd, V: Lanes<S>>(slopes: [f32; 2], x: [V; 2], near: V, far: V) -> V::Mask {
    let least = min(near * slopes[0], far * slopes[0]);
    let greatest = max(near * slopes[1], far * slopes[1]);
    x[1].simd_lt(least) | x[0].simd_gt(greatest)
}
