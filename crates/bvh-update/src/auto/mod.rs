//! The strategy that chooses, so that updates and queries together take the least time.
//!
//! ```text
//! builder = decide_blindly(ledger)   chaos: a new tree, no pass
//! tally   = pass(tree, primitives)   refit and rotate, with sums of areas
//! seen    = observe(tree, tally)     the excess over the baseline, which falls if the tree got better
//! ledger.charge(seen)                what queries lose to this tree
//! plan    = decide(ledger, seen)     pure: policy.rs
//! outcome = execute(plan)            a new top, a new tree, or nothing, where neither costs less
//! ledger  = ledger.after(outcome)
//! ```
//!
//! The ledger lies in the tree, so a clone goes on as the original would. Work is priced by
//! constants (`cost_model.rs`), and queries by what the caller says of them ([`Load`]), so
//! decisions are reproducible.

use bvh_core::{Bvh, Primitives};

use crate::quality::{finite_or_zero, take_baseline, take_cost};
use crate::rebuild::{build_again, build_beside};
use crate::refit::{Rotate, Tally, parts, pass};
use crate::repair::{Repaired, open_costly};
use crate::report::{Decision, Update, UpdateError};
use crate::state::{Baseline, Ledger, Measure, State};
use crate::workspace::Workspace;

mod cost_model;
mod policy;

pub use cost_model::Load;
use cost_model::QueryCost;
use policy::{Observation, Outcome, Plan, Rebuild};
use policy::{decide, decide_blindly, is_hardly_better, pays_every_frame};

/// Settings of [`Strategy::Auto`](crate::Strategy::Auto).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Auto {
    /// What will be asked of the tree before the next update; by default two rays in coherent
    /// packets for each pixel of 1024 x 1024. [`Updater::report`](crate::Updater::report) changes
    /// it from frame to frame. This default makes `Auto` rebuild a tree of a few thousand
    /// primitives often, so callers should report what they ask of such a tree.
    // Not derived from anything. Half and double: docs/TUNING.md, prices of loads.
    pub load: Load,
}

bvh_core::with_methods!(Auto: with_load(load: Load));

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
    let mut ledger = State::of(bvh).ledger;
    let count = primitives.len() as f64;
    let queries = QueryCost::new(auto.load, count, ledger.last_excess);
    let is_another_number = primitives.len() != bvh.len();
    let other = is_another_number.then(|| queries.builder(count, ledger.frames));
    let (outcome, update) = if let Some(builder) = other.or_else(|| decide_blindly(&ledger, count, queries)) {
        let update = build_again(bvh, primitives, builder, &mut workspace.rebuild)?;
        // Another number of primitives says nothing of the trees before.
        ledger = if is_another_number { Ledger::default() } else { ledger };
        (Outcome::Rebuilt { builder, is_soon: !is_another_number }, update)
    } else {
        take_baseline(bvh);
        let mut tally = pass(bvh, primitives, Some(Rotate::default()), &workspace.passes);
        let seen = observe(bvh, &mut tally, queries);
        // In the tree, since a build may fail.
        State::of_mut(parts(bvh).state).ledger.charge(&seen);
        ledger = State::of(bvh).ledger;
        execute(decide(&ledger, &seen), bvh, primitives, &seen, &mut tally, workspace)?
    };
    State::of_mut(parts(bvh).state).ledger = ledger.after(outcome);
    Ok(update)
}

/// Notes the scale of the scene and the least cost of the tree, and gives what `decide` needs.
///
/// The excess is that over the baseline before: a tree that is better than any so far has one below
/// 0.
fn observe(bvh: &mut Bvh, tally: &mut Tally, queries: QueryCost) -> Observation {
    let (cost, primitives) = (take_cost(bvh, tally), bvh.len() as f64);
    let State { baseline, ledger, .. } = State::of_mut(parts(bvh).state);
    ledger.last_excess = baseline.excess(cost);
    let has_void_baseline = baseline.is_void(finite_or_zero(cost));
    if finite_or_zero(cost) > 0.0 {
        baseline.cost = if baseline.cost == 0.0 { cost } else { baseline.cost.min(cost) };
    }
    Observation {
        primitives,
        nodes: (tally.leaves + tally.inner) as f64,
        excess: ledger.last_excess,
        has_void_baseline,
        queries,
    }
}

/// Does what was decided.
fn execute<P: Primitives + ?Sized>(
    plan: Plan,
    bvh: &mut Bvh,
    primitives: &P,
    seen: &Observation,
    tally: &mut Tally,
    workspace: &mut Workspace,
) -> Result<(Outcome, Update), UpdateError> {
    let (outcome, decision, reason) = match plan {
        Plan::Keep(reason) => (Outcome::Nothing, Decision::AsAlways, reason),
        Plan::Rebuild(new) => return rebuild_if_better(new, bvh, primitives, seen, tally, workspace),
        Plan::Repair { threshold, most, reason, or_rebuild } => {
            let baseline: Baseline = State::of(bvh).baseline;
            let threshold = threshold * baseline.unit() * baseline.scale;
            match (open_costly(bvh, tally, threshold, most, &mut workspace.repair), or_rebuild) {
                (top @ Repaired::Top { subtrees }, _) => {
                    (Outcome::Repair(top), Decision::PartialRebuild { subtrees }, reason)
                }
                (_, Some(new)) => return rebuild_if_better(new, bvh, primitives, seen, tally, workspace),
                (none, None) => (Outcome::Repair(none), Decision::Unrepaired, reason),
            }
        }
    };
    Ok((outcome, Update { decision, reason: Some(reason), ..tally.report(bvh) }))
}

/// Builds a new tree beside the old one, which stays if the new one is hardly better.
fn rebuild_if_better<P: Primitives + ?Sized>(
    (builder, reason): Rebuild,
    bvh: &mut Bvh,
    primitives: &P,
    seen: &Observation,
    tally: &Tally,
    Workspace { rebuild: scratch, .. }: &mut Workspace,
) -> Result<(Outcome, Update), UpdateError> {
    let is_soon = pays_every_frame(&State::of(bvh).ledger, seen);
    let update = build_beside(bvh, primitives, builder, scratch)?;
    let [new_cost, old_cost] = [&mut scratch.beside, &mut *bvh].map(|tree| {
        State::of_mut(parts(tree).state).baseline = Baseline::default();
        take_baseline(tree);
        State::of(tree).baseline.measured_cost()
    });
    let (outcome, update) = if is_hardly_better(new_cost, old_cost) {
        (Outcome::Kept(builder), Update { decision: Decision::Kept { builder }, ..tally.report(bvh) })
    } else {
        std::mem::swap(bvh, &mut scratch.beside);
        (Outcome::Rebuilt { builder, is_soon }, update)
    };
    Ok((outcome, Update { reason: Some(reason), ..update }))
}
