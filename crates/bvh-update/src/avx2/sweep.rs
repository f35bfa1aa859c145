//! The kernel of the reverse sweep in AVX2.

use std::arch::x86_64::*;
use std::ops::Range;

use bvh_core::{Node, Primitives};

use super::{Leaf, any_doubt, compress, fitted, products_of_one, union, with_words_of, words};
use crate::kernels::{Fitted, fit_leaf};
use crate::raw::SharedNodes;
use crate::sweep::{AHEAD, List, Lists, STRETCH, stretches};

impl Lists {
    /// Lists what is in a stretch, four pairs at a time.
    #[target_feature(enable = "avx2,popcnt")]
    fn fill(&mut self, nodes: SharedNodes<'_>, stretch: Range<usize>) {
        const { assert!(Node::LEAF == 1 << 31 && Node::DYNAMIC == 1 << 30) };
        [self.ones.count, self.primitives.count, self.others.count, self.inner.count] = [0; 4];
        for first in stretch.clone().step_by(4) {
            for pair in first..first + 4 {
                nodes.prefetch::<false>((2 * pair).wrapping_sub(2 * STRETCH));
            }
            let [a, b, c, d] = nodes.four_pairs_lanes(2 * first, 2 * stretch.end - 2);
            let (ab, cd) = (words(a, b), words(c, d));
            let links = _mm256_permute2x128_si256::<0x20>(ab, cd);
            let aux = _mm256_permute2x128_si256::<0x31>(ab, cd);
            let lanes = |mask| _mm256_movemask_ps(_mm256_castsi256_ps(mask)) as u32;
            let here = (1 << (2 * 4.min(stretch.end - first))) - 1;
            let moves = lanes(_mm256_slli_epi32::<1>(links)) & here;
            let leaves = lanes(links) & moves;
            let ones = lanes(_mm256_cmpeq_epi32(aux, _mm256_set1_epi32(1 << 8))) & leaves;
            let numbers = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let slots = _mm256_add_epi32(_mm256_set1_epi32(2 * first as i32), numbers);
            self.ones.add(slots, ones);
            self.primitives.add(_mm256_and_si256(links, _mm256_set1_epi32(Node::INDEX as i32)), ones);
            self.others.add(slots, leaves & !ones);
            self.inner.add(slots, moves & !leaves);
        }
    }
}

impl List {
    /// Appends the lanes in a set.
    #[target_feature(enable = "avx2,popcnt")]
    #[inline]
    fn add(&mut self, lanes: __m256i, set: u32) {
        self.numbers[self.count..self.count + 8].copy_from_slice(&compress(lanes, set as usize));
        self.count += set.count_ones() as usize;
    }
}

/// See [`sweep::sweep`](crate::sweep::sweep).
#[target_feature(enable = "avx2,popcnt")]
pub(crate) fn sweep<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    piece: Range<usize>,
    [here, next]: &mut [Lists; 2],
) -> Fitted {
    let mut others = Fitted::default();
    let (mut leaf_areas, mut inner_areas, mut count) = (_mm256_setzero_pd(), _mm256_setzero_pd(), 0);
    let mut stretches = stretches(piece);
    let mut fill_next = |lists: &mut Lists| {
        let stretch = stretches.next();
        lists.fill(nodes, stretch.clone().unwrap_or_default());
        stretch.is_some()
    };
    let (mut here, mut next) = (here, next);
    let mut goes_on = fill_next(here);
    while goes_on {
        goes_on = fill_next(next);
        here.primitives.look_ahead(&next.primitives);
        let numbers = &here.primitives.numbers;
        let soon = numbers[AHEAD..].iter().zip(&numbers[2 * AHEAD..]);
        for ((&slot, &primitive), (&soon, &later)) in here.ones.all().iter().zip(numbers).zip(soon) {
            primitives.prefetch_index(later as usize);
            primitives.prefetch_data(soon as usize);
            let leaf = Leaf::of_one(primitives, primitive as usize);
            if any_doubt(leaf.doubt, leaf.doubt) {
                fit_leaf(nodes, primitives, slot as usize, &mut others);
                continue;
            }
            nodes.set_lanes(slot as usize, with_words_of(nodes.lanes(slot as usize), leaf.aabb()));
            leaf_areas = _mm256_add_pd(leaf_areas, leaf.areas());
            count += 1;
        }
        for &slot in here.others.all() {
            let node = nodes.get(slot as usize);
            if node.count() > 0 {
                let leaf = Leaf::of_some(primitives, &node);
                if !any_doubt(leaf.doubt, leaf.doubt) {
                    nodes.set_lanes(slot as usize, with_words_of(nodes.lanes(slot as usize), leaf.aabb()));
                    leaf_areas = _mm256_add_pd(leaf_areas, leaf.areas());
                    count += 1;
                    continue;
                }
            }
            fit_leaf(nodes, primitives, slot as usize, &mut others);
        }
        others.inner += here.inner.count as u64;
        for &slot in here.inner.all().iter().rev() {
            let slot = slot as usize;
            let [l, r] = nodes.pair_lanes(nodes.get(slot).first());
            let whole = union(l, r);
            // The structure is as it was, and so are height and motion.
            nodes.set_lanes(slot, with_words_of(nodes.lanes(slot), whole));
            inner_areas = _mm256_add_pd(inner_areas, _mm256_cvtps_pd(products_of_one(whole)));
        }
        (here, next) = (next, here);
    }
    others.and(&fitted(count, leaf_areas, inner_areas))
}
