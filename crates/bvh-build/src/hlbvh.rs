//! Hierarchical linear BVH: a top by the surface area heuristic over clusters along the Morton curve (Pantaleoni and
//! Luebke 2010, "HLBVH: hierarchical LBVH construction for real-time ray tracing of dynamic geometry"; binned, as Garanzha,
//! Pantaleoni, McAllister 2011, "Simpler and faster HLBVH with work queues").
//!
//! Departure: a cluster is not what has some number of leading bits in common, but the largest node of the linear
//! tree of at most [`CLUSTER`] primitives. So there are as many clusters where primitives are dense as where they are not.

use bvh_core::MAX_HEIGHT;
use rayon::prelude::*;

use crate::binned::{self, Bins, Leaves};
use crate::bytes_of;
use crate::item::{Hull, Item};
use crate::morton::{self, Sorted};
use crate::plot::Plot;
use crate::radix::Key;

/// Most primitives in a cluster.
const CLUSTER: usize = 32;

/// Fewest clusters for a task.
const PART: usize = 256;

/// Memory for clusters.
#[derive(Default)]
pub(crate) struct Tops {
    items: Vec<Item>,
    /// Where each cluster begins and ends along the curve.
    ranges: Vec<[u32; 2]>,
}

impl Tops {
    pub(crate) fn bytes(&self) -> usize {
        bytes_of(&self.items) + bytes_of(&self.ranges)
    }
}

/// Builds the tree over `items`, which have boxes and lie along the curve as `sorted` says; gives its hull.
pub(crate) fn build(
    items: &[Item],
    sorted: &Sorted<'_>,
    (tops, spare, all_bins): (&mut Tops, &mut Vec<Item>, &mut Vec<Bins>),
    bins: u32,
    threads: usize,
    plot: Plot,
) -> Hull {
    match sorted {
        Sorted::Short(keys) => grow(items, keys, (tops, spare, all_bins), bins, threads, plot),
        Sorted::Long(keys) => grow(items, keys, (tops, spare, all_bins), bins, threads, plot),
    }
}

fn grow<K: Key>(
    items: &[Item],
    keys: &[K],
    (tops, spare, all_bins): (&mut Tops, &mut Vec<Item>, &mut Vec<Bins>),
    bins: u32,
    threads: usize,
    plot: Plot,
) -> Hull {
    tops.ranges.clear();
    cut(keys, 0, &mut tops.ranges);
    tops.items.resize(tops.ranges.len(), Item::NOTHING);
    let ranges = &tops.ranges;
    let gather = |(i, top): (usize, &mut Item)| {
        let [start, end] = ranges[i].map(|i| i as usize);
        let hulls = keys[start..end].iter().map(|key| items[key.number() as usize].hull());
        *top = Item::cluster(hulls.fold(Hull::EMPTY, Hull::union), i as u32, (end - start) as u32);
    };
    if threads > 1 {
        tops.items.par_iter_mut().with_min_len(PART).enumerate().for_each(gather);
    } else {
        tops.items.iter_mut().enumerate().for_each(gather);
    }
    let clusters = Clusters { items, keys, ranges };
    binned::build(&mut tops.items, (spare, all_bins), &clusters, bins, threads, plot)
}

/// Lists the clusters of a node of the linear tree that begins at `start`.
fn cut<K: Key>(keys: &[K], start: u32, ranges: &mut Vec<[u32; 2]>) {
    if keys.len() <= CLUSTER {
        ranges.push([start, start + keys.len() as u32]);
    } else {
        let (l, r) = morton::split(keys);
        cut(l, start, ranges);
        cut(r, start + l.len() as u32, ranges);
    }
}

struct Clusters<'a, K> {
    items: &'a [Item],
    keys: &'a [K],
    ranges: &'a [[u32; 2]],
}

impl<K: Key> Leaves for Clusters<'_, K> {
    const MOST: usize = CLUSTER;

    fn slots(&self, clusters: &[Item]) -> usize {
        clusters.iter().map(|cluster| cluster.size() as usize).sum()
    }

    fn grow(&self, cluster: &Item, plot: Plot) -> Hull {
        let [start, end] = self.ranges[cluster.number() as usize].map(|i| i as usize);
        let keys = &self.keys[start..end];
        if plot.depth() as usize + keys.len() - 1 > MAX_HEIGHT as usize {
            let mut items = [Item::NOTHING; CLUSTER];
            items.iter_mut().zip(keys).for_each(|(item, key)| *item = self.items[key.number() as usize]);
            return plot.halve(&items[..keys.len()]);
        }
        morton::grow(keys, self.items, false, plot)
    }
}
