//! The kernels in AVX2: one node in one register.
//!
//! A node's eight words are `[min.x min.y min.z link | max.x max.y max.z aux]`. Sums and products are taken in the
//! order of `Aabb::half_area` and without fused multiply-add, so the bits are those of the portable kernels. The
//! two words that are no coordinates are kept out of products: as floats they may be denormal, and slow.
//!
//! The usual case is a leaf that moves and holds one primitive; nodes with other leaves are left to the portable code.

use std::arch::x86_64::*;

use bvh_core::{COST_INTERSECT, COST_TRAVERSE, Primitives};

use crate::kernels::{Accepted, Areas, Fitted, evaluate, fit_inner};
use crate::raw::SharedNodes;

// Every node that the kernels add up counts once.
const _: () = assert!(COST_INTERSECT == 1.0 && COST_TRAVERSE == 1.0);

/// Lane mask of the two words that are no coordinates.
const WORDS: i32 = 0b1000_1000;

/// How many list entries ahead of its use a primitive's data is fetched.
const AHEAD: usize = 8;

/// See [`kernels::twigs`](crate::kernels::twigs).
#[target_feature(enable = "avx2")]
pub(crate) fn twigs<P: Primitives + ?Sized>(nodes: SharedNodes<'_>, primitives: &P, list: &[u32]) -> Fitted {
    let mut others = Fitted::default();
    let (mut leaf_areas, mut inner_areas, mut count) = (_mm256_setzero_pd(), _mm256_setzero_pd(), 0);
    // The primitives of some twigs ahead, whose indices are on their way, and then their data.
    let mut ahead = [[0; 2]; AHEAD];
    for i in 0..list.len() + 2 * AHEAD {
        let on_their_way = &mut ahead[i % AHEAD];
        on_their_way.iter().for_each(|&p| primitives.prefetch_data(p));
        if let Some(&slot) = list.get(i) {
            let [l, r] = nodes.pair(nodes.get(slot as usize).first());
            *on_their_way = [l.first(), r.first()];
            on_their_way.iter().for_each(|&p| primitives.prefetch_index(p));
        }
        if i < 2 * AHEAD {
            continue;
        }

        let slot = list[i - 2 * AHEAD] as usize;
        let pair = nodes.get(slot).first();
        let [l, r] = nodes.pair(pair);
        if l.is_single_and_moves() && r.is_single_and_moves() {
            let [min, max] = primitives.aabb_lanes(l.first());
            let a = _mm256_set_m128(max.into(), min.into());
            let [min, max] = primitives.aabb_lanes(r.first());
            let b = _mm256_set_m128(max.into(), min.into());
            if !any_nan(a, b) {
                nodes.set_lanes(pair, with_words_of(nodes.lanes(pair), a));
                nodes.set_lanes(pair + 1, with_words_of(nodes.lanes(pair + 1), b));
                let union = union(a, b);
                // A twig's height is known: it was found by it.
                nodes.set_lanes(slot, with_words_of(nodes.lanes(slot), union));
                let of_leaves = both_halves(products(sides(a, b)));
                leaf_areas = _mm256_add_pd(leaf_areas, _mm256_cvtps_pd(of_leaves));
                inner_areas = _mm256_add_pd(inner_areas, _mm256_cvtps_pd(products_of_one(union)));
                count += 2;
                continue;
            }
        }
        fit_inner(nodes, primitives, slot, &mut others);
    }
    others.and(count, leaf_areas, inner_areas)
}

/// See [`kernels::spurs`](crate::kernels::spurs).
#[target_feature(enable = "avx2")]
pub(crate) fn spurs<P: Primitives + ?Sized, const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Fitted {
    let mut others = Fitted::default();
    let (mut leaf_areas, mut inner_areas, mut count) = (_mm256_setzero_pd(), _mm256_setzero_pd(), 0);
    for &slot in list {
        let pair = nodes.get(slot as usize).first();
        let right = usize::from(!nodes.get(pair).is_leaf());
        let leaf = nodes.get(pair + right);
        if leaf.is_single_and_moves() {
            let [min, max] = primitives.aabb_lanes(leaf.first());
            let a = _mm256_set_m128(max.into(), min.into());
            if !any_nan(a, a) {
                nodes.set_lanes(pair + right, with_words_of(nodes.lanes(pair + right), a));
                let b = nodes.lanes(pair + 1 - right);
                let whole = union(a, b);
                nodes.set_lanes(slot as usize, parent(nodes.lanes(slot as usize), b, b, whole));
                leaf_areas = _mm256_add_pd(leaf_areas, _mm256_cvtps_pd(products_of_one(a)));
                inner_areas = _mm256_add_pd(inner_areas, _mm256_cvtps_pd(products_of_one(whole)));
                count += 1;
                if ROTATE {
                    let below = nodes.get(pair + 1 - right).first();
                    let (c, d) = (nodes.lanes(below), nodes.lanes(below + 1));
                    // The leaf takes the place of c, or of d.
                    let then = sums(products(sides(union(a, d), union(a, c))));
                    let now = sums(products(sides(b, b)));
                    if _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(then, now)) & 0x11 != 0 {
                        evaluate(nodes, slot, accepted);
                    }
                }
                continue;
            }
        }
        fit_inner(nodes, primitives, slot as usize, &mut others);
        if ROTATE {
            evaluate(nodes, slot, accepted);
        }
    }
    others.and(count, leaf_areas, inner_areas)
}

/// See [`kernels::forks`](crate::kernels::forks).
#[target_feature(enable = "avx2")]
pub(crate) fn forks<const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Areas {
    let zero = _mm256_setzero_ps();
    // With the minima negated a union is one maximum, and extents are sums.
    let minima = _mm256_setr_ps(-0.0, -0.0, -0.0, -0.0, 0.0, 0.0, 0.0, 0.0);
    let mut sum = _mm256_setzero_pd();
    for &slot in list {
        let pair = nodes.get(slot as usize).first();
        let negated = |n| _mm256_xor_ps(nodes.lanes(n), minima);
        let (l, r) = (negated(pair), negated(pair + 1));
        let union = _mm256_max_ps(l, r);
        let own = nodes.lanes(slot as usize);
        nodes.set_lanes(slot as usize, parent(own, l, r, _mm256_xor_ps(union, minima)));
        let extents = _mm_add_ps(_mm256_extractf128_ps::<1>(union), _mm256_castps256_ps128(union));
        sum = _mm256_add_pd(sum, _mm256_cvtps_pd(products_of_extents(extents)));
        if !ROTATE {
            continue;
        }

        let (below_l, below_r) = (nodes.get(pair).first(), nodes.get(pair + 1).first());
        let (ll, lr) = (negated(below_l), negated(below_l + 1));
        let (rl, rr) = (negated(below_r), negated(below_r + 1));
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
        let of_l_r = _mm256_permute_ps::<0>(sums(products(sides(l, r))));
        let of_r_l = _mm256_permute2f128_ps::<0x01>(of_l_r, of_l_r);
        let now = _mm256_blend_ps::<0b1100_1100>(of_r_l, _mm256_add_ps(of_l_r, of_r_l));
        let changes = _mm256_sub_ps(then, now);
        if _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(changes, zero)) != 0 {
            let in_order = _mm256_setr_epi32(0, 1, 4, 5, 2, 3, 6, 7);
            let changes = bytemuck::cast(_mm256_permutevar8x32_ps(changes, in_order));
            accepted.push(Accepted { changes, slot });
        }
    }
    Areas(bytemuck::cast(sum))
}

impl Fitted {
    /// With leaves of one primitive added, and sums of areas that were kept in a register.
    #[target_feature(enable = "avx2")]
    fn and(mut self, leaves: u64, leaf_areas: __m256d, inner_areas: __m256d) -> Self {
        self.leaves += leaves;
        for (Areas(sum), more) in [(&mut self.leaf_areas, leaf_areas), (&mut self.inner_areas, inner_areas)] {
            *sum = bytemuck::cast(_mm256_add_pd(bytemuck::cast(*sum), more));
        }
        self
    }
}

/// Whether any coordinate is NaN.
#[target_feature(enable = "avx2")]
#[inline]
fn any_nan(a: __m256, b: __m256) -> bool {
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_UNORD_Q>(a, b)) & !WORDS & 0xff != 0
}

/// `node` with another box.
#[target_feature(enable = "avx2")]
#[inline]
fn with_words_of(node: __m256, aabb: __m256) -> __m256 {
    _mm256_blend_ps::<WORDS>(aabb, node)
}

#[target_feature(enable = "avx2")]
#[inline]
fn union(l: __m256, r: __m256) -> __m256 {
    _mm256_blend_ps::<0xf0>(_mm256_min_ps(l, r), _mm256_max_ps(l, r))
}

/// Extents of two boxes.
#[target_feature(enable = "avx2")]
#[inline]
fn sides(a: __m256, b: __m256) -> __m256 {
    _mm256_sub_ps(_mm256_permute2f128_ps::<0x31>(a, b), _mm256_permute2f128_ps::<0x20>(a, b))
}

/// Products xy, yz, zx, and 0 of two boxes' extents.
#[target_feature(enable = "avx2")]
#[inline]
fn products(extents: __m256) -> __m256 {
    let zero = _mm256_setzero_ps();
    let e = _mm256_blend_ps::<WORDS>(_mm256_max_ps(extents, zero), zero);
    _mm256_mul_ps(e, _mm256_permute_ps::<0b11_00_10_01>(e))
}

/// Half areas of two boxes, in lanes 0 and 4, from such products.
#[target_feature(enable = "avx2")]
#[inline]
fn sums(products: __m256) -> __m256 {
    let xy_yz = _mm256_add_ps(products, _mm256_permute_ps::<0b01>(products));
    _mm256_add_ps(xy_yz, _mm256_permute_ps::<0b10>(products))
}

/// The lower half plus the upper.
#[target_feature(enable = "avx2")]
#[inline]
fn both_halves(a: __m256) -> __m128 {
    _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a))
}

/// The products of one box's extents.
#[target_feature(enable = "avx2")]
#[inline]
fn products_of_one(aabb: __m256) -> __m128 {
    products_of_extents(_mm_sub_ps(_mm256_extractf128_ps::<1>(aabb), _mm256_castps256_ps128(aabb)))
}

#[target_feature(enable = "avx2")]
#[inline]
fn products_of_extents(extents: __m128) -> __m128 {
    let zero = _mm_setzero_ps();
    let e = _mm_blend_ps::<0b1000>(_mm_max_ps(extents, zero), zero);
    _mm_mul_ps(e, _mm_permute_ps::<0b11_00_10_01>(e))
}

/// `node` with the box of `union` and the height that its children `l` and `r` give it. Of these the words alone are
/// read.
#[target_feature(enable = "avx2")]
#[inline]
fn parent(node: __m256, l: __m256, r: __m256, union: __m256) -> __m256 {
    // Of the parent's words all of link and the upper 24 bits of aux are kept; aux's low byte is the height.
    let kept = _mm256_setr_epi32(0, 0, 0, -1, 0, 0, 0, !0xff);
    let height = _mm256_setr_epi32(0, 0, 0, 0, 0, 0, 0, 0xff);
    let one = _mm256_setr_epi32(0, 0, 0, 0, 0, 0, 0, 1);
    let highest = _mm256_max_epu8(_mm256_castps_si256(l), _mm256_castps_si256(r));
    let words = _mm256_or_si256(
        _mm256_and_si256(_mm256_castps_si256(node), kept),
        _mm256_and_si256(_mm256_add_epi32(highest, one), height),
    );
    _mm256_blend_ps::<WORDS>(union, _mm256_castsi256_ps(words))
}
