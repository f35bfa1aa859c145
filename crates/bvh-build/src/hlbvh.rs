//! Hierarchical linear BVH: a top by the surface area heuristic over clusters along the Morton
//! curve (Pantaleoni and Luebke 2010, "HLBVH: hierarchical LBVH construction for real-time ray
//! tracing of dynamic geometry"; binned, as Garanzha, Pantaleoni, McAllister 2011, "Simpler and
//! faster HLBVH with work queues").
//!
//! Departure: a cluster is not what has some number of leading bits in common, but the largest node
//! of the linear tree of at most [`CLUSTER`] primitives. So there are as many clusters where
//! primitives are dense as where they are not.

use bvh_core::MAX_HEIGHT;
use rayon::prelude::*;

use crate::binned::{self, Bins, Leaves};
use crate::lists::bytes_of;
use crate::morton::{self, least_parts};
use crate::prim_ref::{Bounds, PrimRef};
use crate::radix::Key;
use crate::subtree_slot::SubtreeSlot;

/// Most primitives in a cluster.
// Half and double: docs/TUNING.md.
const CLUSTER: usize = 32;

/// Fewest clusters for a task.
// Half and double: docs/TUNING.md.
const PART: usize = 256;

/// Memory for clusters.
#[derive(Default)]
pub(crate) struct ClusterMemory {
    prims: Vec<PrimRef>,
    /// Where each cluster begins and ends along the curve.
    ranges: Vec<[u32; 2]>,
}

impl ClusterMemory {
    pub(crate) fn memory_usage(&self) -> usize {
        bytes_of(&self.prims) + bytes_of(&self.ranges)
    }
}

/// Builds the tree over `prims`, which have boxes and lie along the curve as `keys` say.
pub(crate) fn build<K: Key>(
    prims: &[PrimRef],
    keys: &[K],
    (tops, spare, all_bins): (&mut ClusterMemory, &mut Vec<PrimRef>, &mut Vec<Bins>),
    bins: u32,
    threads: usize,
    slot: SubtreeSlot,
) {
    tops.ranges.clear();
    cut(keys, 0, &mut tops.ranges);
    tops.prims.resize(tops.ranges.len(), PrimRef::NOTHING);
    let ranges = &tops.ranges;
    let gather = |(i, top): (usize, &mut PrimRef)| {
        let [start, end] = ranges[i].map(|i| i as usize);
        let boxes = keys[start..end].iter().map(|key| prims[key.number() as usize].bounds());
        *top = PrimRef::cluster(boxes.fold(Bounds::EMPTY, Bounds::union), i as u32, (end - start) as u32);
    };
    tops.prims.par_iter_mut().with_min_len(PART.max(least_parts(threads))).enumerate().for_each(gather);
    let clusters = Clusters { prims, keys, ranges };
    binned::build(&mut tops.prims, (spare, all_bins), &clusters, bins, threads, slot);
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
    prims: &'a [PrimRef],
    keys: &'a [K],
    ranges: &'a [[u32; 2]],
}

impl<K: Key> Leaves for Clusters<'_, K> {
    const MOST: usize = CLUSTER;

    fn slots(&self, clusters: &[PrimRef]) -> usize {
        clusters.iter().map(|cluster| cluster.size() as usize).sum()
    }

    fn subtree(&self, cluster: &PrimRef, slot: SubtreeSlot) {
        let [start, end] = self.ranges[cluster.number() as usize].map(|i| i as usize);
        let keys = &self.keys[start..end];
        if slot.depth as usize + keys.len() - 1 > MAX_HEIGHT as usize {
            let mut prims = [PrimRef::NOTHING; CLUSTER];
            prims.iter_mut().zip(keys).for_each(|(prim, key)| *prim = self.prims[key.number() as usize]);
            return slot.halve(&prims[..keys.len()]);
        }
        morton::build(keys, self.prims, false, slot);
    }
}
