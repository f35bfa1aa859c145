//! Splitting and merging leaves while rotating (Kopta et al. 2012, section 2, proposed as future work).
//!
//! A *run* is a subtree that moves and covers a few slots without a gap. There are few trees over its primitives that
//! leave them in the order of their slots, and the best of these, with leaves of any size, takes the place of the
//! subtree if its SAH cost is lower:
//!
//! ```text
//! best(i..j) = min( COST_INTERSECT * A(i..j) * (j - i),
//!                   COST_TRAVERSE  * A(i..j) + min over k of best(i..k) + best(k..j) )
//! ```
//!
//! So leaves merge where triangles move together, and split where they do not any more, in one step. Both sides of the
//! comparison are sums of the same terms in the same order, so no tree is left for an equal one, and still scenes come
//! to rest.
//!
//! The order of primitives stays as it is, which keeps them streaming through memory; the price is that leaves that
//! rotations brought together from afar cannot merge. Nor can rotations take apart what has merged: a tree that
//! recovers from chaos may end a few per cent above one that has not. A tree that was built with larger leaves splits
//! them as far as it has pairs of nodes to spare; those that are not needed are kept in a list within the arena
//! (`History::spare_pair`).
//!
//! Meshes end with 1.2 to 1.4 nodes a triangle instead of 2, a cost some 2 % lower, and rays 2 to 8 % faster. The
//! update takes 1.3 to 1.6 times as long as rotations alone, and up to 3 times where leaves are coming apart. Where
//! nothing stays together it only costs. O(n) for the n nodes above primitives that move, on one thread after the pass.

use bvh_core::{
    Aabb, Bvh, COST_INTERSECT, COST_TRAVERSE, History, Layout, MAX_HEIGHT, Node, Primitives, prefetch,
};

use crate::cut::scale;
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::strategy::{Rotate, Turn, Update, UpdateError};

/// How leaves are split and merged: subtrees of a few primitives that are neighbours in the tree's order, as they were
/// built, become the cheapest tree with leaves of any size, by the SAH.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leaves {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Most primitives in a leaf that is merged, and in one that is split; at most, and by default, 4.
    pub max_leaf_size: u32,
    /// Leaves are seen to in one of this many updates, different ones each time; a power of two, else the next one. 16
    /// by default. All are seen to when their areas have grown by a tenth.
    pub period: u32,
}

impl Default for Leaves {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), max_leaf_size: LONGEST as u32, period: 16 }
    }
}

/// Most primitives of a run.
pub(crate) const LONGEST: usize = 4;

/// Once the sum of the areas of leaves has grown by this part, it is the turn of all of them: what has merged is coming
/// apart.
pub(crate) const STRETCHED: f64 = 0.1;

/// Subtrees of this height or less take turns; what is above them is walked through in each update.
const SMALL: u32 = 8;

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &Leaves,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let History { updates, reference, .. } = *bvh.history();
    let mut tally = pass(bvh, primitives, options.rotate, scratch);
    let stretched = reference > 0.0 && tally.leaf_area > reference * (1.0 + STRETCHED);
    let turn = Turn::new(Rotate { period: if stretched { 1 } else { options.period } }, updates);
    let change = settle(bvh, primitives, Some(turn), options.max_leaf_size, scale(tally.leaf_area));
    let leaf_area = tally.leaf_area + change.leaves;
    let is_first = stretched || reference == 0.0;
    let history = raw::parts(bvh).history;
    history.reference = if is_first { leaf_area } else { reference.min(leaf_area) };
    history.largest_leaf = 0;
    tally.area += change.all;
    Ok(tally.update(bvh))
}

/// By how much the sum of half areas times weights has changed.
#[derive(Clone, Copy, Default)]
pub(crate) struct Change {
    pub(crate) all: f64,
    /// The part of it that is due to leaves.
    pub(crate) leaves: f64,
    /// By how much the areas of the leaves seen to are greater than those of leaves of one primitive each would be.
    pub(crate) merged: f64,
}

/// Splits and merges the leaves whose turn it is, or splits whichever leaves are better apart, in a tree that has been
/// fitted; references are in this unit of areas.
pub(crate) fn settle<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    merge: Option<Turn>,
    max_leaf_size: u32,
    unit: f64,
) -> Change {
    let mut unfinished = raw::Unfinished::new(bvh);
    let parts = raw::parts(unfinished.bvh);
    parts.history.layout = Layout::Other;
    let mut walk = Walk {
        nodes: parts.nodes,
        order: parts.order,
        primitives,
        merge,
        longest: max_leaf_size.min(LONGEST as u32),
        unit,
        // If primitives panic, spare pairs are lost: some may be in use by then.
        spare: std::mem::take(&mut parts.history.spare_pair),
        change: Change::default(),
    };
    if let Some(run) = walk.subtree(0, 0, false) {
        walk.settle(0, 0, run);
    }
    let change = walk.change;
    parts.history.spare_pair = walk.spare;
    unfinished.done = true;
    change
}

struct Walk<'a, P: ?Sized> {
    nodes: &'a mut [Node],
    order: &'a [u32],
    primitives: &'a P,
    merge: Option<Turn>,
    longest: u32,
    /// The unit of references.
    unit: f64,
    spare: u32,
    change: Change,
}

/// The slots of a subtree, and the sum of half areas times weights over its nodes.
#[derive(Clone, Copy)]
struct Run {
    first: u32,
    count: u32,
    cost: f64,
    /// The part of it that is due to leaves.
    leaves: f64,
}

impl<P: Primitives + ?Sized> Walk<'_, P> {
    /// Settles the longest runs at and below node `n`, but gives that which includes `n` itself to the caller.
    fn subtree(&mut self, n: usize, depth: u32, is_turn: bool) -> Option<Run> {
        let node = self.nodes[n];
        if !node.moves() {
            return None;
        }
        let own = node.aabb().half_area_f64() * node.weight();
        if node.is_leaf() {
            let run = Run { first: node.first() as u32, count: node.count() as u32, cost: own, leaves: own };
            return (1..=self.longest).contains(&run.count).then_some(run);
        }
        let pair = node.first();
        let is_turn = is_turn || node.height() <= SMALL && self.merge.is_none_or(|turn| turn.includes(n));
        if !is_turn && node.height() <= SMALL {
            return None;
        }
        prefetch(self.nodes, self.nodes[pair + 1].first());
        let runs = [pair, pair + 1].map(|child| self.subtree(child, depth + 1, is_turn));
        if let [Some(l), Some(r)] = runs
            && self.merge.is_some()
            && (l.first + l.count == r.first || r.first + r.count == l.first)
            && l.count + r.count <= self.longest
        {
            let cost = own + (l.cost + r.cost);
            let (first, count) = (l.first.min(r.first), l.count + r.count);
            return Some(Run { first, count, cost, leaves: l.leaves + r.leaves });
        }
        for (child, run) in (pair..).zip(runs) {
            if let Some(run) = run {
                self.settle(child, depth + 1, run);
            }
        }
        // The box is the same; the height may not be.
        let mut new = node;
        new.refit(&self.nodes[pair], &self.nodes[pair + 1]);
        if new != node {
            self.nodes[n] = new;
        }
        None
    }

    /// Puts the best tree over a run into the place of node `n`.
    fn settle(&mut self, n: usize, depth: u32, run: Run) {
        if run.count < 2 || depth + run.count - 1 > MAX_HEIGHT {
            return;
        }
        let slots = &self.order[run.first as usize..][..run.count as usize];
        let plan = Plan::new(slots.iter().map(|&p| self.primitives.aabb(p as usize)));
        let best = plan.cost[0][slots.len() - 1];
        let mut leaves = run.leaves;
        if best < run.cost && self.has_pairs(plan.pairs(0, slots.len()), n) {
            leaves = plan.leaves(0, slots.len());
            self.change.all += best - run.cost;
            self.change.leaves += leaves - run.leaves;
            self.release(n);
            self.write(n, &plan, run.first, 0, slots.len());
        }
        self.change.merged += leaves - (0..slots.len()).map(|i| plan.cost[i][i]).sum::<f64>();
    }

    /// Whether there are `count` pairs, those below node `n` and spare ones together.
    fn has_pairs(&self, count: usize, n: usize) -> bool {
        let below = pairs_below(self.nodes, n);
        let mut spare = self.spare;
        for _ in below..count {
            if spare == 0 {
                return false;
            }
            spare = self.nodes[spare as usize].first() as u32;
        }
        true
    }

    /// Keeps the pairs below node `n` for later.
    fn release(&mut self, n: usize) {
        if !self.nodes[n].is_leaf() {
            let pair = self.nodes[n].first();
            self.release(pair);
            self.release(pair + 1);
            self.nodes[pair] = Node::leaf(Aabb::EMPTY, self.spare, 0);
            self.nodes[pair + 1] = Node::NOTHING;
            self.spare = pair as u32;
        }
    }

    /// Writes the part of a plan over primitives `from..to` to node `n`.
    fn write(&mut self, n: usize, plan: &Plan, first: u32, from: usize, to: usize) {
        let split = plan.split[from][to - 1];
        if split == 0 {
            let aabb = plan.aabb[from][to - 1];
            self.nodes[n] = Node::leaf(aabb, first + from as u32, (to - from) as u32);
            return;
        }
        let pair = self.spare as usize;
        self.spare = self.nodes[pair].first() as u32;
        self.write(pair, plan, first, from, split);
        self.write(pair + 1, plan, first, split, to);
        let mut node = Node::parent(&self.nodes[pair], &self.nodes[pair + 1], pair as u32);
        node.set_reference((node.aabb().half_area_f64() / self.unit) as f32);
        self.nodes[n] = node;
    }
}

fn pairs_below(nodes: &[Node], n: usize) -> usize {
    let node = &nodes[n];
    if node.is_leaf() {
        0
    } else {
        1 + [0, 1].map(|i| pairs_below(nodes, node.first() + i)).iter().sum::<usize>()
    }
}

/// The best trees over all parts of a run, by their first and their last primitive.
struct Plan {
    aabb: [[Aabb; LONGEST]; LONGEST],
    cost: [[f64; LONGEST]; LONGEST],
    /// Where the second child begins; 0 for a leaf.
    split: [[usize; LONGEST]; LONGEST],
}

impl Plan {
    fn new(boxes: impl ExactSizeIterator<Item = Aabb>) -> Self {
        let mut plan = Self {
            aabb: [[Aabb::EMPTY; LONGEST]; LONGEST],
            cost: [[0.0; LONGEST]; LONGEST],
            split: [[0; LONGEST]; LONGEST],
        };
        for (to, aabb) in boxes.enumerate() {
            plan.aabb[to][to] = aabb;
            plan.cost[to][to] = aabb.half_area_f64() * COST_INTERSECT;
            for from in (0..to).rev() {
                plan.aabb[from][to] = plan.aabb[from][to - 1].union(aabb);
                let area = plan.aabb[from][to].half_area_f64();
                let mut best = (area * (COST_INTERSECT * (to - from + 1) as f64), 0);
                for k in from + 1..=to {
                    let cost = area * COST_TRAVERSE + (plan.cost[from][k - 1] + plan.cost[k][to]);
                    if cost < best.0 {
                        best = (cost, k);
                    }
                }
                (plan.cost[from][to], plan.split[from][to]) = best;
            }
        }
        plan
    }

    /// The part of the cost over the primitives `from..to` that is due to leaves.
    fn leaves(&self, from: usize, to: usize) -> f64 {
        match self.split[from][to - 1] {
            0 => self.cost[from][to - 1],
            k => self.leaves(from, k) + self.leaves(k, to),
        }
    }

    /// How many inner nodes there are over the primitives `from..to`.
    fn pairs(&self, from: usize, to: usize) -> usize {
        match self.split[from][to - 1] {
            0 => 0,
            k => 1 + self.pairs(from, k) + self.pairs(k, to),
        }
    }
}
