//! The best trees over a few primitives that are neighbours in the tree's order (`leaves.rs`).

use bvh_core::{Aabb, COST_INTERSECT, COST_TRAVERSE, Node, Primitives};

/// Most primitives of a run.
pub(crate) const LONGEST: usize = 4;

/// The best trees over all parts of a run, by their first and their last primitive.
pub(crate) struct Best {
    pub(crate) aabb: [[Aabb; LONGEST]; LONGEST],
    pub(crate) cost: [[f64; LONGEST]; LONGEST],
    /// Where the second child begins; 0 for a leaf.
    pub(crate) split: [[usize; LONGEST]; LONGEST],
}

impl Best {
    pub(crate) fn new(boxes: &[Aabb]) -> Self {
        let mut best = Self {
            aabb: [[Aabb::EMPTY; LONGEST]; LONGEST],
            cost: [[0.0; LONGEST]; LONGEST],
            split: [[0; LONGEST]; LONGEST],
        };
        for (to, &aabb) in boxes.iter().enumerate() {
            best.aabb[to][to] = aabb;
            best.cost[to][to] = aabb.half_area_f64() * COST_INTERSECT;
            for from in (0..to).rev() {
                best.aabb[from][to] = best.aabb[from][to - 1].union(aabb);
                let area = best.aabb[from][to].half_area_f64();
                let mut least = (area * (COST_INTERSECT * (to - from + 1) as f64), 0);
                for k in from + 1..=to {
                    let cost = area * COST_TRAVERSE + (best.cost[from][k - 1] + best.cost[k][to]);
                    if cost < least.0 {
                        least = (cost, k);
                    }
                }
                (best.cost[from][to], best.split[from][to]) = least;
            }
        }
        best
    }

    /// The part of the cost over the primitives `from..to` that is due to leaves.
    pub(crate) fn leaves(&self, from: usize, to: usize) -> f64 {
        let mut sum = 0.0;
        self.for_each_leaf(from, to, &mut |from, to| sum += self.cost[from][to - 1]);
        sum
    }

    /// Calls `f` with the range of each leaf over the primitives `from..to`.
    fn for_each_leaf(&self, from: usize, to: usize, f: &mut impl FnMut(usize, usize)) {
        match self.split[from][to - 1] {
            0 => f(from, to),
            k => {
                self.for_each_leaf(from, k, f);
                self.for_each_leaf(k, to, f);
            }
        }
    }
}

/// Adds the leaves of the best tree over the primitives of a leaf that moves, if that is better than the leaf; gives by how
/// much they cost less.
pub(crate) fn set_apart<P: Primitives + ?Sized>(
    order: &[u32],
    primitives: &P,
    leaf: &Node,
    pieces: &mut Vec<Node>,
) -> f64 {
    let slots = &order[leaf.first()..][..leaf.count()];
    let mut boxes = [Aabb::EMPTY; LONGEST];
    let boxes = &mut boxes[..slots.len()];
    boxes.iter_mut().zip(slots).for_each(|(aabb, &p)| *aabb = primitives.aabb(p as usize));
    let single = boxes.iter().map(|aabb| aabb.half_area_f64() * COST_INTERSECT).sum::<f64>();
    let cost = leaf.aabb().half_area_f64() * leaf.weight();
    let (first, count) = (leaf.first() as u32, leaf.count() as u32);
    if is_best_as_leaf(cost, count, single) {
        return 0.0;
    }
    let best = Best::new(boxes);
    if best.cost[0][boxes.len() - 1] >= cost {
        return 0.0;
    }
    best.for_each_leaf(0, boxes.len(), &mut |from, to| {
        pieces.push(Node::leaf(best.aabb[from][to - 1], first + from as u32, (to - from) as u32));
    });
    cost - best.leaves(0, boxes.len())
}

/// Whether a leaf of this cost and of so many primitives cannot be better, as a tree has a root at least, and leaves of one
/// primitive at best; `single` is what these cost.
pub(crate) fn is_best_as_leaf(cost: f64, count: u32, single: f64) -> bool {
    let area = cost / (COST_INTERSECT * f64::from(count));
    cost <= area * COST_TRAVERSE + single
}
