//! Which part of a tree is to be built anew: everything above the subtrees that are still good.
//!
//! Each inner node has a *reference*: what some measure of it was when it was last built, in units of the scene's size
//! then. What a node exceeds it by, in units of the size now, is its *excess*. The size is the sum of half areas over
//! all leaves, but grows and shrinks only as far as the root's area does: a scene that grows as a whole counts for
//! nothing, and leaves that grow within it do not hide what becomes of the nodes above. Rotations carry references along
//! with the nodes they swap and leave the reference of the node whose children changed as it is.
//!
//! ```text
//! cut(N):      E = cut(L) + cut(R) + max(0, M(N) - scale * reference(N))     in post-order, without primitives
//!              if E > threshold: N is opened, and its children that are not are subtrees to keep
//! ```
//!
//! The measure M is a node's half area where the tree is *regrown*. `divergent.rs` has another; `selective.rs` opens nodes
//! in a way of its own. `walk.rs` is this recursion as it is run; `apart.rs` collects what is kept; `top.rs` builds the top anew.

use bvh_core::{Aabb, Bvh, History, LeafHistory, Node};

use crate::apart::{Apart, Pieces};
use crate::raw;
use crate::selective::Overlaps;
use crate::top::InnerAreas;
use crate::walk::WalkScratch;

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct CutScratch {
    pub(crate) walk: WalkScratch,
    /// Subtrees to keep, and the pairs of nodes above them.
    pub(crate) cut: Vec<u32>,
    pub(crate) pairs: Vec<u32>,
    /// Areas of the nodes above them.
    pub(crate) opened: InnerAreas,
    pub(crate) overlaps: Overlaps,
    pub(crate) boxes: Vec<Aabb>,
    pub(crate) kept: Vec<Node>,
    /// What comes of leaves that are kept.
    pub(crate) pieces: Vec<Pieces>,
    pub(crate) top: Bvh,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Regrown {
    /// Above so many subtrees the top is new, or was as good as that if there are none.
    Top {
        subtrees: usize,
        /// By how much the sum of half areas times weights has changed.
        change: f64,
        apart: Apart,
    },
    /// There would be too many subtrees, or the tree might get too high: nothing was changed.
    TooMuch,
}

impl Regrown {
    /// There was nothing to be had.
    pub(crate) const NOTHING: Self =
        Self::Top { subtrees: 0, change: 0.0, apart: Apart { count: 0, change: 0.0, spare: 0 } };
}

/// What a node is judged by, in the dimension of areas.
pub(crate) trait NodeMeasure: Fn(&[Node], &Node) -> f64 + Copy + Sync {}
impl<F: Fn(&[Node], &Node) -> f64 + Copy + Sync> NodeMeasure for F {}

/// A node's half area.
pub(crate) fn area(_: &[Node], node: &Node) -> f64 {
    f64::from(node.aabb().half_area())
}

/// Takes the areas as they are for references, if there are none yet; a tree is judged by the sum of areas in units of the
/// scene's size.
pub(crate) fn take_references(bvh: &mut Bvh) {
    take_references_of(bvh, area);
}

/// The same with another measure of nodes.
pub(crate) fn take_references_of(bvh: &mut Bvh, measure: impl NodeMeasure) {
    let History { reference, has_other_moving, .. } = *bvh.history();
    if reference != 0.0 && !has_other_moving {
        return;
    }
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    let root = bvh.root().aabb().half_area_f64();
    let parts = raw::parts(bvh);
    if reference != 0.0 {
        sums.rebase(parts.history, root);
        return;
    }
    let sizes = [sums.leaves, root, sums.still_leaves];
    let per_size = 1.0 / size(sizes, [1.0; 2]);
    for n in 0..parts.nodes.len() {
        let reference = (measure(parts.nodes, &parts.nodes[n]) * per_size) as f32;
        parts.nodes[n].set_reference(reference);
    }
    *parts.history = History {
        reference: sums.all * per_size,
        measured: sums.all * per_size,
        sizes,
        size: size(sizes, [1.0; 2]),
        size_factor: 1.0,
        has_other_moving: false,
        evenness: sums.evenness(),
        regret: 0.0,
        since_repair: 0,
        is_beyond_repair: false,
        looks_in_vain: 0,
        trees_in_vain: 0,
        leaves: LeafHistory {
            is_merged: sums.is_merged,
            was_merged: sums.is_merged,
            area: sums.leaves,
            ..LeafHistory::default()
        },
        ..*parts.history
    };
}

/// The excess of a new tree by the standard of the one whose place it took, which `before` tells of. O(n).
pub(crate) fn excess_by(before: &History, bvh: &Bvh) -> f64 {
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    excess(before, sums.all, size_since(before, sums.leaves, bvh))
}

/// The sum of half areas times weights. O(n).
pub(crate) fn sum_of(bvh: &Bvh) -> f64 {
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    sums.all
}

/// What this sum of areas, in a scene of this size, is above that of a good tree; in units of that.
pub(crate) fn excess(history: &History, sum: f64, size: f64) -> f64 {
    over_good(history, sum - history.reference * size, size)
}

/// An area in units of those of a good tree. By area, dense parts of a scene count for little; but there the camera looks.
/// By number, a wall does. The mean.
pub(crate) fn over_good(history: &History, area: f64, size: f64) -> f64 {
    let unit = good_area(history, size);
    if unit > 0.0 { area / unit } else { 0.0 }
}

/// What areas of a tree are told in, given the size of the scene.
pub(crate) fn good_area(history: &History, size: f64) -> f64 {
    history.reference * size * if crate::ablation::is_off(3) { 1.0 } else { history.evenness.sqrt() }
}

/// The size of the scene now, for a tree with references.
pub(crate) fn size_now(bvh: &Bvh, leaf_area: f64) -> f64 {
    size_since(bvh.history(), leaf_area / (1.0 + bvh.history().leaves.growth), bvh)
}

pub(crate) fn size_since(history: &History, leaf_area: f64, bvh: &Bvh) -> f64 {
    let [leaves, root, _] = history.sizes;
    let growth = |now: f64, first: f64| if first > 0.0 { now / first } else { 1.0 };
    let growth = [growth(leaf_area, leaves), growth(bvh.root().aabb().half_area_f64(), root)];
    scale(size(history.sizes, growth) * history.size_factor)
}

/// Half area of all leaves that move, as it was at first, times the growth that leaves and root have in common: that of
/// the one that has changed less, none if one has grown and the other shrunk. 1 where that is no size.
fn size([first, ..]: [f64; 3], [leaves, root]: [f64; 2]) -> f64 {
    scale(first * leaves.min(root).max(leaves.max(root).min(1.0)))
}

/// How good a tree is, by the sum of its areas: 0, to be measured anew, where that is beyond numbers.
pub(crate) fn reference(sum: f64, size: f64) -> f64 {
    let reference = sum / size;
    if reference.is_finite() { reference } else { 0.0 }
}

/// A unit of areas: 1 in place of none.
pub(crate) fn scale(area: f64) -> f64 {
    if area > 0.0 && area.is_finite() { area } else { 1.0 }
}

#[derive(Default)]
struct Sums {
    all: f64,
    leaves: f64,
    still_leaves: f64,
    /// Square roots of areas of leaves, and how many these are.
    widths: f64,
    count: f64,
    /// Whether any leaf that moves has several primitives.
    is_merged: bool,
}

impl Sums {
    /// The square of the mean width of leaves, over the mean of the squares.
    fn evenness(&self) -> f64 {
        let evenness = self.widths * self.widths / (self.count * (self.leaves + self.still_leaves));
        if evenness > 0.0 { evenness.min(1.0) } else { 1.0 }
    }

    /// Other primitives move than before: from now on the size of the scene grows as these do, and is what it was. So all
    /// references hold, and a scene in which something falls asleep in each frame is judged like any other.
    fn rebase(&self, history: &mut History, root: f64) {
        let leaves = &mut history.leaves;
        history.sizes = [self.leaves / (1.0 + leaves.growth), root, self.still_leaves];
        history.size_factor = scale(history.size / size(history.sizes, [1.0; 2]));
        history.has_other_moving = false;
        (leaves.area, leaves.is_merged) = (self.leaves, self.is_merged);
    }

    fn add(&mut self, node: &Node) {
        let area = node.aabb().half_area_f64() * node.weight();
        self.all += area;
        if node.is_leaf() {
            self.widths += area.sqrt();
            self.count += 1.0;
        }
        match (node.is_leaf(), node.moves()) {
            (true, true) => {
                self.leaves += area;
                self.is_merged |= node.count() > 1;
            }
            (true, false) => self.still_leaves += area,
            (false, _) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_a_scene_is_what_its_leaves_and_its_root_have_in_common() {
        let first = [2.0, 100.0, 0.0];
        for (growth, expected) in [
            ([1.0, 1.0], 2.0),
            ([3.0, 3.0], 6.0),
            ([0.5, 0.25], 1.0),
            ([1.5, 4.0], 3.0),
            // Leaves that grow within a room, pieces that fly apart.
            ([5.0, 1.0], 2.0),
            ([1.0, 50.0], 2.0),
            ([0.5, 2.0], 2.0),
            ([0.0, 0.0], 1.0),
            ([f64::INFINITY, f64::INFINITY], 1.0),
        ] {
            assert_eq!(size(first, growth), expected, "{growth:?}");
        }
        assert_eq!(size([0.0; 3], [1.0; 2]), 1.0);
    }

    #[test]
    fn leaves_are_even_if_all_are_alike() {
        let sums = |areas: &[f64]| Sums {
            leaves: areas.iter().sum(),
            widths: areas.iter().map(|area| area.sqrt()).sum(),
            count: areas.len() as f64,
            ..Sums::default()
        };
        assert_eq!(sums(&[4.0; 10]).evenness(), 1.0);
        assert_eq!(sums(&[1.0, 0.0, 0.0, 0.0]).evenness(), 0.25);
        assert_eq!(sums(&[]).evenness(), 1.0);
        assert_eq!(sums(&[f64::INFINITY]).evenness(), 1.0);
    }
}
