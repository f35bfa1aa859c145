//! Rays from one origin as a frustum: boxes that none of them can enter.
//!
//! ```text
//! z       along the axis that all rays follow best, in their direction; x and y along the two others
//! slopes  [s0, s1] contains dx / dz of every ray; the same for y
//! a box [x0, x1] x [y0, y1] x [z0, z1], relative to the origin, is missed if
//!   x1 < least(s0 z) or x0 > greatest(s1 z) for z in [z0, z1]; the same for y
//!   z1 < 0, or z0 lies beyond what any ray still looks for
//! ```
//!
//! `Frustum` and `Frame` test all of this, `Sides` the second line alone.
//!
//! Comparisons along x and y are widened by `SLACK`, far more than the rounding of any ray's own
//! box test, relative to the numbers compared. Those along z need no slack: each ray computes the
//! same differences times a reciprocal that is no less, and rounding is monotonic. So no ray enters
//! a box that is missed.

use bvh_core::{Aabb, Node, Vec3, slab};
use bytemuck::Zeroable;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use crate::simd::{Lanes, load, max, min};
use crate::wide::V;

/// The axis z that all rays of a wave follow, and the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    origin: Vec3,
    axes: [usize; 3],
    negative: bool,
    /// Reciprocal of the greatest extent of a direction along z.
    least_inverse: f32,
}

/// Bounds on the slopes of rays in a [`Frame`]: the least and the greatest along x and along y.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum(pub(crate) [[f32; 2]; 2]);

/// A box in a [`Frame`], relative to its origin: least and greatest x, y and z, the first two
/// widened.
pub(crate) type Outline<V> = [[V; 2]; 3];

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
    pub(crate) fn slopes<S: Simd, V: Lanes<S>>(&self, simd: S, direction: [V; 3]) -> [V; 2] {
        let [x, y, z] = self.axes;
        let inverse = V::simd_from(simd, if self.negative { -1.0 } else { 1.0 }) / direction[z];
        [direction[x] * inverse, direction[y] * inverse]
    }

    /// A box in this frame, for frusta within `frustum`.
    #[inline(always)]
    pub(crate) fn outline(&self, aabb: &Aabb, &Frustum(slopes): &Frustum) -> Outline<f32> {
        let (least, greatest) = (aabb.min - self.origin, aabb.max - self.origin);
        let [x, y, z] = self.axes;
        let [x, y, z] = [[least[x], greatest[x]], [least[y], greatest[y]], [least[z], greatest[z]]];
        let z = if self.negative { [-z[1], -z[0]] } else { z };
        let widen = |x: [f32; 2], slopes: [f32; 2]| {
            let steepest = f32::max(-slopes[0], slopes[1]).max(1.0);
            let slack = SLACK * (z[1].abs() * steepest + (x[0].abs() + x[1].abs())) + f32::MIN_POSITIVE;
            [x[0] - slack, x[1] + slack]
        };
        [widen(x, slopes[0]), widen(y, slopes[1]), z]
    }

    /// A lower bound on where rays enter the box; what they compute themselves is no less.
    #[inline(always)]
    pub(crate) fn enters(&self, &[_, _, z]: &Outline<f32>) -> f32 {
        // Zero times infinity is no bound.
        (z[0].max(0.0) * self.least_inverse).max(0.0)
    }
}

impl Frustum {
    pub(crate) const NONE: Self = Self([[f32::INFINITY, f32::NEG_INFINITY]; 2]);

    #[inline(always)]
    pub(crate) fn union(&self, other: &Self) -> Self {
        let ([x, y], [other_x, other_y]) = (self.0, other.0);
        let hull = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self([hull(x, other_x), hull(y, other_y)])
    }

    /// Whether an outline may be met.
    #[inline(always)]
    pub(crate) fn meets(&self, &[x, y, z]: &Outline<f32>) -> bool {
        let near = slab::max(z[0], 0.0);
        let misses = |[s0, s1]: [f32; 2], [x0, x1]: [f32; 2]| {
            x1 < slab::min(near * s0, z[1] * s0) || x0 > slab::max(near * s1, z[1] * s1)
        };
        !(z[1] < 0.0 || misses(self.0[0], x) || misses(self.0[1], y))
    }

    /// The bits of the outlines, in lanes, that [may be met](Self::meets).
    #[inline(always)]
    pub(crate) fn meets_lanes<S: Simd, V: Lanes<S>>(&self, simd: S, [x, y, z]: Outline<V>) -> u64 {
        let near = max(z[0], V::simd_from(simd, 0.0));
        let behind = z[1].simd_lt(0.0);
        (!(behind | misses(self.0[0], x, near, z[1]) | misses(self.0[1], y, near, z[1]))).to_bitmask()
    }
}

/// The sides of a [`Frustum`] as linear forms of the words of two siblings: a box is missed if for
/// any of its words `scale * word + slopes[0] * near + slopes[1] * far` exceeds the slack. `near`
/// and `far` are where it begins and ends along z; all is relative to the origin. Zeroed they are
/// unknown and miss nothing.
///
/// For words that bound nothing along x or y the origin is NaN, and so is the sum, which exceeds
/// nothing.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct Sides {
    origin: [f32; 16],
    scale: [f32; 16],
    slopes: [[f32; 16]; 2],
    /// The greatest magnitude of a slope, at least 1.
    steepest: f32,
    origin_z: f32,
    /// The words of a node in which its box begins and ends along z.
    ends: [usize; 2],
}

impl Sides {
    pub(crate) fn new(frame: &Frame, frustum: &Frustum) -> Self {
        let [x, y, z] = frame.axes;
        let (sign, ends) = if frame.negative { (-1.0, [z + 4, z]) } else { (1.0, [z, z + 4]) };
        let (origin, origin_z) = ([f32::NAN; 16], frame.origin[z]);
        let mut sides = Self { origin, origin_z, ends, steepest: 1.0, ..Self::zeroed() };
        for (axis, [least, greatest]) in [x, y].into_iter().zip(frustum.0) {
            for (word, scale, slope) in [(axis + 4, -1.0, least), (axis, 1.0, -greatest)] {
                sides.steepest = sides.steepest.max(slope.abs());
                // The end at which the sum is less.
                let end = usize::from(slope < 0.0);
                for lane in [word, word + 8] {
                    (sides.origin[lane], sides.scale[lane]) = (frame.origin[axis], scale);
                    sides.slopes[end][lane] = sign * slope;
                }
            }
        }
        sides
    }

    pub(crate) fn are_unknown(&self) -> bool {
        self.steepest == 0.0
    }

    /// Which of two siblings may be met: bit 0 the left, bit 1 the right.
    #[inline(always)]
    pub(crate) fn meet<S: Simd>(&self, simd: S, siblings: &[Node; 2]) -> u32 {
        let words: &[f32; 16] = bytemuck::cast_ref(siblings);
        // With the mask the compiler knows that the index is in range.
        let along = |word: usize| {
            let [l, r] = [words[word & 7], words[word & 7 | 8]];
            simd.combine_f32x8(f32x8::splat(simd, l), f32x8::splat(simd, r)) - self.origin_z
        };
        let [near, far] = [along(self.ends[0]), along(self.ends[1])];
        let lanes = |from: &[f32; 16]| load::<S, V<S>, 16>(simd, from, 0);
        let across = (lanes(words) - lanes(&self.origin)) * lanes(&self.scale);
        let outside = across + near * lanes(&self.slopes[0]) + far * lanes(&self.slopes[1]);
        let size = across.abs() + (near.abs() + far.abs()) * self.steepest;
        let missed = outside.simd_gt(size * SLACK + f32::MIN_POSITIVE).to_bitmask() as u32;
        u32::from(missed & 0xff == 0) | u32::from(missed & 0xff00 == 0) << 1
    }
}

#[inline(always)]
fn misses<S: Simd, V: Lanes<S>>(slopes: [f32; 2], x: [V; 2], near: V, far: V) -> V::Mask {
    let least = min(near * slopes[0], far * slopes[0]);
    let greatest = max(near * slopes[1], far * slopes[1]);
    x[1].simd_lt(least) | x[0].simd_gt(greatest)
}

#[cfg(test)]
mod tests {
    use bvh_core::{Ray, SimdLevel};

    use super::*;
    use crate::random::uniform;
    use crate::simd::{detected, dispatch};

    /// Whether an outline in all lanes is met; all lanes have to agree.
    fn meets_in_lanes<S: Simd>(simd: S, frustum: &Frustum, outline: &Outline<f32>) -> bool {
        let lanes = outline.map(|ends| ends.map(|end| S::f32s::simd_from(simd, end)));
        let met = frustum.meets_lanes(simd, lanes);
        assert!(met == 0 || met == (1 << S::f32s::LEN) - 1, "{met:b}");
        met != 0
    }

    /// Whether a box is met, as the left and as the right of two siblings. Links are odd as
    /// numbers.
    fn sides_meet<S: Simd>(simd: S, sides: &Sides, aabb: Aabb, surely_met: Aabb) -> bool {
        let meet = |siblings: [Aabb; 2]| {
            let mut words: [f32; 16] = bytemuck::cast(siblings.map(|aabb| Node::leaf(aabb, 0, 1)));
            [words[3], words[7], words[11], words[15]] = [f32::NAN, f32::INFINITY, f32::MIN, 1e-45];
            sides.meet(simd, bytemuck::cast_ref(&words))
        };
        let [left, right] = [meet([aabb, surely_met]), meet([surely_met, aabb])];
        assert!(left & 2 == 2 && right & 1 == 1 && left & 1 == right >> 1, "{left} {right}: {aabb:?}");
        left & 1 == 1
    }

    #[test]
    fn boxes_are_missed_only_if_every_ray_misses() {
        for slopes in [[[-0.4, 0.2], [-0.1, 0.3]], [[0.1, 0.7], [-0.6, -0.1]], [[0.0, 0.5], [-0.5, 0.0]]] {
            for (axis, sign) in [(0, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
                check_frustum(slopes, axis, sign);
            }
        }
    }

    fn check_frustum(slopes: [[f32; 2]; 2], axis: usize, sign: f32) {
        let origin = Vec3::new(0.3, -0.2, 0.1);
        let [x, y] = slopes;
        let corners = [[x[0], y[0]], [x[1], y[0]], [x[0], y[1]], [x[1], y[1]]];
        let (across, up) = ((axis + 1) % 3, (axis + 2) % 3);
        let along = |[x, y]: [f32; 2]| {
            let mut d = Vec3::ZERO;
            (d[across], d[up], d[axis]) = (x, y, sign);
            d
        };
        let rays = corners.map(along);
        let least = rays.iter().fold(Vec3::INFINITY, |a, &d| a.min(d));
        let greatest = rays.iter().fold(Vec3::NEG_INFINITY, |a, &d| a.max(d));
        let frame = Frame::new(origin, least, greatest).expect("an axis");
        let (frustum, middle) = (Frustum(slopes), origin + along(slopes.map(|s| 0.5 * (s[0] + s[1]))));
        let (sides, in_it) = (Sides::new(&frame, &frustum), Aabb::new(middle - 0.3, middle + 0.3));
        // Boxes ahead that are missed, as outlines and by the sides.
        let mut missed = [0; 2];
        // Whether a box is met, and whether one of many rays inside the frustum enters it.
        let mut check = |aabb: Aabb| {
            let entered = (0..81).any(|i| {
                let mix = |[a, b]: [f32; 2], i: usize| a + (b - a) * i as f32 / 8.0;
                let d = along([mix(x, i % 9), mix(y, i / 9)]);
                slab::enters(&Ray::new(origin, d), &aabb, 4.0, Ray::WIDEN).is_some()
            });
            let outline = frame.outline(&aabb, &frustum);
            let meets = frustum.meets(&outline);
            for level in SimdLevel::available() {
                let in_lanes = dispatch!(detected(level), simd => meets_in_lanes(simd, &frustum, &outline));
                assert_eq!(in_lanes, meets, "{level:?}: {aabb:?}");
                let met = dispatch!(detected(level), simd => sides_meet(simd, &sides, aabb, in_it));
                assert!(met || !entered, "{level:?}: {aabb:?}");
                assert!(dispatch!(detected(level), simd => sides_meet(simd, &Sides::zeroed(), aabb, in_it)));
                if outline[2][0] > 0.0 {
                    missed = [missed[0] + u32::from(!meets), missed[1] + u32::from(!met)];
                }
            }
            let meets = meets && frame.enters(&outline) <= 4.0;
            assert!(meets || !entered, "{aabb:?}");
            (meets, entered)
        };
        let mut counts = [0; 3];
        for n in 0..4000u32 {
            let at = |k: u64| uniform(n.into(), k) * 10.0 - 5.0;
            let center = Vec3::new(at(0), at(1), at(2));
            let (meets, _) = check(Aabb::new(center - 0.3, center + 0.3));
            counts[usize::from(meets)] += 1;
            // A box that begins on an edge of the frustum, or a rounding from there.
            let corner = corners[n as usize % 4];
            let start = origin + along(corner) * (0.1 + at(3).abs());
            let mut out = Vec3::splat(0.3);
            (out[across], out[up]) = (0.3 * corner[0].signum(), 0.3 * corner[1].signum());
            let (_, entered) = check(Aabb::new(start.min(start + out), start.max(start + out)));
            counts[2] += u32::from(entered);
        }
        assert!(!check(Aabb::EMPTY).0);
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -0.0, 1e-45] {
            for word in 0..6 {
                let mut planes = [-0.3, -0.3, -0.3, 0.3, 0.3, 0.3];
                planes[word] = odd;
                let [min, max] = [0, 3].map(|i| middle + Vec3::from_slice(&planes[i..i + 3]));
                check(Aabb::new(min, max));
            }
        }
        assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
        assert!(missed[1] > 50 && 100 * missed[1] >= 99 * missed[0], "{missed:?}");
    }
}
