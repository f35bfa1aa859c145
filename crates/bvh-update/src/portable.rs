//! The kernels in plain Rust, for any processor.

use bvh_core::Primitives;
use bvh_core::rotation::{area_changes_at, best};

use crate::block::Visit;
use crate::kernels::{Accepted, fit_at_this_level, moving_area};
use crate::raw::SharedNodes;

/// See [`kernels::fit`](crate::kernels::fit).
pub(crate) fn fit<P: Primitives + ?Sized>(nodes: SharedNodes<'_>, primitives: &P, leaves: &[Visit]) -> u64 {
    fit_at_this_level(nodes, primitives, leaves)
}

/// See [`kernels::unions`](crate::kernels::unions).
pub(crate) fn unions(nodes: SharedNodes<'_>, inner: &[Visit]) -> f64 {
    // One sum a side, as the SIMD kernels have them, so that the bits are the same.
    let mut sums = [0.0; 2];
    for visit in inner.iter().rev() {
        let children = nodes.pair(visit.first());
        for (sum, child) in sums.iter_mut().zip(&children) {
            *sum += moving_area(child);
        }
        let mut node = nodes.get(visit.slot());
        node.refit(&children[0], &children[1]);
        nodes.set(visit.slot(), node);
    }
    sums[0] + sums[1]
}

/// See [`kernels::evaluate`](crate::kernels::evaluate).
pub(crate) fn evaluate(
    nodes: SharedNodes<'_>,
    inner: &[Visit],
    candidates: &[u32],
    accepted: &mut [Accepted],
) -> usize {
    let mut count = 0;
    for &index in candidates {
        let changes = area_changes_at(&nodes, inner[index as usize].first());
        if best(changes).is_some() {
            accepted[count] = Accepted { changes, index };
            count += 1;
        }
    }
    count
}
