//! The pass over a whole tree: refits every box to the primitives' new positions and rotates on the
//! way up.
//!
//! ```text
//! subtrees(roots):  heavy together: both halves of them, in parallel
//!                   else a block: walk down from the roots (block.rs)
//!                                 fit the leaves found     (kernels.rs)
//!                                 subtrees(what is below the block), in parallel
//!                                 refit the block's inner nodes    (kernels.rs)
//!                                 rotate level by level, deepest first (rotations.rs)
//! ```
//!
//! How subtrees are divided depends on the tree alone, never on threads or time: so do sums of
//! floats, and so does every bit of the result. A tree in the order of its builder is refitted by a
//! sweep instead ([`linear`]).

use bvh_core::{Bvh, OnPanic, Primitives, SimdLevel, sah_cost};

use self::block::{Block, Entry, LISTED, Leaves, Lists};
use self::kernels::{fit_leaf, primitive_in, refit_height};
use self::memory::{SPARE_BLOCKS, SPARE_LISTS, lend};
use self::shared::{Available, dispatch};
use crate::report::Update;
use crate::state::{Layout, State};

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod block;
mod cost;
mod kernels;
mod linear;
mod memory;
pub mod plain;
mod rotations;
mod scalar;
mod shared;

pub(crate) use linear::detect_linear;
pub(crate) use memory::THREAD_MEMORY;
pub(crate) use shared::{SharedNodes, parts, share};

pub use self::cost::BlockCost;
pub(crate) use self::cost::Costs;
use self::cost::Stopwatch;

/// Nodes listed by blocks above others: the less, the more can be done at a time.
// Half and double: docs/TUNING.md.
const TOP_LISTED: usize = 128;

/// Inner nodes that subtrees of one block have together, as estimated by [`is_heavy`].
// Half and double: docs/TUNING.md.
const WEIGHT: u64 = 512;

/// Nodes of a small tree, which one thread updates, however high it is: outside of rayon's pool it
/// takes microseconds to share work. One block lists all of it, as it has fewer inner nodes than
/// pairs.
pub(crate) const SMALL: usize = 2 * LISTED;

/// Cache lines, of a pair each, to fetch for each leaf that is fitted: as built, what comes next
/// lies in one piece, and rotations leave it nearly so.
// Half and double: docs/UPDATE_COST.md.
const LINES: usize = 2;

/// The budget of rotations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Rotate {
    /// Rotations are tried at each node in one of this many updates, at different nodes each time;
    /// a power of two, else the next one. 1, every node in every update, by default.
    pub period: u32,
}

bvh_core::with_methods!(Rotate: with_period(period: u32));

impl Default for Rotate {
    fn default() -> Self {
        Self { period: 1 }
    }
}

/// What a pass, or a part of it, has done.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) rotations: [u64; 6],
    pub(crate) leaves: u64,
    pub(crate) inner: u64,
    /// Primitives without a box.
    pub(crate) dropped: u64,
    /// Whether the next two sums were asked for; else they are without meaning.
    pub(crate) has_sums: bool,
    /// Sum of half area times weight over all nodes visited.
    pub(crate) area: f64,
    /// The part of it that is due to leaves.
    pub(crate) leaf_area: f64,
    /// Growth of the same sum over static nodes.
    pub(crate) static_area: f64,
}

/// In a tree whose root has less half area, that of leaves may be below the range of `f32`.
const LEAST_ROOT: f64 = 1e-28;

impl Tally {
    /// What the pass reports; `bvh` is the tree after it.
    pub(crate) fn report(&self, bvh: &Bvh) -> Update {
        let known = || (self.area + bvh.static_area()) / bvh.root().aabb().half_area_f64();
        let sah_cost = || if self.is_in_range(bvh) { known() } else { sah_cost(bvh) };
        Update {
            rotations: self.rotations,
            sah_cost: self.has_sums.then(sah_cost),
            height: bvh.height(),
            nodes_visited: self.leaves + self.inner,
            dropped: self.dropped,
            ..Update::default()
        }
    }

    /// Whether sums are those of `bvh`, the tree after the pass: not where areas are beyond the
    /// range of `f32` on either side.
    pub(crate) fn is_in_range(&self, bvh: &Bvh) -> bool {
        // Static areas are among those of the tree.
        let is_finite = (self.area + bvh.static_area()).is_finite();
        is_finite && bvh.root().aabb().half_area_f64() > LEAST_ROOT
    }

    fn and(mut self, other: &Self) -> Self {
        self.rotations.iter_mut().zip(other.rotations).for_each(|(a, b)| *a += b);
        self.leaves += other.leaves;
        self.inner += other.inner;
        self.dropped += other.dropped;
        self.area += other.area;
        self.leaf_area += other.leaf_area;
        self.static_area += other.static_area;
        self
    }
}

/// Which nodes have their turn: one in `period`, a power of two or else the next one, others in
/// each turn.
#[derive(Clone, Copy, Debug)]
struct Schedule {
    mask: usize,
    turn: usize,
}

impl Schedule {
    fn new(period: u32, turn: u32) -> Self {
        let period = period.clamp(1, 1 << 31).next_power_of_two();
        Self { mask: period as usize - 1, turn: turn as usize }
    }

    /// Whether every node is included.
    fn is_always(self) -> bool {
        self.mask == 0
    }

    /// Whether it is the turn of the node in this slot.
    #[inline]
    fn includes(self, slot: usize) -> bool {
        (slot / 2).wrapping_add(self.turn) & self.mask == 0
    }
}

/// How passes are run, and what their blocks took.
pub(crate) struct PassOptions {
    level: Available,
    /// Whether tallies have sums of areas.
    pub(crate) with_sums: bool,
    /// What blocks took, where that is recorded.
    pub(crate) costs: Option<Costs>,
}

impl Default for PassOptions {
    /// For the best level that the machine has.
    fn default() -> Self {
        Self::with_level(SimdLevel::best())
    }
}

impl PassOptions {
    /// For `level`, or the best below it that the machine has.
    pub(crate) fn with_level(level: SimdLevel) -> Self {
        Self { level: Available::at_most(level), with_sums: true, costs: None }
    }
}

/// Where some subtrees stand among others.
#[derive(Clone, Copy, Default)]
struct Around {
    /// The pair below the root whose turn is next, or 0 where none is.
    next: usize,
    /// The block above, if they are counted.
    block: Option<usize>,
}

/// What all parts of a pass are given.
pub(crate) struct Task<'a, P: ?Sized> {
    nodes: SharedNodes<'a>,
    primitives: &'a P,
    /// Of the tree; empty if each slot holds the primitive of that number.
    order: &'a [u32],
    /// At which nodes rotations are tried, if at any.
    schedule: Option<Schedule>,
    is_partly_static: bool,
    /// Whether each leaf has one primitive.
    of_one: bool,
    options: &'a PassOptions,
}

/// Refits what moves; with `rotate`, rotates on the way up. The caller has checked that there are
/// as many primitives as the tree holds.
pub(crate) fn pass<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    rotate: Option<Rotate>,
    options: &PassOptions,
) -> Tally {
    let (is_in_order, is_partly_static) = (bvh.is_in_order(), !bvh.all_dynamic());
    let of_one = bvh.has_leaves_of_one();
    // Rotations leave the heights of the nodes above them to be updated later, and primitives may
    // panic half-way.
    let unfinished = OnPanic(bvh, Bvh::recompute_metadata);
    let parts = parts(unfinished.0);
    let state = State::of_mut(parts.state);
    let is_linear = rotate.is_none() && detect_linear(parts.nodes, state);
    if rotate.is_some() {
        // Rotations end it: beforehand, for the same reason.
        state.layout = Layout::OTHER;
    }
    let schedule = rotate.map(|rotate| Schedule::new(rotate.period, state.updates));
    state.updates = state.updates.wrapping_add(1);
    let nodes = share(parts.nodes);
    let order = if is_in_order { &[] } else { parts.order };
    let mut tally =
        Task { nodes, primitives, order, schedule, is_partly_static, of_one, options }.run(is_linear);
    *parts.static_area += tally.static_area;
    tally.has_sums = options.with_sums;
    std::mem::forget(unfinished);
    tally
}

impl<P: Primitives + ?Sized> Task<'_, P> {
    fn run(&self, is_linear: bool) -> Tally {
        let root = self.nodes.get(0);
        if !root.is_dynamic() {
            Tally::default()
        } else if root.is_leaf() {
            let mut tally = Tally::default();
            fit_leaf(self.nodes, self.primitives, self.order, 0, &mut tally);
            tally
        } else if is_linear {
            // The slot beside the root is a static leaf without primitives, and may stand in the
            // first stretch.
            self.sweep(0..self.nodes.pairs())
        } else {
            let [[link, _], _] = self.nodes.pair_words(0);
            self.subtrees(&[Entry::new(0, link)], 0, Around::default())
        }
    }

    /// Updates the subtrees below roots of one depth.
    fn subtrees(&self, roots: &[Entry], depth: u32, around: Around) -> Tally {
        let is_heavy = self.is_heavy(roots);
        match roots.len() {
            0 => Tally::default(),
            len if len == 1 || !is_heavy => lend(&SPARE_BLOCKS, |block| {
                (block.depth, block.limit) = (depth, if is_heavy { TOP_LISTED } else { LISTED });
                self.block(block, roots, around)
            }),
            len => {
                let (a, b) = roots.split_at(len / 2);
                let before_b = Around { next: b[0].first(), ..around };
                let (a, b) =
                    rayon::join(|| self.subtrees(a, depth, before_b), || self.subtrees(b, depth, around));
                a.and(&b)
            }
        }
    }

    /// Whether subtrees are more than enough for one block.
    ///
    /// Sizes are not known, heights are: subtrees of height h have 2^(5h/8) inner nodes or so.
    fn is_heavy(&self, roots: &[Entry]) -> bool {
        if 2 * self.nodes.pairs() <= SMALL {
            return false;
        }
        let mut weight = 0;
        roots.iter().any(|root| {
            weight += 1 << (self.nodes.get(root.slot()).height() * 5 / 8);
            weight > WEIGHT
        })
    }

    /// Updates the subtrees below a few roots: a block of nodes, and what is below it.
    fn block(&self, block: &mut Block, roots: &[Entry], around: Around) -> Tally {
        let &PassOptions { level, with_sums, ref costs } = self.options;
        let mut tally = Tally::default();
        let mut watch = Stopwatch::start(costs.as_ref(), around.block);
        lend(&SPARE_LISTS, |Lists { leaves, .. }| {
            dispatch!(level, walk(block, self.nodes, roots, leaves));
            watch.lap(|cost| &mut cost.list);
            let [(rest, _), (below, _)] = block.frontier();
            let next = rest.first().or(below.first()).map_or(around.next, |root| root.first());
            let fetch =
                |i: usize| (0..LINES).for_each(|line| self.nodes.prefetch(next + 2 * (LINES * i + line)));
            self.fit_leaves(leaves, fetch, &mut tally);
            watch.lap(|cost| &mut cost.leaves);
        });
        let [(rest, rest_depth), (below, below_depth)] = block.frontier();
        let after = Around { block: watch.block, ..around };
        let next = below.first().map_or(around.next, |root| root.first());
        // A join that does nothing still takes microseconds outside of the pool.
        if !rest.is_empty() || !below.is_empty() {
            let (rest, below) = rayon::join(
                || self.subtrees(rest, rest_depth, Around { next, ..after }),
                || self.subtrees(below, below_depth, after),
            );
            tally = tally.and(&rest).and(&below);
        }
        watch.skip();
        dispatch!(level, refit_boxes(self.nodes, block.own(), with_sums, &mut tally));
        watch.lap(|cost| &mut cost.boxes);
        lend(&SPARE_LISTS, |lists| self.rotate(block, lists, &mut tally));
        watch.lap(|cost| &mut cost.rotations);
        tally
    }

    /// Fits leaves, and calls `fetch` with the number of each. Entries of the list may name
    /// primitives in the place of slots afterwards.
    fn fit_leaves(&self, leaves: &mut Leaves, fetch: impl Fn(usize), tally: &mut Tally) {
        let Self { nodes, primitives, order, of_one, options, .. } = *self;
        if of_one && !order.is_empty() {
            // Beforehand, as the loop asks three times for the primitive of a leaf.
            for entry in leaves.all_mut() {
                *entry = Entry::new(entry.slot(), primitive_in(order, entry.first()) as u32);
            }
        }
        let area = dispatch!(
            options.level,
            fit_leaves(nodes, primitives, order, leaves, fetch, of_one, options.with_sums)
        );
        let Some(area) = area else {
            leaves.all().iter().for_each(|entry| fit_leaf(nodes, primitives, order, entry.slot(), tally));
            return;
        };
        tally.leaves += leaves.all().len() as u64;
        tally.leaf_area += area;
        tally.area += area;
    }

    /// Rotates at the block's inner nodes.
    fn rotate(&self, block: &Block, lists: &mut Lists, tally: &mut Tally) {
        let nodes = self.nodes;
        let Some(schedule) = self.schedule else { return };
        let Lists { included, accepted, .. } = lists;
        for (level, depth) in block.levels() {
            let level = if schedule.is_always() {
                level
            } else {
                included.clear();
                for &entry in level {
                    refit_height(nodes, entry);
                    included.push_if(entry, schedule.includes(entry.slot()));
                }
                included.all()
            };
            let at = (depth, self.is_partly_static);
            dispatch!(self.options.level, rotate(nodes, level, at, accepted, tally));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use bvh_build::{BuildOptions, Builder, build, build_with};
    use bvh_core::{Aabb, Vec3};
    use bytemuck::zeroed_box;

    use super::*;

    /// A slot that two tasks touch, if there is one, and how many slots are touched at all. A task
    /// touches the slots of its root and everything below.
    fn shared_slot(tree: &Bvh, roots: &[usize]) -> (Option<usize>, usize) {
        let mut is_touched = vec![false; tree.nodes().len()];
        let (mut shared, mut touched) = (None, 0);
        for &root in roots {
            let mut below = vec![root];
            while let Some(slot) = below.pop() {
                if std::mem::replace(&mut is_touched[slot], true) {
                    shared = Some(slot);
                } else {
                    touched += 1;
                }
                let node = &tree.nodes()[slot];
                if !node.is_leaf() {
                    below.extend([node.first(), node.first() + 1]);
                }
            }
        }
        (shared, touched)
    }

    /// What `share` promises: no two tasks touch a node. A task is any part of a block's frontier,
    /// so it is enough that no two roots of a frontier do.
    #[test]
    fn tasks_touch_disjoint_nodes() {
        for n in [100, 5000, 40_000] {
            let place = |i: usize| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32);
            let boxes: Vec<Aabb> = (0..n).map(place).map(|p| Aabb::new(p, p + 0.5)).collect();
            let mut bvh = build(&boxes, Builder::Lbvh).expect("few enough");
            bvh.set_dynamic(|p| p % 5 != 0);
            // Rotations scatter nodes over the arena.
            for _ in 0..3 {
                pass(&mut bvh, &boxes, Some(Rotate::default()), &PassOptions::default());
            }
            let tree = bvh.clone();
            let nodes = share(parts(&mut bvh).nodes);
            let (mut block, mut lists) = (zeroed_box::<Block>(), zeroed_box::<Lists>());
            let [[link, _], _] = nodes.pair_words(0);
            block.limit = TOP_LISTED;
            scalar::walk(&mut block, nodes, &[Entry::new(0, link)], &mut lists.leaves);
            let [(rest, _), (below, _)] = block.frontier();
            let mut roots: Vec<usize> = rest.iter().chain(below).map(|entry| entry.slot()).collect();
            let (shared, touched) = shared_slot(&tree, &roots);
            assert_eq!(shared, None, "of {n}");
            if n < 5000 {
                continue;
            }
            assert!(roots.len() > 10 && touched > n / 2, "most nodes belong to tasks");
            // The check finds a root twice, and a task within another's.
            for within in [roots[3], tree.nodes()[roots[3]].first()] {
                roots.push(within);
                assert!(shared_slot(&tree, &roots).0.is_some());
                roots.pop();
            }
        }
    }

    /// Boxes that count how often they are asked for.
    struct Counted(Vec<Aabb>, AtomicUsize);

    impl Primitives for Counted {
        fn len(&self) -> usize {
            self.0.len()
        }

        fn bounds(&self, i: usize) -> Aabb {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0[i]
        }
    }

    #[test]
    fn each_box_is_asked_for_once() {
        // Every other place is that of three boxes.
        let place = |i: usize| i / 4 * 2 + usize::from(i.is_multiple_of(4));
        let at = |p: usize| Vec3::new((p % 61) as f32, (p % 53) as f32, (p % 47) as f32);
        let boxes: Vec<Aabb> = (0..5000).map(|i| at(place(i))).map(|p| Aabb::new(p, p + 0.5)).collect();
        for max_leaf_size in [1, 4] {
            let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
            let mut bvh = build_with(&boxes, Builder::Sweep, &options).expect("few enough");
            let has_of_one = bvh.nodes().iter().any(|node| node.count() == 1);
            assert!(has_of_one && bvh.has_leaves_of_one() == (max_leaf_size == 1));
            for rotate in [None, Some(Rotate::default()), None] {
                let boxes = Counted(boxes.clone(), AtomicUsize::new(0));
                pass(&mut bvh, &boxes, rotate, &PassOptions::default());
                assert_eq!(boxes.1.into_inner(), 5000, "{rotate:?}");
            }
        }
    }
}
