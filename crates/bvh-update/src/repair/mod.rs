//! Partial rebuilds: subtrees that are still good are kept, and the tree above them is built again.
//!
//! ```text
//! frontier(N):  E = frontier(L) + frontier(R) + max(0, M(N) - scale * reference(N))     in post-order
//!               if E > threshold: N is opened, and its children that are not are subtrees to keep
//! ```
//!
//! A node's *reference* is what its measure M was when the node was last built, in units of the scene's scale. Rotations
//! carry references along with the nodes they swap, and leave the reference of the node whose children changed as it is.
//! M is the half area ([`RepairScore::Area`]) or the distance of the children ([`RepairScore::Divergence`]);
//! [`RepairScore::Overlap`] opens nodes in a way of its own.

use bvh_build::{BuildScratch, Builder};
use bvh_core::{Aabb, Bvh, Node, Primitives};

use crate::quality::{TreeCost, area, cost_after, in_units_of, take_baseline};
use crate::rebuild::{RebuildScratch, new_tree, options_like};
use crate::refit::{RefitScratch, Rotate, Tally, parts, pass};
use crate::report::{Decision, Update, UpdateError};
use crate::state::State;

mod divergence;
mod frontier;
mod overlap;
mod top_tree;

use divergence::divergence;
use frontier::FrontierScratch;
use overlap::Overlaps;
use top_tree::NewTop;
pub(crate) use top_tree::rebuild_top;

/// When to build the tree again above subtrees that are still good.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartialRebuild {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Growth of the tree's cost at which it is repaired, as part of that cost. 0.1 by default.
    pub growth: f64,
    /// Which subtrees count as still good.
    pub score: RepairScore,
}

impl Default for PartialRebuild {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), growth: 0.1, score: RepairScore::Area }
    }
}

/// Which nodes are opened, so that the tree above the others is built again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RepairScore {
    /// Nodes whose area has grown, on the scale of the leaves, since they were built.
    Area,
    /// Nodes that overlap others.
    Overlap,
    /// Nodes whose children have moved apart since they were built.
    Divergence,
}

/// A frontier of more than this part of the primitives is not worth its repair.
// 0.3 repairs more and rebuilds less; the time is the same within the noise: `cargo xtask compare frame`.
pub(crate) const LARGEST_FRONTIER: f64 = 0.2;

/// A subtree is opened if its excess is more than this part of the share that an average primitive had in the cost of
/// the tree when it was built.
const OPENED: f64 = 1.0;

/// Memory that repairs keep.
#[derive(Default)]
pub(crate) struct RepairScratch {
    walk: FrontierScratch,
    /// Subtrees to keep, and the pairs of nodes above them.
    frontier: Vec<u32>,
    pairs: Vec<u32>,
    /// Cost of the nodes above them.
    opened: TreeCost,
    overlaps: Overlaps,
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
    refit: &mut RefitScratch,
    repair: &mut RepairScratch,
    rebuild: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    match options.score {
        RepairScore::Area | RepairScore::Overlap => take_baseline(bvh, area),
        RepairScore::Divergence => take_baseline(bvh, divergence),
    }
    let tally = pass(bvh, primitives, options.rotate, refit);
    let cost = cost_after(bvh, &tally);
    let scale = State::of(bvh).baseline.scale_now(bvh, tally.leaf_area);
    let baseline = &mut State::of_mut(parts(bvh).state).baseline;
    baseline.scale = scale;
    let before = baseline.cost;
    if cost / scale <= before * (1.0 + options.growth) {
        return Ok(tally.report(bvh));
    }
    let n = bvh.len() as f64;
    let most = (LARGEST_FRONTIER * n) as usize;
    // An average primitive's part of the cost, when the tree was built.
    let share = before * scale / n;
    let judge = |top: &NewTop| (cost + top.change) / scale;
    let repaired = match options.score {
        RepairScore::Area => open_grown(bvh, &tally, OPENED * share, most, repair),
        RepairScore::Overlap if !overlap::open(bvh.nodes(), share, most, repair) => Repaired::TooLarge,
        RepairScore::Overlap => rebuild_top(bvh, area, scale, most, repair, judge),
        RepairScore::Divergence => {
            frontier::open(bvh, divergence, scale, divergence::OPENED * share, most, repair);
            rebuild_top(bvh, divergence, scale, most, repair, judge)
        }
    };
    match repaired {
        Repaired::Nothing => {
            // Wait until as much is lost again.
            State::of_mut(parts(bvh).state).baseline.cost = in_units_of(cost, scale);
            Ok(tally.report(bvh))
        }
        Repaired::Top { subtrees } => {
            let decision = Decision::PartialRebuild { subtrees };
            // The cost is not known for free.
            Ok(Update { decision, sah_cost: None, ..tally.report(bvh) })
        }
        Repaired::TooLarge => {
            let options = options_like(bvh);
            let update = new_tree(bvh, primitives, Builder::Ploc, &options, rebuild)?;
            Ok(Update { decision: Decision::Rebuild { builder: Builder::Ploc }, ..update })
        }
    }
}

/// Builds the tree again above the subtrees whose excess of area is at most `threshold`, if there are at most `most` of
/// them, after a pass that has found this.
pub(crate) fn open_grown(
    bvh: &mut Bvh,
    tally: &Tally,
    threshold: f64,
    most: usize,
    scratch: &mut RepairScratch,
) -> Repaired {
    let baseline = State::of(bvh).baseline;
    let scale = baseline.scale_now(bvh, tally.leaf_area);
    let references = frontier::open(bvh, area, scale, threshold, most, scratch);
    rebuild_top(bvh, area, scale, most, scratch, |top| {
        // Leaves have no references.
        references + top.references + (tally.leaf_area + baseline.sizes[2]) / scale
    })
}
