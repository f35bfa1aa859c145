//! The cheapest trees over a few primitives that are neighbours in the tree's order, by dynamic
//! programming.

use bvh_core::{Aabb, COST_INTERSECT, COST_TRAVERSE};

/// Most primitives of a run.
pub(crate) const LONGEST: usize = 4;

/// The best trees over all parts of a run, by their first and their last primitive.
pub(super) struct OptimalTree {
    pub(super) aabb: [[Aabb; LONGEST]; LONGEST],
    pub(super) cost: [[f64; LONGEST]; LONGEST],
    /// Where the second child begins; 0 for a leaf.
    pub(super) split: [[u8; LONGEST]; LONGEST],
}

impl OptimalTree {
    /// The trees over at most [`LONGEST`] boxes.
    pub(super) fn new(boxes: &[Aabb]) -> Self {
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
                        least = (cost, k as u8);
                    }
                }
                (best.cost[from][to], best.split[from][to]) = least;
            }
        }
        best
    }

    /// Adds to a sum, from left to right, the part of the cost over the primitives `from..to` that
    /// is due to leaves, and to a number that of the leaves.
    pub(super) fn add_leaves(&self, (cost, count): (f64, u32), from: usize, to: usize) -> (f64, u32) {
        match self.split[from][to - 1] {
            0 => (cost + self.cost[from][to - 1], count + 1),
            split => {
                let split = usize::from(split);
                self.add_leaves(self.add_leaves((cost, count), from, split), split, to)
            }
        }
    }
}

/// Whether one leaf of this cost cannot be better, as a tree has a root at least, and leaves of one
/// primitive at best.
pub(super) fn are_best_as_leaf(boxes: &[Aabb], cost: f64) -> bool {
    let area = cost / (COST_INTERSECT * boxes.len() as f64);
    let single: f64 = boxes.iter().map(|aabb| aabb.half_area_f64() * COST_INTERSECT).sum();
    cost <= area * COST_TRAVERSE + single
}
