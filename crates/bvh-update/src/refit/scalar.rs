//! The kernels for any processor.

use std::ops::Range;

use bvh_core::Primitives;
use bvh_core::rotation::{area_changes_at, best};

use super::Tally;
use super::block::{Block, Entry, Leaves, Lister};
use super::kernels::{self, Accepted, refit_height};
use super::shared::SharedNodes;

/// See [`Block::walk`].
#[inline(always)]
pub(super) fn walk(
    block: &mut Block,
    nodes: SharedNodes<'_>,
    roots: &[Entry],
    depth: u32,
    limit: usize,
    leaves: &mut Leaves,
) {
    block.walk(nodes, roots, depth, limit, leaves, |parents, count, lister| {
        parents[..count].iter().for_each(|&parent| lister.children(nodes, parent));
    });
}

/// Lists the nodes of successive pairs.
#[inline(always)]
pub(super) fn sweep(nodes: SharedNodes<'_>, pairs: Range<usize>, lister: &mut Lister<'_>) {
    pairs.for_each(|pair| lister.children(nodes, Entry::new(0, 2 * pair as u32)));
}

/// See [`kernels::fit_leaves`].
pub(super) fn fit_leaves<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    leaves: &[Entry],
    fetch: impl Fn(usize),
    with_sums: bool,
    tally: &mut Tally,
) {
    kernels::fit_leaves(nodes, primitives, leaves, fetch, with_sums, tally);
}

/// See [`kernels::refit_boxes`].
pub(super) fn refit_boxes(
    nodes: SharedNodes<'_>,
    parents_first: &[Entry],
    with_sums: bool,
    tally: &mut Tally,
) {
    kernels::refit_boxes(nodes, parents_first, with_sums, tally);
}

/// Refits the heights of nodes, and accepts those at which some rotation is a gain.
pub(super) fn judge(nodes: SharedNodes<'_>, list: &[Entry], accepted: &mut Accepted) {
    for &entry in list {
        refit_height(nodes, entry);
        let changes = area_changes_at(&nodes, entry.first());
        let [c0, c1, c2, c3, c4, c5] = changes;
        accepted.push_if(entry, [c0, c1, c2, c3, c4, c5, 0.0, 0.0], best(changes).is_some());
    }
}
