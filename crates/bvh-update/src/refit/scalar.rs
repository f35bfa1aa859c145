//! The kernels for any processor.

use std::ops::Range;

use bvh_core::Node;
use bvh_core::rotation::{area_changes, best};

use super::Tally;
use super::block::{Block, Entry, Leaves, Lister};
use super::kernels::{Accepted, refit_height};
pub(super) use super::kernels::{fit_leaves, refit_boxes};
use super::shared::SharedNodes;

/// See [`Block::walk`].
#[inline(always)]
pub(super) fn walk(block: &mut Block, nodes: SharedNodes<'_>, roots: &[Entry], leaves: &mut Leaves) {
    block.walk(nodes, roots, leaves, |parents, count, lister| {
        for &parent in &parents[..count] {
            let links = lister.children(nodes, parent);
            lister.rotating(parent, links);
        }
    });
}

/// Lists the nodes of successive pairs.
#[inline(always)]
pub(super) fn sweep(nodes: SharedNodes<'_>, pairs: Range<usize>, lister: &mut Lister<'_>) {
    for pair in pairs {
        lister.children(nodes, Entry::new(0, 2 * pair as u32));
    }
}

/// Refits the heights of nodes, and accepts those at which some rotation is a gain.
pub(super) fn rotate(
    nodes: SharedNodes<'_>,
    list: &[Entry],
    at: (u32, bool),
    accepted: &mut Accepted,
    tally: &mut Tally,
) {
    let mut count = 0;
    for &entry in list {
        refit_height(nodes, entry);
        let [l, r] = nodes.pair(entry.first());
        let below = |n: Node| (!n.is_leaf()).then(|| nodes.pair(n.first()).map(|child| child.aabb()));
        let changes = area_changes(l.aabb(), r.aabb(), below(l), below(r));
        let [c0, c1, c2, c3, c4, c5] = changes;
        accepted.set(count, entry, [c0, c1, c2, c3, c4, c5, 0.0, 0.0]);
        count += usize::from(best(changes).is_some());
    }
    accepted.apply(count, nodes, at, tally);
}
