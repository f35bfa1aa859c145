//! Parallel locally-ordered clustering (Meister and Bittner 2018, "Parallel locally-ordered clustering for bounding
//! volume hierarchy construction"; Benthin, Drabinski, Tessari, Dittebrandt 2022, "PLOC++").
//!
//! ```text
//! clusters = the primitives, sorted along the Morton curve
//! while there is more than one:
//!     each looks among the `radius` before it and the `radius` behind it for the one with which its hull is smallest
//!     two that chose each other become one, in the place of the first
//! ```
//!
//! Departures: equal areas are told apart by an order of all pairs of places in which no two pairs with a place in
//! common are equal, so that some two always choose each other, and, where all areas are equal, every two neighbours do.
//! Where few do nevertheless, the next round joins neighbours whatever their areas: the number of rounds is
//! logarithmic. Nodes are numbered depth first at the end.

use std::ops::Range;

use bvh_core::{MAX_HEIGHT, Node, prefetch};
use rayon::prelude::*;

use crate::item::{Hull, Item};
use crate::morton::{AHEAD, Sorted};
use crate::nearest::{self, MAX_RADIUS};
use crate::plot::{Plot, Site};
use crate::radix::Key;

/// Clusters for a task.
const PART: usize = 2048;

/// Subtrees of fewer primitives are written by one thread.
const GRAIN: usize = 4096;

/// A round that joins fewer than one in so many is followed by one that joins all neighbours.
const SLOW: usize = 32;

/// Two clusters that became one, and the number of primitives in it. A cluster's number is that of its only
/// primitive's item, or the number of items plus that of its merger.
#[derive(Clone, Copy)]
struct Merger {
    left: u32,
    right: u32,
    size: u32,
}

/// Memory for clusters.
#[derive(Default)]
pub(crate) struct Clusters {
    now: Vec<Item>,
    next: Vec<Item>,
    nearest: Vec<u32>,
    mergers: Vec<Merger>,
    parts: Vec<Kept>,
}

/// How many clusters of a part stay, and how many of these are new.
#[derive(Clone, Copy, Default)]
struct Kept {
    clusters: usize,
    mergers: usize,
}

/// Builds the tree over `items`, which have boxes and lie along the curve as `sorted` says; gives its hull.
pub(crate) fn build(
    items: &[Item],
    sorted: &Sorted<'_>,
    radius: u32,
    clusters: &mut Clusters,
    threads: usize,
    plot: Plot,
) -> Hull {
    let n = items.len();
    let radius = radius.clamp(1, MAX_RADIUS as u32) as usize;
    let Clusters { now, next, nearest, mergers, parts } = clusters;
    now.resize(n, Item::NOTHING);
    next.resize(n, Item::NOTHING);
    nearest.resize(n, 0);
    mergers.resize(n - 1, Merger { left: 0, right: 0, size: 0 });
    match sorted {
        Sorted::Short(keys) => gather(keys, items, now, threads),
        Sorted::Long(keys) => gather(keys, items, now, threads),
    }
    let (mut from, mut to) = (&mut now[..], &mut next[..]);
    let (mut count, mut merged) = (n, 0);
    let mut slow = false;
    while count > 1 {
        let threads = if count > 2 * PART { threads } else { 1 };
        let nearest = &mut nearest[..count];
        if slow {
            join_neighbours(nearest);
        } else {
            nearest::find(&from[..count], radius, nearest, threads);
        }
        let round = Round { clusters: &from[..count], nearest };
        let kept = round.run(to, &mut mergers[merged..], (n + merged) as u32, parts, threads);
        slow = kept.mergers < count / SLOW;
        merged += kept.mergers;
        count = kept.clusters;
        std::mem::swap(&mut from, &mut to);
    }
    Tree { items, mergers }.grow(from[0].number(), threads > 1, plot)
}

/// Copies the items in the order of the curve, as clusters.
fn gather<K: Key>(keys: &[K], items: &[Item], sorted: &mut [Item], threads: usize) {
    let copy = |(i, to): (usize, &mut Item)| {
        if let Some(key) = keys.get(i + AHEAD) {
            prefetch(items, key.number() as usize);
        }
        let number = keys[i].number();
        *to = Item::cluster(items[number as usize].hull(), number, 1);
    };
    if threads > 1 {
        sorted.par_iter_mut().with_min_len(PART).enumerate().for_each(copy);
    } else {
        sorted.iter_mut().enumerate().for_each(copy);
    }
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
    clusters: &'a [Item],
    nearest: &'a [u32],
}

impl Round<'_> {
    /// Joins all that chose each other. Clusters that stay are written to `to` in the order they have, mergers to
    /// `mergers`, of which the first is cluster number `first`.
    fn run(
        self,
        to: &mut [Item],
        mergers: &mut [Merger],
        first: u32,
        parts: &mut Vec<Kept>,
        threads: usize,
    ) -> Kept {
        let n = self.clusters.len();
        if threads == 1 {
            return self.join(0..n, to, mergers, first);
        }
        parts.resize(n.div_ceil(PART), Kept::default());
        parts.par_iter_mut().enumerate().for_each(|(p, kept)| {
            *kept = self.count(p * PART..n.min((p + 1) * PART));
        });
        self.join_parts(parts, 0, to, mergers, first);
        Kept::sum(parts)
    }

    /// The place that `i` and the one at that place chose mutually.
    #[inline]
    fn partner(&self, i: usize) -> Option<usize> {
        let j = self.nearest[i] as usize;
        (self.nearest[j] as usize == i).then_some(j)
    }

    fn count(&self, range: Range<usize>) -> Kept {
        range.fold(Kept::default(), |kept, i| match self.partner(i) {
            Some(j) if j < i => kept,
            Some(j) if j > i => Kept { clusters: kept.clusters + 1, mergers: kept.mergers + 1 },
            _ => Kept { clusters: kept.clusters + 1, ..kept },
        })
    }

    /// As [`run`](Self::run) for some of the parts, the first of which begins at `start`.
    fn join_parts(self, parts: &[Kept], start: usize, to: &mut [Item], mergers: &mut [Merger], first: u32) {
        let half = parts.len() / 2;
        if half == 0 {
            self.join(start..self.clusters.len().min(start + PART), to, mergers, first);
            return;
        }
        let (l, r) = parts.split_at(half);
        let kept = Kept::sum(l);
        let (to_l, to_r) = to.split_at_mut(kept.clusters);
        let (mergers_l, mergers_r) = mergers.split_at_mut(kept.mergers);
        rayon::join(
            || self.join_parts(l, start, to_l, mergers_l, first),
            || self.join_parts(r, start + half * PART, to_r, mergers_r, first + kept.mergers as u32),
        );
    }

    /// As [`run`](Self::run) for the clusters at some of the places.
    fn join(&self, range: Range<usize>, to: &mut [Item], mergers: &mut [Merger], first: u32) -> Kept {
        let mut kept = Kept::default();
        // Who chose whom cannot be predicted, so there is no branch on it: what is not to be kept is written over.
        for i in range {
            let j = self.nearest[i] as usize;
            let mutual = self.nearest[j] as usize == i;
            let (a, b) = (&self.clusters[i], &self.clusters[if mutual { j } else { i }]);
            let is_new = mutual & (i < j);
            let size = a.size() + if is_new { b.size() } else { 0 };
            if let Some(merger) = mergers.get_mut(kept.mergers) {
                *merger = Merger { left: a.number(), right: b.number(), size };
            }
            let number = if is_new { first + kept.mergers as u32 } else { a.number() };
            if let Some(place) = to.get_mut(kept.clusters) {
                *place = Item::cluster(a.hull().union(b.hull()), number, size);
            }
            kept.mergers += usize::from(is_new);
            kept.clusters += usize::from(!mutual | (i <= j));
        }
        kept
    }
}

impl Kept {
    fn sum(parts: &[Self]) -> Self {
        parts.iter().fold(Self::default(), |a, b| Self {
            clusters: a.clusters + b.clusters,
            mergers: a.mergers + b.mergers,
        })
    }
}

/// All mergers over all items.
#[derive(Clone, Copy)]
struct Tree<'a> {
    items: &'a [Item],
    mergers: &'a [Merger],
}

impl Tree<'_> {
    /// What a cluster was made of, if it is not a primitive.
    #[inline]
    fn merger(&self, cluster: u32) -> Option<&Merger> {
        (cluster as usize).checked_sub(self.items.len()).map(|i| &self.mergers[i])
    }

    /// Writes the tree below a cluster; gives its hull.
    fn grow(self, cluster: u32, parallel: bool, plot: Plot) -> Hull {
        match self.merger(cluster) {
            Some(&Merger { left, right, size })
                if parallel && size as usize >= GRAIN && plot.any_split_fits() =>
            {
                let left_size = self.merger(left).map_or(1, |merger| merger.size as usize);
                plot.fork(left_size, |plot_l, plot_r| {
                    rayon::join(|| self.grow(left, true, plot_l), || self.grow(right, true, plot_r))
                })
            }
            _ => {
                let depth = plot.depth();
                let site = plot.site();
                let slots = site.first_slot + site.order.len() as u32;
                let mut writer = Writer { tree: self, next: site.below.len(), slots, site };
                let node = writer.write(cluster, depth);
                *writer.site.root = node;
                Hull::of(node.aabb())
            }
        }
    }
}

/// Writes a subtree from its end: children before parents, the right ones before the left ones, which is depth first,
/// parents first, when read from the start.
struct Writer<'a> {
    tree: Tree<'a>,
    site: Site<'a>,
    /// First of the nodes below the root that are written.
    next: usize,
    /// First slot that is written, in the tree.
    slots: u32,
}

impl Writer<'_> {
    fn write(&mut self, cluster: u32, depth: u32) -> Node {
        match self.tree.merger(cluster) {
            None => self.leaf(cluster),
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
        let item = &self.tree.items[cluster as usize];
        self.slots -= 1;
        self.site.order[(self.slots - self.site.first_slot) as usize] = item.number();
        Node::leaf(item.hull().aabb(), self.slots, 1)
    }

    #[inline]
    fn parent(&mut self, l: Node, r: Node) -> Node {
        self.next -= 2;
        self.site.below[self.next] = l;
        self.site.below[self.next + 1] = r;
        Node::parent(&l, &r, self.site.first_node + self.next as u32)
    }
}
