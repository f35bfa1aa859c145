//! The best trees over two, three and four primitives, found by trying all.

use crate::prim_ref::PrimRef;
use crate::subtree_slot::SubtreeSlot;

/// Most primitives that [`build`] takes.
pub(crate) const MOST: usize = 4;

/// Builds the cheapest tree over two to four primitives, the first of equals. O(1). The slot must
/// allow any split.
///
/// All such trees have the same leaves, so only their inner nodes below the root count.
pub(crate) fn build(prims: &[PrimRef], slot: SubtreeSlot) {
    match prims {
        [a, b] => pair(a, b, slot),
        [a, b, c] => {
            let area = |a: &PrimRef, b: &PrimRef| a.bounds().union(b.bounds()).half_area();
            let (ab, ac, bc) = (area(a, b), area(a, c), area(b, c));
            let [a, b, c] = if ab <= ac && ab <= bc {
                [a, b, c]
            } else if ac <= bc {
                [a, c, b]
            } else {
                [b, c, a]
            };
            slot.fork(2, |l, r| (pair(a, b, l), r.leaf(c)));
        }
        [a, b, c, d] => {
            let (even, [a, b, c, d]) = best_of_four([a, b, c, d]);
            if even {
                slot.fork(2, |l, r| (pair(a, b, l), pair(c, d, r)));
            } else {
                slot.fork(3, |l, r| (l.fork(2, |l, r| (pair(a, b, l), r.leaf(c))), r.leaf(d)));
            }
        }
        _ => slot.halve(prims),
    }
}

fn pair(a: &PrimRef, b: &PrimRef, slot: SubtreeSlot) {
    slot.fork(1, |l, r| (l.leaf(a), r.leaf(b)));
}

/// The pairs of 0 1 2 3, each before the other two; two pairs that make up all four stand as far
/// from the front as from the back.
const PAIRS: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]];

/// Whether the best of the fifteen trees is `(a b) (c d)` and not `((a b) c) d`, and its leaves.
fn best_of_four(prims: [&PrimRef; 4]) -> (bool, [&PrimRef; 4]) {
    let bounds = prims.map(PrimRef::bounds);
    let pairs = PAIRS.map(|[a, b, ..]| bounds[a].union(bounds[b]));
    let without = [(5, 1), (5, 0), (0, 3), (0, 2)].map(|(pair, c)| pairs[pair].union(bounds[c]).half_area());
    let pairs = pairs.map(|pair| pair.half_area());
    let (mut best, mut least) = ((true, PAIRS[0]), f32::INFINITY);
    let mut offer = |cost, tree| {
        if cost < least {
            (best, least) = (tree, cost);
        }
    };
    for i in 0..3 {
        offer(pairs[i] + pairs[5 - i], (true, PAIRS[i]));
    }
    for ([a, b, c, d], area) in PAIRS.into_iter().zip(pairs) {
        offer(area + without[d], (false, [a, b, c, d]));
        offer(area + without[c], (false, [a, b, d, c]));
    }
    (best.0, best.1.map(|i| prims[i]))
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Bvh, Vec3};
    use proptest::prelude::*;

    use crate::{Builder, build};

    /// Least area of the inner nodes of any tree over `boxes`, by trying all.
    fn least(boxes: &[Aabb]) -> f64 {
        if boxes.len() < 2 {
            return 0.0;
        }
        let area = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union).half_area_f64();
        // Each way to take some, the first among them, to the left.
        let split = |mask: u32| {
            let side = |left: bool| -> Vec<Aabb> {
                let chosen = |i: usize| ((2 * mask + 1) >> i & 1 == 1) == left;
                (0..boxes.len()).filter(|&i| chosen(i)).map(|i| boxes[i]).collect()
            };
            least(&side(true)) + least(&side(false))
        };
        area + (0..(1 << (boxes.len() - 1)) - 1).map(split).fold(f64::INFINITY, f64::min)
    }

    fn inner_area(bvh: &Bvh) -> f64 {
        let mut area = 0.0;
        bvh.visit(|_, node, _| {
            if !node.is_leaf() {
                area += node.aabb().half_area_f64();
            }
        });
        area
    }

    proptest! {
        #[test]
        fn no_tree_is_cheaper(
            corners in prop::collection::vec(prop::array::uniform6(0f32..1.0), 2..5),
        ) {
            let boxes: Vec<_> = corners
                .iter()
                .map(|c| Aabb::around(&[Vec3::new(c[0], c[1], c[2]), Vec3::new(c[3], c[4], c[5])]))
                .collect();
            let bvh = build(&boxes, Builder::Binned).expect("few");
            prop_assert!(inner_area(&bvh) <= least(&boxes) * (1.0 + 1e-6));
        }
    }
}
