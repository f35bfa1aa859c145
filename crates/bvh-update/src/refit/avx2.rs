//! The kernels in AVX2: one node in one register.
//!
//! A node's eight words are `[min.x min.y min.z link | max.x max.y max.z aux]`. Sums and products
//! are taken in the order of `Aabb::half_area` and without fused multiply-add, so the bits are
//! those of the scalar kernels.

use std::arch::x86_64::*;
use std::ops::Range;

use bvh_core::Primitives;

use super::block::{Block, Entry, Leaves, Lister};
use super::kernels::{self, Accepted, refit_height};
use super::shared::SharedNodes;
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
    leaves: &[Entry],
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
        let [l, r] = nodes.pair_lanes(entry.first());
        let own = bytemuck::cast(nodes.get(entry.slot()));
        let corners = _mm256_blend_ps::<0xf0>(_mm256_min_ps(l, r), _mm256_max_ps(l, r));
        let corners = _mm256_blend_ps::<0x88>(corners, own);
        nodes.set(entry.slot(), bytemuck::cast(corners));
        bytemuck::cast(corners)
    });
}

/// See [`scalar::rotate`](super::scalar::rotate).
#[target_feature(enable = "avx2,bmi1,bmi2")]
#[inline(never)]
pub(super) fn rotate(
    nodes: SharedNodes<'_>,
    list: &[Entry],
    at: (u32, bool),
    accepted: &mut Accepted,
    tally: &mut Tally,
) {
    let zero = _mm256_setzero_ps();
    // With the minima negated a union is one maximum, and extents are sums.
    let minima = _mm256_setr_ps(-0.0, -0.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0);
    let mut count = 0;
    for &entry in list {
        let negated = |pair: [__m256; 2]| pair.map(|lanes| _mm256_xor_ps(lanes, minima));
        let [link_l, link_r] = refit_height(nodes, entry);
        let [l, r] = negated(nodes.pair_lanes(entry.first()));
        let ([ll, lr], [rl, rr]) = (negated(nodes.child_lanes(link_l)), negated(nodes.child_lanes(link_r)));
        // Extents of two boxes; those of an empty box are 0.
        let extents = |a, b| {
            let sides =
                _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
            _mm256_max_ps(sides, zero)
        };
        let unions = |a, b, c, d| extents(_mm256_max_ps(a, b), _mm256_max_ps(c, d));
        let e0 = unions(l, rr, r, lr); // L<->RL  R<->LL
        let e1 = unions(rl, l, ll, r); // L<->RR  R<->LR
        let e4 = unions(rl, lr, ll, rr); // LL<->RL, both children
        let e5 = unions(rr, lr, rl, ll); // LL<->RR, both children
        let (t0, t1) = (_mm256_unpacklo_ps(e0, e1), _mm256_unpackhi_ps(e0, e1));
        let (t4, t5) = (_mm256_unpacklo_ps(e4, e5), _mm256_unpackhi_ps(e4, e5));
        let x = _mm256_shuffle_ps::<0x44>(t0, t4);
        let y = _mm256_shuffle_ps::<0xee>(t0, t4);
        let z = _mm256_shuffle_ps::<0x44>(t1, t5);
        let areas =
            _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, y), _mm256_mul_ps(y, z)), _mm256_mul_ps(z, x));

        // Lanes: 0 1 4 5 | 2 3 4 5, where the last two are sums over both halves.
        let both = _mm256_add_ps(areas, _mm256_permute2f128_ps::<0x01>(areas, areas));
        let then = _mm256_blend_ps::<0b1100_1100>(areas, both);
        // The words may be denormal as floats, and slow: out of the product.
        let own = _mm256_blend_ps::<0b1000_1000>(extents(l, r), zero);
        let products = _mm256_mul_ps(own, _mm256_permute_ps::<0b11_00_10_01>(own));
        let xy_yz = _mm256_add_ps(products, _mm256_permute_ps::<0b01>(products));
        let of_l_r = _mm256_permute_ps::<0>(_mm256_add_ps(xy_yz, _mm256_permute_ps::<0b10>(products)));
        let of_r_l = _mm256_permute2f128_ps::<0x01>(of_l_r, of_l_r);
        let now = _mm256_blend_ps::<0b1100_1100>(of_r_l, _mm256_add_ps(of_l_r, of_r_l));
        let changes = _mm256_sub_ps(then, now);
        let is_gain = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(changes, zero)) != 0;
        let in_order = _mm256_setr_epi32(0, 1, 4, 5, 2, 3, 6, 7);
        accepted.set(count, entry, bytemuck::cast(_mm256_permutevar8x32_ps(changes, in_order)));
        count += usize::from(is_gain);
    }
    accepted.apply(count, nodes, at, tally);
}
