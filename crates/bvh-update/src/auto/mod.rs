//! The strategy that chooses, so that updates and queries together take the least time.
//!
//! ```text
//! builder = decide_blindly(ledger)      chaos: a new tree, no pass
//! seen    = pass(tree, primitives)      refit and rotate, and note what that shows
//! ledger.charge(seen)                   what queries lose to this tree
//! plan    = decide(ledger, seen)        pure: policy.rs
//! outcome = execute(plan)               a new top, a new tree, leaves merged or split, or nothing
//! ledger learns from the outcome
//! ```
//!
//! The ledger lies in the tree, so a clone goes on as the original would. Work is priced by constants (`cost_model.rs`), and
//! queries by what the caller says of them ([`Load`]), so decisions are reproducible.

use bvh_build::Builder;
use bvh_core::{Bvh, Primitives};

use crate::leaves::{LONGEST, LeafScratch, change_leaves};
use crate::quality::{cost_after, cost_of, in_units_of, take_baseline};
use crate::rebuild::{RebuildScratch, new_tree, options_like};
use crate::refit::{RefitScratch, Rotate, RotationSchedule, Tally, parts, pass};
use crate::repair::{RepairScratch, Repaired, open_grown};
use crate::report::{Decision, Update, UpdateError};
use crate::state::{Baseline, Ledger, State};

mod cost_model;
mod policy;

pub use cost_model::Load;
use cost_model::QueryCost;
use policy::{Observation, Plan, decide, decide_blindly, pays_every_frame, reason};

/// Settings of [`Strategy::Auto`](crate::Strategy::Auto).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Auto {
    /// What will be asked of the tree before the next update; by default two rays in coherent packets for each pixel of
    /// 1024 x 1024. [`Updater::report`](crate::Updater::report) changes it from frame to frame.
    pub load: Load,
}

impl Default for Auto {
    fn default() -> Self {
        Self { load: Load::PacketRays(2 << 20) }
    }
}

/// A tree whose cost falls to this part of its baseline in one frame is of a scene that was scattered and has gathered, as in
/// the jump from the last frame of a loop to its first: it may be better than its baseline and still 24 times worse than a new
/// one (`auto_merges_leaves_where_it_is_calm` in `tests/repairs.rs` plays that).
const GATHERED: f64 = 0.5;

/// The memory of what `Auto` may do.
pub(crate) struct AutoScratch<'a> {
    pub(crate) refit: &'a mut RefitScratch,
    pub(crate) repair: &'a mut RepairScratch,
    pub(crate) rebuild: &'a mut RebuildScratch,
    pub(crate) leaves: &'a mut LeafScratch,
}

/// Updates a tree; `last_excess` is that of the tree which a measured load was measured in.
pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    auto: &Auto,
    last_excess: f64,
    scratch: &mut AutoScratch<'_>,
) -> Result<Update, UpdateError> {
    let count = bvh.len() as f64;
    let queries = QueryCost::new(auto.load, count, last_excess);
    let is_another_number = primitives.len() != bvh.len();
    let frames = State::of(bvh).ledger.since_repair;
    let other = is_another_number.then(|| queries.builder(primitives.len() as f64, frames));
    if let Some(builder) = other.or_else(|| decide_blindly(&State::of(bvh).ledger, count, queries)) {
        return rebuild(bvh, primitives, builder, None, scratch);
    }
    take_baseline(bvh);
    let mut tally = pass(bvh, primitives, Some(Rotate::default()), scratch.refit);
    let seen = observe(bvh, &tally, queries);
    let ledger = &mut State::of_mut(parts(bvh).state).ledger;
    ledger.charge(&seen);
    let (plan, reason) = (decide(ledger, &seen), reason(ledger, &seen));
    let update = execute(plan, bvh, primitives, &seen, &mut tally, scratch)?;
    Ok(Update { reason: Some(reason), ..update })
}

/// What a pass shows of a tree; notes its scale and, where the tree has become better, its baseline.
fn observe(bvh: &mut Bvh, tally: &Tally, queries: QueryCost) -> Observation {
    let (before, cost) = (*State::of(bvh), cost_after(bvh, tally));
    let scale = before.baseline.scale_now(bvh, tally.leaf_area);
    let state = State::of_mut(parts(bvh).state);
    let (baseline, ledger) = (&mut state.baseline, &mut state.ledger);
    let now = in_units_of(cost, scale);
    baseline.scale = scale;
    let has_no_baseline = now > 0.0 && (baseline.cost == 0.0 || now < GATHERED * baseline.measured);
    if now > 0.0 {
        baseline.cost = if baseline.cost == 0.0 { now } else { baseline.cost.min(now) };
    }
    // Leaves that are not merged grow by themselves.
    let (leaf_area, is_merged) = (tally.leaf_area / scale, before.spare_pair > 0 && ledger.leaf_area > 0.0);
    ledger.leaf_area = if is_merged { ledger.leaf_area.min(leaf_area) } else { leaf_area };
    let unit = before.baseline.unit(scale);
    let growth = (leaf_area - ledger.leaf_area) * scale / unit;
    Observation {
        primitives: bvh.len() as f64,
        nodes: (tally.leaves + tally.inner) as f64,
        excess: before.baseline.excess(cost, scale),
        leaf_growth: if unit > 0.0 { growth } else { 0.0 },
        has_no_baseline,
        queries,
    }
}

/// Does what was decided, and keeps the ledger of it.
fn execute<P: Primitives + ?Sized>(
    plan: Plan,
    bvh: &mut Bvh,
    primitives: &P,
    seen: &Observation,
    tally: &mut Tally,
    scratch: &mut AutoScratch<'_>,
) -> Result<Update, UpdateError> {
    let decision = match plan {
        Plan::Keep => Decision::AsAlways,
        Plan::Rebuild(builder) => return rebuild(bvh, primitives, builder, Some((tally, seen)), scratch),
        Plan::ChangeLeaves { period } => {
            let is_changed = step_leaves(period, bvh, primitives, seen, tally, scratch.leaves);
            match (is_changed, plan.splits()) {
                (false, _) => Decision::AsAlways,
                (true, false) => Decision::MergeLeaves,
                (true, true) => Decision::SplitLeaves,
            }
        }
        Plan::Repair { threshold, most, or_rebuild } => {
            let baseline: Baseline = State::of(bvh).baseline;
            let repaired =
                open_grown(bvh, tally, threshold * baseline.unit(baseline.scale), most, scratch.repair);
            let ledger = &mut State::of_mut(parts(bvh).state).ledger;
            match (repaired, or_rebuild) {
                (Repaired::Top { subtrees }, _) => {
                    ledger.repaired(subtrees);
                    let decision = Decision::PartialRebuild { subtrees };
                    // The cost is not known for free.
                    return Ok(Update { decision, sah_cost: None, ..tally.report(bvh) });
                }
                (Repaired::TooLarge | Repaired::Nothing, Some(builder)) => {
                    return rebuild(bvh, primitives, builder, Some((tally, seen)), scratch);
                }
                (Repaired::TooLarge, None) => ledger.is_beyond_repair = 1,
                (Repaired::Nothing, None) => ledger.repair.failed(),
            }
            Decision::AsAlways
        }
    };
    Ok(Update { decision, ..tally.report(bvh) })
}

/// Builds a new tree; after a pass, what that found says whether the new tree is better, and whether it came soon.
fn rebuild<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    after_pass: Option<(&Tally, &Observation)>,
    scratch: &mut AutoScratch<'_>,
) -> Result<Update, UpdateError> {
    let before = State::of(bvh).ledger;
    let cost_before = after_pass.map(|(tally, _)| cost_after(bvh, tally));
    // Another number of primitives says nothing of the trees before.
    let is_same_number = primitives.len() == bvh.len();
    let is_soon = after_pass.map_or(is_same_number, |(_, seen)| pays_every_frame(&before, seen));
    let options = options_like(bvh);
    let update = new_tree(bvh, primitives, builder, &options, scratch.rebuild)?;
    let is_better = cost_before.map(|before| cost_of(bvh) < before);
    State::of_mut(parts(bvh).state).ledger = Ledger::rebuilt(&before, builder, is_better, is_soon);
    Ok(Update { decision: Decision::Rebuild { builder }, ..update })
}

/// Merges or splits the leaves whose turn it is; whether any had to be.
fn step_leaves<P: Primitives + ?Sized>(
    period: u32,
    bvh: &mut Bvh,
    primitives: &P,
    seen: &Observation,
    tally: &mut Tally,
    scratch: &mut LeafScratch,
) -> bool {
    // New trees are to have leaves as they were.
    options_like(bvh);
    let State { ledger, baseline, .. } = *State::of(bvh);
    let (scale, unit) = (baseline.scale, baseline.unit(baseline.scale));
    let schedule = RotationSchedule::new(Rotate { period }, ledger.leaf_turn);
    let change = change_leaves(bvh, primitives, schedule, LONGEST as u32, scale, scratch);
    let leaves_before = tally.leaf_area;
    tally.area += change.all;
    tally.leaf_area += change.leaves;
    let State { ledger, baseline, .. } = State::of_mut(parts(bvh).state);
    baseline.leaves_changed(tally.leaf_area / leaves_before);
    ledger.leaf_area = (ledger.leaf_area + change.leaves / scale).max(0.0);
    ledger.leaves_changed(period, -change.all / unit, seen);
    change.all != 0.0
}
