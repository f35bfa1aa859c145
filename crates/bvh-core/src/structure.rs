//! Checks that nodes and an order form a tree.

use thiserror::Error;

use crate::bvh::{MAX_HEIGHT, MAX_PRIMITIVES, Pair, is_identity};
use crate::{Bvh, Node};

/// Why nodes and an order do not form a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Malformed {
    /// No nodes, or an odd number of them.
    #[error("{0} nodes given; a tree has a positive, even number (node 1 is unused)")]
    NodeCount(usize),
    /// Too many primitives.
    #[error("{0} primitives given; at most {MAX_PRIMITIVES} fit")]
    TooManyPrimitives(usize),
    /// An inner node whose children are no pair of the arena, or the root's own.
    #[error("node {node} has its children at {child}; expected an even number above 0 and in the arena")]
    ChildOutOfRange {
        /// The inner node.
        node: usize,
        /// Where it says its children are.
        child: usize,
    },
    /// A pair with two parents.
    #[error("node {0} is the child of more than one node")]
    SharedChild(usize),
    /// A leaf whose slots are out of range or overlap another leaf's.
    #[error("leaf {0} covers slots that do not exist or belong to another leaf")]
    LeafSlots(usize),
    /// Slots in no leaf.
    #[error("{0} slots are in no leaf")]
    UncoveredSlots(usize),
    /// An order that is no permutation.
    #[error("slot {0} holds a primitive that is out of range or in another slot too")]
    Order(usize),
    /// Higher than allowed.
    #[error("the tree is {0} high; at most {MAX_HEIGHT} is allowed")]
    TooHigh(u32),
}

impl Bvh {
    /// Makes a tree of the given nodes over `order.len()` primitives; see [`Bvh`] for the layout.
    ///
    /// Boxes are [`sanitized`](crate::Aabb::sanitized) and otherwise taken as they are. Heights are
    /// computed, and so are the dynamic bits of inner nodes. Leaves without primitives, and pairs
    /// that are in no subtree, become [`Node::NOTHING`]. O(n) time and temporary memory.
    ///
    /// A tree is saved as its [`nodes`](Self::nodes), which are plain data
    /// ([`bytemuck`](https://docs.rs/bytemuck)), and its [`order`](Self::order). Made of these
    /// again it is the same tree, but updates have nothing to go on from: `Auto` takes it for as
    /// good as new. [`validate`](Self::validate) says whether it fits the primitives; if these
    /// have moved, refit it.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let bvh = Bvh::new(&[Node::leaf(unit, 0, 1), Node::NOTHING], vec![0])?;
    /// let saved: (Vec<u8>, Vec<u32>) = (bytemuck::cast_slice(bvh.nodes()).to_vec(), bvh.order().to_vec());
    /// let nodes: Vec<Node> = bytemuck::pod_collect_to_vec(&saved.0);
    /// let loaded = Bvh::new(&nodes, saved.1)?;
    /// assert_eq!(loaded.fingerprint(), bvh.fingerprint());
    /// assert!(loaded.validate(&[unit]).is_ok());
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    ///
    /// # Errors
    /// If the structure is not that of a tree.
    pub fn new(nodes: &[Node], order: Vec<u32>) -> Result<Self, Malformed> {
        if nodes.is_empty() || !nodes.len().is_multiple_of(2) {
            return Err(Malformed::NodeCount(nodes.len()));
        }
        let pairs = nodes.chunks_exact(2).map(|p| Pair([p[0], p[1]])).collect();
        Self { pairs, order, ..Self::default() }.checked()
    }

    /// The tree if its structure is valid, with everything computed that follows from nodes and
    /// order.
    pub(crate) fn checked(mut self) -> Result<Self, Malformed> {
        self.check_order()?;
        for node in self.raw_nodes_mut() {
            // Safe code can give a leaf a height, and updates know leaves by theirs.
            node.clear_leaf_height();
            node.set_aabb(node.aabb().sanitized());
            if node.is_leaf() && node.count() == 0 {
                // Without a box, and static, so that no update looks for its primitives.
                *node = Node::NOTHING;
            }
        }
        let (inner, used) = self.check_structure()?;
        self.pairs[0].0[1] = Node::NOTHING;
        // An unused pair must not look like part of a subtree.
        let unused = self.pairs.iter_mut().zip(used).skip(1).filter(|(_, used)| !used);
        unused.for_each(|(pair, _)| *pair = Pair([Node::NOTHING; 2]));
        self.refit_metadata(&inner);
        self.in_order = is_identity(&self.order);
        self.all_dynamic = self.nodes().iter().all(|n| n.is_dynamic() || n.count() == 0);
        self.leaves_of_one = self.nodes().iter().all(|node| node.count() <= 1);
        self.sum_static_area();
        Ok(self)
    }

    pub(crate) fn check_order(&self) -> Result<(), Malformed> {
        let n = self.order.len();
        if n > MAX_PRIMITIVES {
            return Err(Malformed::TooManyPrimitives(n));
        }
        let mut seen = vec![false; n];
        for (s, &p) in self.order.iter().enumerate() {
            if p as usize >= n || std::mem::replace(&mut seen[p as usize], true) {
                return Err(Malformed::Order(s));
            }
        }
        Ok(())
    }

    /// Checks links and slots by a walk; gives the inner nodes, parents before children, and
    /// whether each pair is in use.
    pub(crate) fn check_structure(&self) -> Result<(Vec<u32>, Vec<bool>), Malformed> {
        let nodes = self.nodes();
        let mut covered = vec![false; self.order.len()];
        let mut used = vec![false; self.pairs.len()];
        let mut inner = Vec::with_capacity(self.pairs.len());
        let mut todo = vec![(0u32, 0)];
        while let Some((n, depth)) = todo.pop() {
            let (n, node) = (n as usize, &nodes[n as usize]);
            if depth > MAX_HEIGHT {
                return Err(Malformed::TooHigh(depth));
            }
            if node.is_leaf() {
                let slots = covered.get_mut(node.first()..node.first() + node.count());
                for slot in slots.ok_or(Malformed::LeafSlots(n))? {
                    if std::mem::replace(slot, true) {
                        return Err(Malformed::LeafSlots(n));
                    }
                }
                continue;
            }
            let child = node.first();
            if child == 0 || !child.is_multiple_of(2) || child >= nodes.len() {
                return Err(Malformed::ChildOutOfRange { node: n, child });
            }
            if std::mem::replace(&mut used[child / 2], true) {
                return Err(Malformed::SharedChild(child));
            }
            inner.push(n as u32);
            // The left child last, so that it is walked first: memory order, if built depth first.
            todo.extend([(child as u32 + 1, depth + 1), (child as u32, depth + 1)]);
        }
        match covered.iter().filter(|&&c| !c).count() {
            0 => Ok((inner, used)),
            n => Err(Malformed::UncoveredSlots(n)),
        }
    }
}
