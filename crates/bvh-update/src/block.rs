//! A block: a thousand child pairs that are refitted and rotated together.
//!
//! The recursion of the paper ([`plain`](crate::plain)) waits for memory at every node. A block walks the tree
//! breadth-first from a few roots instead, asking for each pair's cache line when the pair is queued and using it
//! when its turn comes; then it writes its leaves, hands what lies below the block to further blocks, and comes
//! back up level by level, deepest first: on each level first the rotations, then the unions. Nodes of one level
//! touch disjoint slots, and a rotation leaves its own node's box as it is, so the result is bit for bit that of
//! the recursion.

use bvh_core::Primitives;

use crate::kernels::{Accepted, apply, evaluate, fit, unions};
use crate::raw::{Available, SharedNodes};
use crate::strategy::{Rotate, Turn};

/// Queued pairs of one block; about half of them are processed in it.
const PAIRS: usize = 2048;

/// Roots of one block below another.
const ROOTS: usize = 64;

/// What one task of a pass is given.
pub(crate) struct Task<'a, P: ?Sized> {
    pub(crate) nodes: SharedNodes<'a>,
    /// Numbered by slot.
    pub(crate) primitives: &'a P,
    /// At which nodes rotations are tried, if at any.
    pub(crate) rotations: Option<Turn>,
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

/// A node on the way, in one word: its own slot in the arena, and where what is below it starts (an inner node's
/// child pair in the arena, a leaf's first primitive in the order).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Visit(u64);

impl Visit {
    #[inline]
    pub(crate) fn new(slot: u32, first: u32) -> Self {
        Self(u64::from(slot) << 32 | u64::from(first))
    }

    #[inline]
    pub(crate) fn slot(self) -> usize {
        (self.0 >> 32) as usize
    }

    #[inline]
    pub(crate) fn first(self) -> usize {
        self.0 as u32 as usize
    }
}

/// Inner nodes of one depth that a block starts from.
#[derive(Clone, Copy)]
pub(crate) struct Roots<'a> {
    pub(crate) nodes: &'a [Visit],
    pub(crate) depth: u32,
}

impl<'a> Roots<'a> {
    pub(crate) fn chunks(self, size: usize) -> impl Iterator<Item = Self> {
        self.nodes.chunks(size).map(move |nodes| Roots { nodes, ..self })
    }
}

/// The lists of one block. Their memory is allocated on first use and kept.
#[derive(Default)]
pub(crate) struct Block {
    /// Inner nodes that move, breadth-first; those from `done` on belong to further blocks.
    inner: Vec<Visit>,
    queued: usize,
    done: usize,
    /// Leaves that move.
    leaves: Vec<Visit>,
    leaf_count: usize,
    /// Which of `inner` have a grandchild.
    candidates: Vec<u32>,
    candidate_count: usize,
    /// Where each level starts among `inner` and `candidates`; the last goes on where the frontier starts.
    levels: Vec<(usize, usize)>,
    level_end: usize,
    /// Depth of the roots.
    depth: u32,
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
    block.gather(task, roots, PAIRS);
    block.fit_leaves(task, tally);
    for roots in block.frontier() {
        for chunk in roots.chunks(ROOTS) {
            process(task, chunk, deeper, tally);
        }
    }
    block.ascend(task, tally);
}

impl Block {
    /// Walks down from the roots until about `limit` pairs are queued, and lists what is there.
    pub(crate) fn gather<P: ?Sized>(&mut self, task: &Task<'_, P>, roots: Roots<'_>, limit: usize) {
        let nodes = task.nodes;
        let turn = task.rotations.unwrap_or(Turn::new(Rotate::default(), 0));
        let limit = limit.min(PAIRS);
        if self.inner.is_empty() {
            self.inner.resize(PAIRS, Visit::default());
            self.leaves.resize(2 * PAIRS, Visit::default());
            self.candidates.resize(PAIRS, 0);
            self.levels.reserve(bvh_core::MAX_HEIGHT as usize + 1);
        }
        let (inner, leaves) = (self.inner.as_mut_slice(), self.leaves.as_mut_slice());
        let candidates = self.candidates.as_mut_slice();
        let mut queued = roots.nodes.len();
        inner[..queued].copy_from_slice(roots.nodes);
        self.levels.clear();
        let (mut done, mut level_end, mut leaf_count, mut candidate_count) = (0, 0, 0, 0);
        while done < queued && queued + 2 <= limit {
            if done == level_end {
                self.levels.push((done, candidate_count));
                level_end = queued;
            }
            let pair = inner[done].first();
            let children = nodes.pair(pair);
            // Every child is appended to both lists, and then counted in at most one.
            for (child, slot) in children.iter().zip(pair..) {
                let (leaf, moves, first) = (child.is_leaf(), child.moves(), child.first());
                nodes.prefetch(if leaf { pair } else { first });
                let visit = Visit::new(slot as u32, first as u32);
                inner[queued] = visit;
                leaves[leaf_count] = visit;
                queued += usize::from(moves & !leaf);
                leaf_count += usize::from(moves & leaf);
            }
            candidates[candidate_count] = done as u32;
            let grandchildren = !(children[0].is_leaf() & children[1].is_leaf());
            candidate_count += usize::from(grandchildren & turn.includes(pair));
            done += 1;
        }
        (self.queued, self.done, self.level_end, self.depth) = (queued, done, level_end, roots.depth);
        (self.leaf_count, self.candidate_count) = (leaf_count, candidate_count);
    }

    /// The inner nodes below this block, by depth: the rest of its last level, and the level below.
    pub(crate) fn frontier(&self) -> [Roots<'_>; 2] {
        let depth = self.depth + self.levels.len() as u32;
        let split = self.level_end.max(self.done);
        [
            Roots { nodes: &self.inner[self.done..split], depth: depth - 1 },
            Roots { nodes: &self.inner[split..self.queued], depth },
        ]
    }

    /// Fits the block's leaves to their primitives.
    pub(crate) fn fit_leaves<P: Primitives + ?Sized>(&self, task: &Task<'_, P>, tally: &mut Tally) {
        let leaves = &self.leaves[..self.leaf_count];
        tally.leaves += leaves.len() as u64;
        tally.dropped += fit(task.level, task.nodes, task.primitives, leaves);
    }

    /// Comes back up from the frontier to the roots.
    pub(crate) fn ascend<P: ?Sized>(&mut self, task: &Task<'_, P>, tally: &mut Tally) {
        tally.inner += self.done as u64;
        let (level, nodes) = (task.level, task.nodes);
        let inner = &self.inner[..self.done];
        if task.rotations.is_none() {
            tally.area += unions(level, nodes, inner);
            return;
        }
        self.accepted.resize(PAIRS, Accepted::default());
        let mut end = (self.done, self.candidate_count);
        for (i, &start) in self.levels.iter().enumerate().rev() {
            let candidates = &self.candidates[start.1..end.1];
            let accepted = evaluate(level, nodes, inner, candidates, &mut self.accepted);
            apply(nodes, inner, self.depth + i as u32, &self.accepted[..accepted], tally);
            tally.area += unions(level, nodes, &inner[start.0..end.0]);
            end = start;
        }
    }
}
