//! A block: a thousand child pairs that are refitted and rotated together.
//!
//! The recursion of the paper ([`plain`](crate::plain)) waits for memory at every node. A block walks the tree
//! breadth-first from a few roots instead, asking for each pair's cache line when the pair is queued and using it
//! when its turn comes; then it writes its leaves, hands what lies below the block to further blocks, and comes
//! back up level by level, deepest first: on each level first the rotations, then the unions. Nodes of one level
//! touch disjoint slots, and a rotation leaves its own node's box as it is, so the result is bit for bit that of
//! the recursion.

use bvh_core::Primitives;

use crate::kernels::{Accepted, apply, evaluate, unions};
use crate::raw::{Available, SharedNodes};

/// Queued pairs of one block; about half of them are processed in it.
const PAIRS: usize = 2048;

/// Roots of one block below another.
const ROOTS: usize = 64;

/// How far ahead of its use a primitive's index is fetched, and its data.
const INDEX_AHEAD: usize = 64;
const DATA_AHEAD: usize = 32;

/// What one task of a pass is given.
pub(crate) struct Task<'a, P: ?Sized> {
    pub(crate) nodes: SharedNodes<'a>,
    /// Numbered by slot.
    pub(crate) primitives: &'a P,
    pub(crate) rotations: bool,
    pub(crate) level: Available,
}

/// What a pass, or a part of it, has done.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) rotations: [u64; 6],
    pub(crate) leaves: u64,
    pub(crate) inner: u64,
    pub(crate) dropped: u64,
    /// Sum of half area times weight over all nodes visited but the root.
    pub(crate) area: f64,
    /// Growth of the same sum over nodes that stand still.
    pub(crate) still_area: f64,
}

impl Tally {
    pub(crate) fn add(&mut self, other: &Self) {
        self.rotations.iter_mut().zip(other.rotations).for_each(|(a, b)| *a += b);
        self.leaves += other.leaves;
        self.inner += other.inner;
        self.dropped += other.dropped;
        self.area += other.area;
        self.still_area += other.still_area;
    }
}

/// Inner nodes that a block starts from: their slots, child pairs and depths.
#[derive(Clone, Copy)]
pub(crate) struct Roots<'a> {
    pub(crate) parents: &'a [u32],
    pub(crate) pairs: &'a [u32],
    pub(crate) depths: &'a [u8],
}

impl<'a> Roots<'a> {
    pub(crate) fn chunks(self, size: usize) -> impl ExactSizeIterator<Item = Self> {
        let Self { parents, pairs, depths } = self;
        (0..pairs.len().div_ceil(size)).map(move |i| {
            let range = i * size..pairs.len().min((i + 1) * size);
            Roots { parents: &parents[range.clone()], pairs: &pairs[range.clone()], depths: &depths[range] }
        })
    }
}

/// The lists of one block. Their memory is allocated on first use and kept.
#[derive(Default)]
pub(crate) struct Block {
    /// Child pairs in breadth-first order; those from `done` on belong to further blocks.
    pairs: Vec<u32>,
    /// For each pair, the slot of the node whose children it holds, and that node's depth.
    parents: Vec<u32>,
    depths: Vec<u8>,
    queued: usize,
    done: usize,
    /// Leaves that move: their slots, and the slots of their first primitives.
    leaves: Vec<u32>,
    firsts: Vec<u32>,
    leaf_count: usize,
    /// Pairs of which at least one node has children.
    candidates: Vec<u32>,
    candidate_count: usize,
    /// Where each level starts among pairs and candidates.
    levels: Vec<(usize, usize)>,
    accepted: Vec<Accepted>,
}

/// Blocks nested in each other: 64 roots and 2048 pairs make four levels at least.
pub(crate) const NESTED: usize = bvh_core::MAX_HEIGHT as usize / 4 + 2;

/// Updates the subtrees below `roots`, with a block each level of nesting.
pub(crate) fn process<P: Primitives + ?Sized>(
    task: &Task<'_, P>,
    roots: Roots<'_>,
    blocks: &mut [Block],
    tally: &mut Tally,
) {
    let Some((block, deeper)) = blocks.split_first_mut() else {
        unreachable!("each of {NESTED} nested blocks takes four levels of at most {}", bvh_core::MAX_HEIGHT)
    };
    block.gather(task.nodes, roots, PAIRS);
    block.fit_leaves(task, tally);
    for chunk in block.frontier().chunks(ROOTS) {
        process(task, chunk, deeper, tally);
    }
    block.ascend(task, tally);
}

/// Fits the leaf in slot `leaf`, whose first primitive is in slot `first`, to its primitives.
#[inline]
pub(crate) fn fit_leaf<P: Primitives + ?Sized>(
    task: &Task<'_, P>,
    leaf: usize,
    first: usize,
    tally: &mut Tally,
) {
    let mut node = task.nodes.get(leaf);
    let mut aabb = task.primitives.aabb(first);
    tally.dropped += u64::from(aabb.is_empty());
    for slot in first + 1..first + node.count() {
        let next = task.primitives.aabb(slot);
        tally.dropped += u64::from(next.is_empty());
        aabb = aabb.union(next);
    }
    node.set_aabb(aabb);
    task.nodes.set(leaf, node);
}

impl Block {
    /// Walks down from the roots until about `limit` pairs are queued, and lists what is there.
    pub(crate) fn gather(&mut self, nodes: SharedNodes<'_>, roots: Roots<'_>, limit: usize) {
        let limit = limit.min(PAIRS);
        if self.pairs.is_empty() {
            self.pairs.resize(PAIRS, 0);
            self.parents.resize(PAIRS, 0);
            self.depths.resize(PAIRS, 0);
            self.leaves.resize(2 * PAIRS, 0);
            self.firsts.resize(2 * PAIRS, 0);
            self.candidates.resize(PAIRS, 0);
            self.levels.reserve(bvh_core::MAX_HEIGHT as usize + 1);
        }
        let mut queued = roots.pairs.len();
        self.pairs[..queued].copy_from_slice(roots.pairs);
        self.parents[..queued].copy_from_slice(roots.parents);
        self.depths[..queued].copy_from_slice(roots.depths);
        self.levels.clear();
        let (mut done, mut level_end, mut leaf_count, mut candidate_count) = (0, 0, 0, 0);
        while done < queued && queued + 2 <= limit {
            if done == level_end {
                self.levels.push((done, candidate_count));
                level_end = queued;
            }
            let pair = self.pairs[done] as usize;
            let depth = self.depths[done] + 1;
            let children = nodes.pair(pair);
            // Every child is appended to both lists, and then counted in at most one.
            for (i, child) in children.iter().enumerate() {
                let (leaf, moves, first) = (child.is_leaf(), child.moves(), child.first());
                nodes.prefetch(first);
                self.pairs[queued] = first as u32;
                self.parents[queued] = (pair + i) as u32;
                self.depths[queued] = depth;
                queued += usize::from(!leaf & moves);
                self.leaves[leaf_count] = (pair + i) as u32;
                self.firsts[leaf_count] = first as u32;
                leaf_count += usize::from(leaf & moves);
            }
            self.candidates[candidate_count] = done as u32;
            candidate_count += usize::from(!(children[0].is_leaf() & children[1].is_leaf()));
            done += 1;
        }
        (self.queued, self.done) = (queued, done);
        (self.leaf_count, self.candidate_count) = (leaf_count, candidate_count);
    }

    /// The inner nodes below this block.
    pub(crate) fn frontier(&self) -> Roots<'_> {
        let range = self.done..self.queued;
        Roots {
            parents: &self.parents[range.clone()],
            pairs: &self.pairs[range.clone()],
            depths: &self.depths[range],
        }
    }

    /// Fits the block's leaves to their primitives.
    pub(crate) fn fit_leaves<P: Primitives + ?Sized>(&self, task: &Task<'_, P>, tally: &mut Tally) {
        let leaves = &self.leaves[..self.leaf_count];
        let firsts = &self.firsts[..self.leaf_count];
        for (i, (&leaf, &first)) in leaves.iter().zip(firsts).enumerate() {
            if let Some(&ahead) = firsts.get(i + INDEX_AHEAD) {
                task.primitives.prefetch_index(ahead as usize);
            }
            if let Some(&ahead) = firsts.get(i + DATA_AHEAD) {
                task.primitives.prefetch_data(ahead as usize);
            }
            fit_leaf(task, leaf as usize, first as usize, tally);
        }
        tally.leaves += leaves.len() as u64;
    }

    /// Comes back up from the frontier to the roots.
    pub(crate) fn ascend<P: ?Sized>(&mut self, task: &Task<'_, P>, tally: &mut Tally) {
        tally.inner += self.done as u64;
        let (level, nodes) = (task.level, task.nodes);
        if !task.rotations {
            tally.area += unions(level, nodes, &self.pairs[..self.done], &self.parents[..self.done]);
            return;
        }
        self.accepted.resize(PAIRS, Accepted::default());
        let mut end = (self.done, self.candidate_count);
        for &start in self.levels.iter().rev() {
            let candidates = &self.candidates[start.1..end.1];
            let accepted = evaluate(level, nodes, &self.pairs, candidates, &mut self.accepted);
            let accepted = &self.accepted[..accepted];
            apply(nodes, &self.pairs, &self.depths, accepted, tally);
            let range = start.0..end.0;
            tally.area += unions(level, nodes, &self.pairs[range.clone()], &self.parents[range]);
            end = start;
        }
    }
}
