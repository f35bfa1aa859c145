//! A new top for a tree: a builder's over the boxes of the subtrees that are kept.
//!
//! The opened nodes form the top of the tree, k - 1 of them over k kept subtrees. The new top takes the pairs of the old
//! one, and spare ones where leaves were set apart. Where solids burst into pieces it is a few per cent of the tree.

use bvh_build::{BuildOptions, Builder, rebuild};
use bvh_core::{Bvh, History, Layout, LeafHistory, MAX_HEIGHT, Node};
use rayon::prelude::*;

use crate::apart::Apart;
use crate::cut::{CutScratch, NodeMeasure, Regrown, reference};
use crate::pass::Scratch;
use crate::raw;

/// Opened pairs that a task sums up: sums of floats depend on it.
const SHARE: usize = 4096;

/// What is known of a new top.
#[derive(Clone, Copy, Default)]
pub(crate) struct NewTop {
    /// Sum of the references of its nodes.
    pub(crate) references: f64,
    /// Sum of their half areas times weights, less that of the nodes before.
    pub(crate) change: f64,
    /// The same for those that stand still.
    still_change: f64,
}

/// Builds the tree anew above the subtrees that are kept of the cut, if these are at most `most`; `judge` says how
/// good it is.
pub(crate) fn rebuild_top(
    bvh: &mut Bvh,
    measure: impl NodeMeasure,
    scale: f64,
    apart: Apart,
    most: usize,
    scratch: &mut Scratch,
    judge: impl FnOnce(NewTop) -> f64,
) -> Regrown {
    let Scratch { cut: CutScratch { boxes, kept, cut, pairs, opened, top, .. }, build, .. } = scratch;
    if cut.len().max(kept.len()) > most {
        return Regrown::TooMuch;
    }
    if cut.is_empty() {
        return Regrown::NOTHING;
    }
    boxes.clear();
    boxes.extend(kept.iter().map(Node::aabb));
    let options = BuildOptions::default();
    if rebuild(top, boxes, Builder::BinnedParallel, &options, build).is_err()
        || highest(top, 0, kept) > MAX_HEIGHT
    {
        return Regrown::TooMuch;
    }
    let nodes = bvh.nodes();
    opened.clear();
    opened.resize(pairs.len().div_ceil(SHARE), NewTop::default());
    pairs.par_chunks(SHARE).zip(&mut *opened).for_each(|(pairs, opened)| {
        let slots = pairs.iter().flat_map(|&pair| [pair, pair + 1]);
        slots.for_each(|n| opened.add(&nodes[n as usize], -1.0));
    });
    let mut new = NewTop { change: apart.change, ..NewTop::default() };
    new.add(bvh.root(), -1.0);
    kept.iter().for_each(|node| new.add(node, 1.0));
    for opened in opened.iter() {
        new.change += opened.change;
        new.still_change += opened.still_change;
    }
    let after = top.nodes().iter().filter(|node| !node.is_leaf());
    if after.map(|node| node.aabb().half_area_f64() * node.weight()).sum::<f64>() + new.change >= 0.0 {
        return Regrown::NOTHING;
    }
    assert!(
        top.nodes().len() == 2 * pairs.len() + 2,
        "a tree over k subtrees has k - 1 pairs below the root"
    );
    let parts = raw::parts(bvh);
    let mut graft = Graft { nodes: parts.nodes, measure, top, kept, pairs: pairs.iter(), scale, new };
    graft.write(0, 0);
    let new = graft.new;
    *parts.still_area += new.still_change;
    let reference = reference(judge(new), 1.0);
    let history = parts.history;
    let left = apart.part_left(history);
    let LeafHistory { growth, cost, .. } = history.leaves;
    *history = History {
        reference,
        measured: reference,
        kept: kept.len() as u32,
        period: history.since_repair,
        regret: 0.0,
        since_repair: 0,
        rebuilds_in_a_row: 0,
        layout: Layout::Other,
        spare_pair: apart.spare,
        spare_pair_count: history.spare_pair_count.saturating_sub(apart.count),
        leaves: LeafHistory { growth: growth * left, cost: cost * left, ..history.leaves },
        ..*history
    };
    Regrown::Top { subtrees: kept.len(), change: new.change, apart }
}

impl NewTop {
    /// Adds an inner node to the changes, or takes it off.
    fn add(&mut self, node: &Node, sign: f64) {
        if !node.is_leaf() {
            let area = node.aabb().half_area_f64() * node.weight() * sign;
            self.change += area;
            self.still_change += if node.moves() { 0.0 } else { area };
        }
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

struct Graft<'a, M> {
    nodes: &'a mut [Node],
    measure: M,
    top: &'a Bvh,
    kept: &'a [Node],
    pairs: std::slice::Iter<'a, u32>,
    scale: f64,
    new: NewTop,
}

impl<M: NodeMeasure> Graft<'_, M> {
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
        new.set_reference(((self.measure)(self.nodes, &new) / self.scale) as f32);
        self.new.references += f64::from(new.reference());
        self.new.add(&new, 1.0);
        self.nodes[slot] = new;
    }
}
