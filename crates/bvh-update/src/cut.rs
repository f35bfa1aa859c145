//! Regrowing a tree: which subtrees are still good, and a new top above them.
//!
//! Each inner node has a *reference*: its half area when it was last built, in units of the sum over all leaves then.
//! What a node exceeds it by, on the scale of the leaves now, is its *excess*: uniform growth and shrinking leaves
//! count for nothing. Rotations carry references along with the nodes they swap and leave the reference of the node
//! whose children changed as it is.
//!
//! ```text
//! cut(N):      E = cut(L) + cut(R) + max(0, A(N) - scale * reference(N))     in post-order, without primitives
//!              if E > threshold: N is opened, and its children that are not are subtrees to keep
//! ```
//!
//! The opened nodes form the top of the tree, k - 1 of them over k kept subtrees. A builder makes a new top over the
//! boxes of these, which takes the pairs of the old one. Where solids burst into pieces the cut is a few per cent of the
//! tree. Related: Yoon et al. 2007 and Garanzha 2008, who choose subtrees to restructure by other measures.

use bvh_build::{BuildOptions, Builder, rebuild};
use bvh_core::{Aabb, Bvh, History, MAX_HEIGHT, Node, prefetch};

use crate::pass::Scratch;
use crate::raw;

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct CutScratch {
    queues: Vec<Queue>,
    boxes: Vec<Aabb>,
    kept: Vec<Node>,
    cut: Vec<u32>,
    pairs: Vec<u32>,
    top: Bvh,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Regrown {
    /// The top above this many subtrees is new.
    Top(usize),
    /// There would be too many subtrees, or the tree would get too high: nothing was changed.
    TooMuch,
}

/// Takes the areas as they are for references, if there are none yet; the measure is the sum of areas over that of
/// leaves.
pub(crate) fn take_references(bvh: &mut Bvh) {
    if bvh.history().reference != 0.0 {
        return;
    }
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    let per_leaves = 1.0 / scale(sums.leaves);
    let parts = raw::parts(bvh);
    for node in parts.nodes {
        node.set_reference((node.aabb().half_area_f64() * per_leaves) as f32);
    }
    *parts.history = History {
        reference: sums.all * per_leaves,
        updates: parts.history.updates,
        rotation_pause: parts.history.rotation_pause,
        rebuilds_in_a_row: parts.history.rebuilds_in_a_row,
        ..History::default()
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

/// Builds the tree anew above the subtrees whose excess is at most `threshold`, if there are at most `most` of them.
pub(crate) fn regrow(
    bvh: &mut Bvh,
    leaf_area: f64,
    threshold: f64,
    most: usize,
    scratch: &mut Scratch,
) -> Regrown {
    let scale = scale(leaf_area);
    let Scratch { cut: CutScratch { queues, boxes, kept, cut, pairs, top }, build, .. } = scratch;
    cut.clear();
    pairs.clear();
    let mut walk = Cut { nodes: bvh.nodes(), scale, threshold, cut, pairs, kept: 0.0, most };
    if bvh.height() < 2 {
        return Regrown::Top(0);
    }
    queues.resize_with(MAX_HEIGHT as usize / 3 + 2, Queue::default);
    queues[0].slots.clear();
    queues[0].slots.push(0);
    walk.walk(queues);
    if walk.cut.len() > most {
        return Regrown::TooMuch;
    }
    if walk.cut.is_empty() {
        return Regrown::Top(0);
    }
    let reference = walk.kept;

    // In memory order, as builders number pairs.
    cut.sort_unstable();
    pairs.sort_unstable();
    kept.clear();
    kept.extend(cut.iter().map(|&n| bvh.nodes()[n as usize]));
    boxes.clear();
    boxes.extend(kept.iter().map(Node::aabb));
    let options = BuildOptions::default();
    if rebuild(top, boxes, Builder::BinnedParallel, &options, build).is_err()
        || highest(top, 0, kept) > MAX_HEIGHT
    {
        return Regrown::TooMuch;
    }
    assert!(
        top.nodes().len() == 2 * pairs.len() + 2,
        "a tree over k subtrees has k - 1 pairs below the root"
    );
    let parts = raw::parts(bvh);
    let mut before = 0.0;
    for &pair in pairs.iter() {
        before += still_inner(&parts.nodes[pair as usize]) + still_inner(&parts.nodes[pair as usize + 1]);
    }
    let kept_still: f64 = kept.iter().map(still_inner).sum();
    before += still_inner(&parts.nodes[0]) - kept_still;
    let mut graft =
        Graft { nodes: parts.nodes, top, kept, pairs: pairs.iter(), scale, reference, still: 0.0 };
    graft.write(0, 0);
    let (reference, still) = (graft.reference, graft.still);
    *parts.still_area += still - before;
    let history = parts.history;
    // Leaves are as they were: one unit of their own.
    *history = History {
        reference: reference + 1.0,
        regret: 0.0,
        since_repair: 0,
        rebuilds_in_a_row: 0,
        ..*history
    };
    Regrown::Top(kept.len())
}

/// Half area of an inner node that stands still, else 0.
fn still_inner(node: &Node) -> f64 {
    if node.is_leaf() || node.moves() { 0.0 } else { node.aabb().half_area_f64() * node.weight() }
}

struct Cut<'a> {
    nodes: &'a [Node],
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

impl Cut<'_> {
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
        let own = f64::from(node.aabb().half_area()) - self.scale * f64::from(node.reference());
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

/// Height that a node of `top` has once the subtrees are in place.
fn highest(top: &Bvh, n: usize, kept: &[Node]) -> u32 {
    let node = &top.nodes()[n];
    match (top.children(node), top.primitives(node)) {
        (Some(_), _) => 1 + highest(top, node.first(), kept).max(highest(top, node.first() + 1, kept)),
        (None, &[subtree]) => kept[subtree as usize].height(),
        (None, _) => 0,
    }
}

struct Graft<'a> {
    nodes: &'a mut [Node],
    top: &'a Bvh,
    kept: &'a [Node],
    pairs: std::slice::Iter<'a, u32>,
    scale: f64,
    reference: f64,
    still: f64,
}

impl Graft<'_> {
    /// Writes node `n` of the new top, and what is below, to `slot`.
    fn write(&mut self, n: usize, slot: usize) {
        let node = self.top.nodes()[n];
        if let &[subtree] = self.top.primitives(&node) {
            self.nodes[slot] = self.kept[subtree as usize];
            return;
        }
        let pair = *self.pairs.next().expect("as many pairs as the top has");
        self.write(node.first(), pair as usize);
        self.write(node.first() + 1, pair as usize + 1);
        let (l, r) = (self.nodes[pair as usize], self.nodes[pair as usize + 1]);
        let mut new = Node::inner(node.aabb(), pair);
        new.refit(&l, &r);
        let reference = (node.aabb().half_area_f64() / self.scale) as f32;
        new.set_reference(reference);
        self.reference += f64::from(new.reference());
        self.still += still_inner(&new);
        self.nodes[slot] = new;
    }
}
