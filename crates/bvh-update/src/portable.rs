//! The kernels in plain Rust, for any processor.

use bvh_core::rotation::{area_changes_at, best};

use crate::kernels::{Accepted, moving_area};
use crate::raw::SharedNodes;

/// See [`kernels::unions`](crate::kernels::unions).
pub(crate) fn unions(nodes: SharedNodes<'_>, pairs: &[u32], parents: &[u32]) -> f64 {
    // One sum a side, as the SIMD kernels have them, so that the bits are the same.
    let mut sums = [0.0; 2];
    for (&pair, &parent) in pairs.iter().zip(parents).rev() {
        let children = nodes.pair(pair as usize);
        for (sum, child) in sums.iter_mut().zip(&children) {
            *sum += moving_area(child);
        }
        let mut node = nodes.get(parent as usize);
        node.refit(&children[0], &children[1]);
        nodes.set(parent as usize, node);
    }
    sums[0] + sums[1]
}

/// See [`kernels::evaluate`](crate::kernels::evaluate).
pub(crate) fn evaluate(
    nodes: SharedNodes<'_>,
    pairs: &[u32],
    candidates: &[u32],
    accepted: &mut [Accepted],
) -> usize {
    let mut count = 0;
    for &index in candidates {
        let changes = area_changes_at(&nodes, pairs[index as usize] as usize);
        if best(changes).is_some() {
            accepted[count] = Accepted { changes, index };
            count += 1;
        }
    }
    count
}
