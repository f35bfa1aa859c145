//! The unsafe parts: a node arena that tasks on several threads share, and the calls into AVX2 code.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::__m256;
use std::marker::PhantomData;

use bvh_core::rotation::Slots;
use bvh_core::{Bvh, Node, Parts, SimdLevel};

/// The nodes of one tree, read and written by tasks that keep to disjoint sets of them.
#[derive(Clone, Copy)]
pub(crate) struct SharedNodes<'a> {
    start: *mut Node,
    len: usize,
    nodes: PhantomData<&'a mut [Node]>,
}

// SAFETY: a `SharedNodes` gives access to nodes by value only, and whoever makes one promises that no node is
// touched by two threads without synchronisation between; `Node` is plain data.
#[expect(unsafe_code, reason = "lets tasks share the arena")]
unsafe impl Send for SharedNodes<'_> {}
// SAFETY: as above.
#[expect(unsafe_code, reason = "lets tasks share the arena")]
unsafe impl Sync for SharedNodes<'_> {}

impl<'a> SharedNodes<'a> {
    /// # Safety
    /// While this and its copies live, no node may be written by one thread and read or written by another,
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
        // SAFETY: in range by the assertion; valid and not written elsewhere by the promise to `new`.
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

    /// The node in slot `n` as one register. To be inlined into AVX2 code.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn lanes(&self, n: usize) -> __m256 {
        assert!(n < self.len, "node out of range");
        // SAFETY: as in `get`; a node has the size and the alignment of a register, and any bits make one.
        #[expect(unsafe_code, reason = "reads the shared arena")]
        unsafe {
            self.start.add(n).cast::<__m256>().read()
        }
    }

    /// The nodes in slots `n` and `n + 1`, as [`lanes`](Self::lanes).
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn pair_lanes(&self, n: usize) -> [__m256; 2] {
        assert!(n + 1 < self.len, "pair out of range");
        // SAFETY: as in `lanes`, for both.
        #[expect(unsafe_code, reason = "reads the shared arena")]
        unsafe {
            let first = self.start.add(n).cast::<__m256>();
            [first.read(), first.add(1).read()]
        }
    }

    /// The pairs at slots `n`, `n + 2`, `n + 4` and `n + 6`, but no one behind the pair at `last`.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn four_pairs_lanes(&self, n: usize, last: usize) -> [[__m256; 2]; 4] {
        if n + 6 <= last && last + 1 < self.len {
            // SAFETY: as in `lanes`, for all.
            #[expect(unsafe_code, reason = "reads the shared arena")]
            unsafe {
                self.start.add(n).cast::<[[__m256; 2]; 4]>().read()
            }
        } else {
            [0, 2, 4, 6].map(|i| self.pair_lanes((n + i).min(last)))
        }
    }

    /// Stores a register as the node in slot `n`.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn set_lanes(&self, n: usize, node: __m256) {
        assert!(n < self.len, "node out of range");
        // SAFETY: as in `set`; a register has the size and the alignment of a node, and any bits make one.
        #[expect(unsafe_code, reason = "writes the shared arena")]
        unsafe {
            self.start.add(n).cast::<__m256>().write(node);
        }
    }

    /// Brings the pair that starts at slot `n` into the cache; if that is for later, no nearer than the second level. Any
    /// `n` will do.
    #[inline(always)]
    pub(crate) fn prefetch<const FOR_LATER: bool>(&self, n: usize) {
        #[cfg(target_arch = "x86_64")]
        #[expect(unsafe_code, reason = "prefetching needs a pointer")]
        // SAFETY: prefetching reads nothing architecturally, whatever the address, and `wrapping_add` makes no
        // claim about it. SSE is part of x86-64.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};
            let pair = self.start.wrapping_add(n).cast();
            if FOR_LATER { _mm_prefetch::<_MM_HINT_T1>(pair) } else { _mm_prefetch::<_MM_HINT_T0>(pair) }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = n;
    }
}

/// Shares the nodes of one tree between the tasks of one pass, or of one new top.
pub(crate) fn share(nodes: &mut [Node]) -> SharedNodes<'_> {
    // SAFETY: The nodes are borrowed for as long as the result lives. The pass processes the top block on one
    // thread before its tasks start and after all have ended; a task touches only the nodes below its roots, and reads the
    // root and node 1, which none writes; and as every pair of a valid tree has one parent, and no root is below
    // another, tasks share no node that one of them writes. Where the tree is swept the tasks are the pieces of the arena
    // that `sweep::Pieces` cuts it into: whole subtrees of a linear tree, each in one place. A new top (`top.rs`) is
    // written by tasks that read no node, each to pairs of its own: `rebuild_top` makes sure that none is there twice.
    #[expect(unsafe_code, reason = "shares the arena between tasks")]
    unsafe {
        SharedNodes::new(nodes)
    }
}

/// A tree in the middle of an update: mended if primitives panic before that is done, as rotations leave heights above
/// them to be told later.
pub(crate) struct Unfinished<'a> {
    pub(crate) bvh: &'a mut Bvh,
    pub(crate) done: bool,
}

impl<'a> Unfinished<'a> {
    pub(crate) fn new(bvh: &'a mut Bvh) -> Self {
        Self { bvh, done: false }
    }
}

impl Drop for Unfinished<'_> {
    fn drop(&mut self) {
        if !self.done {
            self.bvh.recompute_metadata();
        }
    }
}

/// The parts of a tree, for a pass that keeps its structure valid.
pub(crate) fn parts(bvh: &mut Bvh) -> Parts<'_> {
    // SAFETY: the pass writes boxes, and structure only by `kernels::apply`, which swaps two slots and refits
    // heights and moving bits on the way up, as the plain pass does. `top.rs` and `settle.rs` put a tree over the same
    // slots or subtrees in the place of another, in pairs that were that one's or spare, with heights and bits refitted.
    // Whoever has moved nodes sets the layout to `Other`. Others write references and the history alone. Where primitives
    // may panic in between, the tree is `Unfinished`; `settle.rs` asks none while it writes.
    #[expect(unsafe_code, reason = "promises to leave a valid tree")]
    unsafe {
        bvh.parts_mut()
    }
}

impl Slots for SharedNodes<'_> {
    #[inline(always)]
    fn get(&self, n: usize) -> Node {
        Self::get(self, n)
    }

    #[inline(always)]
    fn set(&mut self, n: usize, node: Node) {
        Self::set(self, n, node);
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

    /// Whether AVX2 code may run.
    #[inline]
    pub(crate) fn avx2(self) -> bool {
        self.0 >= SimdLevel::Avx2
    }
}

/// Calls `avx2::$name` where the [`Available`] level allows it, else `portable::$name`.
macro_rules! dispatch {
    ($level:expr, $name:ident $(::<$($generic:tt),*>)? ($($argument:expr),* $(,)?)) => {{
        #[cfg(target_arch = "x86_64")]
        if $level.avx2() {
            // SAFETY: an `Available` level is one that the machine has.
            #[expect(unsafe_code, reason = "calls code compiled for AVX2")]
            unsafe { $crate::avx2::$name $(::<$($generic),*>)? ($($argument),*) }
        } else {
            $crate::portable::$name $(::<$($generic),*>)? ($($argument),*)
        }
        #[cfg(not(target_arch = "x86_64"))]
        $crate::portable::$name $(::<$($generic),*>)? ($($argument),*)
    }};
}
pub(crate) use dispatch;
