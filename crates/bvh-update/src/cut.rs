//! Which part of a tree is to be built anew: everything above the subtrees that are still good.
//!
//! Each inner node has a *reference*: what some measure of it was when it was last built, in units of the sum of half
//! areas over all leaves then. What a node exceeds it by, on the scale of the leaves now, is its *excess*. Rotations
//! carry references along with the nodes they swap and leave the reference of the node whose children changed as it is.
//!
//! ```text
//! cut(N):      E = cut(L) + cut(R) + max(0, M(N) - scale * reference(N))     in post-order, without primitives
//!              if E > threshold: N is opened, and its children that are not are subtrees to keep
//! ```
//!
//! The measure M is a node's half area where the tree is *regrown*: uniform growth and shrinking leaves count for
//! nothing. `divergent.rs` has another; `selective.rs` opens nodes in a way of its own. `top.rs` builds the top anew.

use bvh_core::{Aabb, Bvh, History, MAX_HEIGHT, Node, prefetch};

use crate::pass::Scratch;
use crate::raw;
use crate::selective::Overlaps;
use crate::top::rebuild_top;

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct CutScratch {
    queues: Vec<Queue>,
    /// Subtrees to keep, and the pairs of nodes above them.
    pub(crate) cut: Vec<u32>,
    pub(crate) pairs: Vec<u32>,
    pub(crate) overlaps: Overlaps,
    pub(crate) boxes: Vec<Aabb>,
    pub(crate) kept: Vec<Node>,
    pub(crate) top: Bvh,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Regrown {
    /// The top above this many subtrees is new.
    Top(usize),
    /// There would be too many subtrees, or the tree would get too high: nothing was changed.
    TooMuch,
}

/// What a node is judged by, in the dimension of areas.
pub(crate) trait Measure: Fn(&[Node], &Node) -> f64 + Copy {}
impl<F: Fn(&[Node], &Node) -> f64 + Copy> Measure for F {}

/// A node's half area.
pub(crate) fn area(_: &[Node], node: &Node) -> f64 {
    f64::from(node.aabb().half_area())
}

/// Takes the areas as they are for references, if there are none yet; a tree is judged by the sum of areas over that of
/// leaves.
pub(crate) fn take_references(bvh: &mut Bvh) {
    take_references_of(bvh, area);
}

/// The same with another measure of nodes.
pub(crate) fn take_references_of(bvh: &mut Bvh, measure: impl Measure) {
    if bvh.history().reference != 0.0 {
        return;
    }
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    let per_leaves = 1.0 / scale(sums.leaves);
    let parts = raw::parts(bvh);
    for n in 0..parts.nodes.len() {
        let reference = (measure(parts.nodes, &parts.nodes[n]) * per_leaves) as f32;
        parts.nodes[n].set_reference(reference);
    }
    *parts.history = History {
        reference: sums.all * per_leaves,
        regret: 0.0,
        since_repair: 0,
        is_beyond_repair: false,
        ..*parts.history
    };
}

/// The unit of references: the sum of half areas over leaves that move, or 1 if there is none.
pub(crate) fn scale(leaf_area: f64) -> f64 {
    if leaf_area > 0.0 && leaf_area.is_finite() { leaf_area } else { 1.0 }
}

#[derive(Default)]
struct Sums {
    all: f64,
    leaves: f64,
}

impl Sums {
    fn add(&mut self, node: &Node) {
        let area = node.aabb().half_area_f64() * node.weight();
        self.all += area;
        if node.is_leaf() && node.moves() {
            self.leaves += area;
        }
    }
}

/// Builds the tree anew above the subtrees whose excess of area is at most `threshold`, if there are at most `most` of
/// them.
pub(crate) fn regrow(
    bvh: &mut Bvh,
    leaf_area: f64,
    threshold: f64,
    most: usize,
    scratch: &mut Scratch,
) -> Regrown {
    let scale = scale(leaf_area);
    let kept = open(bvh, area, scale, threshold, most, &mut scratch.cut);
    // Leaves are as they were: one unit of their own.
    rebuild_top(bvh, area, scale, most, scratch, |top| kept + top.references + 1.0)
}

/// Finds the subtrees whose excess is at most `threshold`, or more than `most`; gives the sum of references in them.
pub(crate) fn open(
    bvh: &Bvh,
    measure: impl Measure,
    scale: f64,
    threshold: f64,
    most: usize,
    scratch: &mut CutScratch,
) -> f64 {
    let CutScratch { queues, cut, pairs, .. } = scratch;
    cut.clear();
    pairs.clear();
    if bvh.height() < 2 {
        return 0.0;
    }
    let mut walk = Cut { nodes: bvh.nodes(), measure, scale, threshold, cut, pairs, kept: 0.0, most };
    queues.resize_with(MAX_HEIGHT as usize / 3 + 2, Queue::default);
    queues[0].slots.clear();
    queues[0].slots.push(0);
    walk.walk(queues);
    walk.kept
}

struct Cut<'a, M> {
    nodes: &'a [Node],
    measure: M,
    scale: f64,
    threshold: f64,
    most: usize,
    cut: &'a mut Vec<u32>,
    pairs: &'a mut Vec<u32>,
    /// Sum of references of nodes that are not opened.
    kept: f64,
}

/// Nodes of one block of the walk, breadth-first as in `block.rs`, and the excess at and below each.
#[derive(Default)]
struct Queue {
    slots: Vec<u32>,
    excess: Vec<f64>,
}

/// Nodes in one queue, and roots of one block below another.
const QUEUE: usize = 1024;
const ROOTS: usize = 64;

impl<M: Measure> Cut<'_, M> {
    /// Excess at and below nodes with grandchildren, at the front of the first queue.
    fn walk(&mut self, queues: &mut [Queue]) {
        let (queue, deeper) = queues.split_first_mut().expect("as many queues as blocks nest");
        let Queue { slots, excess } = queue;
        let mut done = 0;
        while done < slots.len() && slots.len() + 2 <= QUEUE {
            let first = self.nodes[slots[done] as usize].first();
            for child in [first, first + 1] {
                let node = &self.nodes[child];
                if node.height() > 1 {
                    prefetch(self.nodes, node.first());
                    slots.push(child as u32);
                }
            }
            done += 1;
        }
        excess.clear();
        excess.resize(slots.len(), 0.0);
        for (slots, excess) in slots[done..].chunks(ROOTS).zip(excess[done..].chunks_mut(ROOTS)) {
            if self.cut.len() > self.most {
                return;
            }
            deeper[0].slots.clear();
            deeper[0].slots.extend(slots);
            self.walk(deeper);
            excess.copy_from_slice(&deeper[0].excess[..slots.len()]);
        }
        // Children were queued left first, so they come off the end right first.
        let mut end = slots.len();
        for i in (0..done).rev() {
            let node = self.nodes[slots[i] as usize];
            let mut below = [0.0; 2];
            for (side, below) in below.iter_mut().enumerate().rev() {
                let child = self.nodes[node.first() + side];
                match child.height() {
                    // Leaves have no excess.
                    0 => {}
                    1 => *below = self.settle(&child, [0.0; 2]),
                    _ => {
                        end -= 1;
                        *below = excess[end];
                    }
                }
            }
            excess[i] = self.settle(&node, below);
        }
    }

    /// Opens a node, or keeps it; gives the excess at and below it.
    fn settle(&mut self, node: &Node, below: [f64; 2]) -> f64 {
        let own = (self.measure)(self.nodes, node) - self.scale * f64::from(node.reference());
        let total = below[0] + below[1] + own.max(0.0);
        if total > self.threshold {
            let pair = node.first() as u32;
            self.pairs.push(pair);
            for (child, below) in (pair..).zip(below) {
                if below <= self.threshold {
                    self.cut.push(child);
                }
            }
        } else {
            self.kept += f64::from(node.reference());
        }
        total
    }
}
