//! Listing in AVX-512: the children of eight nodes at a time.

use std::arch::x86_64::*;
use std::ops::Range;

use bvh_core::Node;

use super::block::{Block, Entry, GROUP, Leaves, Lister};
use super::shared::SharedNodes;

// Rotations sixteen nodes at a time took longer on Zen 4 (docs/UPDATE_COST.md).
pub(super) use super::avx2::{fit_leaves, refit_boxes, rotate};

/// See [`Block::walk`].
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,popcnt")]
#[inline(never)]
pub(super) fn walk(block: &mut Block, nodes: SharedNodes<'_>, roots: &[Entry], leaves: &mut Leaves) {
    block.walk(nodes, roots, leaves, |parents, count, lister| {
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

/// See [`Lister::children`].
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,popcnt")]
#[inline]
fn list(nodes: SharedNodes<'_>, parents: &[Entry; GROUP], count: usize, lister: &mut Lister<'_>) {
    // The links of two pairs, of four, and of all eight.
    let of_two = _mm512_setr_epi32(3, 11, 19, 27, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    let of_four = |a: Entry, b: Entry, c: Entry, d: Entry| {
        let two = |a: Entry, b: Entry| {
            let wide = |entry: Entry| bytemuck::cast::<_, __m512i>(nodes.pair(entry.first()));
            _mm512_castsi512_si128(_mm512_permutex2var_epi32(wide(a), of_two, wide(b)))
        };
        _mm256_set_m128i(two(c, d), two(a, b))
    };
    let &[a, b, c, d, e, f, g, h] = parents;
    let links = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(of_four(a, b, c, d)), of_four(e, f, g, h));

    let is_leaf = _mm512_movepi32_mask(links);
    let is_dynamic =
        if cfg!(refit_without = "moving") { !0 } else { _mm512_movepi32_mask(_mm512_slli_epi32::<1>(links)) };
    let listed = is_dynamic & ((1_u32 << (2 * count)) - 1) as u16;
    let parents = bytemuck::cast(*parents);
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
    let compress = |mask: u8, lanes| {
        (bytemuck::cast(_mm512_maskz_compress_epi64(mask, lanes)), mask.count_ones() as usize)
    };
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
