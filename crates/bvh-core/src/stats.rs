//! Figures that describe a tree.

use crate::{Bvh, sah_cost};

/// Figures of one tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Stats {
    /// Primitives, dropped ones included.
    pub primitives: usize,
    /// Primitives in leaves with an empty box: none of them is finite.
    pub dropped: usize,
    /// Inner nodes.
    pub inner: usize,
    /// Leaves.
    pub leaves: usize,
    /// Number of primitives in the largest leaf.
    pub largest_leaf: usize,
    /// Edges from the root to the deepest leaf.
    pub height: u32,
    /// Mean depth of the leaves.
    pub mean_leaf_depth: f64,
    /// Inner nodes with at least one grandchild, where a rotation is possible (Kopta et al. 2012,
    /// section 3: about a quarter of all nodes).
    pub candidates: usize,
    /// SAH cost; see [`sah_cost`].
    pub sah_cost: f64,
    /// Bytes of nodes and order.
    pub bytes: usize,
}

/// Computes the figures of a tree. O(n).
///
/// ```
/// let stats = bvh_core::stats(&bvh_core::Bvh::default());
/// assert_eq!((stats.primitives, stats.leaves, stats.sah_cost), (0, 1, 0.0));
/// ```
#[must_use]
pub fn stats(bvh: &Bvh) -> Stats {
    let mut s = Stats {
        primitives: bvh.len(),
        height: bvh.height(),
        sah_cost: sah_cost(bvh),
        bytes: bvh.memory_usage(),
        ..Stats::default()
    };
    let mut depths = 0u64;
    bvh.visit(|_, node, depth| {
        if node.is_leaf() {
            s.leaves += 1;
            s.largest_leaf = s.largest_leaf.max(node.count());
            s.dropped += if node.aabb().is_empty() { node.count() } else { 0 };
            depths += u64::from(depth);
        } else {
            s.inner += 1;
            s.candidates += usize::from(node.height() > 1);
        }
    });
    s.mean_leaf_depth = depths as f64 / s.leaves as f64;
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::three;
    use crate::{Aabb, Node};

    #[test]
    fn the_figures_of_a_small_tree() {
        let mut nodes = three();
        nodes[3] = Node::leaf(Aabb::EMPTY, 2, 2);
        let bvh = Bvh::new(&nodes, vec![2, 0, 1, 3]).expect("a tree");
        let expected = Stats {
            primitives: 4,
            dropped: 2,
            inner: 2,
            leaves: 3,
            largest_leaf: 2,
            height: 2,
            mean_leaf_depth: 5.0 / 3.0,
            candidates: 1,
            // Two inner nodes and two leaves, all as large as the root.
            sah_cost: 4.0,
            bytes: 6 * 32 + 4 * 4,
        };
        assert_eq!(stats(&bvh), expected);
    }
}
