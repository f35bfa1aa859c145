//! The tree: an arena of node pairs and an order of primitives.

use crate::structure::Malformed;
use crate::{Node, UpdateState};

/// Greatest height of a tree: no leaf is more edges than this below the root.
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
/// Node 0 is the root and node 1 is unused; every other pair `2k, 2k + 1` holds the children of one inner
/// node, or is unused. A leaf covers a run of *slots*; slot `s` holds primitive number `order()[s]`. A tree
/// without primitives is a root with an empty leaf.
///
/// A tree is plain data: its clone behaves as the original would. Its structure is valid at all times: every
/// pair has one parent, every slot is in one leaf, every primitive in one slot, and the height is at most
/// [`MAX_HEIGHT`]. Whether the boxes fit primitives that may have moved since is another matter; see
/// [`validate`](Self::validate).
#[derive(Clone)]
pub struct Bvh {
    pub(crate) pairs: Vec<Pair>,
    pub(crate) order: Vec<u32>,
    pub(crate) in_order: bool,
    /// Whether no primitive stands still.
    pub(crate) all_move: bool,
    pub(crate) still_area: f64,
    pub(crate) update_state: UpdateState,
}

/// The parts of a tree that an update writes and reads, from [`Bvh::parts_mut`].
#[derive(Debug)]
pub struct Parts<'a> {
    /// All node slots.
    pub nodes: &'a mut [Node],
    /// For each slot, the number of the primitive in it.
    pub order: &'a [u32],
    /// Sum of half area times [`Node::weight`] over all nodes that do not move.
    pub still_area: &'a mut f64,
    /// What updates keep with the tree.
    pub state: &'a mut UpdateState,
}

impl Bvh {
    /// A tree of the given nodes over `order.len()` primitives; see [`Bvh`] for the layout.
    ///
    /// Boxes are taken as they are, but [`sanitized`](crate::Aabb::sanitized). Heights and moving bits are computed here, the
    /// latter from the leaves'; slots that are in no subtree become [`Node::NOTHING`].
    /// O(n) time and temporary memory.
    ///
    /// # Errors
    /// If the structure is not that of a tree.
    pub fn new(nodes: &[Node], order: Vec<u32>) -> Result<Self, Malformed> {
        if nodes.is_empty() || !nodes.len().is_multiple_of(2) {
            return Err(Malformed::NodeCount(nodes.len()));
        }
        let pairs = nodes.chunks_exact(2).map(|p| Pair([p[0], p[1]])).collect();
        Self::from_pairs(pairs, order)
    }

    /// Replaces the tree by one that `fill` writes into the same memory: it gets room for `nodes` nodes (rounded up to
    /// even) and the order of `primitives` primitives, both with any content, and says how many node slots it used.
    ///
    /// Allocates only if there is less memory than asked for, and takes no time beyond that of `fill`. If `fill` panics,
    /// the tree is empty afterwards.
    ///
    /// # Safety
    /// What `fill` leaves in the node slots that it says are used, and in the order, must be a tree as [`Bvh`] describes
    /// it, with heights right and every primitive moving: updates that share the arena between threads rely on it.
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub unsafe fn replace_with(
        &mut self,
        nodes: usize,
        primitives: usize,
        fill: impl FnOnce(&mut [Node], &mut [u32]) -> usize,
    ) {
        /// Leaves an empty tree unless told that all went well.
        struct Guard<'a>(&'a mut Bvh, bool);
        impl Drop for Guard<'_> {
            fn drop(&mut self) {
                if !self.1 {
                    *self.0 = Bvh::default();
                }
            }
        }
        let mut guard = Guard(self, false);
        let Guard(bvh, done) = &mut guard;
        bvh.pairs.resize(nodes.div_ceil(2).max(1), Pair([Node::NOTHING; 2]));
        bvh.order.resize(primitives, 0);
        let used = fill(bytemuck::cast_slice_mut(&mut bvh.pairs), &mut bvh.order);
        bvh.pairs.truncate(used.div_ceil(2).max(1));
        bvh.in_order = bvh.order.iter().enumerate().all(|(s, &p)| s == p as usize);
        (bvh.all_move, bvh.still_area, bvh.update_state) = (true, 0.0, UpdateState::default());
        *done = true;
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

    /// What an update needs to change nodes in place.
    ///
    /// # Safety
    /// When the borrow ends the structure must be valid as [`Bvh`] says, with heights and moving bits right and no
    /// primitive moving or standing still that did not before: updates that share the arena between threads rely on it.
    /// Whoever moves pairs of nodes adds one to [`Changes::structure`](crate::Changes::structure).
    #[must_use]
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub unsafe fn parts_mut(&mut self) -> Parts<'_> {
        Parts {
            nodes: bytemuck::cast_slice_mut(&mut self.pairs),
            order: &self.order,
            still_area: &mut self.still_area,
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

    /// Whether slot `s` holds primitive `s` for every `s`, so that updates skip the look-up.
    #[must_use]
    #[inline]
    pub fn is_in_order(&self) -> bool {
        self.in_order
    }

    /// Renumbers the primitives in the order of the leaves and gives the new order: what was primitive
    /// `order[s]` is primitive `s` from now on.
    ///
    /// The caller rearranges its data in the same way and keeps the returned map for its own numbers. Updates
    /// then stream through that data instead of jumping about in it.
    pub fn renumber(&mut self) -> Vec<u32> {
        self.in_order = true;
        // A tree that is being built in the background knows primitives by their old numbers.
        let numbering = &mut self.update_state.changes.numbering;
        *numbering = numbering.wrapping_add(1);
        let identity = (0..self.order.len() as u32).collect();
        std::mem::replace(&mut self.order, identity)
    }

    /// Says which primitives may move from now on, by number; at first all of them do. From a mask this is
    /// `set_moving(|p| mask[p])`, from a few ranges `set_moving(|p| ranges.iter().any(|r| r.contains(&p)))`.
    ///
    /// A leaf moves if any primitive in it does. Refits and rotations do not visit subtrees without a moving primitive.
    /// Saying it takes O(n) time and allocates nothing, and in the next update O(n) once more where that is by a strategy
    /// that repairs. It lasts until it is said anew, through rebuilds too, but to the grain of leaves: what shares a leaf with
    /// something that moves is taken to move by a tree built in the place of this one. If `moves` panics, all primitives move.
    pub fn set_moving(&mut self, moves: impl Fn(usize) -> bool) {
        /// Sets everything in motion unless told that all went well.
        struct Guard<'a>(&'a mut Bvh, bool);
        impl Drop for Guard<'_> {
            fn drop(&mut self) {
                let Self(bvh, done) = self;
                if !*done {
                    bvh.mark_moving(&|_| true);
                }
                let dynamic = &mut bvh.update_state.changes.dynamic;
                *dynamic = dynamic.wrapping_add(1);
            }
        }
        let mut guard = Guard(self, false);
        let Guard(bvh, done) = &mut guard;
        bvh.mark_moving(&moves);
        *done = true;
    }

    fn mark_moving(&mut self, moves: &impl Fn(usize) -> bool) {
        let mut still = Still { any: false, area: 0.0 };
        mark(bytemuck::cast_slice_mut(&mut self.pairs), &self.order, 0, moves, &mut still);
        (self.all_move, self.still_area) = (!still.any, still.area);
    }

    /// Whether every primitive may move, as is so until [`set_moving`](Self::set_moving) says otherwise.
    #[must_use]
    #[inline]
    pub fn all_move(&self) -> bool {
        self.all_move
    }

    /// Computes heights, moving bits and the sum over what stands still anew from the leaves: what is left to do after a
    /// panic in the middle of an update. Boxes are as they are then. O(n) time and temporary memory.
    pub fn mend(&mut self) {
        let inner = self.check_structure().expect("links are those of a tree at any time");
        for &n in inner.iter().rev() {
            let [l, r] = self.children(&self.nodes()[n as usize]).copied().expect("an inner node");
            self.raw_nodes_mut()[n as usize].set_height_and_moves(&l, &r);
        }
        self.sum_still_area();
    }

    /// What updates keep with the tree.
    #[must_use]
    pub fn update_state(&self) -> &UpdateState {
        &self.update_state
    }

    /// Sum of half area times [`Node::weight`] over all nodes that stand still: their part of the SAH cost.
    #[must_use]
    pub fn still_area(&self) -> f64 {
        self.still_area
    }

    /// Sums up [`still_area`](Self::still_area) anew. O(n) where something stands still.
    pub fn sum_still_area(&mut self) {
        let mut sum = 0.0;
        if !self.all_move {
            self.visit(|_, n, _| {
                if !n.moves() {
                    sum += n.aabb().half_area_f64() * n.weight();
                }
            });
        }
        self.still_area = sum;
    }

    /// Memory of its nodes and its order, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes()) + size_of_val(self.order())
    }

    /// Makes room for trees over up to so many primitives, so that to build one of them in this place allocates nothing.
    /// Such room is address space, until it is written to.
    ///
    /// # Panics
    /// If it would take more than `isize::MAX` bytes.
    pub fn reserve(&mut self, primitives: usize) {
        self.pairs.reserve_exact(primitives.saturating_sub(self.pairs.len()));
        self.order.reserve_exact(primitives.saturating_sub(self.order.len()));
    }

    /// Calls `f` with the number, the node and the depth of every node, parents first, left before right. O(n).
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

    /// A number that depends on every bit of the tree's nodes and order (64-bit FNV-1a over 32-bit words): equal
    /// trees have equal hashes on every machine.
    #[must_use]
    pub fn hash(&self) -> u64 {
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
            all_move: true,
            still_area: 0.0,
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

/// What stands still: whether any leaf with primitives does, and the sum of half area times weight.
struct Still {
    any: bool,
    area: f64,
}

/// Sets the moving bits at and below a node, and adds up what stands still there. As deep as the tree is high.
fn mark(
    nodes: &mut [Node],
    order: &[u32],
    n: usize,
    moves: &impl Fn(usize) -> bool,
    still: &mut Still,
) -> bool {
    let node = nodes[n];
    let first = node.first();
    let any = if node.is_leaf() {
        order[first..first + node.count()].iter().any(|&p| moves(p as usize))
    } else {
        let l = mark(nodes, order, first, moves, still);
        mark(nodes, order, first + 1, moves, still) | l
    };
    nodes[n].set_moves(any);
    if !any {
        still.any |= node.count() > 0;
        still.area += node.aabb().half_area_f64() * node.weight();
    }
    any
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
    fn a_valid_tree_is_taken_and_its_heights_computed() {
        let bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert_eq!((bvh.height(), bvh.nodes()[2].height(), bvh.nodes()[3].height()), (2, 1, 0));
        assert_eq!(bvh.primitives(&bvh.nodes()[4]), [2]);
        assert!(!bvh.is_in_order());
        assert!(bvh.primitives(bvh.root()).is_empty());
        assert_eq!(bvh.nodes().as_ptr().addr() % 64, 0);
    }

    #[test]
    fn leaves_have_no_height_and_unused_slots_hold_nothing() {
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
        bvh.set_moving(|_| false);
        assert!(bvh.still_area().is_finite());
    }

    #[test]
    fn whether_all_move_is_known_and_outlives_the_nodes() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.all_move() && Bvh::default().all_move());
        for still in 0..3 {
            bvh.set_moving(|p| p != still);
            let again = Bvh::new(bvh.nodes(), bvh.order().to_vec()).expect("valid");
            assert!(!bvh.all_move() && !again.all_move());
        }
        let boxes = [BOX; 3].as_slice();
        bvh.all_move = true;
        assert!(matches!(bvh.validate(&boxes), Err(Invalid::Moves { .. })));
        bvh.set_moving(|_| true);
        assert!(bvh.all_move() && bvh.validate(&boxes).is_ok());
    }

    #[test]
    fn a_tree_is_written_into_the_memory_of_another() {
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
    fn moving_bits_follow_the_primitives() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.root().moves());
        bvh.set_moving(|p| p == 1);
        let moves = |n: usize| bvh.nodes()[n].moves();
        assert!(moves(0) && !moves(2) && moves(3) && !moves(4) && !moves(5));
        bvh.set_moving(|_| false);
        assert!(!bvh.root().moves());
    }

    #[test]
    fn renumbering_keeps_the_leaves_and_tells_the_old_numbers() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert_eq!(bvh.renumber(), [2, 0, 1]);
        assert!(bvh.is_in_order());
        assert_eq!(bvh.order(), [0, 1, 2]);
    }

    #[test]
    fn the_hash_sees_every_node_and_the_order() {
        let a = Bvh::new(&three(), vec![0, 1, 2]).expect("valid");
        let b = Bvh::new(&three(), vec![0, 2, 1]).expect("valid");
        let mut c = a.clone();
        assert_eq!(a.hash(), c.hash());
        c.set_moving(|p| p == 0);
        assert!(a.hash() != b.hash() && a.hash() != c.hash());
    }
}
