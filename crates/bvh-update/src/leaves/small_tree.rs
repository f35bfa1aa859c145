//! The cheapest trees over a few primitives that are neighbours in the tree's order, by dynamic programming.

use bvh_core::{Aabb, COST_INTERSECT, COST_TRAVERSE, Primitives};

/// Most primitives of a run.
pub(crate) const LONGEST: usize = 4;

/// The best trees over all parts of a run, by their first and their last primitive.
pub(super) struct OptimalTree {
    pub(super) aabb: [[Aabb; LONGEST]; LONGEST],
    pub(super) cost: [[f64; LONGEST]; LONGEST],
    /// Where the second child begins; 0 for a leaf.
    pub(super) split: [[usize; LONGEST]; LONGEST],
}

impl OptimalTree {
    fn new(boxes: &[Aabb]) -> Self {
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

    /// Adds to `sum`, from left to right, the part of the cost over the primitives `from..to` that is due to leaves.
    pub(super) fn add_leaves(&self, sum: f64, from: usize, to: usize) -> f64 {
        match self.split[from][to - 1] {
            0 => sum + self.cost[from][to - 1],
            k => self.add_leaves(self.add_leaves(sum, from, k), k, to),
        }
    }
}

/// The boxes of a few primitives, and what they cost in leaves of one each.
pub(super) struct SmallTree {
    boxes: [Aabb; LONGEST],
    count: usize,
    pub(super) single: f64,
}

impl SmallTree {
    /// The primitives in these slots, at most [`LONGEST`].
    #[inline]
    pub(super) fn new<P: Primitives + ?Sized>(primitives: &P, slots: &[u32]) -> Self {
        let mut few = Self { boxes: [Aabb::EMPTY; LONGEST], count: slots.len(), single: 0.0 };
        few.boxes.iter_mut().zip(slots).for_each(|(aabb, &p)| *aabb = primitives.aabb(p as usize));
        few.single = few.boxes[..few.count].iter().map(|aabb| aabb.half_area_f64() * COST_INTERSECT).sum();
        few
    }

    /// Whether one leaf of this cost cannot be better, as a tree has a root at least, and leaves of one primitive at best.
    pub(super) fn are_best_as_leaf(&self, cost: f64) -> bool {
        let area = cost / (COST_INTERSECT * self.count as f64);
        cost <= area * COST_TRAVERSE + self.single
    }

    pub(super) fn best(&self) -> OptimalTree {
        OptimalTree::new(&self.boxes[..self.count])
    }
}
