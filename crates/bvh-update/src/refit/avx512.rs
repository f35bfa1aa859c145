//! Listing and judging in AVX-512: one pair of nodes in one register.
//!
//! Four unions of four boxes each give all that the six rotations make; sums and products are in the order of
//! `Aabb::half_area`, so the bits are those of the scalar kernel.

use std::arch::x86_64::*;
use std::ops::Range;

use bvh_core::Node;

use super::Tally;
use super::block::{Block, Entry, GROUP, Leaves, Lister};
use super::kernels::{Accepted, refit_height};
use super::shared::{SharedNodes, entries, lanes};

pub(super) use super::avx2::{fit_leaves, refit_boxes};

/// See [`Block::walk`].
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,popcnt")]
#[inline(never)]
pub(super) fn walk(
    block: &mut Block,
    nodes: SharedNodes<'_>,
    roots: &[Entry],
    depth: u32,
    limit: usize,
    leaves: &mut Leaves,
) {
    block.walk(nodes, roots, depth, limit, leaves, |parents, count, lister| {
        list(nodes, parents, count, lister);
    });
}

/// See [`scalar::sweep`](super::scalar::sweep).
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,popcnt")]
#[inline(never)]
pub(super) fn sweep(nodes: SharedNodes<'_>, pairs: Range<usize>, lister: &mut Lister<'_>) {
    for start in pairs.clone().step_by(GROUP) {
        // The last pair takes the place of those behind the end.
        let parents = std::array::from_fn(|i| Entry::new(0, 2 * (start + i).min(pairs.end - 1) as u32));
        list(nodes, &parents, GROUP.min(pairs.end - start), lister);
    }
}

/// See [`scalar::list`](super::scalar::list).
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,popcnt")]
#[inline]
fn list(nodes: SharedNodes<'_>, parents: &[Entry; GROUP], count: usize, lister: &mut Lister<'_>) {
    // The links of two pairs, of four, and of all eight.
    let of_two = _mm512_setr_epi32(3, 11, 19, 27, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    let of_four = |a: Entry, b: Entry, c: Entry, d: Entry| {
        let two = |a: Entry, b: Entry| {
            let two =
                _mm512_permutex2var_epi32(nodes.pair_wide(a.first()), of_two, nodes.pair_wide(b.first()));
            _mm512_castsi512_si128(two)
        };
        _mm256_set_m128i(two(c, d), two(a, b))
    };
    let &[a, b, c, d, e, f, g, h] = parents;
    let links = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(of_four(a, b, c, d)), of_four(e, f, g, h));

    let is_leaf = _mm512_movepi32_mask(links);
    let moves =
        if cfg!(refit_without = "moving") { !0 } else { _mm512_movepi32_mask(_mm512_slli_epi32::<1>(links)) };
    let listed = moves & ((1_u32 << (2 * count)) - 1) as u16;
    let parents = lanes(parents);
    let left_slots = _mm512_slli_epi64::<34>(parents);
    let left_slots = _mm512_srli_epi64::<2>(left_slots);
    let left = _mm512_or_si512(left_slots, _mm512_maskz_mov_epi32(0x5555, links));
    let right = _mm512_or_si512(
        _mm512_add_epi64(left_slots, _mm512_set1_epi64(1 << 32)),
        _mm512_srli_epi64::<32>(links),
    );
    let in_order =
        [_mm512_setr_epi64(0, 8, 1, 9, 2, 10, 3, 11), _mm512_setr_epi64(4, 12, 5, 13, 6, 14, 7, 15)];
    let both = in_order.map(|in_order| _mm512_permutex2var_epi64(left, in_order, right));
    let compress =
        |mask: u8, lanes| (entries(_mm512_maskz_compress_epi64(mask, lanes)), mask.count_ones() as usize);
    let halves = |mask: u16| {
        let [(a, i), (b, j)] = [compress(mask as u8, both[0]), compress((mask >> 8) as u8, both[1])];
        ([a, b], [i, j])
    };
    let (inner, inner_counts) = halves(!is_leaf & listed);
    let (leaves, leaf_counts) = halves(is_leaf & listed);
    let both_leaves = _mm512_set1_epi32(Node::LEAF as i32);
    let with_inner = _mm512_cmpneq_epi64_mask(_mm512_and_si512(links, both_leaves), both_leaves);
    let (rotating, rotating_count) = compress(with_inner & ((1_u32 << count) - 1) as u8, parents);
    lister.append(inner, rotating, leaves, [inner_counts, leaf_counts, [rotating_count, 0]]);
}

/// See [`scalar::rotate`](super::scalar::rotate).
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
#[inline(never)]
pub(super) fn rotate(
    nodes: SharedNodes<'_>,
    list: &[Entry],
    at: (u32, bool),
    accepted: &mut Accepted,
    tally: &mut Tally,
) {
    // With the minima negated a union is one maximum, and extents are sums.
    let minima = _mm512_broadcast_f32x8(_mm256_setr_ps(-0.0, -0.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0));
    // From lanes of singles and doubles to the order of `Rotation::ALL`.
    let in_order = _mm512_setr_epi32(4, 0, 12, 8, 9, 1, 9, 1, 4, 0, 12, 8, 9, 1, 9, 1);
    let mut count = 0;
    for &entry in list {
        let [link_l, link_r] = refit_height(nodes, entry);
        let negated = |pair: __m512i| _mm512_xor_ps(_mm512_castsi512_ps(pair), minima);
        let n = negated(nodes.pair_wide(entry.first()));
        let (l, r) = (negated(nodes.child_wide(link_l)), negated(nodes.child_wide(link_r)));
        let single_l = _mm512_max_ps(_mm512_shuffle_f32x4::<0x44>(n, n), r); // L u RL, L u RR
        let single_r = _mm512_max_ps(_mm512_shuffle_f32x4::<0xee>(n, n), l); // R u LL, R u LR
        let straight = _mm512_max_ps(l, r); // LL u RL, LR u RR
        let crossed = _mm512_max_ps(l, _mm512_shuffle_f32x4::<0x4e>(r, r)); // LL u RR, LR u RL

        // Extents of four boxes, a quarter of the register each; those of an empty box are 0. What words make of the
        // fourth lanes stays there.
        let extents = |a, b| {
            let sides = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0xdd>(a, b));
            _mm512_max_ps(_mm512_add_ps(sides.0, sides.1), _mm512_setzero_ps())
        };
        // Their products xy, yz, zx.
        let products = |e| _mm512_mul_ps(e, _mm512_permute_ps::<0b11_00_10_01>(e));
        let (singles, doubles) =
            (products(extents(single_l, single_r)), products(extents(straight, crossed)));
        // Half areas in the first lane of each quarter for singles, in the second for doubles.
        let xy_yz = _mm512_unpacklo_ps(singles, doubles);
        let areas = _mm512_add_ps(
            _mm512_add_ps(xy_yz, _mm512_permute_ps::<0b01_00_11_10>(xy_yz)),
            _mm512_unpackhi_ps(singles, doubles),
        );
        // Those of L R L R, a quarter each, in every lane.
        let (l, r) = (_mm512_castps512_ps256(n), _mm512_extractf32x8_ps::<1>(n));
        let sides = (_mm256_permute2f128_ps::<0x20>(l, r), _mm256_permute2f128_ps::<0x31>(l, r));
        let now = _mm256_max_ps(_mm256_add_ps(sides.0, sides.1), _mm256_setzero_ps());
        let now = _mm256_mul_ps(now, _mm256_permute_ps::<0b11_00_10_01>(now));
        let xy_yz = _mm256_add_ps(_mm256_permute_ps::<0>(now), _mm256_permute_ps::<0b01_01_01_01>(now));
        let now = _mm256_add_ps(xy_yz, _mm256_permute_ps::<0b10_10_10_10>(now));
        let now = _mm512_broadcast_f32x8(now);

        // Doubles have sums of two boxes, in both of their quarters.
        let neighbors = |v| _mm512_shuffle_f32x4::<0b10_11_00_01>(v, v);
        let then = _mm512_mask_add_ps(areas, 0x2222, areas, neighbors(areas));
        let swapped = _mm512_shuffle_f32x4::<0b00_00_01_01>(now, now);
        let now = _mm512_mask_add_ps(swapped, 0x2222, now, neighbors(now));
        let changes = _mm512_sub_ps(then, now);
        let gains = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(then, now) & 0x3333;
        let changes = _mm512_castps512_ps256(_mm512_permutexvar_ps(in_order, changes));
        accepted.set(count, entry, bytemuck::cast(changes));
        count += usize::from(gains != 0);
    }
    accepted.apply(count, nodes, at, tally);
}
