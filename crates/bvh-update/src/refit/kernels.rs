//! Loops of the pass, each over a list of nodes: leaves, boxes of inner nodes, heights.
//!
//! They are written once, in vectors of four that every target has, and compiled for each SIMD
//! level. Boxes have a version of their own for AVX2 (`avx2.rs`). Rotations are in `rotations.rs`.

use bvh_core::glam::Vec4;
use bvh_core::{Aabb, COST_INTERSECT, Node, Primitives};

use super::Tally;
use super::block::{Entry, Leaves};
use super::shared::SharedNodes;

/// How many leaves ahead the corners of triangles are fetched.
// Other distances: docs/TUNING.md.
const AHEAD: usize = 12;

/// How many leaves ahead their indices are fetched: long before the corners, which cannot be asked
/// for without them.
// Other distances: docs/UPDATE_COST.md.
const INDICES_AHEAD: usize = 3 * AHEAD;

/// A sum of half areas, as sums of products `xy`, `yz`, `zx`, and one without meaning.
///
/// Kept apart, the products need no sum across a vector. A few are added in `f32`, their sums in
/// `f64`; the order is that of the lists, so every SIMD level has the same bits.
#[derive(Default)]
struct AreaSum {
    total: [f64; 4],
    part: Vec4,
}

/// Products added in `f32`: the error is 7 roundings at most, 4e-7.
const PART: usize = 8;

impl AreaSum {
    /// Adds the area of a box that is number `i` of its list. What is in the fourth lane does not
    /// matter.
    #[inline(always)]
    fn add_extent(&mut self, i: usize, extent: Vec4, weight: f32) {
        self.part += extent * Vec4::new(extent.y, extent.z, extent.x, extent.w) * weight;
        if i % PART == PART - 1 {
            self.flush();
        }
    }

    #[inline(always)]
    fn flush(&mut self) {
        let part = std::mem::take(&mut self.part).to_array();
        self.total.iter_mut().zip(part).for_each(|(total, part)| *total += f64::from(part));
    }

    fn total(mut self) -> f64 {
        self.flush();
        let [xy, yz, zx, _] = self.total;
        xy + yz + zx
    }
}

/// A box in lanes, with a node's words in the fourth.
type Corners = [Vec4; 2];

/// The primitive in a slot of the tree's order, which is empty if each slot holds the primitive of
/// that number.
#[inline(always)]
pub(super) fn primitive_in(order: &[u32], slot: usize) -> usize {
    if order.is_empty() { slot } else { order[slot] as usize }
}

/// Fits leaves to their primitives, and gives the sum of areas; `None` if some have no primitive,
/// or primitives without a box: then `fit_leaf` has to fit each of them again. Where each has one,
/// as `of_one` says, entries name primitives, else slots of the order. `fetch` is called with the
/// number of each leaf, to ask for what will be needed next.
#[inline(always)]
pub(super) fn fit_leaves<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    order: &[u32],
    leaves: &mut Leaves,
    fetch: impl Fn(usize),
    of_one: bool,
    with_sums: bool,
) -> Option<f64> {
    // One loop for all takes longer: docs/UPDATE_COST.md.
    if of_one {
        fit_valid::<_, true>(nodes, primitives, &[], leaves, fetch, with_sums)
    } else if order.is_empty() {
        fit_valid::<_, false>(nodes, primitives, &[], leaves, fetch, with_sums)
    } else {
        fit_valid::<_, false>(nodes, primitives, order, leaves, fetch, with_sums)
    }
}

/// As [`fit_leaves`], where each has one primitive if `OF_ONE`.
#[inline(always)]
fn fit_valid<P: Primitives + ?Sized, const OF_ONE: bool>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    order: &[u32],
    leaves: &mut Leaves,
    fetch: impl Fn(usize),
    with_sums: bool,
) -> Option<f64> {
    let (mut sum, mut validity) = (AreaSum::default(), Vec4::ZERO);
    let first = |entry: &Entry| primitive_in(order, entry.first());
    let padded = leaves.padded(INDICES_AHEAD);
    padded.iter().take(INDICES_AHEAD).for_each(|entry| primitives.prefetch_index(first(entry)));
    padded.iter().take(AHEAD).for_each(|entry| primitives.prefetch_data(first(entry)));
    for (i, window) in padded.windows(INDICES_AHEAD + 1).enumerate() {
        let entry = window[0];
        primitives.prefetch_index(first(&window[INDICES_AHEAD]));
        primitives.prefetch_data(first(&window[AHEAD]));
        fetch(i);
        let [own_min, own_max]: Corners = bytemuck::cast(nodes.get(entry.slot()));
        let count = own_max.w.to_bits() >> 8;
        debug_assert!(!OF_ONE || count == 1, "{count} primitives in a leaf");
        // So the compiler knows it.
        let count = if OF_ONE { 1 } else { count };
        let [min, max, next_validity] = lanes_of(primitives, order, entry.first(), count as usize);
        validity += next_validity;
        let corners: Corners = [min.with_w(own_min.w), max.with_w(own_max.w)];
        nodes.set(entry.slot(), bytemuck::cast(corners));
        if with_sums {
            sum.add_extent(i, max - min, COST_INTERSECT as f32 * count as f32);
        }
    }
    let is_finite = cfg!(refit_without = "validity") || validity.truncate().is_finite();
    is_finite.then(|| sum.total())
}

/// As [`Primitives::aabb_lanes`], for successive slots.
#[inline(always)]
fn lanes_of<P: Primitives + ?Sized>(primitives: &P, order: &[u32], first: usize, count: usize) -> [Vec4; 3] {
    if count == 0 {
        // An empty box, which does not count as valid.
        return [Vec4::INFINITY, Vec4::NEG_INFINITY, Vec4::NAN];
    }
    let mut lanes = primitives.aabb_lanes(primitive_in(order, first));
    // Not by `fold`: the compiler makes it a call in some loops. With `fold` refits took 15.2 ns a
    // triangle, with `for` 9.7 (docs/UPDATE_COST.md).
    for slot in first + 1..first + count {
        let [min, max, validity] = lanes;
        let [next_min, next_max, next_validity] = primitives.aabb_lanes(primitive_in(order, slot));
        lanes = [min.min(next_min), max.max(next_max), validity + next_validity];
    }
    lanes
}

/// Fits the leaf in slot `n` of the arena, whatever its primitives are.
#[cold]
#[inline(never)]
pub(super) fn fit_leaf<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    order: &[u32],
    n: usize,
    tally: &mut Tally,
) {
    let mut node = nodes.get(n);
    let mut aabb = Aabb::EMPTY;
    for slot in node.first()..node.first() + node.count() {
        let next = primitives.aabb(primitive_in(order, slot)).sanitized();
        // A sanitised box is empty only if it is `Aabb::EMPTY`.
        tally.dropped += u64::from(next.min.x == f32::INFINITY);
        aabb = aabb.union(next);
    }
    node.set_aabb(aabb);
    nodes.set(n, node);
    tally.leaves += 1;
    tally.leaf_area += node.sah_term();
    tally.area += node.sah_term();
}

/// Refits the boxes of inner nodes, children before parents; words stay as they are.
#[inline(always)]
pub(super) fn refit_boxes(
    nodes: SharedNodes<'_>,
    parents_first: &[Entry],
    with_sums: bool,
    tally: &mut Tally,
) {
    refit_boxes_with(parents_first, with_sums, tally, |entry| {
        let [l, r]: [Corners; 2] = nodes.pair(entry.first()).map(bytemuck::cast);
        let [own_min, own_max]: Corners = bytemuck::cast(nodes.get(entry.slot()));
        let corners = [l[0].min(r[0]).with_w(own_min.w), l[1].max(r[1]).with_w(own_max.w)];
        nodes.set(entry.slot(), bytemuck::cast(corners));
        corners
    });
}

/// Calls `refit`, which gives the new box, for each inner node, children before parents.
#[inline(always)]
pub(super) fn refit_boxes_with(
    parents_first: &[Entry],
    with_sums: bool,
    tally: &mut Tally,
    refit: impl Fn(Entry) -> [Vec4; 2],
) {
    let mut sum = AreaSum::default();
    for (i, &entry) in parents_first.iter().rev().enumerate() {
        let [min, max] = refit(entry);
        if with_sums {
            // An empty box has negative extents.
            sum.add_extent(i, (max - min).max(Vec4::ZERO), 1.0);
        }
    }
    tally.inner += parents_first.len() as u64;
    tally.area += sum.total();
}

/// Gives a node the height that follows from its children's, and returns their link words.
#[inline(always)]
pub(super) fn refit_height(nodes: SharedNodes<'_>, entry: Entry) -> [u32; 2] {
    let [[link_l, l], [link_r, r]] = nodes.pair_words(entry.first());
    let height = 1 + (l & Node::HEIGHT).max(r & Node::HEIGHT);
    // Few heights change.
    if !cfg!(refit_without = "heights") && nodes.get(entry.slot()).height() != height {
        nodes.set_height(entry.slot(), height);
    }
    [link_l, link_r]
}
