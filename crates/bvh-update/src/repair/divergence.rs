//! Where motion diverges.
//!
//! Primitives that move together are a *cluster*, and a cluster's subtree is still good wherever it goes; bad is what
//! is above clusters that have parted. Two children part by the distance that their centres have moved away from each
//! other since their parent was built. The square of that distance is an area. It takes the place of the
//! node's own area in the search for the frontier: nodes with divergence at or below them are opened, the rest are the
//! clusters. O(n).
//!
//! The idea is that of clustered updates (Garanzha 2008), whose reinsertion of cluster roots is not followed here.

use bvh_core::Node;

/// A node is opened if divergence at and below it exceeds this part of the share that an average primitive had in
/// the sum of areas when the tree was last built.
pub(super) const OPENED: f64 = 0.5;

/// Square of the distance between the centres of a node's children; 0 for a leaf, or if one of them is empty.
pub(super) fn divergence(nodes: &[Node], node: &Node) -> f64 {
    // Node slots that are not in use may hold anything.
    let Some([l, r]) = nodes.get(node.first()..node.first() + 2) else { return 0.0 };
    let (l, r) = (l.aabb(), r.aabb());
    if node.is_leaf() || l.is_empty() || r.is_empty() {
        return 0.0;
    }
    f64::from(l.center().distance_squared(r.center()))
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Vec3, sah_cost};

    use super::super::RepairScratch;
    use super::super::frontier::open;
    use super::*;
    use crate::quality::take_baseline;
    use crate::refit::{RefitScratch, pass};

    #[test]
    fn clusters_are_what_moves_together() {
        // Stripes of a sheet that alternate between two clusters.
        let cluster = |i: usize| i / 4 % 2;
        let pose = |apart: f32| -> Vec<Aabb> {
            let at = |i: usize| Vec3::new((i % 40) as f32, (i / 40) as f32, cluster(i) as f32 * apart);
            (0..1600).map(at).map(|corner| Aabb::new(corner, corner + 0.9)).collect()
        };
        let mut bvh = build(&pose(0.0), Builder::Sweep).expect("few enough");
        take_baseline(&mut bvh, divergence);
        let before = sah_cost(&bvh);
        let tally = pass(&mut bvh, &pose(50.0), None, &mut RefitScratch::new());
        assert!(sah_cost(&bvh) > 2.0 * before);
        let mut scratch = RepairScratch::default();
        open(&bvh, divergence, tally.leaf_area, 1.0, 1600, &mut scratch);
        let mut covered = 0;
        for &kept in &scratch.frontier {
            let (mut below, mut clusters) = (vec![kept as usize], [false; 2]);
            while let Some(n) = below.pop() {
                let node = &bvh.nodes()[n];
                for &p in bvh.primitives(node) {
                    clusters[cluster(p as usize)] = true;
                    covered += 1;
                }
                if !node.is_leaf() {
                    below.extend([node.first(), node.first() + 1]);
                }
            }
            assert!(clusters != [true; 2], "a cluster of primitives that have parted");
        }
        assert!(covered == 1600 && scratch.frontier.len() < 600, "{} clusters", scratch.frontier.len());
    }

    #[test]
    fn nothing_diverges_where_there_are_no_two_children() {
        let nodes = [Node::inner(Aabb::EMPTY, 2), Node::NOTHING, Node::NOTHING, Node::NOTHING];
        assert_eq!(nodes.map(|node| divergence(&nodes, &node)), [0.0; 4]);
        assert_eq!(divergence(&nodes, &Node::inner(Aabb::EMPTY, 1000)), 0.0);
    }
}
