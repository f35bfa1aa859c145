//! The unsafe parts: a node arena that tasks on several threads share, and the calls into code for
//! a SIMD level.

use std::marker::PhantomData;

use bvh_core::{Bvh, Node, Parts, SimdLevel};

/// The nodes of one tree, read and written by tasks that keep to disjoint sets of them.
#[derive(Clone, Copy)]
pub(crate) struct SharedNodes<'a> {
    start: *mut Node,
    len: usize,
    nodes: PhantomData<&'a mut [Node]>,
}

// SAFETY: a `SharedNodes` gives access to nodes by value only, and whoever makes one promises that
// no node is touched by two threads without synchronisation between; `Node` is plain data.
#[expect(unsafe_code, reason = "lets tasks share the arena")]
unsafe impl Send for SharedNodes<'_> {}
// SAFETY: as above.
#[expect(unsafe_code, reason = "lets tasks share the arena")]
unsafe impl Sync for SharedNodes<'_> {}

impl<'a> SharedNodes<'a> {
    /// # Safety
    /// As long as `'a` lasts, no node may be written by one thread and read or written by another,
    /// unless something between orders the two.
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub(crate) unsafe fn new(nodes: &'a mut [Node]) -> Self {
        Self { start: nodes.as_mut_ptr(), len: nodes.len(), nodes: PhantomData }
    }

    /// Number of pairs.
    pub(crate) fn pairs(&self) -> usize {
        self.len / 2
    }

    /// The node in slot `n`.
    #[inline(always)]
    pub(crate) fn get(&self, n: usize) -> Node {
        assert!(n < self.len, "node out of range");
        // SAFETY: in range by the assertion; valid and not written elsewhere by the promise to
        // `new`.
        #[expect(unsafe_code, reason = "reads the shared arena")]
        unsafe {
            self.start.add(n).read()
        }
    }

    /// The nodes in slots `n` and `n + 1`.
    #[inline(always)]
    pub(crate) fn pair(&self, n: usize) -> [Node; 2] {
        assert!(n + 1 < self.len, "pair out of range");
        // SAFETY: as in `get`, for both.
        #[expect(unsafe_code, reason = "reads the shared arena")]
        unsafe {
            [self.start.add(n).read(), self.start.add(n + 1).read()]
        }
    }

    /// Stores a whole node into slot `n`.
    #[inline(always)]
    pub(crate) fn set(&self, n: usize, node: Node) {
        assert!(n < self.len, "node out of range");
        // SAFETY: in range by the assertion; not read or written elsewhere by the promise to `new`.
        #[expect(unsafe_code, reason = "writes the shared arena")]
        unsafe {
            self.start.add(n).write(node);
        }
    }

    /// The link and aux words of the nodes in slots `n` and `n + 1`.
    #[inline(always)]
    pub(crate) fn pair_words(&self, n: usize) -> [[u32; 2]; 2] {
        self.pair(n).map(|node| {
            let [.., link, _, _, _, aux]: [u32; 8] = bytemuck::cast(node);
            [link, aux]
        })
    }

    /// Replaces the height of the node in slot `n`.
    #[inline(always)]
    pub(crate) fn set_height(&self, n: usize, height: u32) {
        assert!(n < self.len, "node out of range");
        const { assert!(Node::HEIGHT == 0xff) }
        // The lowest byte of a node's last word.
        let byte = if cfg!(target_endian = "little") { 28 } else { 31 };
        // SAFETY: as in `set`, within a node of 32 bytes of which any byte may have any value.
        #[expect(unsafe_code, reason = "writes the shared arena")]
        unsafe {
            self.start.add(n).cast::<u8>().add(byte).write(height as u8);
        }
    }

    /// The pair that starts at slot `n`, to be read later.
    #[inline(always)]
    pub(crate) fn pair_at(&self, n: usize) -> PairAt<'a> {
        assert!(n + 1 < self.len, "pair out of range");
        PairAt(self.start.wrapping_add(n).cast_const(), PhantomData)
    }

    /// The children of a node with that link word; for a leaf, boxes around everything.
    #[inline(always)]
    pub(crate) fn children_at(&self, link: u32) -> PairAt<'a> {
        let is_leaf = link & Node::LEAF != 0;
        // That of a leaf is no pair.
        let PairAt(pair, nodes) = self.pair_at(if is_leaf { 0 } else { (link & Node::INDEX) as usize });
        PairAt(std::hint::select_unpredictable(is_leaf, EVERYTHING.0.as_ptr().cast(), pair), nodes)
    }

    /// Brings the pair that starts at slot `n` into the cache. Any `n` will do.
    #[inline(always)]
    pub(crate) fn prefetch(&self, n: usize) {
        bvh_core::prefetch_at(self.start, n);
    }
}

/// A pair of nodes in range, or two boxes around everything: 64 bytes, aligned to 32, that can be
/// read as long as `'a` lasts. Only this module makes one. It stays on its thread.
#[derive(Clone, Copy)]
pub(crate) struct PairAt<'a>(*const Node, PhantomData<&'a Node>);

impl PairAt<'_> {
    /// Part `i` of it: a node, or minima or maxima of one with a word behind them.
    #[inline(always)]
    pub(crate) fn part<T: bytemuck::Pod>(self, i: usize) -> T {
        const { assert!(64 % size_of::<T>() == 0 && align_of::<T>() <= 32) }
        let parts = const { 64 / size_of::<T>() };
        debug_assert!(i < parts);
        // SAFETY: within the 64 bytes, by the modulo; `T` may have any bytes; not written elsewhere
        // by the promise to `SharedNodes::new`.
        #[expect(unsafe_code, reason = "reads the shared arena")]
        unsafe {
            self.0.cast::<T>().add(i % parts).read()
        }
    }
}

/// Two boxes around everything: in the place of a leaf's children they make every rotation a loss.
static EVERYTHING: Everything = Everything([[[f32::NEG_INFINITY; 4], [f32::INFINITY; 4]]; 2]);

#[repr(align(64))]
struct Everything([[[f32; 4]; 2]; 2]);

/// Shares the nodes of one tree between the tasks of one pass, or of one new top.
pub(crate) fn share(nodes: &mut [Node]) -> SharedNodes<'_> {
    // SAFETY: The nodes are borrowed for as long as the result lives. The pass processes the top
    // block on one thread before its tasks start and after all have ended; a task touches only its
    // roots and what is below them, and reads the tree's root and node 1, which none writes; and as
    // every pair of a valid tree has one parent, and no root is below another, tasks share no node
    // that one of them writes. Where the tree is swept the tasks are the pieces of the arena that
    // `linear` divides it into: whole subtrees of a linear tree, each in one place. A new top
    // (`top_tree.rs`) is written by tasks that read no node, each to pairs of its own:
    // `rebuild_top` makes sure that none is there twice.
    #[expect(unsafe_code, reason = "shares the arena between tasks")]
    unsafe {
        SharedNodes::new(nodes)
    }
}

/// The parts of a tree, for a pass that keeps its structure valid.
pub(crate) fn parts(bvh: &mut Bvh) -> Parts<'_> {
    // SAFETY: the pass writes boxes, and structure only by `Accepted::apply`, which swaps two slots
    // and refits heights and dynamic bits on the way up, as the plain pass does.
    // `repair/top_tree.rs` builds a new top over the same subtrees in the pairs of the old top, and
    // refits heights and bits. Whoever has moved nodes sets the layout to `OTHER`. Others write
    // references and the state alone. Where primitives may panic in between, an `OnPanic`
    // recomputes heights.
    #[expect(unsafe_code, reason = "promises to leave a valid tree")]
    unsafe {
        bvh.parts_mut()
    }
}

/// A SIMD level that this machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Available(SimdLevel);

impl Available {
    /// `level`, or the best there is below it.
    pub(crate) fn at_most(level: SimdLevel) -> Self {
        Self(level.min(SimdLevel::best()))
    }

    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub(crate) fn is(self, level: SimdLevel) -> bool {
        self.0 >= level
    }
}

/// Calls `$name` of the module for the [`Available`] level.
macro_rules! dispatch {
    ($level:expr, $name:ident($($argument:expr),* $(,)?)) => {{
        match $level {
            // SAFETY: an `Available` level is one that the machine has.
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "calls code compiled for AVX-512")]
            level if level.is(bvh_core::SimdLevel::Avx512) => unsafe { $crate::refit::avx512::$name($($argument),*) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "calls code compiled for AVX2")]
            level if level.is(bvh_core::SimdLevel::Avx2) => unsafe { $crate::refit::avx2::$name($($argument),*) },
            _ => $crate::refit::scalar::$name($($argument),*),
        }
    }};
}
pub(crate) use dispatch;
