//! Trees as the optimisation by insertion sees them: nodes that have areas, of their boxes or
//! otherwise.

use bvh_core::{Aabb, Node};

/// A tree of nodes that have areas: of their boxes, or over several poses.
pub(crate) trait Tree: Sync {
    /// A box, or one for each pose.
    type Bounds: Send;

    fn nodes(&self) -> &[Node];
    fn nodes_mut(&mut self) -> &mut [Node];
    /// Slot of the node above all that may move: 0, or a child of that.
    fn root(&self) -> usize;
    /// The bounds of the node in slot `n`.
    fn bounds(&self, n: usize) -> Self::Bounds;
    /// Enlarges `bounds` by the node in slot `n`.
    fn enlarge(&self, bounds: &mut Self::Bounds, n: usize);
    /// Area of a bounds.
    fn area(&self, bounds: &Self::Bounds) -> f64;
    /// Area of the node in slot `n`.
    #[inline]
    fn area_of(&self, n: usize) -> f64 {
        self.area(&self.bounds(n))
    }
    /// Area of the node in slot `n` enlarged by `bounds`.
    fn area_with(&self, n: usize, bounds: &Self::Bounds) -> f64;
    /// Copies a node to another slot, with its bounds.
    fn copy(&mut self, from: usize, to: usize);
    /// Makes the node in slot `n` fit its children; whether that changed it.
    fn refit(&mut self, n: usize) -> bool;
}

/// The boxes of the nodes themselves, from `root` on down.
pub(crate) struct Boxes<'a> {
    pub(crate) nodes: &'a mut [Node],
    pub(crate) root: usize,
}

impl Tree for Boxes<'_> {
    type Bounds = Aabb;

    #[inline]
    fn nodes(&self) -> &[Node] {
        self.nodes
    }
    #[inline]
    fn nodes_mut(&mut self) -> &mut [Node] {
        self.nodes
    }
    #[inline]
    fn root(&self) -> usize {
        self.root
    }
    #[inline]
    fn bounds(&self, n: usize) -> Aabb {
        self.nodes[n].aabb()
    }
    #[inline]
    fn enlarge(&self, bounds: &mut Aabb, n: usize) {
        *bounds = bounds.union(self.nodes[n].aabb());
    }
    #[inline]
    fn area(&self, bounds: &Aabb) -> f64 {
        bounds.half_area_f64()
    }
    #[inline]
    fn area_with(&self, n: usize, bounds: &Aabb) -> f64 {
        self.nodes[n].aabb().union(*bounds).half_area_f64()
    }
    #[inline]
    fn copy(&mut self, from: usize, to: usize) {
        self.nodes[to] = self.nodes[from];
    }
    #[inline]
    fn refit(&mut self, n: usize) -> bool {
        refit(self.nodes, n)
    }
}

/// Makes the node in slot `n` fit its children; whether that changed it.
#[inline]
pub(crate) fn refit(nodes: &mut [Node], n: usize) -> bool {
    let before = nodes[n];
    let (l, r) = (nodes[before.first()], nodes[before.first() + 1]);
    nodes[n].refit(&l, &r);
    nodes[n] != before
}
