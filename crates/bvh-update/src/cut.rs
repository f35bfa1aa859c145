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
//! in a way of its own. `apart.rs` collects what is kept; `top.rs` builds the top anew.

use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_core::{Aabb, Bvh, History, LeafHistory, MAX_HEIGHT, Node, Primitives, prefetch};
use rayon::prelude::*;

use crate::apart::{Apart, keep};
use crate::block::Tally;
use crate::pass::Scratch;
use crate::raw;
use crate::selective::Overlaps;
use crate::top::{NewTop, rebuild_top};

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct CutScratch {
    tasks: Vec<Task>,
    /// Subtrees to keep, and the pairs of nodes above them.
    pub(crate) cut: Vec<u32>,
    pub(crate) pairs: Vec<u32>,
    pub(crate) overlaps: Overlaps,
    pub(crate) boxes: Vec<Aabb>,
    pub(crate) kept: Vec<Node>,
    /// The pieces of one leaf.
    pub(crate) pieces: Vec<Node>,
    /// What is known of the pairs above the cut.
    pub(crate) opened: Vec<NewTop>,
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
    /// There would be too many subtrees, or the tree would get too high: nothing was changed.
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
    if bvh.history().reference != 0.0 {
        return;
    }
    let mut sums = Sums::default();
    bvh.visit(|_, node, _| sums.add(node));
    let sizes = [sums.leaves, bvh.root().aabb().half_area_f64(), sums.still_leaves];
    let per_size = 1.0 / size(sizes, [1.0; 2]);
    let parts = raw::parts(bvh);
    for n in 0..parts.nodes.len() {
        let reference = (measure(parts.nodes, &parts.nodes[n]) * per_size) as f32;
        parts.nodes[n].set_reference(reference);
    }
    *parts.history = History {
        reference: sums.all * per_size,
        measured: sums.all * per_size,
        sizes,
        evenness: sums.evenness(),
        regret: 0.0,
        since_repair: 0,
        is_beyond_repair: false,
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
    let good = before.reference * size_since(before, sums.leaves, bvh);
    (sums.all - good) / (good * before.evenness.sqrt())
}

/// The size of the scene now, for a tree with references.
pub(crate) fn size_now(bvh: &Bvh, leaf_area: f64) -> f64 {
    size_since(bvh.history(), leaf_area / (1.0 + bvh.history().leaves.growth), bvh)
}

pub(crate) fn size_since(history: &History, leaf_area: f64, bvh: &Bvh) -> f64 {
    let [leaves, root, _] = history.sizes;
    let growth = |now: f64, first: f64| if first > 0.0 { now / first } else { 1.0 };
    size(history.sizes, [growth(leaf_area, leaves), growth(bvh.root().aabb().half_area_f64(), root)])
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

/// Nodes of more than this part of the root's area are opened in any case. There are few, but a subtree as large as the
/// room that everything else is in would have to be kept beside all of it.
const LARGE: f32 = 0.005;

/// Builds the tree anew above the subtrees whose excess of area is at most `threshold`, if there are at most `most` of
/// them, after a pass that has found this.
pub(crate) fn regrow<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    tally: &Tally,
    threshold: f64,
    most: usize,
    scratch: &mut Scratch,
) -> Regrown {
    let references = open(bvh, area, size_now(bvh, tally.leaf_area), threshold, most, &mut scratch.cut);
    let apart = keep(bvh, primitives, most, &mut scratch.cut);
    let size = apart.size(bvh, tally.leaf_area);
    // Leaves have no references.
    let leaves = (tally.leaf_area + apart.change + bvh.history().sizes[2]) / size;
    rebuild_top(bvh, area, size, apart, most, scratch, |top| references + top.references + leaves)
}

/// Finds the subtrees whose excess is at most `threshold`, or more than `most`; gives the sum of references in them.
pub(crate) fn open(
    bvh: &Bvh,
    measure: impl NodeMeasure,
    scale: f64,
    threshold: f64,
    most: usize,
    scratch: &mut CutScratch,
) -> f64 {
    let CutScratch { tasks, cut, pairs, .. } = scratch;
    cut.clear();
    pairs.clear();
    if bvh.height() < 2 {
        return 0.0;
    }
    let large = LARGE * bvh.root().aabb().half_area();
    let found = Found::default();
    let walk = Walk { nodes: bvh.nodes(), measure, scale, threshold, large, most, found: &found };
    tasks.resize_with(1 + QUEUE.div_ceil(PER_TASK), Task::default);
    tasks.iter_mut().for_each(Task::clear);
    walk.share_out(tasks);
    let kept = tasks.iter().map(|task| task.kept).sum();
    if found.bad.into_inner() > 0 {
        tasks.iter().for_each(|task| cut.extend_from_slice(&task.cut));
        tasks.iter().for_each(|task| pairs.extend_from_slice(&task.pairs));
    }
    kept
}

/// What one task has found below its nodes.
#[derive(Default)]
struct Task {
    queues: Vec<Queue>,
    cut: Vec<u32>,
    pairs: Vec<u32>,
    /// Sum of references of nodes that are not opened.
    kept: f64,
    /// How many nodes were opened for their excess.
    bad: usize,
}

/// What all tasks have found so far.
#[derive(Default)]
struct Found {
    /// How many subtrees are in their cuts.
    cut: AtomicUsize,
    /// How many nodes were opened for their excess.
    bad: AtomicUsize,
}

impl Task {
    fn clear(&mut self) {
        self.queues.resize_with(MAX_HEIGHT as usize / 3 + 2, Queue::default);
        self.cut.clear();
        self.pairs.clear();
        (self.kept, self.bad) = (0.0, 0);
    }
}

struct Walk<'a, M> {
    nodes: &'a [Node],
    measure: M,
    scale: f64,
    threshold: f64,
    large: f32,
    most: usize,
    /// The walk ends early where there is something bad and the cut has more than `most`.
    found: &'a Found,
}

/// Nodes of one block of the walk, breadth-first as in `block.rs`, and the excess at and below each.
#[derive(Default)]
struct Queue {
    slots: Vec<u32>,
    /// How many of them belong to this block; the others, to further blocks.
    done: usize,
    excess: Vec<f64>,
}

/// Nodes in one queue, and roots of one block below another.
const QUEUE: usize = 1024;
const ROOTS: usize = 64;
/// Roots of a task.
const PER_TASK: usize = 8;

impl<M: NodeMeasure> Walk<'_, M> {
    /// Walks through the whole tree; the first task is the block at its top.
    fn share_out(&self, tasks: &mut [Task]) {
        let (top, tasks) = tasks.split_first_mut().expect("one for the top");
        let mut queues = std::mem::take(&mut top.queues);
        let queue = &mut queues[0];
        self.list(queue, &[0]);
        let roots = queue.slots[queue.done..].par_chunks(PER_TASK);
        let excess = queue.excess[queue.done..].par_chunks_mut(PER_TASK);
        roots.zip(excess).zip(tasks).for_each(|((roots, excess), task)| {
            let mut queues = std::mem::take(&mut task.queues);
            self.walk(roots, excess, &mut queues, task);
            task.queues = queues;
        });
        self.ascend(queue, top);
        top.queues = queues;
    }

    /// Finds the excess at and below nodes with grandchildren.
    fn walk(&self, roots: &[u32], excess: &mut [f64], queues: &mut [Queue], task: &mut Task) {
        let (queue, deeper) = queues.split_first_mut().expect("as many queues as blocks nest");
        self.list(queue, roots);
        let Queue { slots, done, excess: below } = queue;
        for (roots, excess) in slots[*done..].chunks(ROOTS).zip(below[*done..].chunks_mut(ROOTS)) {
            let [cut, bad] = [&self.found.cut, &self.found.bad].map(|found| found.load(Ordering::Relaxed));
            if cut > self.most && bad > 0 {
                return;
            }
            self.walk(roots, excess, deeper, task);
        }
        self.ascend(queue, task);
        excess.copy_from_slice(&queue.excess[..roots.len()]);
    }

    /// Lists nodes with grandchildren, breadth-first.
    fn list(&self, queue: &mut Queue, roots: &[u32]) {
        let Queue { slots, done, excess } = queue;
        slots.clear();
        slots.extend(roots);
        *done = 0;
        while *done < slots.len() && slots.len() + 2 <= QUEUE {
            let first = self.nodes[slots[*done] as usize].first();
            for child in [first, first + 1] {
                let node = &self.nodes[child];
                if node.height() > 1 {
                    prefetch(self.nodes, node.first());
                    slots.push(child as u32);
                }
            }
            *done += 1;
        }
        excess.clear();
        excess.resize(slots.len(), 0.0);
    }

    /// Settles the nodes of a block, once the excess of those below it is known.
    fn ascend(&self, queue: &mut Queue, task: &mut Task) {
        let Queue { slots, done, excess } = queue;
        let before = (task.cut.len(), task.bad);
        // Children were queued left first, so they come off the end right first.
        let mut end = slots.len();
        for i in (0..*done).rev() {
            let node = self.nodes[slots[i] as usize];
            let mut below = [0.0; 2];
            for (side, below) in below.iter_mut().enumerate().rev() {
                let child = self.nodes[node.first() + side];
                match child.height() {
                    // Leaves have no excess.
                    0 => {}
                    1 => *below = self.settle(&child, [0.0; 2], task),
                    _ => {
                        end -= 1;
                        *below = excess[end];
                    }
                }
            }
            excess[i] = self.settle(&node, below, task);
        }
        self.found.cut.fetch_add(task.cut.len() - before.0, Ordering::Relaxed);
        self.found.bad.fetch_add(task.bad - before.1, Ordering::Relaxed);
    }

    /// Whether a node is opened, given the excess at and below it.
    fn is_opened(&self, node: &Node, excess: f64) -> bool {
        excess > self.threshold || node.height() > 0 && node.aabb().half_area() > self.large
    }

    /// Opens a node, or keeps it; gives the excess at and below it.
    fn settle(&self, node: &Node, below: [f64; 2], task: &mut Task) -> f64 {
        let own = (self.measure)(self.nodes, node) - self.scale * f64::from(node.reference());
        let total = below[0] + below[1] + own.max(0.0);
        task.bad += usize::from(total > self.threshold);
        if self.is_opened(node, total) {
            let pair = node.first();
            task.pairs.push(pair as u32);
            for (child, below) in (pair..).zip(below) {
                if !self.is_opened(&self.nodes[child], below) {
                    task.cut.push(child as u32);
                }
            }
        } else {
            task.kept += f64::from(node.reference());
        }
        total
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
