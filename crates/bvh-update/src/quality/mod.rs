//! How good a tree is: its cost beside a baseline, on the scale of the scene.
//!
//! The cost of a tree is the sum of half area times weight over its nodes. A scene that grows as a
//! whole makes every tree cost more, so costs are compared in units of the scene's *scale*, which
//! is an area:
//!
//! ```text
//! scale  = half area of the dynamic leaves at first * growth that leaves and root have in common * scale_factor
//! cost   = that of the tree / scale                 and so is the baseline
//! unit   = baseline * sqrt(uniformity)
//! excess = (cost - baseline) / unit
//! ```
//!
//! Leaves that grow within a room, and pieces that fly apart, leave the scale as it is.
//! `scale_factor` keeps it where other dynamic primitives change the sizes that growth is measured
//! by; else it is 1.
//!
//! What moves the baseline:
//!
//! ```text
//! take_baseline       a tree that has none: built, given by the caller, or measured by another strategy before
//! repair::open_costly a new top: the references of dynamic inner nodes, and what leaves and static nodes
//!                     cost now
//! repair::update      no subtree worth opening: raised to what the tree costs now
//! auto::observe       a tree that costs less than its baseline: `Auto` lowers the baseline to that
//! auto::execute       a tree that is hardly worse than a new one: it counts as good
//! ```
//!
//! Where a few leaves hold most of the area, as the walls of a room do, they hold most of the cost
//! as well, while rays meet mostly what is small. *Uniformity* is the square of the mean width of
//! leaves over the mean of the squares: 1 if all are alike. Its square root lies halfway between
//! counting leaves by area and counting them by number. Without it updates and rays take 31 % more
//! counted work in bart-museum and 8 % more on exploding-dragon (`docs/ABLATION.md`).

use bvh_core::{Bvh, Node};
use rayon::prelude::*;

use crate::refit::{Tally, parts};
use crate::state::{Baseline, State};

/// Nodes whose terms one task adds up. How the arena is divided depends on its length alone, so
/// sums do not depend on threads.
// Half and double: docs/TUNING.md.
const BLOCK: usize = 4096;

/// Adds up terms of all nodes. Those that are not in use are leaves without primitives ([`Bvh`]).
pub(crate) fn sum<const N: usize>(nodes: &[Node], term: &(impl Fn(&Node) -> [f64; N] + Sync)) -> [f64; N] {
    let and = |sums: [f64; N], terms: [f64; N]| std::array::from_fn(|i| sums[i] + terms[i]);
    if nodes.len() <= BLOCK {
        return nodes.iter().map(term).fold([0.0; N], and);
    }
    let (left, right) = nodes.split_at((nodes.len() / 2).next_multiple_of(BLOCK));
    let (left, right) = rayon::join(|| sum(left, term), || sum(right, term));
    and(left, right)
}

/// A tree whose cost has fallen below this part of what it was when its baseline was measured
/// belongs to a scene that was scattered and is compact again, as in the jump from the last frame
/// of a loop to its first: it may be better than its baseline and still 24 times worse than a new
/// one (`auto_follows_boxes_that_scatter_and_meet_again` in `tests/repairs.rs` plays that). Any
/// part from 0.25 to 0.9 passes this test, 0.1 does not (`docs/TUNING.md`).
const COMPACT_AGAIN: f64 = 0.5;

/// A node's part in what a baseline needs: the cost, that of dynamic and of static leaves, the
/// width of leaves, and their number.
fn terms(node: &Node) -> [f64; 5] {
    let term = node.sah_term();
    match (node.count() > 0, node.is_dynamic()) {
        (true, true) => [term, term, 0.0, term.sqrt(), 1.0],
        (true, false) => [term, 0.0, term, term.sqrt(), 1.0],
        (false, _) => [term, 0.0, 0.0, 0.0, 0.0],
    }
}

/// Measures a tree that has no baseline: every inner node keeps its half area, in units of the
/// scale, as its reference. O(n) where there is no baseline, or other primitives are dynamic than
/// before.
pub(crate) fn take_baseline(bvh: &mut Bvh) {
    let Baseline { cost, has_other_dynamic, .. } = State::of(bvh).baseline;
    if cost != 0.0 && has_other_dynamic == 0 {
        return;
    }
    let [all, dynamic_leaves, static_leaves, widths, leaves] = sum(bvh.nodes(), &terms);
    let root = bvh.root().aabb().half_area_f64();
    let parts = parts(bvh);
    let baseline = &mut State::of_mut(parts.state).baseline;
    let sizes = [dynamic_leaves, root];
    if cost != 0.0 {
        baseline.take_sizes(sizes);
        return;
    }
    let per_scale = 1.0 / common_growth(sizes, [1.0; 2]);
    parts.nodes.par_iter_mut().with_min_len(BLOCK).for_each(|node| {
        node.set_reference((f64::from(node.aabb().half_area()) * per_scale) as f32);
    });
    *baseline = Baseline {
        cost: all * per_scale,
        measured: all * per_scale,
        sizes,
        growth: [1.0; 2],
        scale: common_growth(sizes, [1.0; 2]),
        scale_factor: 1.0,
        leaf_uniformity: leaf_uniformity(widths, leaves, dynamic_leaves + static_leaves),
        ..Baseline::default()
    };
}

impl Baseline {
    /// From now on the scale grows as leaves and root of these sizes do. It is what it was, so
    /// references hold, and so is the growth so far: where it began again with each other mask, a
    /// loop of motion would not end on the scale that it began with.
    pub(crate) fn take_sizes(&mut self, [leaves, root]: [f64; 2]) {
        self.sizes = [leaves / or_one(self.growth[0]), root / or_one(self.growth[1])];
        self.scale_factor = or_one(self.scale / common_growth(self.sizes, self.growth));
        self.has_other_dynamic = 0;
    }

    /// Notes how the scene has grown, given the area of its dynamic leaves now; gives its scale.
    pub(crate) fn take_growth(&mut self, root_area: f64, leaf_area: f64) -> f64 {
        let [leaves, root] = self.sizes;
        let growth = |now: f64, first: f64| if first > 0.0 { now / first } else { 1.0 };
        self.growth = [growth(leaf_area, leaves), growth(root_area, root)];
        self.scale = or_one(common_growth(self.sizes, self.growth) * self.scale_factor);
        self.scale
    }

    /// Whether a tree that costs `now`, in units of the scale, shows that the baseline says
    /// nothing: the tree had no cost when it was measured, or far more.
    pub(crate) fn is_void(&self, now: f64) -> bool {
        now > 0.0 && (self.cost == 0.0 || now < COMPACT_AGAIN * self.measured)
    }

    /// What changes of cost are compared with, in units of the scale.
    pub(crate) fn unit(&self) -> f64 {
        self.cost * self.leaf_uniformity.sqrt()
    }

    /// What the tree cost, just after it was measured.
    pub(crate) fn measured_cost(&self) -> f64 {
        self.measured * self.scale
    }

    /// How far a cost, in units of the scale, is above that of a tree as good as the baseline; 0
    /// where that is no number.
    pub(crate) fn excess(&self, cost: f64) -> f64 {
        let excess = (cost - self.cost) / self.unit();
        if self.unit() > 0.0 && excess.is_finite() { excess } else { 0.0 }
    }
}

/// The square of the mean width of leaves, over the mean of their areas; 1 where that is no number.
fn leaf_uniformity(widths: f64, leaves: f64, areas: f64) -> f64 {
    let uniformity = widths * widths / (leaves * areas);
    if uniformity > 0.0 { uniformity.min(1.0) } else { 1.0 }
}

/// Gives the cost of a tree after a pass, in units of the scale of the scene, which it notes. Where
/// areas are beyond the range of `f32`, takes the sums of the pass again.
pub(crate) fn take_cost(bvh: &mut Bvh, tally: &mut Tally) -> f64 {
    if !tally.is_in_range(bvh) {
        let [all, leaves, ..] = sum(bvh.nodes(), &terms);
        (tally.area, tally.leaf_area) = (all - bvh.static_area(), leaves);
    }
    let (cost, root_area) = (tally.area + bvh.static_area(), bvh.root().aabb().half_area_f64());
    let baseline = &mut State::of_mut(parts(bvh).state).baseline;
    cost / baseline.take_growth(root_area, tally.leaf_area)
}

/// Half area of all dynamic leaves, as it was at first, times the growth that leaves and root have
/// in common: that of the one that has changed less, none if one has grown and the other shrunk. 1
/// where that is no area.
fn common_growth([first, _]: [f64; 2], [leaves, root]: [f64; 2]) -> f64 {
    or_one(first * leaves.min(root).max(leaves.max(root).min(1.0)))
}

/// A baseline cost; 0, to be measured again, in the place of one that is not finite.
pub(crate) fn finite_or_zero(cost: f64) -> f64 {
    if cost.is_finite() { cost } else { 0.0 }
}

/// An area to divide by: 1 in the place of one that is no positive number.
fn or_one(area: f64) -> f64 {
    if area > 0.0 && area.is_finite() { area } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::{PartialRebuild, Strategy, Updater};

    #[test]
    fn sums_are_of_the_nodes_in_the_tree_and_the_same_for_any_number_of_threads() {
        let at = |i: usize, k: usize| {
            let seed = (k as u64).rotate_left(32) ^ i as u64;
            fastrand::Rng::with_seed(seed).f32() * 1000.0
        };
        let pose = |frame: usize| -> Vec<Aabb> {
            let corner = |i: usize| Vec3::new(at(i / 4, 8), at(i / 4, 9), at(i, frame) * (frame % 2) as f32);
            (0..10_000).map(corner).map(|corner| Aabb::new(corner, corner + 9.0)).collect()
        };
        let more = [Node::leaf(pose(0)[0], 0, 1); 2000];
        let mut unused = 0;
        for strategy in Strategy::all() {
            let built = build(&pose(0), Builder::Lbvh).expect("few enough");
            let mut bvh = Bvh::new(&[built.nodes(), &more].concat(), built.order().to_vec()).expect("valid");
            bvh.set_dynamic(|p| p % 5 != 0);
            let mut updater = Updater::new(strategy);
            for frame in 1..8 {
                updater.update(&mut bvh, &pose(frame)).expect("same count");
            }
            let (mut expected, mut in_use) = ([0.0; 5], 1);
            bvh.visit(|_, node, _| {
                expected.iter_mut().zip(terms(node)).for_each(|(sum, term)| *sum += term);
                in_use += 1;
            });
            unused += bvh.nodes().len() - in_use;
            let [sums, on_one] = [3, 1].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| sum(bvh.nodes(), &terms))
            });
            for (sum, expected) in sums.into_iter().zip(expected) {
                assert!((sum - expected).abs() <= 1e-12 * expected, "{}: {sum} {expected}", strategy.name());
            }
            assert_eq!(sums.map(f64::to_bits), on_one.map(f64::to_bits));
        }
        assert!(unused > 1000, "{unused} nodes are not in use");
    }

    /// Leaves and root grow and shrink, not quite at the same time, and others are dynamic in each
    /// frame.
    #[test]
    fn the_scale_returns_with_the_motion_whatever_becomes_dynamic() {
        const LOOP: usize = 40;
        let pose = |frame: usize| -> Vec<Aabb> {
            let (sin, cos) = (frame as f32 / LOOP as f32 * std::f32::consts::TAU).sin_cos();
            let corner = |i: usize| Vec3::new(i as f32 * (2.0 + sin), (i % 9) as f32, 0.0);
            (0..300).map(corner).map(|c| Aabb::new(c, c + 2.0 + 0.7 * (sin + cos))).collect()
        };
        let mut bvh = build(&pose(0), Builder::Sweep).expect("few enough");
        let mut updater =
            Updater::new(Strategy::PartialRebuild(PartialRebuild { rotate: None, cost_increase: 1e9 }));
        let scales: Vec<f64> = (0..=10 * LOOP)
            .map(|frame| {
                bvh.set_dynamic(|p| p != frame % 2);
                updater.update(&mut bvh, &pose(frame)).expect("as many");
                State::of(&bvh).baseline.scale
            })
            .collect();
        let drift = scales[10 * LOOP] / scales[0];
        assert!((0.98..1.02).contains(&drift), "{drift}");
        assert!(scales.iter().any(|scale| scale / scales[0] > 1.2), "nothing grows");
    }

    #[test]
    fn the_scale_follows_what_leaves_and_root_have_in_common() {
        let first = [2.0, 100.0];
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
        assert_eq!(common_growth([0.0; 2], [1.0; 2]), 1.0);
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
        assert_eq!(baseline.excess(6.0), 0.5);
        let uneven = Baseline { leaf_uniformity: 0.25, ..baseline };
        assert_eq!(uneven.excess(6.0), 1.0);
        assert_eq!(Baseline::default().excess(6.0), 0.0);
    }
}
