//! The kernels in AVX2. A register holds one node where boxes are refitted, and a coordinate of
//! eight nodes where rotations are judged.
//!
//! A node's eight words are `[min.x min.y min.z link | max.x max.y max.z aux]`. Sums and products
//! are taken in the order of `Aabb::half_area` and without fused multiply-add, so the bits are
//! those of the scalar kernels.

use std::arch::x86_64::*;
use std::ops::Range;

use bvh_core::{Primitives, rotation::NO_GAIN};

use super::block::{Block, Entry, Leaves, Lister};
use super::kernels;
use super::rotations::{self, Accepted, BestRotations, Boxes, define_rotate};
use super::shared::{PairAt, SharedNodes};
use super::{Tally, scalar};

/// See [`Block::walk`].
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline(never)]
pub(super) fn walk(block: &mut Block, nodes: SharedNodes<'_>, roots: &[Entry], leaves: &mut Leaves) {
    scalar::walk(block, nodes, roots, leaves);
}

/// See [`scalar::sweep`].
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline(never)]
pub(super) fn sweep(nodes: SharedNodes<'_>, pairs: Range<usize>, lister: &mut Lister<'_>) {
    scalar::sweep(nodes, pairs, lister);
}

/// See [`kernels::fit_leaves`].
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline(never)]
pub(super) fn fit_leaves<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    order: &[u32],
    leaves: &mut Leaves,
    fetch: impl Fn(usize),
    of_one: bool,
    with_sums: bool,
) -> Option<f64> {
    kernels::fit_leaves(nodes, primitives, order, leaves, fetch, of_one, with_sums)
}

/// See [`kernels::refit_boxes`].
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline(never)]
pub(super) fn refit_boxes(
    nodes: SharedNodes<'_>,
    parents_first: &[Entry],
    with_sums: bool,
    tally: &mut Tally,
) {
    kernels::refit_boxes_with(parents_first, with_sums, tally, |entry| {
        let pair = nodes.pair_at(entry.first());
        let (l, r) = (pair.part(0), pair.part(1));
        let own = bytemuck::cast(nodes.get(entry.slot()));
        let corners = _mm256_blend_ps::<0xf0>(_mm256_min_ps(l, r), _mm256_max_ps(l, r));
        let corners = _mm256_blend_ps::<0x88>(corners, own);
        nodes.set(entry.slot(), bytemuck::cast(corners));
        bytemuck::cast(corners)
    });
}

/// Nodes that are judged at a time.
const WIDTH: usize = 8;

/// The boxes of the nodes on one side of all pairs.
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline]
fn boxes(pairs: &[PairAt<'_>; WIDTH], side: usize) -> Boxes<__m256> {
    // Of four nodes: minima in the lower half, maxima in the upper.
    let four = |i: usize| {
        let row = |j: usize| pairs[i + j].part(side);
        let (a, b, c, d) = (row(0), row(1), row(2), row(3));
        let (xy, xy2) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
        let (z, z2) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
        [
            _mm256_shuffle_ps::<0x44>(xy, xy2),
            _mm256_shuffle_ps::<0xee>(xy, xy2),
            _mm256_shuffle_ps::<0x44>(z, z2),
        ]
    };
    let ([x, y, z], [x2, y2, z2]) = (four(0), four(4));
    let low = |a, b| _mm256_permute2f128_ps::<0x20>(a, b);
    let high = |a, b| _mm256_permute2f128_ps::<0x31>(a, b);
    Boxes { min: [low(x, x2), low(y, y2), low(z, z2)], max: [high(x, x2), high(y, y2), high(z, z2)] }
}

/// The best rotation of each node, given the changes under all. A NaN is no gain.
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline]
fn best(changes: [__m256; 6]) -> BestRotations<WIDTH> {
    let no_gain = _mm256_set1_ps(NO_GAIN);
    let (mut least, mut rotations) = (no_gain, _mm256_setzero_ps());
    for (i, change) in (0..).zip(changes) {
        let is_less = _mm256_cmp_ps::<_CMP_LT_OQ>(change, least);
        least = _mm256_blendv_ps(least, change, is_less);
        rotations = _mm256_blendv_ps(rotations, _mm256_castsi256_ps(_mm256_set1_epi32(i)), is_less);
    }
    let gains = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(least, no_gain)) as u32;
    BestRotations { gains, changes: bytemuck::cast(least), rotations: bytemuck::cast(rotations) }
}

define_rotate! {
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    #[inline(never)]
    zero: _mm256_setzero_ps(), min: _mm256_min_ps, max: _mm256_max_ps,
    add: _mm256_add_ps, sub: _mm256_sub_ps, mul: _mm256_mul_ps
}
