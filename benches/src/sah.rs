//! SAH cost of other libraries' trees.

use bvh_core::{Aabb, COST_INTERSECT, COST_TRAVERSE};

/// The cost of a tree as [`bvh_core::sah_cost`] defines it, from the box and the number of
/// primitives of every node, the root included; inner nodes have 0 primitives. `None` if the root's
/// box has no area.
pub(crate) fn sah(root: Aabb, nodes: impl IntoIterator<Item = (Aabb, usize)>) -> Option<f64> {
    let cost = |primitives| if primitives == 0 { COST_TRAVERSE } else { COST_INTERSECT * primitives as f64 };
    let sum: f64 = nodes.into_iter().map(|(aabb, primitives)| aabb.half_area_f64() * cost(primitives)).sum();
    let area = root.half_area_f64();
    (area > 0.0).then(|| sum / area)
}
