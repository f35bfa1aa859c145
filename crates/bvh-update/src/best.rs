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

/// The boxes of a few primitives, and what they cost in leaves of one each.
pub(crate) struct Few {
    boxes: [Aabb; LONGEST],
    count: usize,
    pub(crate) single: f64,
}

impl Few {
    /// The primitives in these slots, at most [`LONGEST`].
    #[inline]
    pub(crate) fn new<P: Primitives + ?Sized>(primitives: &P, slots: &[u32]) -> Self {
        let mut few = Self { boxes: [Aabb::EMPTY; LONGEST], count: slots.len(), single: 0.0 };
        few.boxes.iter_mut().zip(slots).for_each(|(aabb, &p)| *aabb = primitives.aabb(p as usize));
        few.single = few.boxes[..few.count].iter().map(|aabb| aabb.half_area_f64() * COST_INTERSECT).sum();
        few
    }

    /// Whether one leaf of this cost cannot be better, as a tree has a root at least, and leaves of one primitive at best.
    pub(crate) fn are_best_as_leaf(&self, cost: f64) -> bool {
        let area = cost / (COST_INTERSECT * self.count as f64);
        cost <= area * COST_TRAVERSE + self.single
    }

    pub(crate) fn best(&self) -> Best {
        Best::new(&self.boxes[..self.count])
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
    let (first, count) = (leaf.first(), leaf.count());
    let few = Few::new(primitives, &order[first..][..count]);
    let cost = leaf.aabb().half_area_f64() * leaf.weight();
    if few.are_best_as_leaf(cost) {
        return 0.0;
    }
    let best = few.best();
    if best.cost[0][count - 1] >= cost {
        return 0.0;
    }
    best.for_each_leaf(0, count, &mut |from, to| {
        pieces.push(Node::leaf(best.aabb[from][to - 1], (first + from) as u32, (to - from) as u32));
    });
    cost - best.leaves(0, count)
}
