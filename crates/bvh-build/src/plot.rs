//! The part of a tree that a subtree is written to.

use bvh_core::{MAX_HEIGHT, Node};

use crate::item::{Hull, Item};

/// Room for a subtree of one primitive a leaf: its root, the `order.len() - 1` pairs of nodes below, and
/// `order.len()` slots.
///
/// Pairs lie depth first: the pair of the root's children, then all pairs below the left child, then all below
/// the right one. As a subtree's size is known from its number of primitives, both halves can be written at
/// the same time.
pub(crate) struct Plot<'a> {
    root: &'a mut Node,
    below: &'a mut [Node],
    first_node: u32,
    order: &'a mut [u32],
    first_slot: u32,
    depth: u32,
}

/// A plot for those who write it all by themselves: each pair of nodes and each slot once, children behind parents.
pub(crate) struct Site<'a> {
    pub(crate) root: &'a mut Node,
    /// All nodes below the root.
    pub(crate) below: &'a mut [Node],
    /// Number of the first of `below` in the tree.
    pub(crate) first_node: u32,
    pub(crate) order: &'a mut [u32],
    /// Number of the first of `order` in the tree.
    pub(crate) first_slot: u32,
}

impl<'a> Plot<'a> {
    /// The plot of a whole tree. Node 1 stays unused.
    pub(crate) fn new(nodes: &'a mut [Node], order: &'a mut [u32]) -> Self {
        let (top, below) = nodes.split_at_mut(2);
        Self { root: &mut top[0], below, first_node: 2, order, first_slot: 0, depth: 0 }
    }

    /// Edges between the tree's root and this one.
    pub(crate) fn depth(&self) -> u32 {
        self.depth
    }

    /// Hands over the place itself.
    pub(crate) fn site(self) -> Site<'a> {
        let Self { root, below, first_node, order, first_slot, .. } = self;
        Site { root, below, first_node, order, first_slot }
    }

    /// Whether any split here leaves room below for the rest, within [`MAX_HEIGHT`]. Otherwise what is to be split must be
    /// halved from here on, which always fits, be it primitives or subtrees of at most `most` primitives.
    #[inline]
    pub(crate) fn any_split_fits(&self, most: usize) -> bool {
        let halvings = |n: usize| n.next_power_of_two().ilog2();
        self.depth + halvings(self.order.len()) + halvings(most) < MAX_HEIGHT
    }

    /// Makes the root the leaf of the only primitive; gives its hull.
    #[inline]
    pub(crate) fn leaf(self, item: &Item) -> Hull {
        self.order[0] = item.number();
        *self.root = Node::leaf(item.hull().aabb(), self.first_slot, 1);
        item.hull()
    }

    /// Makes the root an inner node over two subtrees, the left one over the first `n` slots and the right one
    /// over the rest, which `both` grows in any order or at once; gives the hull of the two that this returns.
    #[inline]
    pub(crate) fn fork(self, n: usize, both: impl FnOnce(Plot<'_>, Plot<'_>) -> (Hull, Hull)) -> Hull {
        let (pair, below) = self.below.split_at_mut(2);
        let [left_root, right_root] = pair else { unreachable!("split off as two") };
        let (left_below, right_below) = below.split_at_mut(2 * (n - 1));
        let (left_order, right_order) = self.order.split_at_mut(n);
        let depth = self.depth + 1;
        let left = Plot {
            root: left_root,
            below: left_below,
            first_node: self.first_node + 2,
            order: left_order,
            first_slot: self.first_slot,
            depth,
        };
        let right = Plot {
            root: right_root,
            below: right_below,
            first_node: self.first_node + 2 * n as u32,
            order: right_order,
            first_slot: self.first_slot + n as u32,
            depth,
        };
        let (l, r) = both(left, right);
        *self.root = Node::parent(&pair[0], &pair[1], self.first_node);
        l.union(r)
    }

    /// Halves the primitives down to the leaves, in the order given; gives their hull.
    pub(crate) fn halve(self, items: &[Item]) -> Hull {
        match items {
            [item] => self.leaf(item),
            _ => {
                let n = items.len() / 2;
                self.fork(n, |l, r| (l.halve(&items[..n]), r.halve(&items[n..])))
            }
        }
    }
}

/// Where the middle of the primitives is, once they are ordered by their centres on the axis on which these
/// spread most; ties by number. Left as they are if they do not spread at all.
pub(crate) fn middle(items: &mut [Item], centers: &Hull) -> usize {
    let n = items.len() / 2;
    let spread = (centers.max - centers.min).truncate();
    if spread.max_element() > 0.0 {
        let axis = spread.max_position();
        let key = |i: &Item| (i.center_on(axis), i.number());
        items.select_nth_unstable_by(n, |a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        });
    }
    n
}
