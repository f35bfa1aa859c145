//! The strategy that chooses, so that updates and queries together take the least time.
//!
//! ```text
//! builder = decide_blindly(ledger)      chaos: a new tree, no pass
//! seen    = pass(tree, primitives)      refit, rotate, and measure cost and scale
//! ledger.charge(seen)                   what queries lose to this tree
//! plan    = decide(ledger, seen)        pure: policy.rs
//! outcome = execute(plan)               a new top, a new tree, or nothing, where neither costs less
//! ledger learns from the outcome
//! ```
//!
//! The ledger lies in the tree, so a clone goes on as the original would. Work is priced by
//! constants (`cost_model.rs`), and queries by what the caller says of them ([`Load`]), so
//! decisions are reproducible.

use bvh_build::Builder;
use bvh_core::{Bvh, Primitives};

use crate::quality::{finite_or_zero, take_baseline, take_cost};
use crate::rebuild::{build_again, build_beside};
use crate::refit::{Rotate, Tally, parts, pass};
use crate::repair::{Repaired, open_grown};
use crate::report::{Decision, Update, UpdateError};
use crate::state::{Baseline, Ledger, Measure, State};
use crate::workspace::Workspace;

mod cost_model;
mod policy;

pub use cost_model::Load;
use cost_model::QueryCost;
use policy::{LEAST_GAIN, Observation, Plan, decide, decide_blindly, pays_every_frame};

/// Settings of [`Strategy::Auto`](crate::Strategy::Auto).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Auto {
    /// What will be asked of the tree before the next update; by default two rays in coherent
    /// packets for each pixel of 1024 x 1024. [`Updater::report`](crate::Updater::report) changes
    /// it from frame to frame. This default makes `Auto` rebuild a tree of a few thousand
    /// primitives often, so callers should report what they ask of such a tree.
    // Not derived from anything. Half and double: docs/TUNING.md, prices of loads.
    pub load: Load,
}

impl Default for Auto {
    fn default() -> Self {
        Self { load: Load::PacketRays(2 << 20) }
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    auto: &Auto,
    workspace: &mut Workspace,
) -> Result<Update, UpdateError> {
    State::of_mut(parts(bvh).state).expect_measure(Measure::AREAS);
    workspace.passes.with_sums = true;
    let Ledger { last_excess, frames, .. } = State::of(bvh).ledger;
    let count = primitives.len() as f64;
    let queries = QueryCost::new(auto.load, count, last_excess);
    let is_another_number = primitives.len() != bvh.len();
    let other = is_another_number.then(|| queries.builder(count, frames));
    if let Some(builder) = other.or_else(|| decide_blindly(&State::of(bvh).ledger, count, queries)) {
        return rebuild(bvh, primitives, builder, None, workspace);
    }
    take_baseline(bvh);
    let mut tally = pass(bvh, primitives, Some(Rotate::default()), &workspace.passes);
    let seen = observe(bvh, &mut tally, queries);
    let ledger = &mut State::of_mut(parts(bvh).state).ledger;
    ledger.charge(&seen);
    let (plan, reason) = decide(ledger, &seen);
    let update = execute(plan, bvh, primitives, &seen, &mut tally, workspace)?;
    Ok(Update { reason: Some(reason), ..update })
}

/// Notes the scale of the scene and the least cost of the tree, and gives what `decide` needs.
///
/// The excess is that over the baseline before: a tree that is better than any so far has one below
/// 0.
fn observe(bvh: &mut Bvh, tally: &mut Tally, queries: QueryCost) -> Observation {
    let (cost, primitives) = (take_cost(bvh, tally), bvh.len() as f64);
    let root_area = bvh.root().aabb().half_area_f64();
    let State { baseline, ledger, .. } = State::of_mut(parts(bvh).state);
    let scale = baseline.take_growth(root_area, tally.leaf_area);
    let now = finite_or_zero(cost / scale);
    ledger.last_excess = baseline.excess(cost, scale);
    let has_void_baseline = baseline.is_void(now);
    if now > 0.0 {
        baseline.cost = if baseline.cost == 0.0 { now } else { baseline.cost.min(now) };
    }
    Observation {
        primitives,
        nodes: (tally.leaves + tally.inner) as f64,
        excess: ledger.last_excess,
        has_void_baseline,
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
    workspace: &mut Workspace,
) -> Result<Update, UpdateError> {
    let decision = match plan {
        Plan::Keep => Decision::AsAlways,
        Plan::Rebuild(builder) => return rebuild(bvh, primitives, builder, Some((tally, seen)), workspace),
        Plan::Repair { threshold, most, or_rebuild } => {
            let baseline: Baseline = State::of(bvh).baseline;
            let repaired = open_grown(
                bvh,
                tally,
                threshold * baseline.unit(baseline.scale),
                most,
                &mut workspace.repair,
            );
            let ledger = &mut State::of_mut(parts(bvh).state).ledger;
            match (repaired, or_rebuild) {
                (Repaired::Top { subtrees }, _) => {
                    ledger.repaired(subtrees);
                    return Ok(Update {
                        decision: Decision::PartialRebuild { subtrees },
                        ..tally.report(bvh)
                    });
                }
                (Repaired::TooLarge | Repaired::Nothing, Some(builder)) => {
                    return rebuild(bvh, primitives, builder, Some((tally, seen)), workspace);
                }
                (Repaired::TooLarge, None) => ledger.is_beyond_repair = 1,
                (Repaired::Nothing, None) => ledger.repair.failed(),
            }
            Decision::Unrepaired
        }
    };
    Ok(Update { decision, ..tally.report(bvh) })
}

/// Builds a new tree. After a pass it is built beside the old one, which stays unless the new one
/// costs less by [`LEAST_GAIN`]: on two of five inputs trees were worse without that
/// (`docs/ABLATION.md`).
fn rebuild<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    after_pass: Option<(&Tally, &Observation)>,
    Workspace { rebuild: scratch, .. }: &mut Workspace,
) -> Result<Update, UpdateError> {
    // Another number of primitives says nothing of the trees before.
    let is_same_number = primitives.len() == bvh.len();
    let before = if is_same_number { State::of(bvh).ledger } else { Ledger::default() };
    let Some((tally, seen)) = after_pass else {
        let update = build_again(bvh, primitives, builder, scratch)?;
        State::of_mut(parts(bvh).state).ledger = Ledger::rebuilt(&before, builder, is_same_number);
        return Ok(update);
    };
    let update = build_beside(bvh, primitives, builder, scratch)?;
    let [new_cost, old_cost] = [&mut scratch.beside, &mut *bvh].map(|tree| {
        State::of_mut(parts(tree).state).baseline = Baseline::default();
        take_baseline(tree);
        State::of(tree).baseline.measured_cost()
    });
    if new_cost >= (1.0 - LEAST_GAIN) * old_cost {
        State::of_mut(parts(bvh).state).ledger = Ledger::kept_old_tree(&before, builder);
        return Ok(Update { decision: Decision::Kept { builder }, ..tally.report(bvh) });
    }
    std::mem::swap(bvh, &mut scratch.beside);
    let is_soon = pays_every_frame(&before, seen);
    State::of_mut(parts(bvh).state).ledger = Ledger::rebuilt(&before, builder, is_soon);
    Ok(update)
}
