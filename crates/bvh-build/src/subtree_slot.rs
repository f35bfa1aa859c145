//! The output range of a subtree: where its nodes and its order are written.

use bvh_core::{MAX_HEIGHT, Node};

use crate::prim_ref::{Bounds, PrimRef};

/// Room for a subtree of one primitive a leaf: its root, the `order.len() - 1` pairs of nodes
/// below, and `order.len()` slots.
///
/// Pairs lie depth first: the pair of the root's children, then all pairs below the left child,
/// then all below the right one. The number of primitives gives the size of a subtree, so both
/// halves can be written at the same time. A builder either calls [`leaf`](Self::leaf) and
/// [`fork`](Self::fork) or writes all fields itself: each pair and each slot once, children behind
/// parents.
pub(crate) struct SubtreeSlot<'a> {
    pub(crate) root: &'a mut Node,
    /// All nodes below the root.
    pub(crate) below: &'a mut [Node],
    /// Number of the first of `below` in the tree.
    pub(crate) first_node: u32,
    pub(crate) order: &'a mut [u32],
    /// Number of the first of `order` in the tree.
    pub(crate) first_slot: u32,
    /// Edges between the tree's root and this one.
    pub(crate) depth: u32,
}

impl<'a> SubtreeSlot<'a> {
    /// The range of a whole tree. Node 1 stays unused.
    pub(crate) fn new(nodes: &'a mut [Node], order: &'a mut [u32]) -> Self {
        let (top, below) = nodes.split_at_mut(2);
        Self { root: &mut top[0], below, first_node: 2, order, first_slot: 0, depth: 0 }
    }

    /// Whether the tree stays within [`MAX_HEIGHT`] whatever split is made here, if all is halved
    /// below it down to parts of `largest` primitives. If not, the primitives must be halved from
    /// here on, which always fits.
    #[inline]
    pub(crate) fn any_split_fits(&self, largest: usize) -> bool {
        let halvings = |n: usize| n.next_power_of_two().ilog2();
        self.depth + halvings(self.order.len()) + halvings(largest) < MAX_HEIGHT
    }

    /// Makes the root the leaf of the only primitive.
    #[inline]
    pub(crate) fn leaf(self, prim: &PrimRef) {
        self.order[0] = prim.number();
        *self.root = Node::leaf(prim.bounds().aabb(), self.first_slot, 1);
    }

    /// Makes the root an inner node over two subtrees: the left one over the first `n` slots, the
    /// right one over the rest. `both` builds them in any order or at once.
    #[inline]
    pub(crate) fn fork(self, n: usize, both: impl FnOnce(SubtreeSlot<'_>, SubtreeSlot<'_>) -> ((), ())) {
        let (pair, below) = self.below.split_at_mut(2);
        let [left, right] = &mut *pair else { unreachable!("split off as two") };
        let (left_below, right_below) = below.split_at_mut(2 * (n - 1));
        let (left_order, right_order) = self.order.split_at_mut(n);
        let (first_node, depth) = (self.first_node, self.depth + 1);
        // Each primitive before has one pair, the root's included.
        let half = |root, below, order, before: u32| {
            let (first_node, first_slot) = (first_node + 2 * before.max(1), self.first_slot + before);
            SubtreeSlot { root, below, first_node, order, first_slot, depth }
        };
        both(half(left, left_below, left_order, 0), half(right, right_below, right_order, n as u32));
        *self.root = Node::parent(&pair[0], &pair[1], first_node);
    }

    /// Halves the primitives down to the leaves, in the order given.
    pub(crate) fn halve(self, prims: &[PrimRef]) {
        match prims {
            [prim] => self.leaf(prim),
            _ => {
                let n = prims.len() / 2;
                self.fork(n, |l, r| (l.halve(&prims[..n]), r.halve(&prims[n..])));
            }
        }
    }
}

/// Moves the lower half of the primitives to the front and gives its size. The order is that of the
/// centres on the axis of their greatest spread, ties by number; the given one if they do not
/// spread.
pub(crate) fn middle(prims: &mut [PrimRef], centers: &Bounds) -> usize {
    let n = prims.len() / 2;
    let spread = (centers.max - centers.min).truncate();
    if spread.max_element() > 0.0 {
        let axis = spread.max_position();
        prims.select_nth_unstable_by(n, |a, b| {
            let by_center = a.center_on(axis).total_cmp(&b.center_on(axis));
            by_center.then(a.number().cmp(&b.number()))
        });
    }
    n
}
