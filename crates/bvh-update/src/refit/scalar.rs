//! The kernels for any processor.

use bvh_core::Primitives;
use bvh_core::rotation::{area_changes_at, best};

use super::Tally;
use super::block::{Entry, GROUP, Leaves, Lister};
use super::kernels::{self, Accepted, refit_height};
use super::shared::SharedNodes;

/// Lists the nodes of the first `count` of eight pairs.
#[inline(always)]
pub(super) fn list(nodes: SharedNodes<'_>, pairs: [usize; GROUP], count: usize, lister: &mut Lister<'_>) {
    for &pair in &pairs[..count] {
        lister.pair(nodes, pair);
    }
}

/// See [`kernels::fit_leaves`].
pub(super) fn fit_leaves<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    leaves: &mut Leaves,
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
