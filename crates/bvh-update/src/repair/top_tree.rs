//! A new top for a tree: a builder's tree over the boxes of the subtrees that are kept.
//!
//! The opened nodes form the top of the tree, k - 1 of them over k kept subtrees. The new top takes
//! the pairs of the old one. Where solids burst into pieces it is a few per cent of the tree.

use bvh_build::{BuildOptions, Builder, rebuild};
use bvh_core::{Bvh, MAX_HEIGHT, Node};
use rayon::prelude::*;

use super::frontier::Frontier;
use super::{RepairScratch, Repaired};
use crate::quality::finite_or_zero;
use crate::refit::{SMALL, SharedNodes, parts, share};
use crate::state::{Layout, State};

/// Subtrees of a new top that are higher than this are written by two tasks.
// Half and double: docs/TUNING.md.
const FORKED: u32 = 8;

/// Fewest subtrees for a task to copy; not tuned.
const GRAIN: usize = 1024;

/// How many pairs ahead their places are fetched; not tuned.
const AHEAD: usize = 16;

/// Builds the tree again above the frontier that was found, if there are at most `most` subtrees to
/// keep. The baseline becomes the sum of all references and of `others`, the cost, in units of the
/// scale, of what has none.
pub(super) fn rebuild_top(
    bvh: &mut Bvh,
    others: f64,
    scale: f64,
    most: usize,
    scratch: &mut RepairScratch,
) -> Repaired {
    let RepairScratch { walk, boxes, kept, top, build } = scratch;
    let Frontier { kept: frontier, pairs, cost: before, static_cost, references } = &mut walk.top.found;
    if frontier.len() > most {
        return Repaired::TooLarge;
    }
    if frontier.is_empty() {
        return Repaired::Nothing;
    }
    // In memory order, as builders number pairs.
    frontier.par_sort_unstable();
    pairs.par_sort_unstable();
    let nodes = bvh.nodes();
    frontier.par_iter().with_min_len(GRAIN).map(|&n| nodes[n as usize]).collect_into_vec(kept);
    boxes.clear();
    boxes.extend(kept.iter().map(Node::aabb));
    if rebuild(top, boxes, Builder::BinnedParallel, &BuildOptions::default(), build).is_err()
        || top.height() + kept.iter().map(Node::height).max().unwrap_or(0) > MAX_HEIGHT
    {
        return Repaired::TooLarge;
    }
    let after: f64 = top.nodes().iter().filter(|node| !node.is_leaf()).map(Node::sah_term).sum();
    if after - *before >= 0.0 {
        return Repaired::Nothing;
    }
    // A tree over k subtrees has k - 1 pairs below the root, each its own, as tasks write to them
    // (`refit::share`). They may be fewer in a tree that was given with inner boxes which do not
    // hold what is in them.
    let has_places = pairs.first().is_none_or(|&pair| pair > 1) && pairs.is_sorted_by(|a, b| a < b);
    if !has_places || top.nodes().len() != 2 * pairs.len() + 2 {
        return Repaired::TooLarge;
    }
    let parts = parts(bvh);
    let graft = Graft { nodes: share(parts.nodes), top, kept, pairs, scale };
    let Grafted { root, static_cost: after, references: above } = graft.write(0);
    graft.nodes.set(0, root);
    *parts.static_area += after - *static_cost;
    let state = State::of_mut(parts.state);
    state.baseline.cost = finite_or_zero(*references + above + others);
    state.baseline.measured = state.baseline.cost;
    state.layout = Layout::OTHER;
    Repaired::Top { subtrees: kept.len() }
}

/// A new top, to be written to the place of the old one.
struct Graft<'a> {
    nodes: SharedNodes<'a>,
    top: &'a Bvh,
    kept: &'a [Node],
    /// A place for each pair of the new top.
    pairs: &'a [u32],
    scale: f64,
}

/// A node of the new top below which all is written, and sums over the inner nodes there.
struct Grafted {
    /// It has yet to be put in its place.
    root: Node,
    static_cost: f64,
    references: f64,
}

impl Graft<'_> {
    /// Writes what is below node `n` of the new top. The order of the sums does not depend on the
    /// number of threads.
    fn write(&self, n: usize) -> Grafted {
        let node = &self.top.nodes()[n];
        if let &[subtree] = self.top.primitives(node) {
            let root = self.kept[subtree as usize];
            return Grafted { root, static_cost: 0.0, references: 0.0 };
        }
        let first = node.first();
        if let Some(&soon) = self.pairs.get(first / 2 + AHEAD) {
            self.nodes.prefetch(soon as usize);
        }
        let [l, r] = if node.height() > FORKED && 2 * self.nodes.pairs() > SMALL {
            rayon::join(|| self.write(first), || self.write(first + 1)).into()
        } else {
            [self.write(first), self.write(first + 1)]
        };
        let (place, pair) = (self.pairs[first / 2 - 1], [l.root, r.root]);
        self.nodes.set(place as usize, pair[0]);
        self.nodes.set(place as usize + 1, pair[1]);
        let mut root = Node::parent(&pair[0], &pair[1], place);
        root.set_reference((f64::from(root.aabb().half_area()) / self.scale) as f32);
        let static_cost = (l.static_cost + r.static_cost) + root.static_term();
        Grafted { root, static_cost, references: l.references + r.references + f64::from(root.reference()) }
    }
}
