//! Parallel locally-ordered clustering (Meister and Bittner 2018, "Parallel locally-ordered
//! clustering for bounding volume hierarchy construction"; Benthin, Drabinski, Tessari, Dittebrandt
//! 2022, "PLOC++").
//!
//! ```text
//! clusters = the primitives, sorted along the Morton curve
//! while there is more than one:
//!     each looks among the `radius` before it and the `radius` behind it for the one with which its bounds are smallest
//!     two that chose each other become one, in the place of the first
//! ```
//!
//! Departures: pairs of equal area are ordered by their places. No two pairs with a place in common
//! are equal in that order. So in each round some two clusters choose each other, and where all
//! areas are equal, all neighbours do. After a round with few such pairs, the next round joins all
//! neighbours. So the number of rounds is logarithmic. Nodes are numbered depth first at the end.

use std::hint::select_unpredictable;
use std::ops::Range;

use bvh_core::{MAX_HEIGHT, Node, prefetch};
use rayon::prelude::*;

use crate::lists::bytes_of;
use crate::morton::{AHEAD, Sorted, least_parts, with_keys};
use crate::neighbor_search::{self, MAX_RADIUS, Window};
use crate::prim_ref::PrimRef;
use crate::radix::Key;
use crate::subtree_slot::SubtreeSlot;

/// Clusters for a task.
// Half and double: docs/TUNING.md.
const PART: usize = 2048;

/// Subtrees of fewer primitives are written by one thread.
// Half and double: docs/TUNING.md.
const GRAIN: usize = 4096;

/// After a round that joins fewer than one cluster in this number, a round joins all neighbours.
const SLOW: usize = 32;

/// Two clusters that became one, and the number of primitives in it. A cluster's number is the
/// place of its only leaf, or the number of leaves plus that of its merger.
#[derive(Clone, Copy)]
struct Merger {
    left: u32,
    right: u32,
    size: u32,
}

/// Memory for clusters.
#[derive(Default)]
pub(crate) struct PlocMemory {
    /// The primitives along the curve.
    leaves: Vec<PrimRef>,
    spare: Vec<PrimRef>,
    nearest: Vec<u32>,
    mergers: Vec<Merger>,
    parts: Vec<Kept>,
}

impl PlocMemory {
    pub(crate) fn memory_usage(&self) -> usize {
        let Self { leaves, spare, nearest, mergers, parts } = self;
        bytes_of(leaves) + bytes_of(spare) + bytes_of(nearest) + bytes_of(mergers) + bytes_of(parts)
    }
}

/// How many clusters of a part stay, and how many of these are new.
#[derive(Clone, Copy, Default)]
struct Kept {
    clusters: usize,
    mergers: usize,
}

/// Builds the tree over `prims`, which have boxes and lie along the curve as `sorted` says. Other
/// primitives are left in their place.
pub(crate) fn build(
    prims: &mut [PrimRef],
    sorted: &Sorted<'_>,
    radius: u32,
    memory: &mut PlocMemory,
    threads: usize,
    slot: SubtreeSlot,
) {
    let n = prims.len();
    let PlocMemory { leaves, spare, nearest, mergers, parts } = memory;
    crate::lists::make_room(spare, n, PrimRef::NOTHING, threads);
    crate::lists::make_room(nearest, n, 0, threads);
    crate::lists::make_room(mergers, n - 1, Merger { left: 0, right: 0, size: 0 }, threads);
    with_keys!(sorted, keys => gather(keys, prims, leaves, threads));
    let mut window = Window::new(radius.clamp(1, MAX_RADIUS as u32) as usize);
    let (mut from, mut to) = (&mut spare[..], prims);
    let (mut count, mut merged, mut slow) = (n, 0, false);
    while count > 1 {
        let clusters = if merged == 0 { &leaves[..] } else { &from[..count] };
        let threads = if count > 2 * PART { threads } else { 1 };
        let nearest = &mut nearest[..count];
        if slow {
            join_neighbours(nearest);
        } else {
            neighbor_search::find(clusters, nearest, &mut window, threads);
        }
        let round = Round { clusters, nearest, is_first: merged == 0, number: (n + merged) as u32 };
        let kept = round.run(to, &mut mergers[merged..], parts, threads);
        slow = kept.mergers < count / SLOW;
        merged += kept.mergers;
        count = kept.clusters;
        std::mem::swap(&mut from, &mut to);
    }
    let root = (n + merged - 1) as u32;
    Tree { leaves, mergers }.subtree(root, threads > 1, slot);
}

/// Copies the primitives in the order of the curve.
fn gather<K: Key>(keys: &[K], prims: &[PrimRef], sorted: &mut Vec<PrimRef>, threads: usize) {
    let places = keys.par_iter().enumerate().with_min_len(PART.max(least_parts(threads)));
    let prim = |(i, key): (usize, &K)| {
        if let Some(later) = keys.get(i + AHEAD) {
            prefetch(prims, later.number() as usize);
        }
        prims[key.number() as usize]
    };
    places.map(prim).collect_into_vec(sorted);
}

/// Lets each two neighbours choose each other; the last, if it has none, itself.
fn join_neighbours(nearest: &mut [u32]) {
    let last = nearest.len() as u32 - 1;
    for (i, nearest) in (0..).zip(nearest) {
        *nearest = last.min(i ^ 1);
    }
}

/// The clusters of a round and the place that each chose.
#[derive(Clone, Copy)]
struct Round<'a> {
    clusters: &'a [PrimRef],
    nearest: &'a [u32],
    /// Whether the clusters are the leaves.
    is_first: bool,
    /// Number of the first new cluster.
    number: u32,
}

impl Round<'_> {
    /// Joins all that chose each other. Clusters that stay are written to `to` in the order they
    /// have, those that are new to `mergers`, too.
    fn run(self, to: &mut [PrimRef], mergers: &mut [Merger], parts: &mut Vec<Kept>, threads: usize) -> Kept {
        let n = self.clusters.len();
        if threads == 1 {
            return self.join(0..n, to, mergers);
        }
        parts.resize(n.div_ceil(PART), Kept::default());
        parts.par_iter_mut().enumerate().for_each(|(p, kept)| {
            *kept = self.count(p * PART..n.min((p + 1) * PART));
        });
        self.join_parts(parts, 0, to, mergers);
        Kept::sum(parts)
    }

    fn count(&self, range: Range<usize>) -> Kept {
        let mut kept = Kept::default();
        for i in range {
            let j = self.nearest[i] as usize;
            let mutual = self.nearest[j] as usize == i;
            kept.mergers += usize::from(mutual & (i < j));
            kept.clusters += usize::from(!mutual | (i <= j));
        }
        kept
    }

    /// As [`run`](Self::run) for some of the parts, the first of which begins at `start`.
    fn join_parts(self, parts: &[Kept], start: usize, to: &mut [PrimRef], mergers: &mut [Merger]) {
        let half = parts.len() / 2;
        if half == 0 {
            self.join(start..self.clusters.len().min(start + PART), to, mergers);
            return;
        }
        let (l, r) = parts.split_at(half);
        let kept = Kept::sum(l);
        let (to_l, to_r) = to.split_at_mut(kept.clusters);
        let (mergers_l, mergers_r) = mergers.split_at_mut(kept.mergers);
        let right = Self { number: self.number + kept.mergers as u32, ..self };
        rayon::join(
            || self.join_parts(l, start, to_l, mergers_l),
            || right.join_parts(r, start + half * PART, to_r, mergers_r),
        );
    }

    /// As [`run`](Self::run) for the clusters at some of the places.
    fn join(&self, range: Range<usize>, to: &mut [PrimRef], mergers: &mut [Merger]) -> Kept {
        if self.is_first {
            self.join_if::<true>(range, to, mergers)
        } else {
            self.join_if::<false>(range, to, mergers)
        }
    }

    fn join_if<const FIRST: bool>(
        &self,
        range: Range<usize>,
        to: &mut [PrimRef],
        mergers: &mut [Merger],
    ) -> Kept {
        let mut kept = Kept::default();
        let (clusters, nearest) = (self.clusters, &self.nearest[..self.clusters.len()]);
        // Mutual choices are unpredictable, so there is no branch on them: unwanted output is
        // overwritten.
        for i in range {
            let j = nearest[i] as usize;
            let mutual = nearest[j] as usize == i;
            let other = select_unpredictable(mutual, j, i);
            let (a, b) = (&clusters[i], &clusters[other]);
            let number = |cluster: &PrimRef, i| if FIRST { i as u32 } else { cluster.number() };
            let size = |cluster: &PrimRef| if FIRST { 1 } else { cluster.size() };
            let is_new = mutual & (i < j);
            let (left, right) = (number(a, i), number(b, other));
            let size = size(a) + select_unpredictable(is_new, size(b), 0);
            if let Some(merger) = mergers.get_mut(kept.mergers) {
                *merger = Merger { left, right, size };
            }
            let number = select_unpredictable(is_new, self.number + kept.mergers as u32, left);
            if let Some(place) = to.get_mut(kept.clusters) {
                *place = PrimRef::cluster(a.bounds().union(b.bounds()), number, size);
            }
            kept.mergers += usize::from(is_new);
            kept.clusters += usize::from(!mutual | (i <= j));
        }
        kept
    }
}

impl Kept {
    fn sum(parts: &[Self]) -> Self {
        let sum = |of: fn(&Self) -> usize| parts.iter().map(of).sum();
        Self { clusters: sum(|kept| kept.clusters), mergers: sum(|kept| kept.mergers) }
    }
}

/// All mergers over all leaves.
#[derive(Clone, Copy)]
struct Tree<'a> {
    leaves: &'a [PrimRef],
    mergers: &'a [Merger],
}

impl Tree<'_> {
    /// What a cluster was made of, if it is not a primitive.
    #[inline]
    fn merger(&self, cluster: u32) -> Option<&Merger> {
        (cluster as usize).checked_sub(self.leaves.len()).map(|i| &self.mergers[i])
    }

    /// Writes the tree below a cluster.
    fn subtree(self, cluster: u32, parallel: bool, slot: SubtreeSlot) {
        match self.merger(cluster) {
            Some(&Merger { left, right, size })
                if parallel && size as usize >= GRAIN && slot.any_split_fits(1) =>
            {
                let left_size = self.merger(left).map_or(1, |merger| merger.size as usize);
                slot.fork(left_size, |slot_l, slot_r| {
                    rayon::join(|| self.subtree(left, true, slot_l), || self.subtree(right, true, slot_r))
                });
            }
            _ => {
                let depth = slot.depth;
                let slots = slot.first_slot + slot.order.len() as u32;
                let mut writer = Writer { tree: self, next: slot.below.len(), slots, slot };
                let node = writer.write(cluster, depth);
                *writer.slot.root = node;
            }
        }
    }
}

/// Writes a subtree from its end: children before parents, the right ones before the left ones,
/// which is depth first, parents first, when read from the start.
struct Writer<'a> {
    tree: Tree<'a>,
    slot: SubtreeSlot<'a>,
    /// First of the nodes below the root that are written.
    next: usize,
    /// First slot that is written, in the tree.
    slots: u32,
}

impl Writer<'_> {
    fn write(&mut self, cluster: u32, depth: u32) -> Node {
        match self.tree.merger(cluster) {
            None => self.leaf(cluster),
            // Two leaves: nearly half of all mergers, for which calls would take longer than the
            // work.
            Some(&Merger { left, right, size: 2 }) => {
                let r = self.leaf(right);
                let l = self.leaf(left);
                self.parent(l, r)
            }
            Some(merger) if merger.size.next_power_of_two().ilog2() + depth >= MAX_HEIGHT => {
                let mut leaves = Vec::new();
                let mut todo = vec![cluster];
                while let Some(cluster) = todo.pop() {
                    match self.tree.merger(cluster) {
                        Some(merger) => todo.extend([merger.right, merger.left]),
                        None => leaves.push(cluster),
                    }
                }
                self.halve(&leaves)
            }
            Some(&Merger { left, right, .. }) => {
                // Mergers of one round lie along the curve, and so do subtrees: the mergers before
                // these come next.
                for child in [left, right] {
                    let place = (child as usize).saturating_sub(self.tree.leaves.len() + AHEAD);
                    prefetch(self.tree.mergers, place);
                }
                let r = self.write(right, depth + 1);
                let l = self.write(left, depth + 1);
                self.parent(l, r)
            }
        }
    }

    /// A balanced tree, where any other might be too high.
    fn halve(&mut self, leaves: &[u32]) -> Node {
        if let [leaf] = leaves {
            return self.leaf(*leaf);
        }
        let (l, r) = leaves.split_at(leaves.len() / 2);
        let r = self.halve(r);
        let l = self.halve(l);
        self.parent(l, r)
    }

    #[inline]
    fn leaf(&mut self, cluster: u32) -> Node {
        prefetch(self.tree.leaves, (cluster as usize).saturating_sub(AHEAD));
        let prim = &self.tree.leaves[cluster as usize];
        self.slots -= 1;
        self.slot.order[(self.slots - self.slot.first_slot) as usize] = prim.number();
        Node::leaf(prim.bounds().aabb(), self.slots, 1)
    }

    #[inline]
    fn parent(&mut self, l: Node, r: Node) -> Node {
        self.next -= 2;
        self.slot.below[self.next] = l;
        self.slot.below[self.next + 1] = r;
        Node::parent(&l, &r, self.slot.first_node + self.next as u32)
    }
}
