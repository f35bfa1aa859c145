//! SAH cost of other libraries' trees, by the definition of [`bvh_core::sah_cost`].

use bvh_core::{COST_INTERSECT, COST_TRAVERSE};

/// Sum over the nodes of a tree.
#[derive(Default)]
pub(crate) struct Sah {
    sum: f64,
}

impl Sah {
    /// Adds a node with the given half area and number of primitives, 0 for an inner node.
    pub(crate) fn add(&mut self, half_area: f64, primitives: usize) {
        self.sum +=
            half_area * if primitives == 0 { COST_TRAVERSE } else { COST_INTERSECT * primitives as f64 };
    }

    /// The cost, normalised by the root.
    pub(crate) fn cost(&self, root_half_area: f64) -> Option<f64> {
        (root_half_area > 0.0).then(|| self.sum / root_half_area)
    }
}

/// Half the surface area of a box with the given extents.
pub(crate) fn half_area(extent: [f32; 3]) -> f64 {
    let [x, y, z] = extent.map(f64::from);
    x * y + y * z + z * x
}
