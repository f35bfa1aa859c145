//! A block: a thousand inner nodes that are refitted and rotated together.
//!
//! The recursion of the paper ([`plain`](crate::plain)) waits for memory at every node. A block walks the tree
//! breadth-first from a few roots instead, asking for each pair's cache line when its parent is listed and using it
//! when the parent's turn comes. Nodes are listed by kind: *twigs* have two leaves for children, *spurs* one, and
//! *forks* none. A twig, told by its height of 1, is not walked through. Twigs are then fitted, what lies below the
//! block is handed to further blocks, and spurs and forks come back up level by level, deepest first: on each level
//! first the boxes, then the rotations. Nodes of one level touch disjoint slots, and a rotation leaves its own node's
//! box as it is, so the result is bit for bit that of the recursion.

use std::ops::Range;

use bvh_core::{Node, Primitives};

use crate::kernels::{Accepted, Fitted, apply, forks, gather, spurs, twigs};
use crate::raw::{Available, SharedNodes};
use crate::strategy::Turn;
use crate::sweep;

/// Inner nodes with grandchildren that one block lists; about half of them are processed in it.
pub(crate) const LISTED: usize = 1024;

/// Roots of one block below another.
pub(crate) const ROOTS: usize = 64;

/// What one task of a pass is given.
pub(crate) struct Task<'a, P: ?Sized> {
    pub(crate) nodes: SharedNodes<'a>,
    /// Numbered by slot of the order.
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
    /// Sum of half area times weight over all nodes visited.
    pub(crate) area: f64,
    /// The part of it that is due to leaves.
    pub(crate) leaf_area: f64,
    /// By how much rotations have lowered it.
    pub(crate) gain: f64,
    /// Growth of the same sum over nodes that stand still.
    pub(crate) static_area: f64,
}

impl Tally {
    pub(crate) fn add(&mut self, other: &Self) {
        self.rotations.iter_mut().zip(other.rotations).for_each(|(a, b)| *a += b);
        self.leaves += other.leaves;
        self.inner += other.inner;
        self.dropped += other.dropped;
        self.area += other.area;
        self.leaf_area += other.leaf_area;
        self.gain += other.gain;
        self.static_area += other.static_area;
    }

    pub(crate) fn add_fitted(&mut self, fitted: Fitted) {
        self.leaves += fitted.leaves;
        self.inner += fitted.inner;
        self.dropped += fitted.dropped;
        self.leaf_area += fitted.leaf_areas.total();
        self.area += fitted.leaf_areas.total() + fitted.inner_areas.total();
    }
}

/// Slots of inner nodes of one depth and with grandchildren, that a block starts from.
#[derive(Clone, Copy)]
pub(crate) struct Roots<'a> {
    pub(crate) slots: &'a [u32],
    /// The first child of each.
    pub(crate) pairs: &'a [u32],
    pub(crate) depth: u32,
}

impl<'a> Roots<'a> {
    pub(crate) fn chunks(self, size: usize) -> impl Iterator<Item = Self> {
        let chunks = self.slots.chunks(size).zip(self.pairs.chunks(size));
        chunks.map(move |(slots, pairs)| Roots { slots, pairs, ..self })
    }
}

/// The spurs and forks of one block, of nodes that move.
pub(crate) struct Block {
    queue: Box<Queue>,
    /// Where each level ends among the spurs and forks that are done.
    levels: Vec<Level>,
    /// Where the last level ends in the queue.
    level_end: usize,
    /// Depth of the roots.
    depth: u32,
}

/// What a walk has found: numbers of slots in the arena.
pub(crate) struct Queue {
    /// Spurs and forks, breadth-first; those from `done` on belong to further blocks.
    pub(crate) slots: [u32; LISTED],
    /// The first child of each.
    pub(crate) pairs: [u32; LISTED],
    pub(crate) listed: usize,
    pub(crate) done: usize,
    /// Those that are done.
    pub(crate) spurs: [u32; LISTED],
    pub(crate) spur_count: usize,
    pub(crate) forks: [u32; LISTED],
}

#[derive(Clone, Copy, Default)]
struct Level {
    spurs: usize,
    forks: usize,
}

/// Nodes that a walk looks at together.
pub(crate) const GROUP: usize = 4;

impl Queue {
    fn new() -> Self {
        let list = [0; LISTED];
        Self { slots: list, pairs: list, listed: 0, done: 0, spurs: list, spur_count: 0, forks: list }
    }

    fn start(&mut self, roots: Roots<'_>) {
        let count = roots.slots.len();
        (self.listed, self.done, self.spur_count) = (count, 0, 0);
        self.slots[..count].copy_from_slice(roots.slots);
        self.pairs[..count].copy_from_slice(roots.pairs);
    }

    fn roots(&self, range: Range<usize>, depth: u32) -> Roots<'_> {
        Roots { slots: &self.slots[range.clone()], pairs: &self.pairs[range], depth }
    }

    /// Whether the children of another group have room, and so have lists of what is done.
    pub(crate) fn has_room(&self) -> bool {
        self.listed + 2 * GROUP <= LISTED
    }

    fn level(&self) -> Level {
        Level { spurs: self.spur_count, forks: self.done - self.spur_count }
    }
}

/// Twigs of one block: two at most below each node that is done.
pub(crate) struct Twigs {
    pub(crate) slots: [u32; 2 * LISTED],
    /// The first child of each.
    pub(crate) pairs: [u32; 2 * LISTED],
    pub(crate) count: usize,
}

/// Lists that blocks below each other share, as none needs them while another is at work.
pub(crate) struct Lists {
    twigs: Twigs,
    accepted: Vec<Accepted>,
    /// Nodes of one level at which it is, and is not, the turn for rotations.
    turns: [[u32; LISTED]; 2],
}

/// Blocks nested in each other: 64 roots and 1024 listed nodes make three levels at least.
pub(crate) const NESTED: usize = bvh_core::MAX_HEIGHT as usize / 3 + 2;

/// What one worker keeps, in bytes: its nested blocks and their lists. The mesh has no part in it.
const WORKER_MEMORY: usize = NESTED * (size_of::<Queue>() + size_of::<Block>() + 100 * size_of::<Level>())
    + size_of::<Lists>()
    + size_of::<[sweep::Lists; 2]>()
    + LISTED * size_of::<Accepted>();

const _: () = assert!(WORKER_MEMORY < 1 << 20, "well below 1 MiB");

/// Updates the subtrees below `roots`, with a block each level of nesting, and fetches what will be `next`.
pub(crate) fn process<P: Primitives + ?Sized>(
    task: &Task<'_, P>,
    roots: Roots<'_>,
    next: Next<'_>,
    blocks: &mut [Block],
    lists: &mut Lists,
    tally: &mut Tally,
) {
    let Some((block, deeper)) = blocks.split_first_mut() else {
        unreachable!("each of {NESTED} nested blocks takes three levels of at most {}", bvh_core::MAX_HEIGHT)
    };
    block.gather(task, roots, lists);
    let frontier = block.frontier();
    let mut chunks = frontier.iter().flat_map(|roots| roots.chunks(ROOTS)).peekable();
    let mut lines = FIRST_LINES;
    let first = chunks.peek().map_or(next, |chunk| Next { pairs: chunk.pairs, lines });
    lists.fit_twigs(task, first, tally);
    while let Some(chunk) = chunks.next() {
        let next = chunks.peek().map_or(next, |chunk| Next { pairs: chunk.pairs, lines });
        let before = tally.inner;
        process(task, chunk, next, deeper, lists, tally);
        lines = ((tally.inner - before) as usize / chunk.slots.len()).clamp(1, MOST_LINES);
    }
    block.ascend(task, lists, tally);
}

/// Subtrees whose turn is next. As built they lie in one piece, and rotations leave them nearly so; what lies behind
/// their first pairs is fetched while others are fitted.
#[derive(Clone, Copy, Default)]
pub(crate) struct Next<'a> {
    pub(crate) pairs: &'a [u32],
    /// Cache lines, of a pair each, to fetch for each of them.
    pub(crate) lines: usize,
}

/// Lines to fetch for the first subtrees of a block, and for any.
const FIRST_LINES: usize = 6;
const MOST_LINES: usize = 16;

impl Block {
    pub(crate) fn new() -> Self {
        let levels = Vec::with_capacity(bvh_core::MAX_HEIGHT as usize + 1);
        Self { queue: Box::new(Queue::new()), levels, level_end: 0, depth: 0 }
    }

    /// Walks down from the roots until about [`LISTED`] nodes are queued.
    pub(crate) fn gather<P: ?Sized>(&mut self, task: &Task<'_, P>, roots: Roots<'_>, lists: &mut Lists) {
        let queue = &mut *self.queue;
        queue.start(roots);
        lists.twigs.count = 0;
        self.depth = roots.depth;
        self.levels.clear();
        loop {
            let (start, end) = (queue.done, queue.listed);
            gather(task.level, task.nodes, queue, &mut lists.twigs, end);
            // Where there was no room for any node of this level, the frontier is the whole of it.
            self.level_end = if queue.done > start { end } else { start };
            if queue.done > start {
                self.levels.push(queue.level());
            }
            if queue.done < end || queue.listed == end {
                return;
            }
        }
    }

    /// The spurs and forks below this block, by depth: the rest of its last level, and the level below.
    pub(crate) fn frontier(&self) -> [Roots<'_>; 2] {
        let (queue, depth) = (&self.queue, self.depth + self.levels.len() as u32);
        [queue.roots(queue.done..self.level_end, depth - 1), queue.roots(self.level_end..queue.listed, depth)]
    }

    /// Comes back up from the frontier to the roots.
    pub(crate) fn ascend<P: Primitives + ?Sized>(
        &self,
        task: &Task<'_, P>,
        lists: &mut Lists,
        tally: &mut Tally,
    ) {
        tally.inner += self.queue.done as u64;
        for i in (0..self.levels.len()).rev() {
            let start = if i == 0 { Level::default() } else { self.levels[i - 1] };
            let spurs = &self.queue.spurs[start.spurs..self.levels[i].spurs];
            let forks = &self.queue.forks[start.forks..self.levels[i].forks];
            lists.level(task, spurs, forks, self.depth + i as u32, tally);
        }
    }
}

impl Lists {
    pub(crate) fn new() -> Box<Self> {
        let (accepted, turns) = (Vec::with_capacity(LISTED), [[0; LISTED]; 2]);
        let twigs = Twigs { slots: [0; 2 * LISTED], pairs: [0; 2 * LISTED], count: 0 };
        Box::new(Self { twigs, accepted, turns })
    }

    /// Lists the root alone, which is a twig.
    pub(crate) fn list_root(&mut self, root: &Node) {
        (self.twigs.slots[0], self.twigs.pairs[0], self.twigs.count) = (0, root.first() as u32, 1);
    }

    /// Fits the twigs of a block.
    pub(crate) fn fit_twigs<P: Primitives + ?Sized>(
        &self,
        task: &Task<'_, P>,
        next: Next<'_>,
        tally: &mut Tally,
    ) {
        tally.inner += self.twigs.count as u64;
        tally.add_fitted(twigs(task.level, task.nodes, task.primitives, &self.twigs, next));
    }

    /// Fits the spurs and forks of one level, and rotates there.
    fn level<P: Primitives + ?Sized>(
        &mut self,
        task: &Task<'_, P>,
        spur_list: &[u32],
        fork_list: &[u32],
        depth: u32,
        tally: &mut Tally,
    ) {
        let Task { nodes, primitives, level, .. } = *task;
        let accepted = &mut self.accepted;
        let Some(turn) = task.rotations else {
            tally.add_fitted(spurs::<P, false>(level, nodes, primitives, spur_list, accepted));
            tally.area += forks::<false>(level, nodes, fork_list, accepted).total();
            return;
        };
        accepted.clear();
        if turn.is_always() {
            tally.add_fitted(spurs::<P, true>(level, nodes, primitives, spur_list, accepted));
            tally.area += forks::<true>(level, nodes, fork_list, accepted).total();
        } else {
            let [now, later] = turn.split(spur_list, &mut self.turns);
            tally.add_fitted(spurs::<P, true>(level, nodes, primitives, now, accepted));
            tally.add_fitted(spurs::<P, false>(level, nodes, primitives, later, accepted));
            let [now, later] = turn.split(fork_list, &mut self.turns);
            tally.area += forks::<true>(level, nodes, now, accepted).total();
            tally.area += forks::<false>(level, nodes, later, accepted).total();
        }
        apply(nodes, depth, accepted, tally);
    }
}
