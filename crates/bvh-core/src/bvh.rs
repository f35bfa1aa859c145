//! The tree: an arena of node pairs and an order of primitives.

use crate::{Node, UpdateState};

/// Greatest height of a tree, in edges between the root and a leaf.
///
/// Builders and updates keep to it. A traversal that puts off one child at each inner node needs a
/// stack of this many entries; one that pushes both children and pops one, of one more.
pub const MAX_HEIGHT: u32 = 96;

/// Greatest number of primitives of a tree: 2^29, on targets of 32 bits 2^24. Twice as many would
/// take 2 GiB of nodes there, more than one allocation may have.
pub const MAX_PRIMITIVES: usize = 1 << if cfg!(target_pointer_width = "32") { 24 } else { 29 };

/// Siblings, side by side in one cache line.
#[doc(hidden)]
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Pair(pub [Node; 2]);

const _: () = assert!(size_of::<Pair>() == 64 && align_of::<Pair>() == 64);

/// A bounding volume hierarchy over primitives that are known by number.
///
/// Node 0 is the root and node 1 is unused. Every other pair `2k, 2k + 1` holds the children of one
/// inner node, or is unused. Unused nodes are leaves without primitives. A leaf covers a run of
/// *slots*; slot `s` holds primitive `order()[s]`. A tree without primitives is a root with an
/// empty leaf.
///
/// A tree is plain data: its clone behaves as the original would. A tree that is being built in the
/// background takes the place of whichever of the two is updated first when it is ready. The
/// structure of a tree is valid at all times: every pair has one parent, every slot is in one leaf,
/// every primitive in one slot, and the height is at most [`MAX_HEIGHT`]. Whether boxes fit
/// primitives that have moved since the last update is another matter; see
/// [`validate`](Self::validate).
///
/// ```
/// use bvh_core::{Aabb, Bvh, Node, Vec3};
///
/// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
/// let (l, r) = (Node::leaf(unit, 0, 1), Node::leaf(unit, 1, 1));
/// let bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![1, 0])?;
/// let [left, right] = bvh.children(bvh.root()).expect("an inner node");
/// assert_eq!((bvh.primitives(left), bvh.primitives(right)), (&[1][..], &[0][..]));
/// assert_eq!((bvh.len(), bvh.height()), (2, 1));
/// assert!(bvh.validate(&[unit; 2]).is_ok());
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
pub struct Bvh {
    pub(crate) pairs: Vec<Pair>,
    pub(crate) order: Vec<u32>,
    pub(crate) in_order: bool,
    pub(crate) all_dynamic: bool,
    pub(crate) leaves_of_one: bool,
    pub(crate) static_area: f64,
    pub(crate) update_state: UpdateState,
}

impl Clone for Bvh {
    fn clone(&self) -> Self {
        Self { pairs: self.pairs.clone(), order: self.order.clone(), ..*self }
    }

    /// In the memory that `self` has: of a large tree this takes a fraction of the time of a new
    /// one.
    fn clone_from(&mut self, from: &Self) {
        let (mut pairs, mut order) = (std::mem::take(&mut self.pairs), std::mem::take(&mut self.order));
        pairs.clone_from(&from.pairs);
        order.clone_from(&from.order);
        *self = Self { pairs, order, ..*from };
    }
}

/// The parts of a tree that an update writes and reads, from [`Bvh::parts_mut`].
#[doc(hidden)]
#[derive(Debug)]
pub struct Parts<'a> {
    /// All node slots.
    pub nodes: &'a mut [Node],
    /// For each slot, the number of the primitive in it.
    pub order: &'a [u32],
    /// Sum of [`Node::sah_term`] over all static nodes.
    pub static_area: &'a mut f64,
    /// What updates keep with the tree.
    pub state: &'a mut UpdateState,
}

/// Guards a tree: if a panic drops the guard, the function repairs the tree. Code that succeeds
/// passes the guard to `mem::forget`.
#[doc(hidden)]
pub struct OnPanic<'a>(pub &'a mut Bvh, pub fn(&mut Bvh));

impl Drop for OnPanic<'_> {
    fn drop(&mut self) {
        self.1(self.0);
    }
}

impl Bvh {
    /// Replaces the tree by one that `fill` writes into the same memory. `fill` gets the pairs of
    /// nodes and the order with any content and length, and leaves in them the pairs and slots of
    /// the new tree, at least one pair. If it panics, the tree is empty afterwards.
    ///
    /// # Safety
    /// Pairs and order must form a tree as [`Bvh`] describes it, without empty leaves but where
    /// there are no primitives, with right heights and every node dynamic: updates that share the
    /// arena between threads rely on it.
    #[doc(hidden)]
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub unsafe fn replace_with(&mut self, fill: impl FnOnce(&mut Vec<Pair>, &mut Vec<u32>)) {
        let guard = OnPanic(self, Self::clear);
        let bvh = &mut *guard.0;
        fill(&mut bvh.pairs, &mut bvh.order);
        bvh.pairs[0].0[1] = Node::NOTHING;
        bvh.in_order = is_identity(&bvh.order);
        // A tree of n leaves takes n pairs, node 1 included.
        bvh.leaves_of_one = bvh.pairs.len() == bvh.order.len().max(1);
        (bvh.all_dynamic, bvh.static_area, bvh.update_state) = (true, 0.0, UpdateState::default());
        std::mem::forget(guard);
    }

    /// Returns all node slots; see [`Bvh`] for what is where.
    #[must_use]
    #[inline]
    pub fn nodes(&self) -> &[Node] {
        bytemuck::cast_slice(&self.pairs)
    }

    pub(crate) fn raw_nodes_mut(&mut self) -> &mut [Node] {
        bytemuck::cast_slice_mut(&mut self.pairs)
    }

    /// Returns the parts that an update changes in place.
    ///
    /// # Safety
    /// When the borrow ends, the structure must be valid as [`Bvh`] says, heights and dynamic bits
    /// must be right, each primitive as dynamic as before: updates that share the arena
    /// between threads rely on it. Whoever moves pairs of nodes adds one to
    /// [`Changes::structure`](crate::Changes::structure), unless it keeps the words of the state
    /// and updates them itself.
    #[doc(hidden)]
    #[must_use]
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub unsafe fn parts_mut(&mut self) -> Parts<'_> {
        Parts {
            nodes: bytemuck::cast_slice_mut(&mut self.pairs),
            order: &self.order,
            static_area: &mut self.static_area,
            state: &mut self.update_state,
        }
    }

    /// Returns the root.
    #[must_use]
    #[inline]
    pub fn root(&self) -> &Node {
        &self.pairs[0].0[0]
    }

    /// Returns the left and right child of an inner node of this tree; `None` for a leaf.
    #[must_use]
    #[inline]
    pub fn children(&self, node: &Node) -> Option<&[Node; 2]> {
        (!node.is_leaf()).then(|| &self.pairs[node.first() / 2].0)
    }

    /// Returns the numbers of the primitives in a leaf of this tree; empty for an inner node.
    #[must_use]
    #[inline]
    pub fn primitives(&self, leaf: &Node) -> &[u32] {
        if leaf.count() > 0 { &self.order[leaf.first()..leaf.first() + leaf.count()] } else { &[] }
    }

    /// Returns, for each slot, the number of the primitive in it: a permutation.
    #[must_use]
    #[inline]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Returns the number of primitives.
    #[must_use]
    #[inline]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Returns whether there are no primitives.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Returns the height of the tree: edges from the root to the deepest leaf.
    #[must_use]
    #[inline]
    pub fn height(&self) -> u32 {
        self.root().height()
    }

    /// Returns whether slot `s` holds primitive `s` for every `s`; updates then skip the look-up.
    #[must_use]
    #[inline]
    pub fn is_in_order(&self) -> bool {
        self.in_order
    }

    /// Returns whether each leaf has one primitive, except for [`Node::NOTHING`]; updates are then
    /// faster.
    #[must_use]
    #[inline]
    pub fn has_leaves_of_one(&self) -> bool {
        self.leaves_of_one
    }

    /// Renumbers the primitives in the order of the leaves and gives the old numbers: primitive `s`
    /// is now what was primitive `order[s]`.
    ///
    /// The caller rearranges its data in the same way and keeps the returned map for its own
    /// numbers. Updates then stream through that data instead of jumping about in it. O(n).
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let mut points = vec![Vec3::X, Vec3::ZERO];
    /// let leaf = |i: usize, slot| Node::leaf(Aabb::new(points[i], points[i]), slot, 1);
    /// let (l, r) = (leaf(1, 0), leaf(0, 1));
    /// let mut bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![1, 0])?;
    /// let old_numbers = bvh.reorder_primitives();
    /// points = old_numbers.iter().map(|&p| points[p as usize]).collect();
    /// assert_eq!(points, [Vec3::ZERO, Vec3::X]);
    /// assert_eq!(bvh.order(), [0, 1]);
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn reorder_primitives(&mut self) -> Vec<u32> {
        self.in_order = true;
        // A tree that is being built in the background knows primitives by their old numbers.
        let numbering = &mut self.update_state.changes.numbering;
        *numbering = numbering.wrapping_add(1);
        let identity = (0..self.order.len() as u32).collect();
        std::mem::replace(&mut self.order, identity)
    }

    /// Recomputes heights, dynamic bits and the static part of the cost from the leaves, after a
    /// panic in the middle of an update. Boxes stay as they are. If the structure is broken, too,
    /// the tree becomes empty. O(n) time and temporary memory.
    #[doc(hidden)]
    pub fn recompute_metadata(&mut self) {
        let Ok((inner, _)) = self.check_structure() else {
            return self.clear();
        };
        self.refit_metadata(&inner);
        self.sum_static_area();
    }

    /// Empties the tree. Changes are counted on: whoever counts them must not miss the next ones.
    fn clear(&mut self) {
        let changes = self.update_state.changes;
        *self = Self::default();
        self.update_state.changes = changes;
    }

    /// Sets heights and dynamic bits of inner nodes, which are listed parents first.
    pub(crate) fn refit_metadata(&mut self, inner: &[u32]) {
        for &n in inner.iter().rev() {
            let Pair([l, r]) = self.pairs[self.nodes()[n as usize].first() / 2];
            self.raw_nodes_mut()[n as usize].refit_metadata(&l, &r);
        }
    }

    /// Returns what updates keep with the tree.
    #[must_use]
    pub fn update_state(&self) -> &UpdateState {
        &self.update_state
    }

    /// Returns the memory of the nodes and the order, in bytes.
    #[must_use]
    pub fn memory_usage(&self) -> usize {
        size_of_val(self.nodes()) + size_of_val(self.order())
    }

    /// Calls `f` with the number, the node and the depth of every node, parents first, left before
    /// right. O(n).
    ///
    /// ```
    /// let mut leaves = 0;
    /// bvh_core::Bvh::default().visit(|_, node, _| leaves += usize::from(node.is_leaf()));
    /// assert_eq!(leaves, 1);
    /// ```
    pub fn visit(&self, mut f: impl FnMut(usize, &Node, u32)) {
        let nodes = self.nodes();
        let (mut next, mut later) = (Some((0, 0)), Vec::new());
        while let Some((n, depth)) = next {
            let node = &nodes[n];
            f(n, node, depth);
            next = if node.is_leaf() {
                later.pop()
            } else {
                later.push((node.first() + 1, depth + 1));
                Some((node.first(), depth + 1))
            };
        }
    }

    /// Returns a number that depends on every bit of the nodes and the order (64-bit FNV-1a over
    /// 32-bit words, pairs that are not in use included): trees of equal bits have equal
    /// fingerprints on every machine. O(n).
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        let words: &[u32] = bytemuck::cast_slice(&self.pairs);
        // By hand: recorded fingerprints depend on it, and it is too little for a dependency.
        words
            .iter()
            .chain(&self.order)
            .fold(0xcbf2_9ce4_8422_2325, |h, &w| (h ^ u64::from(w)).wrapping_mul(0x100_0000_01b3))
    }
}

impl Default for Bvh {
    /// The empty tree.
    fn default() -> Self {
        Self {
            pairs: vec![Pair([Node::NOTHING; 2])],
            order: Vec::new(),
            in_order: true,
            all_dynamic: true,
            leaves_of_one: true,
            static_area: 0.0,
            update_state: UpdateState::default(),
        }
    }
}

impl std::fmt::Debug for Bvh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bvh")
            .field("primitives", &self.len())
            .field("nodes", &self.nodes().len())
            .field("height", &self.height())
            .field("aabb", &self.root().aabb())
            .finish()
    }
}

/// Whether each slot holds the primitive of its own number.
pub(crate) fn is_identity(order: &[u32]) -> bool {
    order.iter().enumerate().all(|(s, &p)| s == p as usize)
}

#[cfg(test)]
pub(crate) mod tests;
