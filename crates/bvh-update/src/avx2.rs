//! The kernels in AVX2: one node in one register.
//!
//! A node's eight words are `[min.x min.y min.z link | max.x max.y max.z aux]`. Sums and products are taken in the
//! order of `Aabb::half_area` and without fused multiply-add, so the bits are those of the portable kernels. The
//! two words that are no coordinates are kept out of products: as floats they may be denormal, and slow.

use std::arch::x86_64::*;

use bvh_core::{Aabb, COST_INTERSECT, COST_TRAVERSE, Node, Primitives, Vec3};

use crate::block::Visit;
use crate::kernels::{Accepted, fit_at_this_level};
use crate::raw::SharedNodes;

/// Stands in for the children of a leaf: every union with it has infinite area, so no rotation with it wins.
const MISSING: [Node; 2] = {
    let everything = Aabb::new(Vec3::MIN, Vec3::MAX);
    [Node::leaf(everything, 0, 0); 2]
};

// The weights below are counts, not costs.
const _: () = assert!(COST_INTERSECT == 1.0 && COST_TRAVERSE == 1.0);

/// Lane mask of the two words that are no coordinates.
const WORDS: i32 = 0b1000_1000;

/// See [`kernels::fit`](crate::kernels::fit).
#[target_feature(enable = "avx2")]
pub(crate) fn fit<P: Primitives + ?Sized>(nodes: SharedNodes<'_>, primitives: &P, leaves: &[Visit]) -> u64 {
    fit_at_this_level(nodes, primitives, leaves)
}

/// See [`kernels::unions`](crate::kernels::unions).
#[target_feature(enable = "avx2")]
pub(crate) fn unions(nodes: SharedNodes<'_>, inner: &[Visit]) -> f64 {
    // Of the parent's words all of link and the upper 24 bits of aux are kept; aux's low byte is the height.
    let kept = _mm256_setr_epi32(0, 0, 0, -1, 0, 0, 0, !0xff);
    let height = _mm256_setr_epi32(0, 0, 0, 0, 0, 0, 0, 0xff);
    let one = _mm256_setr_epi32(0, 0, 0, 0, 0, 0, 0, 1);
    let mut sums = _mm_setzero_pd();
    for visit in inner.iter().rev() {
        let [l, r]: [__m256; 2] = nodes.pair(visit.first()).map(bytemuck::cast);
        let below = _mm256_permute2f128_ps::<0x20>(l, r);
        let above = _mm256_permute2f128_ps::<0x31>(l, r);

        let areas = areas_of_two(_mm256_sub_ps(above, below));
        let (link, aux) = (_mm256_castps_si256(below), _mm256_castps_si256(above));
        // max(count, 1), which is 1 for an inner node, where the moving bit is set.
        let weights = _mm256_and_si256(
            _mm256_max_epu32(_mm256_srli_epi32::<8>(aux), _mm256_set1_epi32(1)),
            _mm256_srai_epi32::<31>(_mm256_slli_epi32::<1>(link)),
        );
        let weights =
            _mm_unpackhi_epi32(_mm256_castsi256_si128(weights), _mm256_extracti128_si256::<1>(weights));
        let weights = _mm_cvtepi32_pd(_mm_shuffle_epi32::<0b11_10_11_10>(weights));
        let areas = _mm_unpacklo_ps(_mm256_castps256_ps128(areas), _mm256_extractf128_ps::<1>(areas));
        sums = _mm_add_pd(sums, _mm_mul_pd(_mm_cvtps_pd(areas), weights));

        let union = _mm256_blend_ps::<0xf0>(_mm256_min_ps(l, r), _mm256_max_ps(l, r));
        let highest = _mm256_max_epu8(_mm256_castps_si256(l), _mm256_castps_si256(r));
        let words = _mm256_or_si256(
            _mm256_and_si256(bytemuck::cast(nodes.get(visit.slot())), kept),
            _mm256_and_si256(_mm256_add_epi32(highest, one), height),
        );
        let node = _mm256_blend_ps::<WORDS>(union, _mm256_castsi256_ps(words));
        nodes.set(visit.slot(), bytemuck::cast(node));
    }
    _mm_cvtsd_f64(sums) + _mm_cvtsd_f64(_mm_unpackhi_pd(sums, sums))
}

/// Half areas of two boxes whose extents are in lanes 0 to 2 and 4 to 6, in lanes 0 and 4.
#[target_feature(enable = "avx2")]
#[inline]
fn areas_of_two(extents: __m256) -> __m256 {
    let zero = _mm256_setzero_ps();
    let e = _mm256_blend_ps::<WORDS>(_mm256_max_ps(extents, zero), zero);
    let products = _mm256_mul_ps(e, _mm256_permute_ps::<0b11_00_10_01>(e)); // xy yz zx
    let xy_yz = _mm256_add_ps(products, _mm256_permute_ps::<0b01>(products));
    _mm256_add_ps(xy_yz, _mm256_permute_ps::<0b10>(products))
}

/// See [`kernels::evaluate`](crate::kernels::evaluate).
#[target_feature(enable = "avx2")]
pub(crate) fn evaluate(
    nodes: SharedNodes<'_>,
    inner: &[Visit],
    candidates: &[u32],
    accepted: &mut [Accepted],
) -> usize {
    let zero = _mm256_setzero_ps();
    // With the minima negated a union is one maximum, and extents are sums.
    let minima = _mm256_setr_ps(-0.0, -0.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0);
    let mut count = 0;
    for &index in candidates {
        let pair = nodes.pair(inner[index as usize].first());
        let negated = |n: Node| _mm256_xor_ps(bytemuck::cast(n), minima);
        let [ll, lr] = nodes.children_or(&pair[0], &MISSING).map(negated);
        let [rl, rr] = nodes.children_or(&pair[1], &MISSING).map(negated);
        let [l, r] = pair.map(negated);

        // Extents of the unions of two pairs of boxes.
        let sides =
            |a, b| _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
        let extents = |a, b, c, d| _mm256_max_ps(sides(_mm256_max_ps(a, b), _mm256_max_ps(c, d)), zero);
        let e0 = extents(l, rr, r, lr); // L<->RL  R<->LL
        let e1 = extents(rl, l, ll, r); // L<->RR  R<->LR
        let e4 = extents(rl, lr, ll, rr); // LL<->RL, both children
        let e5 = extents(rr, lr, rl, ll); // LL<->RR, both children
        let (t0, t1) = (_mm256_unpacklo_ps(e0, e1), _mm256_unpackhi_ps(e0, e1));
        let (t4, t5) = (_mm256_unpacklo_ps(e4, e5), _mm256_unpackhi_ps(e4, e5));
        let x = _mm256_shuffle_ps::<0x44>(t0, t4);
        let y = _mm256_shuffle_ps::<0xee>(t0, t4);
        let z = _mm256_shuffle_ps::<0x44>(t1, t5);
        let xy_yz = _mm256_add_ps(_mm256_mul_ps(x, y), _mm256_mul_ps(y, z));
        let areas = _mm256_add_ps(xy_yz, _mm256_mul_ps(z, x));

        // Lanes: 0 1 4 5 | 2 3 4 5, where the last two are sums over both halves.
        let both = _mm256_add_ps(areas, _mm256_permute2f128_ps::<0x01>(areas, areas));
        let then = _mm256_blend_ps::<0b1100_1100>(areas, both);
        let of_l_r = _mm256_permute_ps::<0>(areas_of_two(sides(l, r)));
        let of_r_l = _mm256_permute2f128_ps::<0x01>(of_l_r, of_l_r);
        let now = _mm256_blend_ps::<0b1100_1100>(of_r_l, _mm256_add_ps(of_l_r, of_r_l));
        let changes = _mm256_sub_ps(then, now);

        let gains = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(changes, zero));
        let in_order = _mm256_setr_epi32(0, 1, 4, 5, 2, 3, 0, 0);
        let changes: [f32; 8] = bytemuck::cast(_mm256_permutevar8x32_ps(changes, in_order));
        // Always written and kept by arithmetic: a branch here would be mispredicted often.
        let [c0, c1, c2, c3, c4, c5, ..] = changes;
        accepted[count] = Accepted { changes: [c0, c1, c2, c3, c4, c5], index };
        count += usize::from(gains != 0);
    }
    count
}
