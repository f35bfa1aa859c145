//! A block: some hundred inner nodes that are refitted and rotated together.
//!
//! The recursion of the paper ([`plain`](crate::plain)) waits for memory at every node. A block
//! walks the tree breadth-first from a few roots instead. It asks for the cache line of a pair of
//! children some turns before their parent's turn. What lies below the block is handed to further
//! blocks. Then the block's boxes follow in reverse order, and its rotations level by level,
//! deepest first. Nodes of one level touch disjoint slots, and a rotation keeps its own node's box,
//! so the result is bit for bit that of the recursion.

use bvh_core::{MAX_HEIGHT, Node};
use bytemuck::Zeroable;

use super::rotations::Accepted;
use super::shared::SharedNodes;

/// Inner nodes that one block lists, but for the last level.
// Half and double: docs/TUNING.md.
pub(crate) const LISTED: usize = 1024;

/// Room of a list, a power of two: an index modulo the room needs no check.
const ROOM: usize = 2 * LISTED;

/// How many nodes ahead a walk fetches children.
// Half and double: docs/TUNING.md.
const FETCHED: usize = 16;

/// Nodes whose children are listed together.
pub(super) const GROUP: usize = 8;

/// A node in a list: its slot in the upper half, its link word in the lower.
#[repr(transparent)]
#[derive(Clone, Copy, Default, bytemuck::Pod, Zeroable)]
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

    /// Inner node: slot of its left child. Leaf: its first slot of the order, or in the pass, where
    /// each leaf has one primitive, that.
    #[inline(always)]
    pub(crate) fn first(self) -> usize {
        self.0 as usize & Node::INDEX as usize
    }
}

/// A list with room for `N` entries.
#[derive(Zeroable)]
pub(crate) struct List<const N: usize> {
    entries: [Entry; N],
    count: usize,
}

/// Inner nodes, parents before children.
pub(crate) type Queue = List<ROOM>;
/// Leaves of one block or stretch: with room for two children of each listed node.
pub(crate) type Leaves = List<{ 2 * ROOM }>;

impl<const N: usize> List<N> {
    /// Eight entries, counted or not.
    #[inline(always)]
    fn group(&self, start: usize) -> [Entry; GROUP] {
        let group = self.entries[start..].first_chunk();
        *group.expect("lists have room")
    }

    pub(crate) fn all(&self) -> &[Entry] {
        &self.entries[..self.count]
    }

    /// All, and `n` copies of the last one, so that a loop can look `n` entries ahead. Empty if the
    /// list is. There must be room.
    pub(super) fn padded(&mut self, n: usize) -> &[Entry] {
        let Some(&last) = self.all().last() else { return &[] };
        self.entries[self.count..][..n].fill(last);
        &self.entries[..self.count + n]
    }

    pub(super) fn all_mut(&mut self) -> &mut [Entry] {
        &mut self.entries[..self.count]
    }

    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Appends a node if `condition` holds, without a branch.
    #[inline(always)]
    pub(crate) fn push_if(&mut self, entry: Entry, condition: bool) {
        self.entries[self.count % N] = entry;
        self.count += usize::from(condition);
    }
}

/// Fills lists of inner nodes, of leaves, and of nodes with grandchildren. The counts are its own
/// while it does, and so in registers.
pub(crate) struct Lister<'a> {
    inner: &'a mut Queue,
    rotating: &'a mut Queue,
    leaves: &'a mut Leaves,
    counts: Counts,
}

/// How long the lists are.
#[derive(Clone, Copy, Default)]
pub(super) struct Counts {
    pub(super) inner: usize,
    pub(super) rotating: usize,
    pub(super) leaves: usize,
}

impl<'a> Lister<'a> {
    pub(crate) fn new(
        roots: &[Entry],
        inner: &'a mut Queue,
        rotating: &'a mut Queue,
        leaves: &'a mut Leaves,
    ) -> Self {
        inner.entries[..roots.len()].copy_from_slice(roots);
        inner.entries[roots.len()..][..GROUP].fill(Entry::default());
        Self { inner, rotating, leaves, counts: Counts { inner: roots.len(), ..Counts::default() } }
    }

    /// Lists the children of a node, where they move. Each is written to both lists and counted in
    /// one, as a branch would be mispredicted often. Gives their link words.
    #[inline(always)]
    pub(super) fn children(&mut self, nodes: SharedNodes<'_>, parent: Entry) -> [u32; 2] {
        let (pair, counts) = (parent.first(), &mut self.counts);
        let links = nodes.pair_words(pair).map(|[link, _]| link);
        for (i, link) in links.into_iter().enumerate() {
            const { assert!(Node::LEAF == 1 << 31 && Node::DYNAMIC == 1 << 30) }
            let entry = Entry::new(pair + i, link);
            let is_leaf = (link >> 31) as usize;
            let is_dynamic = if cfg!(refit_without = "moving") { 1 } else { (link >> 30 & 1) as usize };
            self.leaves.entries[counts.leaves % (2 * ROOM)] = entry;
            counts.leaves += is_leaf & is_dynamic;
            self.inner.entries[counts.inner % ROOM] = entry;
            counts.inner += (1 - is_leaf) & is_dynamic;
        }
        links
    }

    /// Lists a node, given the link words of its children, if it has grandchildren.
    #[inline(always)]
    pub(super) fn rotating(&mut self, node: Entry, links: [u32; 2]) {
        self.rotating.entries[self.counts.rotating % ROOM] = node;
        self.counts.rotating += usize::from(links[0] & links[1] & Node::LEAF == 0);
    }

    /// Appends eight entries to each list, of which the first few count. The others among `inner`
    /// are those of the root.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn append(
        &mut self,
        inner: [[Entry; GROUP]; 2],
        rotating: [Entry; GROUP],
        leaves: [[Entry; GROUP]; 2],
        counts: [[usize; 2]; 3],
    ) {
        let now = &mut self.counts;
        for i in 0..2 {
            self.inner.entries[now.inner..][..GROUP].copy_from_slice(&inner[i]);
            now.inner += counts[0][i];
            self.leaves.entries[now.leaves..][..GROUP].copy_from_slice(&leaves[i]);
            now.leaves += counts[1][i];
        }
        self.inner.entries[now.inner..][..GROUP].fill(Entry::default());
        self.rotating.entries[now.rotating..][..GROUP].copy_from_slice(&rotating);
        now.rotating += counts[2][0];
    }

    pub(crate) fn finish(self) {
        self.inner.count = self.counts.inner;
        self.rotating.count = self.counts.rotating;
        self.leaves.count = self.counts.leaves;
    }
}

/// What a block has found on its way down.
#[derive(Zeroable)]
pub(crate) struct Block {
    queue: Queue,
    /// Listed nodes whose children are listed, too: the block's own.
    done: usize,
    /// Where the last level ends in the queue.
    last: usize,
    /// The block's nodes with grandchildren, level by level.
    rotating: Queue,
    /// Where each level ends among them, and how many levels there are.
    ends: [usize; MAX_HEIGHT as usize + 1],
    levels: usize,
    /// Depth of the roots.
    pub(super) depth: u32,
    /// How many nodes are listed, but for the last level.
    pub(super) limit: usize,
}

impl Block {
    /// Walks down from roots until [`limit`](Self::limit) nodes are listed; `list` lists the
    /// children of the first few of eight nodes.
    #[inline(always)]
    pub(super) fn walk(
        &mut self,
        nodes: SharedNodes<'_>,
        roots: &[Entry],
        leaves: &mut Leaves,
        list: impl Fn(&[Entry; GROUP], usize, &mut Lister<'_>),
    ) {
        let Self { queue, last, rotating, ends, levels, limit, .. } = self;
        let mut done = 0;
        *levels = 0;
        let mut lister = Lister::new(roots, queue, rotating, leaves);
        roots.iter().take(FETCHED).for_each(|root| nodes.prefetch(root.first()));
        while done < lister.counts.inner && lister.counts.inner < *limit {
            *last = lister.counts.inner;
            while done < *last && lister.counts.inner < *limit {
                let count = GROUP.min(*last - done);
                let group: [Entry; GROUP] = lister.inner.group(done);
                for entry in lister.inner.group(done + FETCHED) {
                    nodes.prefetch(entry.first());
                }
                list(&group, count, &mut lister);
                done += count;
            }
            ends[*levels] = lister.counts.rotating;
            *levels += 1;
        }
        lister.finish();
        self.done = done;
    }

    /// The block's own nodes, parents before children.
    pub(crate) fn own(&self) -> &[Entry] {
        &self.queue.entries[..self.done]
    }

    /// The nodes below this block, by depth: the rest of its last level, and the level below.
    pub(crate) fn frontier(&self) -> [(&[Entry], u32); 2] {
        let depth = self.depth + self.levels as u32;
        let (rest, below) = (self.done..self.last, self.last..self.queue.count);
        [(&self.queue.entries[rest], depth - 1), (&self.queue.entries[below], depth)]
    }

    /// The block's nodes with grandchildren by depth, deepest first.
    pub(crate) fn levels(&self) -> impl Iterator<Item = (&[Entry], u32)> {
        (0..self.levels).rev().map(|i| {
            let start = if i == 0 { 0 } else { self.ends[i - 1] };
            (&self.rotating.entries[start..self.ends[i]], self.depth + i as u32)
        })
    }
}

/// Lists that no block needs while another is at work.
#[derive(Zeroable)]
pub(crate) struct Lists {
    pub(crate) leaves: Leaves,
    /// Inner nodes of a stretch.
    pub(crate) inner: Queue,
    /// Nodes of a level whose turn it is.
    pub(crate) included: Queue,
    pub(crate) accepted: Accepted,
}
