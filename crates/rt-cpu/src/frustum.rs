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
//! Each comparison is widened by `SLACK`, far more than the rounding of any ray's own box test,
//! relative to the numbers compared. So no ray enters a box that is missed.

use bvh_core::{Aabb, Node, Vec3};
use bytemuck::Zeroable;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use crate::simd::{Lanes, load, max, min};
use crate::wide;

/// The axis z that all rays of a bundle follow, and the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) origin: Vec3,
    axes: [usize; 3],
    negative: bool,
    /// Reciprocal of the greatest extent of a direction along z.
    least_inverse: f32,
}

/// Bounds on the slopes of rays in a [`Frame`]: the least and the greatest along x and along y.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum(pub(crate) [[f32; 2]; 2]);

/// A box in a [`Frame`], relative to its origin and widened: least and greatest x, y and z.
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
            let slack = SLACK * (z[1].abs() * steepest + (x[0].abs() + x[1].abs()));
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

    /// The bits of the outlines, in lanes, that may be met.
    #[inline(always)]
    pub(crate) fn meets<S: Simd, V: Lanes<S>>(&self, simd: S, [x, y, z]: Outline<V>) -> u64 {
        let near = max(z[0], V::simd_from(simd, 0.0));
        let behind = z[1].simd_lt(0.0);
        (!(behind | misses(self.0[0], x, near, z[1]) | misses(self.0[1], y, near, z[1]))).to_bitmask()
    }
}

#[inline(always)]
fn misses<S: Simd, V: Lanes<S>>(slopes: [f32; 2], x: [V; 2], near: V, far: V) -> V::Mask {
    let least = min(near * slopes[0], far * slopes[0]);
    let greatest = max(near * slopes[1], far * slopes[1]);
    x[1].simd_lt(least) | x[0].simd_gt(greatest)
}

/// A [`Frustum`] as linear forms of the words of two siblings: a box is missed if for any of its
/// words `a * scale + b * slope - limit` exceeds the slack. Relative to the origin, `a` is the word
/// and `b` is where the box begins or ends along z. Zeroed it misses nothing.
///
/// Two words of a node are no coordinates. There the origin is infinite: the sum is NaN, which
/// exceeds nothing.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct FrustumPlanes {
    origin: [f32; 16],
    scale: [f32; 16],
    slope: [f32; 16],
    /// The greater of `|slope|` and 1; 0 where there is no `b`.
    weight: [f32; 16],
    limit: [f32; 16],
    /// 1 where `b` is the end along z, 0 where it is the beginning.
    ends: [f32; 16],
    origin_z: f32,
    /// The word of a node in which its box begins along z; it ends in word `near ^ 4`.
    near: usize,
}

impl FrustumPlanes {
    /// The frustum of rays that look for hits up to `t_max`.
    #[inline(always)]
    pub(crate) fn new(frame: &Frame, frustum: &Frustum, t_max: f32) -> Self {
        let [x, y, z] = frame.axes;
        let (sign, near) = if frame.negative { (-1.0, z + 4) } else { (1.0, z) };
        let [[x0, x1], [y0, y1]] = frustum.0;
        let mut planes =
            Self { origin: [f32::INFINITY; 16], origin_z: frame.origin[z], near, ..Self::zeroed() };
        for (word, scale, slope, ends, has_b) in [
            (x + 4, -1.0, x0 * sign, x0 <= 0.0, true),
            (x, 1.0, -x1 * sign, x1 > 0.0, true),
            (y + 4, -1.0, y0 * sign, y0 <= 0.0, true),
            (y, 1.0, -y1 * sign, y1 > 0.0, true),
            (near ^ 4, -sign, 0.0, false, false),
            (near, sign * frame.least_inverse, 0.0, false, false),
        ] {
            for lane in [word, word + 8] {
                planes.origin[lane] = frame.origin[word & 3];
                planes.scale[lane] = scale;
                planes.slope[lane] = slope;
                planes.weight[lane] = if has_b { slope.abs().max(1.0) } else { 0.0 };
                planes.ends[lane] = if ends { 1.0 } else { 0.0 };
            }
        }
        planes.look_up_to(t_max);
        planes
    }

    /// Rays no longer look for hits beyond `t_max`.
    #[inline(always)]
    pub(crate) fn look_up_to(&mut self, t_max: f32) {
        self.limit[self.near & 7] = t_max;
        self.limit[self.near & 7 | 8] = t_max;
    }

    /// Which of two siblings may be met: bit 0 the left, bit 1 the right.
    #[inline(always)]
    pub(crate) fn meets<S: Simd>(&self, simd: S, pair: &[Node; 2]) -> u32 {
        let words: &[f32; 16] = bytemuck::cast_ref(pair);
        // With the mask the compiler knows that the index is in range.
        let both = |word: usize| {
            let [l, r] = [words[word & 7], words[word & 7 | 8]];
            simd.combine_f32x8(f32x8::splat(simd, l), f32x8::splat(simd, r))
        };
        let a = (lanes(simd, words) - lanes(simd, &self.origin)) * lanes(simd, &self.scale);
        let ends = lanes(simd, &self.ends).simd_gt(0.0);
        let b = ends.select(both(self.near ^ 4), both(self.near)) - self.origin_z;
        let outside = a + b * lanes(simd, &self.slope) - lanes(simd, &self.limit);
        let size = a.abs() + b.abs() * lanes(simd, &self.weight);
        let missed = outside.simd_gt(size * SLACK + f32::MIN_POSITIVE).to_bitmask() as u32;
        u32::from(missed & 0xff == 0) | u32::from(missed & 0xff00 == 0) << 1
    }
}

#[inline(always)]
fn lanes<S: Simd>(simd: S, numbers: &[f32; 16]) -> wide::V<S> {
    load(simd, numbers, 0)
}

#[cfg(test)]
mod tests {
    use bvh_core::{Ray, SimdLevel, slab};

    use super::*;
    use crate::simd::detected;

    /// Links that are NaN, infinite or tiny as numbers.
    #[test]
    fn words_that_are_no_coordinates_do_not_count() {
        let frame = Frame::new(Vec3::ZERO, Vec3::new(-0.5, -0.5, 1.0), Vec3::new(0.5, 0.5, 1.0));
        let planes = FrustumPlanes::new(&frame.expect("an axis"), &Frustum([[-0.5, 0.5]; 2]), 4.0);
        for (z, expected) in [(2.0, 3), (9.0, 0), (-9.0, 0)] {
            let aabb = Aabb::new(Vec3::new(-0.1, -0.1, z), Vec3::new(0.1, 0.1, z + 0.1));
            for link in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -0.0, 1e-45] {
                let mut words: [f32; 16] = bytemuck::cast([Node::leaf(aabb, 0, 1); 2]);
                for word in [3, 7, 11, 15] {
                    words[word] = link;
                }
                let pair: [Node; 2] = bytemuck::cast(words);
                for level in SimdLevel::available() {
                    let meets = crate::simd::dispatch!(detected(level), simd => planes.meets(simd, &pair));
                    assert_eq!(meets, expected, "{link} at {z}");
                }
            }
        }
    }

    #[test]
    fn boxes_are_missed_only_if_every_ray_misses() {
        let origin = Vec3::new(0.3, -0.2, 0.1);
        let corners = [[-0.4, -0.1], [0.2, -0.1], [-0.4, 0.3], [0.2, 0.3]];
        for (axis, sign) in [(0, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
            let along = |[x, y]: [f32; 2]| {
                let mut d = Vec3::ZERO;
                (d[(axis + 1) % 3], d[(axis + 2) % 3], d[axis]) = (x, y, sign);
                d
            };
            let rays = corners.map(along);
            let least = rays.iter().fold(Vec3::INFINITY, |a, &d| a.min(d));
            let greatest = rays.iter().fold(Vec3::NEG_INFINITY, |a, &d| a.max(d));
            let frame = Frame::new(origin, least, greatest).expect("an axis");
            let frustum = Frustum([[-0.4, 0.2], [-0.1, 0.3]]);
            let planes = FrustumPlanes::new(&frame, &frustum, 4.0);
            let (mut met, mut missed) = (0, 0);
            for n in 0..4000u32 {
                let at = |k: u32| {
                    (n.wrapping_mul(2_654_435_761).wrapping_add(k * 40_503) % 1000) as f32 / 100.0 - 5.0
                };
                let center = Vec3::new(at(1), at(2 + n), at(3 + 7 * n));
                let aabb = Aabb::new(center - 0.3, center + 0.3);
                // Rays densely inside the frustum.
                let entered = (0..81).any(|i| {
                    let mix = |a: f32, b: f32, i: usize| a + (b - a) * i as f32 / 8.0;
                    let d = along([mix(-0.4, 0.2, i % 9), mix(-0.1, 0.3, i / 9)]);
                    slab::enters(&Ray::new(origin, d), &aabb, 4.0, Ray::WIDEN).is_some()
                });
                let pair = [Node::leaf(aabb, 0, 1), Node::leaf(Aabb::EMPTY, 1, 1)];
                for level in SimdLevel::available() {
                    let meets = crate::simd::dispatch!(detected(level), simd => planes.meets(simd, &pair));
                    assert!(meets & 1 == 1 || !entered, "{aabb:?}");
                    (met, missed) = (met + (meets & 1), missed + (1 - (meets & 1)));
                }
            }
            assert!(met > 50 && missed > 50, "{met} {missed}");
        }
    }
}
