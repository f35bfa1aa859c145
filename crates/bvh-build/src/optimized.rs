//! What an optimisation did.

/// What an optimisation did to a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Optimized {
    /// Passes over the tree.
    pub passes: u32,
    /// Rotations applied, or subtrees moved.
    pub changes: u64,
    /// SAH cost before ([`sah_cost`](bvh_core::sah_cost)).
    pub before: f64,
    /// SAH cost after.
    pub after: f64,
}
