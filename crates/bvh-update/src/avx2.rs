//! The kernels in AVX2: one node in one register.
//!
//! A node's eight words are `[min.x min.y min.z link | max.x max.y max.z aux]`. Sums and products are taken in the
//! order of `Aabb::half_area` and without fused multiply-add, so the bits are those of the portable kernels. The
//! two words that are no coordinates are kept out of products: as floats they may be denormal, and slow.
//!
//! The usual case is a leaf that moves and whose primitives all have boxes; nodes with other leaves are left to the
//! portable code.

mod sweep;

use std::arch::x86_64::*;

use bvh_core::{COST_INTERSECT, COST_TRAVERSE, Node, Primitives};

use crate::block::{GROUP, Next, Queue, Twigs};
use crate::kernels::{Accepted, Areas, Fitted, evaluate, fit_inner};
use crate::raw::SharedNodes;

pub(crate) use sweep::sweep;

// Every node that the kernels add up counts once.
const _: () = assert!(COST_INTERSECT == 1.0 && COST_TRAVERSE == 1.0);

/// Lane mask of the two words that are no coordinates.
const WORDS: i32 = 0b1000_1000;

/// For each set of lanes their numbers in order, a byte each: compresses eight lanes to those in the set.
const COMPRESS: [u64; 256] = {
    let mut table = [0; 256];
    let mut set = 0;
    while set < 256 {
        let (mut lane, mut count) = (0, 0);
        while lane < 8 {
            if set >> lane & 1 == 1 {
                table[set] |= lane << (8 * count);
                count += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

/// See [`kernels::gather`](crate::kernels::gather). Four nodes at a time: the words of their eight children are
/// transposed into two registers.
#[target_feature(enable = "avx2,popcnt")]
pub(crate) fn gather(nodes: SharedNodes<'_>, queue: &mut Queue, twigs: &mut Twigs, end: usize) {
    const { assert!(GROUP == 4) };
    let zero = _mm256_setzero_si256();
    let numbers = _mm_setr_epi32(0, 1, 2, 3);
    let both = _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3);
    let sides = _mm256_setr_epi32(0, 1, 0, 1, 0, 1, 0, 1);
    while queue.done < end && queue.has_room() {
        let done = queue.done;
        let count = GROUP.min(end - done);
        let queued = bytemuck::pod_read_unaligned(bytemuck::cast_slice(&queue.pairs[done..done + GROUP]));
        // What is behind the end counts for nothing, but must be in range.
        let pairs = _mm_and_si128(queued, _mm_cmpgt_epi32(_mm_set1_epi32(count as i32), numbers));
        let pair_lanes = |n| nodes.pair_lanes(n as usize);
        let a = pair_lanes(_mm_cvtsi128_si32(pairs));
        let b = pair_lanes(_mm_extract_epi32::<1>(pairs));
        let c = pair_lanes(_mm_extract_epi32::<2>(pairs));
        let d = pair_lanes(_mm_extract_epi32::<3>(pairs));
        let (ab, cd) = (words(a, b), words(c, d));
        let links = _mm256_permute2x128_si256::<0x20>(ab, cd);
        let heights = _mm256_and_si256(
            _mm256_permute2x128_si256::<0x31>(ab, cd),
            _mm256_set1_epi32(Node::HEIGHT as i32),
        );
        let is_leaf = _mm256_cmpeq_epi32(heights, zero);
        let is_deep = _mm256_cmpgt_epi32(heights, _mm256_set1_epi32(1));
        let below = _mm256_and_si256(links, _mm256_set1_epi32(Node::INDEX as i32));
        let pairs = _mm256_permutevar8x32_epi32(_mm256_castsi128_si256(pairs), both);
        let slots = _mm256_add_epi32(pairs, sides);
        let near: [u32; 8] = bytemuck::cast(_mm256_blendv_epi8(below, pairs, is_leaf));
        near.iter().for_each(|&pair| nodes.prefetch::<false>(pair as usize));

        let lanes = |mask| _mm256_movemask_ps(_mm256_castsi256_ps(mask)) as u32;
        const { assert!(Node::DYNAMIC == 1 << 30) };
        let moves = lanes(_mm256_slli_epi32::<1>(links)) & ((1 << (2 * count)) - 1);
        let deep = (lanes(is_deep) & moves) as usize;
        let low = (!lanes(is_deep) & !lanes(is_leaf) & moves) as usize;
        let listed = queue.listed;
        queue.slots[listed..listed + 8].copy_from_slice(&compress(slots, deep));
        queue.pairs[listed..listed + 8].copy_from_slice(&compress(below, deep));
        queue.listed += deep.count_ones() as usize;
        let count_before = twigs.count;
        twigs.slots[count_before..count_before + 8].copy_from_slice(&compress(slots, low));
        twigs.pairs[count_before..count_before + 8].copy_from_slice(&compress(below, low));
        twigs.count += low.count_ones() as usize;

        // Spurs are those with a leaf in one of two lanes.
        let of_pairs = _mm256_or_si256(is_leaf, _mm256_slli_epi64::<32>(is_leaf));
        let spurs = _mm256_movemask_pd(_mm256_castsi256_pd(of_pairs)) as usize & ((1 << count) - 1);
        let forks = !spurs & ((1 << count) - 1);
        let own: [u32; 8] = queue.slots[done..done + 8].try_into().expect("eight");
        let (s, f) = (queue.spur_count, done - queue.spur_count);
        queue.spurs[s..s + 8].copy_from_slice(&compress(bytemuck::cast(own), spurs));
        queue.forks[f..f + 8].copy_from_slice(&compress(bytemuck::cast(own), forks));
        queue.spur_count += spurs.count_ones() as usize;
        queue.done += count;
    }
}

/// The links, and then the aux words, of two pairs of nodes.
#[target_feature(enable = "avx2")]
#[inline]
fn words([a, b]: [__m256; 2], [c, d]: [__m256; 2]) -> __m256i {
    let ab = _mm256_castps_pd(_mm256_unpackhi_ps(a, b));
    let cd = _mm256_castps_pd(_mm256_unpackhi_ps(c, d));
    _mm256_castpd_si256(_mm256_unpackhi_pd(ab, cd))
}

/// The lanes in a set, in order; then any.
#[target_feature(enable = "avx2")]
#[inline]
fn compress(lanes: __m256i, set: usize) -> [u32; 8] {
    let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(COMPRESS[set & 0xff] as i64));
    bytemuck::cast(_mm256_permutevar8x32_epi32(lanes, order))
}

/// How many twigs are looked at together.
const TWIGS: usize = 16;

/// Subtrees of the next ones to fetch meanwhile.
const NEXT: usize = 5;

/// See [`kernels::twigs`](crate::kernels::twigs).
#[target_feature(enable = "avx2")]
pub(crate) fn twigs<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &Twigs,
    next: Next<'_>,
) -> Fitted {
    let mut others = Fitted::default();
    let (mut leaf_areas, mut inner_areas, mut count) = (_mm256_setzero_pd(), _mm256_setzero_pd(), 0);
    let part = |i: usize| i * TWIGS..list.count.min((i + 1) * TWIGS);
    let mut next_pairs = next.pairs.iter();
    let parts = list.count.div_ceil(TWIGS);
    // While some twigs are fitted, the corners of the next are on their way, and the indices of those after them. The
    // primitives of a leaf are neighbours: fetching the first fetches most of the others.
    for i in 0..parts + 2 {
        if i < parts {
            let leaves = list.pairs[part(i)].iter().flat_map(|&pair| nodes.pair(pair as usize));
            leaves.for_each(|leaf| primitives.prefetch_index(leaf.first()));
        }
        if (1..=parts).contains(&i) {
            let leaves = list.pairs[part(i - 1)].iter().flat_map(|&pair| nodes.pair(pair as usize));
            leaves.for_each(|leaf| primitives.prefetch_data(leaf.first()));
        }
        for &pair in next_pairs.by_ref().take(NEXT) {
            (0..next.lines).for_each(|line| nodes.prefetch::<true>(pair as usize + 2 * line));
        }
        if i < 2 {
            continue;
        }
        for (&slot, &pair) in list.slots[part(i - 2)].iter().zip(&list.pairs[part(i - 2)]) {
            let (slot, pair) = (slot as usize, pair as usize);
            let leaves = nodes.pair(pair);
            let [l, r] = if leaves[0].is_dynamic_single() & leaves[1].is_dynamic_single() {
                [Leaf::of_one(primitives, leaves[0].first()), Leaf::of_one(primitives, leaves[1].first())]
            } else if is_fit_here(&leaves[0]) & is_fit_here(&leaves[1]) {
                [Leaf::of_some(primitives, &leaves[0]), Leaf::of_some(primitives, &leaves[1])]
            } else {
                fit_inner(nodes, primitives, slot, &mut others);
                continue;
            };
            if any_doubt(l.doubt, r.doubt) {
                fit_inner(nodes, primitives, slot, &mut others);
                continue;
            }
            nodes.set_lanes(pair, with_words_of(nodes.lanes(pair), l.aabb()));
            nodes.set_lanes(pair + 1, with_words_of(nodes.lanes(pair + 1), r.aabb()));
            let (min, max) = (_mm_min_ps(l.min, r.min), _mm_max_ps(l.max, r.max));
            // A twig's height is known: it was found by it.
            nodes.set_lanes(slot, with_words_of(nodes.lanes(slot), _mm256_set_m128(max, min)));
            leaf_areas = _mm256_add_pd(leaf_areas, l.areas());
            leaf_areas = _mm256_add_pd(leaf_areas, r.areas());
            inner_areas = _mm256_add_pd(inner_areas, products_of_some(_mm_sub_ps(max, min)));
            count += 2;
        }
    }
    others.and(&fitted(count, leaf_areas, inner_areas))
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
        if is_fit_here(&leaf) {
            let leaf = if leaf.is_dynamic_single() {
                Leaf::of_one(primitives, leaf.first())
            } else {
                Leaf::of_some(primitives, &leaf)
            };
            let a = leaf.aabb();
            if !any_doubt(leaf.doubt, leaf.doubt) {
                nodes.set_lanes(pair + right, with_words_of(nodes.lanes(pair + right), a));
                let b = nodes.lanes(pair + 1 - right);
                let whole = union(a, b);
                nodes.set_lanes(slot as usize, parent(nodes.lanes(slot as usize), b, b, whole));
                leaf_areas = _mm256_add_pd(leaf_areas, leaf.areas());
                inner_areas = _mm256_add_pd(inner_areas, _mm256_cvtps_pd(products_of_one(whole)));
                count += 1;
                if ROTATE {
                    let below = nodes.get(pair + 1 - right).first();
                    let [c, d] = nodes.pair_lanes(below);
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
    others.and(&fitted(count, leaf_areas, inner_areas))
}

/// How many forks ahead grandchildren are fetched, and twice as many children.
const FORKS: usize = 3;

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
    for (i, &slot) in list.iter().enumerate() {
        if ROTATE {
            // A fork takes so many instructions that the processor does not see the loads of the next by itself.
            if let Some(&next) = list.get(i + 2 * FORKS) {
                nodes.prefetch::<false>(nodes.get(next as usize).first());
            }
            if let Some(&next) = list.get(i + FORKS) {
                let below = nodes.pair(nodes.get(next as usize).first());
                below.iter().for_each(|node| nodes.prefetch::<false>(node.first()));
            }
        }
        let pair = nodes.get(slot as usize).first();
        let negated = |n| nodes.pair_lanes(n).map(|lanes| _mm256_xor_ps(lanes, minima));
        let [l, r] = negated(pair);
        let union = _mm256_max_ps(l, r);
        let own = nodes.lanes(slot as usize);
        nodes.set_lanes(slot as usize, parent(own, l, r, _mm256_xor_ps(union, minima)));
        let extents = _mm_add_ps(_mm256_extractf128_ps::<1>(union), _mm256_castps256_ps128(union));
        sum = _mm256_add_pd(sum, _mm256_cvtps_pd(products_of_extents(extents)));
        if !ROTATE {
            continue;
        }

        let (below_l, below_r) = (nodes.get(pair).first(), nodes.get(pair + 1).first());
        let ([ll, lr], [rl, rr]) = (negated(below_l), negated(below_r));
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

/// Whether a leaf is one that these kernels fit, unless there is doubt about a primitive.
#[inline(always)]
fn is_fit_here(leaf: &Node) -> bool {
    leaf.is_dynamic() & (leaf.count() > 0)
}

/// The box around the primitives of a leaf, unless their doubt is not finite: then it means nothing.
#[derive(Clone, Copy)]
struct Leaf {
    min: __m128,
    max: __m128,
    doubt: __m128,
    weight: f64,
}

impl Leaf {
    /// A leaf of one primitive.
    #[inline(always)]
    fn of_one<P: Primitives + ?Sized>(primitives: &P, primitive: usize) -> Self {
        let [min, max, doubt] = primitives.aabb_lanes(primitive).map(__m128::from);
        Self { min, max, doubt, weight: 1.0 }
    }

    /// A leaf of one primitive or more. The first and the last are always looked at, be they the same: whether there
    /// are one or two in a leaf cannot be predicted.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn of_some<P: Primitives + ?Sized>(primitives: &P, leaf: &Node) -> Self {
        let (first, last) = (leaf.first(), leaf.first() + leaf.count() - 1);
        let mut all = Self::of_one(primitives, first).and(Self::of_one(primitives, last));
        for primitive in first + 1..last {
            all = all.and(Self::of_one(primitives, primitive));
        }
        Self { weight: leaf.count() as f64, ..all }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn and(self, other: Self) -> Self {
        // A number less itself is 0 if it is finite, else NaN.
        let zero = |doubt| _mm_sub_ps(doubt, doubt);
        Self {
            min: _mm_min_ps(self.min, other.min),
            max: _mm_max_ps(self.max, other.max),
            doubt: _mm_add_ps(zero(self.doubt), zero(other.doubt)),
            weight: self.weight,
        }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn aabb(self) -> __m256 {
        _mm256_set_m128(self.max, self.min)
    }

    /// Products of the box's extents, as often as there are primitives.
    #[target_feature(enable = "avx2")]
    #[inline]
    fn areas(self) -> __m256d {
        _mm256_mul_pd(products_of_some(_mm_sub_ps(self.max, self.min)), _mm256_set1_pd(self.weight))
    }
}

/// Products xy, yz, zx of the extents of a box that is not empty, and one without meaning.
#[target_feature(enable = "avx2")]
#[inline]
fn products_of_some(extents: __m128) -> __m256d {
    _mm256_cvtps_pd(_mm_mul_ps(extents, _mm_permute_ps::<0b11_00_10_01>(extents)))
}

/// Sums of areas that were kept in a register.
#[target_feature(enable = "avx2")]
fn fitted(leaves: u64, leaf_areas: __m256d, inner_areas: __m256d) -> Fitted {
    let [leaf_areas, inner_areas] = [leaf_areas, inner_areas].map(|sum| Areas(bytemuck::cast(sum)));
    Fitted { leaves, leaf_areas, inner_areas, ..Fitted::default() }
}

/// Whether one of the first three lanes is not finite.
#[target_feature(enable = "avx2")]
#[inline]
fn any_doubt(a: __m128, b: __m128) -> bool {
    // A number less itself is NaN if it is not finite.
    let not_finite = _mm_cmpunord_ps(_mm_sub_ps(a, a), _mm_sub_ps(b, b));
    _mm_movemask_ps(not_finite) & 0b111 != 0
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
