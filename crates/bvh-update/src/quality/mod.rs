//! How good a tree is: its cost beside a baseline, on the scale of the scene.
//!
//! The cost of a tree is the sum of half area times weight over its nodes. A scene that grows as a whole makes every tree
//! cost more, so costs are compared in units of the scene's *scale*, which is an area:
//!
//! ```text
//! scale  = half area of the dynamic leaves at first * growth that leaves and root have in common * scale_factor
//! unit   = baseline * scale * sqrt(uniformity)
//! excess = (cost - baseline * scale) / unit
//! ```
//!
//! Leaves that grow within a room, and pieces that fly apart, leave the scale as it is. `scale_factor` keeps it where other
//! dynamic primitives change the sizes that growth is measured by; else it is 1.
//!
//! What moves the baseline:
//!
//! ```text
//! take_baseline       a tree that has none: built, given by the caller, or measured by another strategy before
//! repair::open_grown  a new top: the references of all nodes, as if what grew below had not
//! auto::observe       a tree that costs less than its baseline: `Auto` lowers the baseline to that
//! ```
//!
//! Where a few leaves hold most of the area, as the walls of a room do, they hold most of the cost as well, while rays meet
//! mostly what is small. *Uniformity* is the square of the mean width of leaves over the mean of the squares. By area what is small
//! counts for its part of the cost, by number for `1 / uniformity` times as much; the root is the geometric mean of both. Without
//! it updates and rays take 31 % more counted work in bart-museum and 8 % more on exploding-dragon (`docs/ABLATION.md`).

use bvh_core::{Bvh, Node};

use crate::refit::{Tally, parts};
use crate::state::{Baseline, State};

/// Sums of half area times weight over nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct TreeCost {
    pub(crate) all: f64,
    /// The part of it that is due to static nodes.
    pub(crate) fixed: f64,
}

impl TreeCost {
    pub(crate) fn add(&mut self, node: &Node) {
        let term = node.sah_term();
        self.all += term;
        self.fixed += if node.is_dynamic() { 0.0 } else { term };
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self { all: self.all + other.all, fixed: self.fixed + other.fixed }
    }
}

/// Measures a tree that has no baseline: every inner node keeps its half area, in units of the scale, as its reference. O(n)
/// where there is no baseline, or other primitives are dynamic than before.
pub(crate) fn take_baseline(bvh: &mut Bvh) {
    let Baseline { cost, has_other_dynamic, .. } = State::of(bvh).baseline;
    if cost != 0.0 && has_other_dynamic == 0 {
        return;
    }
    let (mut all, mut dynamic_leaves, mut static_leaves) = (0.0, 0.0, 0.0);
    let (mut widths, mut leaves) = (0.0, 0.0);
    bvh.visit(|_, node, _| {
        let term = node.sah_term();
        all += term;
        if node.is_leaf() {
            widths += term.sqrt();
            leaves += 1.0;
        }
        match (node.is_leaf(), node.is_dynamic()) {
            (true, true) => dynamic_leaves += term,
            (true, false) => static_leaves += term,
            (false, _) => {}
        }
    });
    let root = bvh.root().aabb().half_area_f64();
    let parts = parts(bvh);
    let baseline = &mut State::of_mut(parts.state).baseline;
    let sizes = [dynamic_leaves, root, static_leaves];
    if cost != 0.0 {
        baseline.take_sizes(sizes);
        return;
    }
    let per_scale = 1.0 / common_growth(sizes, [1.0; 2]);
    for node in parts.nodes.iter_mut() {
        node.set_reference((f64::from(node.aabb().half_area()) * per_scale) as f32);
    }
    *baseline = Baseline {
        cost: all * per_scale,
        measured: all * per_scale,
        sizes,
        scale: common_growth(sizes, [1.0; 2]),
        scale_factor: 1.0,
        leaf_uniformity: leaf_uniformity(widths, leaves, dynamic_leaves + static_leaves),
        ..Baseline::default()
    };
}

impl Baseline {
    /// From now on the scale grows as leaves and root of these sizes do; it is what it was, so references hold.
    pub(crate) fn take_sizes(&mut self, sizes: [f64; 3]) {
        self.sizes = sizes;
        self.scale_factor = or_one(self.scale / common_growth(sizes, [1.0; 2]));
        self.has_other_dynamic = 0;
    }

    /// The scale of the scene, given the area of its dynamic leaves now.
    pub(crate) fn scale_now(&self, bvh: &Bvh, leaf_area: f64) -> f64 {
        let [leaves, root, _] = self.sizes;
        let growth = |now: f64, first: f64| if first > 0.0 { now / first } else { 1.0 };
        let growth = [growth(leaf_area, leaves), growth(bvh.root().aabb().half_area_f64(), root)];
        or_one(common_growth(self.sizes, growth) * self.scale_factor)
    }

    /// What changes of cost are compared with.
    pub(crate) fn unit(&self, scale: f64) -> f64 {
        self.cost * scale * self.leaf_uniformity.sqrt()
    }

    /// How far a cost is above that of a tree as good as the baseline, in units; 0 where that is no number.
    pub(crate) fn excess(&self, cost: f64, scale: f64) -> f64 {
        let unit = self.unit(scale);
        let excess = (cost - self.cost * scale) / unit;
        if unit > 0.0 && excess.is_finite() { excess } else { 0.0 }
    }
}

/// The square of the mean width of leaves, over the mean of their areas; 1 where that is no number.
fn leaf_uniformity(widths: f64, leaves: f64, areas: f64) -> f64 {
    let uniformity = widths * widths / (leaves * areas);
    if uniformity > 0.0 { uniformity.min(1.0) } else { 1.0 }
}

/// The cost of a tree after a pass.
pub(crate) fn cost_after(bvh: &Bvh, tally: &Tally) -> f64 {
    tally.area + bvh.static_area()
}

/// The cost of a tree. O(n).
pub(crate) fn cost_of(bvh: &Bvh) -> f64 {
    let mut cost = TreeCost::default();
    bvh.visit(|_, node, _| cost.add(node));
    cost.all
}

/// Half area of all dynamic leaves, as it was at first, times the growth that leaves and root have in common: that of
/// the one that has changed less, none if one has grown and the other shrunk. 1 where that is no area.
fn common_growth([first, ..]: [f64; 3], [leaves, root]: [f64; 2]) -> f64 {
    or_one(first * leaves.min(root).max(leaves.max(root).min(1.0)))
}

/// A baseline cost; 0, to be measured again, in the place of one that is not finite.
pub(crate) fn finite_or_zero(cost: f64) -> f64 {
    if cost.is_finite() { cost } else { 0.0 }
}

/// An area to divide by: 1 in the place of one that is no positive number.
pub(crate) fn or_one(area: f64) -> f64 {
    if area > 0.0 && area.is_finite() { area } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_follows_what_leaves_and_root_have_in_common() {
        let first = [2.0, 100.0, 0.0];
        for (growth, expected) in [
            ([1.0, 1.0], 2.0),
            ([3.0, 3.0], 6.0),
            ([0.5, 0.25], 1.0),
            ([1.5, 4.0], 3.0),
            // Leaves that grow within a room, pieces that fly apart.
            ([5.0, 1.0], 2.0),
            ([1.0, 50.0], 2.0),
            ([0.5, 2.0], 2.0),
            ([0.0, 0.0], 1.0),
            ([f64::INFINITY, f64::INFINITY], 1.0),
        ] {
            assert_eq!(common_growth(first, growth), expected, "{growth:?}");
        }
        assert_eq!(common_growth([0.0; 3], [1.0; 2]), 1.0);
    }

    #[test]
    fn leaves_of_one_size_are_uniform() {
        let of = |areas: &[f64]| {
            let widths = areas.iter().map(|area| area.sqrt()).sum();
            leaf_uniformity(widths, areas.len() as f64, areas.iter().sum())
        };
        assert_eq!([of(&[4.0; 10]), of(&[1.0, 0.0, 0.0, 0.0])], [1.0, 0.25]);
        assert_eq!([of(&[]), of(&[f64::INFINITY])], [1.0; 2]);
    }

    #[test]
    fn excess_is_relative_to_the_baseline() {
        let baseline = Baseline { cost: 4.0, leaf_uniformity: 1.0, ..Baseline::default() };
        assert_eq!(baseline.excess(12.0, 2.0), 0.5);
        let uneven = Baseline { leaf_uniformity: 0.25, ..baseline };
        assert_eq!(uneven.excess(12.0, 2.0), 1.0);
        assert_eq!(Baseline::default().excess(12.0, 2.0), 0.0);
    }
}
