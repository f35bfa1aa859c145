//! Partial rebuilds: subtrees that are still good are kept, and the tree above them is built again.
//!
//! ```text
//! frontier(N):  E = frontier(L) + frontier(R) + max(0, A(N) - scale * reference(N))     in post-order, for dynamic N
//!               if E > threshold: N is opened, and its children that are not are subtrees to keep
//! ```
//!
//! A node's *reference* is what its half area A was when the node was last built, in units of the
//! scene's scale. Rotations carry references along with the nodes they swap, and leave the
//! reference of the node whose children changed as it is.

use bvh_build::{BuildScratch, Builder};
use bvh_core::{Aabb, Bvh, Node, Primitives};

use crate::quality::{finite_or_zero, take_baseline, take_cost};
use crate::rebuild::{RebuildScratch, build_again};
use crate::refit::{PassOptions, Rotate, Tally, parts, pass};
use crate::report::{Decision, Update, UpdateError};
use crate::state::{Measure, State};

mod frontier;
mod top_tree;

use frontier::FrontierScratch;
use top_tree::rebuild_top;

/// When to build the tree again above subtrees that are still good.
///
/// A tree whose cost falls below half of its baseline, as where a scattered scene is compact again,
/// is built again as a whole, whatever `cost_increase` is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PartialRebuild {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Increase of the tree's cost at which it is repaired, as part of that cost. 0.1 by default.
    pub cost_increase: f64,
}

bvh_core::with_methods!(PartialRebuild: with_rotate(rotate: Option<Rotate>), with_cost_increase(cost_increase: f64));

impl Default for PartialRebuild {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), cost_increase: 0.1 }
    }
}

/// A frontier of more than this part of the primitives is not worth its repair.
// Half and double: docs/TUNING.md.
const LARGEST_FRONTIER: f64 = 0.2;

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct RepairScratch {
    walk: FrontierScratch,
    boxes: Vec<Aabb>,
    kept: Vec<Node>,
    top: Bvh,
    build: BuildScratch,
}

/// What a repair did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Repaired {
    /// A new top stands above this number of subtrees.
    Top { subtrees: usize },
    /// The old top was as good.
    Nothing,
    /// There would be too many subtrees, or the tree might get too high: nothing was changed.
    TooLarge,
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &PartialRebuild,
    passes: &mut PassOptions,
    repair: &mut RepairScratch,
    rebuild: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    State::of_mut(parts(bvh).state).expect_measure(Measure::AREAS);
    passes.with_sums = true;
    take_baseline(bvh);
    let mut tally = pass(bvh, primitives, options.rotate, passes);
    let cost = take_cost(bvh, &mut tally);
    let baseline = State::of(bvh).baseline;
    if baseline.is_void(finite_or_zero(cost)) {
        return build_again(bvh, primitives, Builder::Ploc, rebuild);
    }
    if cost <= baseline.cost * (1.0 + options.cost_increase) {
        return Ok(tally.report(bvh));
    }
    let n = bvh.len() as f64;
    let (threshold, most) = (baseline.cost * baseline.scale / n, (LARGEST_FRONTIER * n) as usize);
    // Opened is what exceeds an average primitive's part of the cost when the tree was built.
    match open_costly(bvh, &mut tally, threshold, most, repair) {
        Repaired::Nothing => {
            // Wait until as much is lost again.
            State::of_mut(parts(bvh).state).baseline.cost = finite_or_zero(cost);
            Ok(Update { decision: Decision::Unrepaired, ..tally.report(bvh) })
        }
        Repaired::Top { subtrees } => {
            Ok(Update { decision: Decision::PartialRebuild { subtrees }, ..tally.report(bvh) })
        }
        Repaired::TooLarge => build_again(bvh, primitives, Builder::Ploc, rebuild),
    }
}

/// Builds the tree again above the subtrees whose excess of area is at most `threshold`, if there
/// are at most `most` of them, after a pass that has found this. The cost of the tree is then no
/// longer that of the pass.
pub(crate) fn open_costly(
    bvh: &mut Bvh,
    tally: &mut Tally,
    threshold: f64,
    most: usize,
    scratch: &mut RepairScratch,
) -> Repaired {
    let scale = State::of(bvh).baseline.scale;
    frontier::find(bvh, scale, threshold, most, &mut scratch.walk);
    // Leaves and what stands still below the new top count as what they cost now.
    let others = (tally.leaf_area + bvh.static_area() - scratch.walk.top.found.static_cost) / scale;
    let repaired = rebuild_top(bvh, others, scale, most, scratch);
    tally.has_sums &= !matches!(repaired, Repaired::Top { .. });
    repaired
}
