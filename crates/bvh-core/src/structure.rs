//! Whether nodes and an order make a tree.

use thiserror::Error;

use crate::bvh::{MAX_HEIGHT, MAX_PRIMITIVES, Pair};
use crate::{Bvh, Node};

/// Why nodes and an order do not make a tree.
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
    /// Checks the structure, and computes what can be.
    pub(crate) fn from_pairs(pairs: Vec<Pair>, order: Vec<u32>) -> Result<Self, Malformed> {
        let mut bvh = Self { pairs, order, in_order: false, ..Self::default() };
        bvh.check_order()?;
        for node in bvh.raw_nodes_mut() {
            // Safe code can give a leaf a height, and updates tell leaves by theirs.
            node.clear_leaf_height();
            node.set_aabb(node.aabb().sanitized());
        }
        bvh.pairs[0].0[1] = Node::NOTHING;
        if let Some(parents) = bvh.parents_if_ordered() {
            for pair in (1..bvh.pairs.len()).rev() {
                bvh.tell_parent(parents[pair] as usize - 1, 2 * pair)?;
            }
        } else {
            let inner = bvh.check_structure()?;
            let mut used = vec![false; bvh.pairs.len()];
            for &n in inner.iter().rev() {
                let first = bvh.nodes()[n as usize].first();
                bvh.tell_parent(n as usize, first)?;
                used[first / 2] = true;
            }
            // What is in no one's subtree must not look as if it were.
            let unused = bvh.pairs.iter_mut().zip(used).skip(1).filter(|(_, used)| !used);
            unused.for_each(|(pair, _)| *pair = Pair([Node::NOTHING; 2]));
        }
        bvh.in_order = bvh.order.iter().enumerate().all(|(s, &p)| s == p as usize);
        bvh.all_move = bvh.nodes().iter().all(|n| n.moves() || n.count() == 0);
        bvh.sum_still_area();
        Ok(bvh)
    }

    fn tell_parent(&mut self, parent: usize, first: usize) -> Result<(), Malformed> {
        let Pair([l, r]) = self.pairs[first / 2];
        let node = &mut self.raw_nodes_mut()[parent];
        node.set_height_and_moves(&l, &r);
        if node.height() > MAX_HEIGHT { Err(Malformed::TooHigh(node.height())) } else { Ok(()) }
    }

    fn check_order(&self) -> Result<(), Malformed> {
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

    /// 1 + the number of the node above each pair, if every pair is in use and lies behind that node, as builders
    /// leave them.
    ///
    /// The structure is then valid: with one parent each, and that before it, all pairs lead up to the root. One
    /// pass in memory order, twice as fast as the walk that judges all other trees.
    fn parents_if_ordered(&self) -> Option<Vec<u32>> {
        let (pairs, slots) = (self.pairs.len(), self.order.len());
        // For each pair, and after these for each slot, 1 + the number of the node it belongs to; 0 while unknown.
        let mut owner = vec![0u32; pairs + slots];
        let (mut inner, mut covered) = (0, 0);
        for (n, node) in self.nodes().iter().enumerate() {
            let (leaf, first, count) = (node.is_leaf(), node.first(), node.count());
            if n == 1 {
                continue;
            }
            if leaf && count != 1 {
                for slot in owner.get_mut(pairs + first..pairs + first + count)? {
                    if std::mem::replace(slot, n as u32 + 1) != 0 {
                        return None;
                    }
                }
                covered += count;
                continue;
            }
            // One path for both kinds: which nodes are leaves cannot be predicted.
            let (place, after, end) =
                if leaf { (pairs + first, 0, pairs + slots) } else { (first / 2, n / 2, pairs) };
            let odd = !leaf && first % 2 != 0;
            if odd
                || place <= after
                || place >= end
                || std::mem::replace(&mut owner[place], n as u32 + 1) != 0
            {
                return None;
            }
            inner += usize::from(!leaf);
            covered += usize::from(leaf);
        }
        (inner + 1 == pairs && covered == slots).then_some(owner)
    }

    /// Walks the structure; gives the inner nodes, parents before children.
    pub(crate) fn check_structure(&self) -> Result<Vec<u32>, Malformed> {
        let nodes = self.nodes();
        if nodes.is_empty() {
            return Err(Malformed::NodeCount(0));
        }
        let mut covered = vec![false; self.order.len()];
        let mut reached = vec![false; self.pairs.len()];
        let mut inner = Vec::with_capacity(self.pairs.len());
        let mut todo = vec![0u32];
        while let Some(n) = todo.pop() {
            let (n, node) = (n as usize, &nodes[n as usize]);
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
            if std::mem::replace(&mut reached[child / 2], true) {
                return Err(Malformed::SharedChild(child));
            }
            inner.push(n as u32);
            // The left child last, so that it is walked first: memory order, if built depth first.
            todo.extend([child as u32 + 1, child as u32]);
        }
        match covered.iter().filter(|&&c| !c).count() {
            0 => Ok(inner),
            n => Err(Malformed::UncoveredSlots(n)),
        }
    }
}
