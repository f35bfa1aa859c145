//! A block: some hundred inner nodes that are refitted and rotated together.
//!
//! The recursion of the paper ([`plain`](crate::plain)) waits for memory at every node. A block walks the tree
//! breadth-first from a few roots instead. It asks for the cache line of a pair of children when it lists their
//! parent, and reads the pair when the parent's turn comes. What lies below the block is handed to further blocks.
//! Then the block's boxes follow in reverse order, and its rotations level by level, deepest first.
//! Nodes of one level touch disjoint slots, and a rotation keeps its own node's box, so the result is bit for bit
//! that of the recursion.

use std::ops::Range;

use bvh_core::{MAX_HEIGHT, Node};

use super::kernels::{AHEAD, Accepted};
use super::shared::SharedNodes;

/// Inner nodes that one block lists; about half of them are processed in it.
pub(crate) const LISTED: usize = 1024;

/// Roots of one block below another.
pub(crate) const ROOTS: usize = 64;

/// Room of a list, a power of two: an index modulo the room needs no check.
const ROOM: usize = 2 * LISTED;

/// Pairs that a sweep lists together.
pub(super) const GROUP: usize = 8;

/// A node in a list: its slot in the upper half, its link word in the lower.
#[repr(transparent)]
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Entry(u64);

impl Entry {
    #[inline(always)]
    pub(crate) fn new(slot: usize, link: u32) -> Self {
        Self((slot as u64) << 32 | u64::from(link))
    }

    #[inline(always)]
    pub(crate) fn slot(self) -> usize {
        (self.0 >> 32) as usize
    }

    /// Inner node: slot of its left child. Leaf: its first primitive.
    #[inline(always)]
    pub(crate) fn first(self) -> usize {
        self.0 as usize & Node::INDEX as usize
    }

    #[inline(always)]
    pub(crate) fn link(self) -> u32 {
        self.0 as u32
    }
}

/// Inner nodes, parents before children.
pub(crate) struct Queue {
    entries: [Entry; ROOM],
    count: usize,
}

impl Queue {
    #[inline(always)]
    pub(crate) fn get(&self, range: Range<usize>) -> &[Entry] {
        &self.entries[range]
    }

    pub(crate) fn all(&self) -> &[Entry] {
        &self.entries[..self.count]
    }
}

impl Default for Queue {
    fn default() -> Self {
        Self { entries: [Entry::default(); ROOM], count: 0 }
    }
}

/// Leaves of one block or stretch.
pub(crate) struct Leaves {
    /// With room for two children of each listed node, and for what kernels look ahead to.
    entries: [Entry; 2 * ROOM],
    count: usize,
    /// Not 0 if some leaf has another number of primitives than one.
    others: u32,
}

impl Leaves {
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn have_one_primitive_each(&self) -> bool {
        self.others == 0
    }

    pub(crate) fn all(&self) -> &[Entry] {
        &self.entries[..self.count]
    }

    /// The leaves, and behind the last the first of `next`, or the last again and again.
    pub(crate) fn with_next(&mut self) -> &[Entry] {
        let last = self.entries[self.count.saturating_sub(1)];
        self.entries[self.count..self.count + 2 * AHEAD].fill(last);
        &self.entries[..self.count + 2 * AHEAD]
    }
}

impl Default for Leaves {
    fn default() -> Self {
        Self { entries: [Entry::default(); 2 * ROOM], count: 0, others: 0 }
    }
}

/// Fills lists of inner nodes and leaves. The counts are its own while it does, and so in registers.
pub(crate) struct Lister<'a> {
    inner: &'a mut Queue,
    leaves: &'a mut Leaves,
    inner_count: usize,
    leaf_count: usize,
    others: u32,
}

impl<'a> Lister<'a> {
    pub(crate) fn new(roots: &[Entry], inner: &'a mut Queue, leaves: &'a mut Leaves) -> Self {
        inner.entries[..roots.len()].copy_from_slice(roots);
        Self { inner, leaves, inner_count: roots.len(), leaf_count: 0, others: 0 }
    }

    /// Lists the two nodes of a pair that move, each among the leaves or the inner nodes. Gives their link words.
    ///
    /// Each is written to both lists and counted in one, as a branch would be mispredicted often.
    #[inline(always)]
    pub(super) fn pair(&mut self, nodes: SharedNodes<'_>, pair: usize) -> [u32; 2] {
        let words = nodes.pair_words(pair);
        for (i, [link, aux]) in words.into_iter().enumerate() {
            const { assert!(Node::LEAF == 1 << 31 && Node::DYNAMIC == 1 << 30) };
            let entry = Entry::new(pair + i, link);
            let is_leaf = (link >> 31) as usize;
            let moves = if cfg!(refit_without = "moving") { 1 } else { (link >> 30 & 1) as usize };
            self.leaves.entries[self.leaf_count % (2 * ROOM)] = entry;
            self.leaf_count += is_leaf & moves;
            self.others |= (aux ^ 1 << 8) & (link as i32 >> 31) as u32;
            self.inner.entries[self.inner_count % ROOM] = entry;
            self.inner_count += (1 - is_leaf) & moves;
        }
        words.map(|[link, _]| link)
    }

    /// Appends eight leaves and eight inner nodes, of which the first few count.
    #[inline(always)]
    pub(super) fn append(&mut self, [leaves, inner]: [[Entry; GROUP]; 2], counts: [usize; 2], others: u32) {
        self.leaves.entries[self.leaf_count..self.leaf_count + GROUP].copy_from_slice(&leaves);
        self.inner.entries[self.inner_count..self.inner_count + GROUP].copy_from_slice(&inner);
        self.leaf_count += counts[0];
        self.inner_count += counts[1];
        self.others |= others;
    }

    pub(crate) fn finish(self) {
        self.inner.count = self.inner_count;
        (self.leaves.count, self.leaves.others) = (self.leaf_count, self.others);
    }
}

/// What a block has found on its way down.
#[derive(Default)]
pub(crate) struct Block {
    queue: Queue,
    /// Listed nodes whose children are listed, too: the block's own.
    done: usize,
    /// Where the last level begins and ends in the queue.
    last: Range<usize>,
    /// The block's nodes with grandchildren, level by level.
    rotating: Queue,
    /// Where each level ends among them.
    levels: Vec<usize>,
    depth: u32,
}

impl Block {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { levels: Vec::with_capacity(MAX_HEIGHT as usize + 1), ..Self::default() })
    }

    /// Walks down from roots of one depth until `limit` nodes are listed.
    pub(crate) fn walk(
        &mut self,
        nodes: SharedNodes<'_>,
        roots: &[Entry],
        depth: u32,
        limit: usize,
        leaves: &mut Leaves,
    ) {
        let Self { queue, last, rotating, levels, .. } = self;
        levels.clear();
        let (mut done, mut rotating_count) = (0, 0);
        let mut lister = Lister::new(roots, queue, leaves);
        while done < lister.inner_count && lister.inner_count < limit {
            *last = done..lister.inner_count;
            while done < last.end && lister.inner_count < limit {
                let entry = lister.inner.entries[done % ROOM];
                let links = lister.pair(nodes, entry.first());
                for link in links {
                    // A leaf's first primitive is no pair: the root's line is as good as any.
                    nodes.prefetch((link & Node::INDEX & !(link as i32 >> 31) as u32) as usize);
                }
                rotating.entries[rotating_count % ROOM] = entry;
                rotating_count += usize::from(links[0] & links[1] & Node::LEAF == 0);
                done += 1;
            }
            levels.push(rotating_count);
        }
        lister.finish();
        (self.done, self.rotating.count) = (done, rotating_count);
        self.depth = depth;
    }

    /// The block's own nodes, parents before children.
    pub(crate) fn own(&self) -> &[Entry] {
        self.queue.get(0..self.done)
    }

    /// The nodes below this block, by depth: the rest of its last level, and the level below.
    pub(crate) fn frontier(&self) -> [(&[Entry], u32); 2] {
        let depth = self.depth + self.levels.len() as u32;
        let (rest, below) = (self.done..self.last.end, self.last.end..self.queue.count);
        [(self.queue.get(rest), depth - 1), (self.queue.get(below), depth)]
    }

    /// The block's nodes with grandchildren by depth, deepest first.
    pub(crate) fn levels(&self) -> impl Iterator<Item = (&[Entry], u32)> {
        (0..self.levels.len()).rev().map(|i| {
            let start = if i == 0 { 0 } else { self.levels[i - 1] };
            (self.rotating.get(start..self.levels[i]), self.depth + i as u32)
        })
    }
}

/// Lists that no block needs while another is at work.
pub(crate) struct Lists {
    pub(crate) leaves: Leaves,
    /// Inner nodes of a stretch, or those of a level whose turn it is.
    pub(crate) inner: Queue,
    pub(crate) accepted: Accepted,
}

impl Queue {
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Appends a node if `condition` holds, without a branch.
    #[inline(always)]
    pub(crate) fn push_if(&mut self, entry: Entry, condition: bool) {
        self.entries[self.count % ROOM] = entry;
        self.count += usize::from(condition);
    }
}

impl Lists {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { leaves: Leaves::default(), inner: Queue::default(), accepted: Accepted::default() })
    }
}
