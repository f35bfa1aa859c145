//! Where motion diverges (Garanzha 2008, "Efficient clustered BVH update algorithm for highly-dynamic models").
//!
//! Triangles that move together are a *cluster*, and a cluster's subtree is still good wherever it goes; bad is what is
//! above clusters that have parted. Two children part as far as their centres have moved away from each other since
//! their parent was built, and the square of that distance is an area, which takes the place of a node's own in `cut.rs`: nodes with
//! divergence at or below them are opened, the rest are the clusters.
//!
//! Published is more: motion is compared from frame to frame, clusters are put back in one by one, and those that have come apart
//! are rebuilt each on its own. Here motion is what has added up since a node was built, for which a node has room, and
//! all that is above the clusters is built anew at once.

use bvh_core::Node;

/// Square of the distance between the centres of a node's children; 0 for a leaf, or if one of them is empty.
pub(crate) fn divergence(nodes: &[Node], node: &Node) -> f64 {
    // Node slots that are not in use may hold anything.
    let Some([l, r]) = nodes.get(node.first()..node.first() + 2) else { return 0.0 };
    let (l, r) = (l.aabb(), r.aabb());
    if node.is_leaf() || l.is_empty() || r.is_empty() {
        return 0.0;
    }
    f64::from(l.center().distance_squared(r.center()))
}
