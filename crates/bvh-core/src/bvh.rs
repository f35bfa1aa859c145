//! The tree: an arena of node pairs and an order of primitives.

use std::ops::Range;

use crate::structure::Malformed;
use crate::{Node, UpdateState};

/// Greatest height of a tree, in edges between the root and a leaf.
///
/// Builders and updates keep to it, so a traversal stack of this many entries never overflows.
pub const MAX_HEIGHT: u32 = 96;

/// Greatest number of primitives of a tree.
pub const MAX_PRIMITIVES: usize = 1 << 29;

/// Siblings, side by side in one cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Pair(pub(crate) [Node; 2]);

const _: () = assert!(size_of::<Pair>() == 64 && align_of::<Pair>() == 64);

/// A bounding volume hierarchy over primitives that are known by number.
///
/// Node 0 is the root and node 1 is unused. Every other pair `2k, 2k + 1` holds the children of one
/// inner node, or is unused. A leaf covers a run of *slots*; slot `s` holds primitive `order()[s]`.
/// A tree without primitives is a root with an empty leaf.
///
/// A tree is plain data: its clone behaves as the original would. Its structure is valid at all
/// times: every pair has one parent, every slot is in one leaf, every primitive in one slot, and
/// the height is at most [`MAX_HEIGHT`]. Whether boxes fit primitives that have moved since the
/// last update is another matter; see [`validate`](Self::validate).
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
    pub(crate) static_area: f64,
    pub(crate) update_state: UpdateState,
}

impl Clone for Bvh {
    fn clone(&self) -> Self {
        Self { pairs: self.pairs.clone(), order: self.order.clone(), ..*self }
    }

    /// In the memory that `self` has: of a large tree this takes a fraction of the time of a new one.
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

/// A tree that a function repairs when a panic drops this; whoever gets through forgets it.
#[doc(hidden)]
pub struct OnPanic<'a>(pub &'a mut Bvh, pub fn(&mut Bvh));

impl Drop for OnPanic<'_> {
    fn drop(&mut self) {
        self.1(self.0);
    }
}

impl Bvh {
    /// Makes a tree of the given nodes over `order.len()` primitives; see [`Bvh`] for the layout.
    ///
    /// Boxes are [`sanitized`](crate::Aabb::sanitized) and otherwise taken as they are. Heights are
    /// computed, and so are the dynamic bits of inner nodes. Pairs that are in no subtree become
    /// [`Node::NOTHING`]. O(n) time and temporary memory.
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

    /// Replaces the tree by one that `fill` writes into the same memory.
    ///
    /// `fill` gets room for `nodes` nodes (rounded up to even) and the order of `primitives`
    /// primitives, both with any content, and gives the number of node slots it used. Allocates
    /// only if the memory is too small. If `fill` panics, the tree is empty afterwards.
    ///
    /// # Safety
    /// The used node slots and the order must form a tree as [`Bvh`] describes it, with right
    /// heights and every node dynamic: updates that share the arena between threads rely on it.
    #[doc(hidden)]
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub unsafe fn replace_with(
        &mut self,
        nodes: usize,
        primitives: usize,
        fill: impl FnOnce(&mut [Node], &mut [u32]) -> usize,
    ) {
        let guard = OnPanic(self, |bvh| *bvh = Self::default());
        let bvh = &mut *guard.0;
        bvh.pairs.resize(nodes.div_ceil(2).max(1), Pair([Node::NOTHING; 2]));
        bvh.order.resize(primitives, 0);
        let used = fill(bytemuck::cast_slice_mut(&mut bvh.pairs), &mut bvh.order);
        bvh.pairs.truncate(used.div_ceil(2).max(1));
        bvh.in_order = is_identity(&bvh.order);
        (bvh.all_dynamic, bvh.static_area, bvh.update_state) = (true, 0.0, UpdateState::default());
        std::mem::forget(guard);
    }

    /// All node slots; see [`Bvh`] for what is where.
    #[must_use]
    #[inline]
    pub fn nodes(&self) -> &[Node] {
        bytemuck::cast_slice(&self.pairs)
    }

    pub(crate) fn raw_nodes_mut(&mut self) -> &mut [Node] {
        bytemuck::cast_slice_mut(&mut self.pairs)
    }

    /// The parts that an update changes in place.
    ///
    /// # Safety
    /// When the borrow ends, the structure must be valid as [`Bvh`] says, heights and dynamic bits
    /// must be right, each primitive as dynamic as before: updates that share the arena
    /// between threads rely on it. Whoever moves pairs of nodes adds one to
    /// [`Changes::structure`](crate::Changes::structure).
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

    /// The root.
    #[must_use]
    #[inline]
    pub fn root(&self) -> &Node {
        &self.pairs[0].0[0]
    }

    /// Left and right child of an inner node of this tree; `None` for a leaf.
    #[must_use]
    #[inline]
    pub fn children(&self, node: &Node) -> Option<&[Node; 2]> {
        (!node.is_leaf()).then(|| &self.pairs[node.first() / 2].0)
    }

    /// Numbers of the primitives in a leaf of this tree; empty for an inner node.
    #[must_use]
    #[inline]
    pub fn primitives(&self, leaf: &Node) -> &[u32] {
        if leaf.is_leaf() { &self.order[leaf.first()..leaf.first() + leaf.count()] } else { &[] }
    }

    /// For each slot, the number of the primitive in it: a permutation.
    #[must_use]
    #[inline]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Number of primitives.
    #[must_use]
    #[inline]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are no primitives.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Height of the tree: edges from the root to the deepest leaf.
    #[must_use]
    #[inline]
    pub fn height(&self) -> u32 {
        self.root().height()
    }

    /// Whether slot `s` holds primitive `s` for every `s`; updates then skip the look-up.
    #[must_use]
    #[inline]
    pub fn is_in_order(&self) -> bool {
        self.in_order
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

    /// Sets which primitives are dynamic, that is, may move. At first all are.
    ///
    /// Updates do not visit static subtrees, and their boxes stay as they are. A leaf is dynamic if
    /// any primitive in it is. The setting survives rebuilds at leaf granularity: a primitive that
    /// shares a leaf with a dynamic one counts as dynamic in the next tree. If `is_dynamic` panics,
    /// all primitives are dynamic. O(n), no allocation.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let (l, r) = (Node::leaf(unit, 0, 1), Node::leaf(unit, 1, 1));
    /// let mut bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![0, 1])?;
    /// let mask = [false, true];
    /// bvh.set_dynamic(|p| mask[p]);
    /// assert!(!bvh.nodes()[2].is_dynamic() && bvh.nodes()[3].is_dynamic());
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn set_dynamic(&mut self, is_dynamic: impl Fn(usize) -> bool) {
        let dynamic = &mut self.update_state.changes.dynamic;
        *dynamic = dynamic.wrapping_add(1);
        let guard = OnPanic(self, |bvh| bvh.mark_dynamic(&|_| true));
        guard.0.mark_dynamic(&is_dynamic);
        std::mem::forget(guard);
    }

    /// Makes the primitives in any of `ranges` dynamic and all others static; see
    /// [`set_dynamic`](Self::set_dynamic). Ranges may overlap and exceed the number of primitives.
    /// O(n log r) for r ranges.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let mut bvh = Bvh::new(&[Node::leaf(unit, 0, 1), Node::NOTHING], vec![0])?;
    /// bvh.set_dynamic_ranges(&[3..7]);
    /// assert!(!bvh.root().is_dynamic());
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn set_dynamic_ranges(&mut self, ranges: &[Range<usize>]) {
        let mut sorted: Vec<_> = ranges.iter().map(|r| (r.start, r.end)).collect();
        sorted.sort_unstable();
        // From here on each end is the greatest of all ranges up to there.
        let mut end = 0;
        for range in &mut sorted {
            end = end.max(range.1);
            range.1 = end;
        }
        self.set_dynamic(|p| {
            let begun = sorted.partition_point(|&(start, _)| start <= p);
            begun > 0 && p < sorted[begun - 1].1
        });
    }

    fn mark_dynamic(&mut self, is_dynamic: &impl Fn(usize) -> bool) {
        (self.all_dynamic, self.static_area) = (true, 0.0);
        self.mark(0, is_dynamic);
    }

    /// Sets the dynamic bits at and below node `n`, and adds up the static nodes there; gives that
    /// of `n`. As deep as the tree is high.
    fn mark(&mut self, n: usize, is_dynamic: &impl Fn(usize) -> bool) -> bool {
        let node = self.nodes()[n];
        let first = node.first();
        let dynamic = if node.is_leaf() {
            self.primitives(&node).iter().any(|&p| is_dynamic(p as usize))
        } else {
            // Both, whatever the first one gives.
            self.mark(first, is_dynamic) | self.mark(first + 1, is_dynamic)
        };
        self.raw_nodes_mut()[n].set_dynamic(dynamic);
        if !dynamic {
            self.all_dynamic &= node.count() == 0;
            self.static_area += node.sah_term();
        }
        dynamic
    }

    /// Whether every primitive is dynamic, as is so until [`set_dynamic`](Self::set_dynamic) makes
    /// some static.
    #[must_use]
    #[inline]
    pub fn all_dynamic(&self) -> bool {
        self.all_dynamic
    }

    /// Recomputes heights, dynamic bits and the static part of the cost from the leaves, after a
    /// panic in the middle of an update. Boxes stay as they are. If the structure is broken, too,
    /// the tree becomes empty. O(n) time and temporary memory.
    #[doc(hidden)]
    pub fn recompute_metadata(&mut self) {
        let Ok(inner) = self.check_structure() else {
            *self = Self::default();
            return;
        };
        self.refit_metadata(&inner);
        self.sum_static_area();
    }

    /// Sets heights and dynamic bits of inner nodes, which are listed parents first.
    pub(crate) fn refit_metadata(&mut self, inner: &[u32]) {
        for &n in inner.iter().rev() {
            let Pair([l, r]) = self.pairs[self.nodes()[n as usize].first() / 2];
            self.raw_nodes_mut()[n as usize].refit_metadata(&l, &r);
        }
    }

    /// What updates keep with the tree.
    #[must_use]
    pub fn update_state(&self) -> &UpdateState {
        &self.update_state
    }

    /// Sum of [`Node::sah_term`] over all static nodes: their part of the SAH cost.
    #[doc(hidden)]
    #[must_use]
    pub fn static_area(&self) -> f64 {
        self.static_area
    }

    /// Recomputes [`static_area`](Self::static_area). O(n) if there are static primitives, else
    /// O(1).
    #[doc(hidden)]
    pub fn sum_static_area(&mut self) {
        let mut sum = 0.0;
        if !self.all_dynamic {
            self.visit(|_, node, _| sum += node.static_term());
        }
        self.static_area = sum;
    }

    /// Memory of the nodes and the order, in bytes.
    #[must_use]
    pub fn memory_usage(&self) -> usize {
        size_of_val(self.nodes()) + size_of_val(self.order())
    }

    /// Reserves room for trees over up to `primitives` primitives, so that building one in the same
    /// place allocates nothing. The room is address space until it is written to.
    ///
    /// # Panics
    /// If the room exceeds `isize::MAX` bytes.
    pub fn reserve(&mut self, primitives: usize) {
        self.pairs.reserve_exact(primitives.saturating_sub(self.pairs.len()));
        self.order.reserve_exact(primitives.saturating_sub(self.order.len()));
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
        let mut todo = vec![(0, 0)];
        while let Some((n, depth)) = todo.pop() {
            let node = &nodes[n];
            f(n, node, depth);
            if !node.is_leaf() {
                todo.extend([(node.first() + 1, depth + 1), (node.first(), depth + 1)]);
            }
        }
    }

    /// A number that depends on every bit of the nodes and the order (64-bit FNV-1a over 32-bit
    /// words): equal trees have equal fingerprints on every machine. O(n).
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        let words: &[u32] = bytemuck::cast_slice(&self.pairs);
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
mod tests {
    use super::*;
    use crate::{Aabb, Invalid, Vec3};

    const BOX: Aabb = Aabb::new(Vec3::ZERO, Vec3::ONE);

    /// Root over an inner node (children at 4) and a leaf.
    fn three() -> [Node; 6] {
        [
            Node::inner(BOX, 2),
            Node::NOTHING,
            Node::inner(BOX, 4),
            Node::leaf(BOX, 2, 1),
            Node::leaf(BOX, 0, 1),
            Node::leaf(BOX, 1, 1),
        ]
    }

    #[test]
    fn heights_of_a_valid_tree_are_computed() {
        let bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert_eq!((bvh.height(), bvh.nodes()[2].height(), bvh.nodes()[3].height()), (2, 1, 0));
        assert_eq!(bvh.primitives(&bvh.nodes()[4]), [2]);
        assert!(!bvh.is_in_order());
        assert!(bvh.primitives(bvh.root()).is_empty());
        assert_eq!(bvh.nodes().as_ptr().addr() % 64, 0);
    }

    #[test]
    fn leaf_heights_and_unused_slots_are_reset() {
        let mut nodes = [three().as_slice(), &[Node::inner(BOX, 2), Node::leaf(BOX, 0, 1)]].concat();
        nodes[1] = Node::inner(BOX, 100);
        // A leaf of height 2, as safe code can make one.
        let (l, r) = (Node::parent(&nodes[4], &nodes[5], 4), nodes[4]);
        nodes[3].refit(&l, &r);
        nodes[3].set_aabb(BOX);
        assert_eq!(nodes[3].height(), 2);
        let bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
        assert_eq!((bvh.height(), bvh.nodes()[3]), (2, Node::leaf(BOX, 2, 1)));
        assert_eq!([1, 6, 7].map(|n| bvh.nodes()[n]), [Node::NOTHING; 3]);
    }

    #[test]
    fn boxes_that_are_not_finite_are_empty() {
        let mut nodes = three();
        nodes[4].set_aabb(Aabb { min: Vec3::NAN, max: Vec3::ONE });
        let mut bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
        assert_eq!(bvh.nodes()[4].aabb(), Aabb::EMPTY);
        bvh.set_dynamic(|_| false);
        assert!(bvh.static_area().is_finite());
    }

    #[test]
    fn all_dynamic_follows_the_leaves() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.all_dynamic() && Bvh::default().all_dynamic());
        for fixed in 0..3 {
            bvh.set_dynamic(|p| p != fixed);
            let again = Bvh::new(bvh.nodes(), bvh.order().to_vec()).expect("valid");
            assert!(!bvh.all_dynamic() && !again.all_dynamic());
        }
        let boxes = [BOX; 3].as_slice();
        bvh.all_dynamic = true;
        assert!(matches!(bvh.validate(&boxes), Err(Invalid::Dynamic { .. })));
        bvh.set_dynamic(|_| true);
        assert!(bvh.all_dynamic() && bvh.validate(&boxes).is_ok());
    }

    #[test]
    fn replace_with_reuses_memory_and_empties_the_tree_on_panic() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        let rebuild = |bvh: &mut Bvh, fill: fn(&mut [Node], &mut [u32]) -> usize| {
            // SAFETY: what is written is a tree.
            #[expect(unsafe_code, reason = "writes a tree by hand")]
            unsafe {
                bvh.replace_with(2, 2, fill);
            }
        };
        let memory = bvh.nodes().as_ptr();
        rebuild(&mut bvh, |nodes, order| {
            nodes[0] = Node::leaf(BOX, 0, 2);
            order.copy_from_slice(&[1, 0]);
            2
        });
        let fresh = Bvh::new(&[Node::leaf(BOX, 0, 2), Node::NOTHING], vec![1, 0]).expect("valid");
        assert_eq!((bvh.root(), bvh.order(), bvh.is_in_order()), (fresh.root(), fresh.order(), false));
        assert_eq!(bvh.nodes().as_ptr(), memory);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            rebuild(&mut bvh, |nodes, _| {
                nodes[0] = Node::inner(BOX, 100);
                panic!("half way");
            });
        }));
        assert!(caught.is_err());
        assert_eq!((bvh.nodes(), bvh.len()), (&[Node::NOTHING; 2][..], 0));
    }

    #[test]
    fn malformed_trees_are_refused_with_the_reason() {
        let with = |i: usize, node| {
            let mut nodes = three();
            nodes[i] = node;
            Bvh::new(&nodes, vec![0, 1, 2]).map(|_| ()).expect_err("malformed")
        };
        assert_eq!(with(2, Node::inner(BOX, 2)), Malformed::SharedChild(2));
        assert_eq!(with(2, Node::inner(BOX, 0)), Malformed::ChildOutOfRange { node: 2, child: 0 });
        assert_eq!(with(2, Node::inner(BOX, 6)), Malformed::ChildOutOfRange { node: 2, child: 6 });
        assert_eq!(with(3, Node::leaf(BOX, 0, 1)), Malformed::LeafSlots(3));
        assert_eq!(with(3, Node::leaf(BOX, 2, 9)), Malformed::LeafSlots(3));
        assert_eq!(with(3, Node::leaf(BOX, 2, 0)), Malformed::UncoveredSlots(1));
        assert_eq!(Bvh::new(&three(), vec![0, 1, 1]).unwrap_err(), Malformed::Order(2));
        assert_eq!(Bvh::new(&three(), vec![0, 1, 3]).unwrap_err(), Malformed::Order(2));
        assert_eq!(Bvh::new(&three()[..5], vec![]).unwrap_err(), Malformed::NodeCount(5));
        assert_eq!(Bvh::new(&[], vec![]).unwrap_err(), Malformed::NodeCount(0));
    }

    #[test]
    fn pairs_may_lie_in_any_order_and_unused() {
        let nodes = [
            Node::inner(BOX, 6),
            Node::NOTHING,
            Node::leaf(BOX, 0, 1),
            Node::leaf(BOX, 1, 1),
            Node::inner(BOX, 2),
            Node::inner(BOX, 2),
            Node::leaf(BOX, 2, 1),
            Node::inner(BOX, 2),
        ];
        let bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
        assert_eq!((bvh.height(), bvh.nodes()[6].height(), bvh.nodes()[7].height()), (2, 0, 1));
        // A pair below itself.
        let ring = [Node::inner(BOX, 2), Node::NOTHING, Node::inner(BOX, 2), Node::leaf(BOX, 0, 1)];
        assert_eq!(Bvh::new(&ring, vec![0]).unwrap_err(), Malformed::SharedChild(2));
    }

    #[test]
    fn a_chain_beyond_the_bound_is_refused() {
        let chain = |height: usize| {
            let mut nodes = vec![Node::inner(BOX, 2), Node::NOTHING];
            for i in 1..=height {
                let deeper = Node::inner(BOX, 2 * i as u32 + 2);
                let last = Node::leaf(BOX, height as u32, 1);
                nodes.push(Node::leaf(BOX, i as u32 - 1, 1));
                nodes.push(if i < height { deeper } else { last });
            }
            Bvh::new(&nodes, (0..=height as u32).collect())
        };
        assert_eq!(chain(MAX_HEIGHT as usize).map(|b| b.height()), Ok(MAX_HEIGHT));
        assert_eq!(chain(97).map(|b| b.height()), Err(Malformed::TooHigh(97)));
    }

    #[test]
    fn dynamic_bits_follow_the_primitives() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.root().is_dynamic());
        bvh.set_dynamic(|p| p == 1);
        let is_dynamic = |n: usize| bvh.nodes()[n].is_dynamic();
        assert!(is_dynamic(0) && !is_dynamic(2) && is_dynamic(3) && !is_dynamic(4) && !is_dynamic(5));
        bvh.set_dynamic(|_| false);
        assert!(!bvh.root().is_dynamic());
    }

    #[test]
    fn ranges_set_what_a_predicate_would() {
        let nodes: Vec<_> = (0..16).map(|i| Node::leaf(BOX, i, 1)).collect();
        let mut all = vec![Node::inner(BOX, 2), Node::NOTHING];
        (0..15).for_each(|i| {
            all.push(nodes[i as usize]);
            all.push(if i < 14 { Node::inner(BOX, 2 * i + 4) } else { nodes[15] });
        });
        let mut bvh = Bvh::new(&all, (0..16).collect()).expect("valid");
        for ranges in [vec![], vec![3..5, 0..1], vec![9..12, 2..11, 4..5, 15..99], vec![7..7, 12..20]] {
            bvh.set_dynamic(|p| ranges.iter().any(|r| r.contains(&p)));
            let (expected, area) = (bvh.fingerprint(), bvh.static_area());
            bvh.set_dynamic(|_| true);
            bvh.set_dynamic_ranges(&ranges);
            assert_eq!((bvh.fingerprint(), bvh.static_area()), (expected, area), "{ranges:?}");
        }
    }

    #[test]
    fn a_panic_in_a_predicate_makes_all_dynamic() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        bvh.set_dynamic(|_| false);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            bvh.set_dynamic(|p| p == 0 && panic!("half way"));
        }));
        assert!(caught.is_err() && bvh.all_dynamic() && bvh.static_area() == 0.0);
        bvh.validate(&[BOX; 3]).expect("valid");
    }

    #[test]
    fn reordering_keeps_the_leaves_and_gives_the_old_numbers() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert_eq!(bvh.reorder_primitives(), [2, 0, 1]);
        assert!(bvh.is_in_order());
        assert_eq!(bvh.order(), [0, 1, 2]);
    }

    #[test]
    fn the_fingerprint_depends_on_nodes_and_order() {
        let a = Bvh::new(&three(), vec![0, 1, 2]).expect("valid");
        let b = Bvh::new(&three(), vec![0, 2, 1]).expect("valid");
        let mut c = a.clone();
        assert_eq!(a.fingerprint(), c.fingerprint());
        c.set_dynamic(|p| p == 0);
        assert!(a.fingerprint() != b.fingerprint() && a.fingerprint() != c.fingerprint());
    }
}
