//! The kernels in plain Rust, for any processor.

use bvh_core::Primitives;

use crate::kernels::{Accepted, Areas, Fitted, evaluate, fit_inner, refit};
use crate::raw::SharedNodes;

/// See [`kernels::twigs`](crate::kernels::twigs).
pub(crate) fn twigs<P: Primitives + ?Sized>(nodes: SharedNodes<'_>, primitives: &P, list: &[u32]) -> Fitted {
    let mut fitted = Fitted::default();
    for &slot in list {
        fit_inner(nodes, primitives, slot as usize, &mut fitted);
    }
    fitted
}

/// See [`kernels::spurs`](crate::kernels::spurs).
pub(crate) fn spurs<P: Primitives + ?Sized, const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Fitted {
    let mut fitted = Fitted::default();
    for &slot in list {
        fit_inner(nodes, primitives, slot as usize, &mut fitted);
        if ROTATE {
            evaluate(nodes, slot, accepted);
        }
    }
    fitted
}

/// See [`kernels::forks`](crate::kernels::forks).
pub(crate) fn forks<const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Areas {
    let mut areas = Areas::default();
    for &slot in list {
        refit(nodes, slot as usize, &mut areas);
        if ROTATE {
            evaluate(nodes, slot, accepted);
        }
    }
    areas
}
