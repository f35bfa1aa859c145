//! What to do about a tree: a pure function of what was lost so far and what a pass has seen.
//!
//! Repairs and rebuilds each have an account of what was lost since the last one
//! ([`SkiRental`](crate::ski_rental::SkiRental)), and are due once that exceeds their price:
//!
//! ```text
//! a new top         lost: excess of the tree over its baseline      price: finding the frontier, building the top
//! a new tree        lost: the same, and what a fast build costs     price: a build
//! ```

use bvh_build::Builder;

use super::cost_model::{self, QueryCost, TOP_SUBTREE};
use crate::repair::Repaired;
use crate::report::Reason;
use crate::ski_rental::SkiRental;
use crate::state::Ledger;

/// One in this many rebuilds in a row is made after a pass that looks whether it is needed. Without
/// the looks chaos that ends leaves bart-museum with trees of up to 1.27 times the cost of a new
/// one (`docs/ABLATION.md`, periodic looks). With 8, 32 and 64 trees cost
/// 1.01, 1.08 and 1.15 of a new one there, for 1.05, and frames take as long within the noise
/// (`docs/TUNING.md`).
const LOOK_AGAIN: u32 = 16;
/// Rebuilds in a row after which the next ones are blind: one may be chance. With 1 and 4
/// frames take as long within the noise (`docs/TUNING.md`).
const BLIND_AFTER: u32 = 2;
/// A subtree is opened if that pays within the frames since the last repair, but at most within
/// this many. With 8 and the rules of then, `auto` took 1.11 times as long as the best single
/// strategy on exploding-dragon, now 1.03 (Zen 4, 14e2b80, 2026-11-23: `cargo xtask compare frame
/// --scene exploding-dragon --frames 24 --threads 2`).
const LONGEST_PAYBACK: u32 = 32;
/// A new tree has to cost less than the old one by this part to take its place: on two of five
/// inputs trees were worse without that. `docs/ABLATION.md` has that and another value.
const LEAST_GAIN: f64 = 0.02;

/// What a pass has seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub(super) primitives: f64,
    /// Nodes visited: the dynamic ones.
    pub(super) nodes: f64,
    /// How far the cost is above the baseline, in its units (`quality/mod.rs`).
    pub(super) excess: f64,
    /// Whether the baseline says nothing: the tree had no cost when it was built, or far more than
    /// now.
    pub(super) has_void_baseline: bool,
    pub(super) queries: QueryCost,
}

impl Observation {
    /// The builder for a new tree now, and what that costs.
    fn rebuild(&self, ledger: &Ledger) -> (Builder, f64) {
        let builder = self.queries.builder(self.primitives, ledger.frames);
        (builder, cost_model::rebuild(builder, self.primitives))
    }
}

/// A tree to build, and why.
pub(super) type Rebuild = (Builder, Reason);

/// What is to be done, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Plan {
    Keep(Reason),
    /// Build the tree again above the subtrees whose excess is at most `threshold`, in the same
    /// units as that of the tree. If there are more than `most`, or none is above it, build a new
    /// tree, if one is due as well; else the tree stays, and one with too many is beyond repair
    /// until it is rebuilt.
    Repair {
        threshold: f64,
        most: usize,
        reason: Reason,
        or_rebuild: Option<Rebuild>,
    },
    Rebuild(Rebuild),
}

/// What came of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    Nothing,
    /// A repair was tried.
    Repair(Repaired),
    /// A new tree took the place of the old one; if soon, it is in a row with the rebuild before.
    Rebuilt {
        builder: Builder,
        is_soon: bool,
    },
    /// A new tree is hardly better than the old one, which counts as good as by that builder from
    /// now on.
    Kept(Builder),
}

/// The builder of a tree that is built without a pass before, since trees were bad again at once:
/// after [`BLIND_AFTER`] rebuilds in a row, each soon enough that one in every frame is cheaper,
/// but for a look now and then.
pub(super) fn decide_blindly(ledger: &Ledger, primitives: f64, queries: QueryCost) -> Option<Builder> {
    let row = ledger.rebuilds_in_a_row;
    (row >= BLIND_AFTER && !row.is_multiple_of(LOOK_AGAIN)).then(|| queries.builder(primitives, 1))
}

/// Whether a new tree in every frame costs less than passes and a new tree now and then.
///
/// ```text
/// rate  = 2 lost / (k (k + 1))            the loss grows linearly over k frames
/// cycle = pass + sqrt(2 price rate)       per frame, if a tree is rebuilt as soon as as much is lost as that costs
/// ```
pub(super) fn pays_every_frame(ledger: &Ledger, seen: &Observation) -> bool {
    let (_, price_of_rebuild) = seen.rebuild(ledger);
    let frames = f64::from(ledger.frames.max(1));
    let rate = 2.0 * ledger.repair.lost() / (frames * (frames + 1.0));
    let cycle = cost_model::pass(seen.nodes) + (2.0 * price_of_rebuild * rate).sqrt();
    cycle > seen.queries.rebuild_every_frame(seen.primitives)
}

/// Whether a new tree after a pass costs so little less than the old one that this stays.
pub(super) fn is_hardly_better(new_cost: f64, old_cost: f64) -> bool {
    new_cost >= (1.0 - LEAST_GAIN) * old_cost
}

/// What to do after a pass, with its losses already charged. Where nothing is due, the reason is
/// that of a new top, or of a new tree where the top is beyond repair.
///
/// An example: a tree over 100,000 triangles costs 9 % more than it did, and the load is two packet
/// rays for each of a million pixels. Each frame loses 2^21 rays * 25 ns * 0.4 * 0.09 = 1.9 ms. A
/// new top costs 200,000 nodes * 9 ns and 6,000 subtrees * 400 ns, which is 4.2 ms: it is due in
/// the third frame. At twice the cost a frame loses 21 ms: a new top is due at once, and a new tree
/// at 100,000 triangles * 85 ns as well. Then the top is tried first, and a tree is built if there
/// is no such top, or none that costs less.
pub(super) fn decide(ledger: &Ledger, seen: &Observation) -> Plan {
    let because = |account: SkiRental, price: f64| {
        let [lost_ms, price_ms] = [account.lost(), price * account.patience()].map(|ns| 1e-6 * ns);
        Reason { lost_ms, price_ms, excess: seen.excess }
    };
    let (builder, price_of_rebuild) = seen.rebuild(ledger);
    let rebuild = (builder, because(ledger.rebuild, price_of_rebuild));
    let is_rebuild_due = ledger.rebuild.is_due(price_of_rebuild);
    let [is_beyond_repair, is_fast] = [ledger.is_beyond_repair != 0, ledger.is_fast_build != 0];
    if seen.has_void_baseline || (is_rebuild_due && (is_beyond_repair || is_fast)) {
        return Plan::Rebuild(rebuild);
    }
    if is_beyond_repair {
        return Plan::Keep(rebuild.1);
    }
    let price_of_repair = cost_model::repair(seen.nodes, ledger.subtrees);
    let reason = because(ledger.repair, price_of_repair);
    if !ledger.repair.is_due(price_of_repair) {
        return Plan::Keep(reason);
    }
    let frames = f64::from(ledger.frames.clamp(1, LONGEST_PAYBACK)) * ledger.repair.patience();
    let threshold = TOP_SUBTREE / (seen.queries.lost(1.0) * frames);
    let most = cost_model::most_subtrees(seen.nodes, cost_model::rebuild(Builder::Ploc, seen.primitives));
    Plan::Repair { threshold, most, reason, or_rebuild: is_rebuild_due.then_some(rebuild) }
}

impl Ledger {
    /// Charges what this frame loses.
    pub(super) fn charge(&mut self, seen: &Observation) {
        self.repair.charge(seen.queries.lost(seen.excess));
        self.rebuild.charge(seen.queries.lost(seen.excess));
        // A fast build in the place of a fast build gains nothing.
        if self.is_fast_build != 0 && seen.queries.builder(seen.primitives, self.frames) != Builder::Lbvh {
            self.rebuild.charge(seen.queries.lost_to_fast_build());
        }
        self.frames = self.frames.saturating_add(1);
    }

    /// The ledger after what came of a plan. After what brought nothing, the same waits for twice
    /// its price.
    pub(super) fn after(self, outcome: Outcome) -> Self {
        let new = Self { subtrees: self.subtrees, ..Self::default() };
        let is_fast = |builder| u32::from(builder == Builder::Lbvh);
        match outcome {
            Outcome::Nothing => self,
            Outcome::Repair(Repaired::Top { subtrees }) => {
                Self { subtrees: subtrees as u32, is_fast_build: self.is_fast_build, ..new }
            }
            Outcome::Repair(Repaired::Nothing) => Self { repair: SkiRental::FAILED, ..self },
            Outcome::Repair(Repaired::TooLarge) => Self { is_beyond_repair: 1, ..self },
            Outcome::Rebuilt { builder, is_soon } => {
                let rebuilds_in_a_row = if is_soon { self.rebuilds_in_a_row.wrapping_add(1) } else { 0 };
                Self { is_fast_build: is_fast(builder), rebuilds_in_a_row, ..new }
            }
            Outcome::Kept(builder) => {
                let failed = SkiRental::FAILED;
                Self { is_fast_build: is_fast(builder), repair: failed, rebuild: failed, ..new }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cost_model::Load;
    use super::*;

    const N: f64 = 1000.0;

    fn seen(excess: f64) -> Observation {
        let queries = QueryCost::new(Load::SingleRays(1000), N, 0.0);
        Observation { primitives: N, nodes: 2.0 * N, excess, has_void_baseline: false, queries }
    }

    /// A ledger that nothing is due in, after ten quiet frames.
    fn quiet() -> Ledger {
        Ledger { frames: 10, ..Ledger::default() }
    }

    /// A ledger after one frame.
    fn charged(mut ledger: Ledger, seen: &Observation) -> Ledger {
        ledger.charge(seen);
        ledger
    }

    #[test]
    fn a_good_tree_is_kept_and_a_bad_one_repaired_once_that_pays() {
        let price = cost_model::repair(2.0 * N, 0);
        let little = price / seen(0.0).queries.lost(1.0);
        for (excess, expected) in [(0.0, false), (0.5 * little, false), (1.5 * little, true)] {
            let plan = decide(&charged(quiet(), &seen(excess)), &seen(excess));
            assert_eq!(matches!(plan, Plan::Repair { .. }), expected, "{excess}: {plan:?}");
        }
        // Twice half of it.
        let ledger = charged(charged(quiet(), &seen(0.6 * little)), &seen(0.6 * little));
        assert!(matches!(decide(&ledger, &seen(0.6 * little)), Plan::Repair { or_rebuild: None, .. }));
    }

    #[test]
    fn a_failed_repair_waits_twice_as_long_and_opens_more() {
        let ledger = charged(quiet(), &seen(1.0));
        let Plan::Repair { threshold, .. } = decide(&ledger, &seen(1.0)) else { panic!("{ledger:?}") };
        let mut ledger = ledger.after(Outcome::Repair(Repaired::Nothing));
        let price = cost_model::repair(2.0 * N, 0);
        ledger.repair.charge(1.5 * price);
        assert!(matches!(decide(&ledger, &seen(0.0)), Plan::Keep(_)));
        ledger.repair.charge(price);
        let Plan::Repair { threshold: lower, .. } = decide(&ledger, &seen(0.0)) else { panic!("{ledger:?}") };
        assert_eq!(lower, 0.5 * threshold);
    }

    #[test]
    fn the_example_is_right() {
        let queries = QueryCost::new(Load::PacketRays(2 << 20), 1e5, 0.0);
        let seen =
            Observation { primitives: 1e5, nodes: 2e5, excess: 0.09, has_void_baseline: false, queries };
        let mut ledger = Ledger::default();
        let plans = [1, 2, 3].map(|_| {
            ledger.charge(&seen);
            decide(&ledger, &seen)
        });
        let [_, Plan::Keep(_), Plan::Repair { reason, .. }] = plans else { panic!("{plans:?}") };
        assert_eq!([reason.price_ms, reason.lost_ms].map(|ms| (10.0 * ms).round()), [42.0, 57.0]);
    }

    #[test]
    fn the_reason_is_what_was_compared() {
        let with = |charge: fn(&mut Ledger)| {
            let mut ledger = quiet();
            charge(&mut ledger);
            ledger
        };
        let plans = [
            with(|ledger| ledger.repair.charge(1e9)),
            with(|ledger| (ledger.is_fast_build, _) = (1, ledger.rebuild.charge(1e9))),
            with(|ledger| (ledger.is_beyond_repair, _) = (1, ledger.rebuild.charge(1e9))),
        ]
        .map(|ledger| decide(&ledger, &seen(0.0)));
        for plan in plans {
            let (Plan::Repair { reason, .. } | Plan::Rebuild((_, reason))) = plan else { panic!("{plan:?}") };
            assert!(reason.lost_ms > reason.price_ms, "{plan:?}");
        }
        let plan = decide(&quiet(), &seen(0.1));
        let Plan::Keep(reason) = plan else { panic!("{plan:?}") };
        assert!(reason.lost_ms <= reason.price_ms && reason.excess == 0.1);
        // Both are due: the price of the tree that may be built in the place of a new top is its
        // own.
        let both = with(|ledger| {
            ledger.repair.charge(1e9);
            ledger.rebuild.charge(2e9);
        });
        let plan = decide(&both, &seen(0.0));
        let Plan::Repair { reason: of_top, or_rebuild: Some((builder, of_tree)), .. } = plan else {
            panic!("{plan:?}")
        };
        assert_eq!((of_top.lost_ms, of_tree.lost_ms), (1e3, 2e3));
        assert_eq!(of_tree.price_ms, 1e-6 * cost_model::rebuild(builder, N));
        assert_ne!(of_tree.price_ms, of_top.price_ms);
    }

    #[test]
    fn a_tree_beyond_repair_is_rebuilt_once_that_pays() {
        let beyond = Ledger { is_beyond_repair: 1, ..quiet() };
        assert!(matches!(decide(&charged(beyond, &seen(0.01)), &seen(0.01)), Plan::Keep(_)));
        assert!(matches!(decide(&charged(beyond, &seen(0.1)), &seen(0.1)), Plan::Rebuild(_)));
    }

    #[test]
    fn a_fast_build_is_replaced_by_a_good_one() {
        let mut ledger = Ledger { is_fast_build: 1, frames: 0, ..quiet() };
        let rebuilds = (0..100).find_map(|frame| {
            ledger.charge(&seen(0.0));
            match decide(&ledger, &seen(0.0)) {
                Plan::Rebuild((builder, _)) => Some((frame, builder)),
                _ => None,
            }
        });
        assert!(matches!(rebuilds, Some((_, Builder::Ploc))), "{rebuilds:?}");
    }

    #[test]
    fn the_ledger_learns_from_what_came_of_a_plan() {
        let mut before = Ledger {
            subtrees: 9,
            is_fast_build: 1,
            is_beyond_repair: 1,
            rebuilds_in_a_row: 3,
            last_excess: 0.5,
            ..quiet()
        };
        before.rebuild.charge(1e9);
        assert_eq!(before.after(Outcome::Nothing), before);
        let top = before.after(Outcome::Repair(Repaired::Top { subtrees: 7 }));
        assert_eq!(top, Ledger { subtrees: 7, is_fast_build: 1, ..Ledger::default() });
        let too_large = Ledger { is_beyond_repair: 0, ..before }.after(Outcome::Repair(Repaired::TooLarge));
        assert_eq!(too_large, before);
        let waits = before.after(Outcome::Repair(Repaired::Nothing));
        assert_eq!(waits, Ledger { repair: SkiRental::FAILED, ..before });
        for (builder, is_fast_build) in [(Builder::Ploc, 0), (Builder::Lbvh, 1)] {
            let new = Ledger { subtrees: 9, is_fast_build, ..Ledger::default() };
            let in_a_row = before.after(Outcome::Rebuilt { builder, is_soon: true });
            assert_eq!(in_a_row, Ledger { rebuilds_in_a_row: 4, ..new });
            assert_eq!(before.after(Outcome::Rebuilt { builder, is_soon: false }), new);
            let failed = SkiRental::FAILED;
            let kept = before.after(Outcome::Kept(builder));
            assert_eq!(kept, Ledger { repair: failed, rebuild: failed, ..new });
        }
    }

    #[test]
    fn a_new_tree_has_to_cost_less_by_two_in_a_hundred() {
        assert_eq!(
            [0.5, 0.97, 0.99, 1.0, 2.0].map(|new| is_hardly_better(new, 1.0)),
            [false, false, true, true, true]
        );
        assert!(is_hardly_better(0.0, 0.0));
    }

    #[test]
    fn a_tree_without_a_baseline_is_rebuilt_at_once() {
        let seen = Observation { has_void_baseline: true, ..seen(0.0) };
        assert!(matches!(decide(&quiet(), &seen), Plan::Rebuild(_)));
    }

    #[test]
    fn a_tree_that_is_bad_at_once_had_better_be_new_in_every_frame() {
        let bad = cost_model::rebuild(Builder::Ploc, N) / seen(0.0).queries.lost(1.0);
        let pays = |frames, excess| {
            let ledger = charged(Ledger { frames, ..quiet() }, &seen(excess));
            pays_every_frame(&ledger, &seen(excess))
        };
        // As much in a hundred frames is no reason.
        assert_eq!([pays(0, bad), pays(0, 0.01 * bad), pays(100, bad)], [true, false, false]);
    }

    #[test]
    fn rebuilds_in_a_row_need_no_pass_but_for_a_look_now_and_then() {
        let queries = seen(0.0).queries;
        let blind = |row| decide_blindly(&Ledger { rebuilds_in_a_row: row, ..quiet() }, N, queries).is_some();
        assert_eq!([0, 1, 2, 15, 16, 17].map(blind), [false, false, true, true, false, true]);
    }

    #[test]
    fn twice_the_cost_loses_at_least_the_time_of_an_update() {
        let lost = |load| QueryCost::new(load, N, 0.0).lost(1.0);
        let least = cost_model::pass(2.0 * N);
        let none = [Load::SingleRays(0), Load::Nodes(0), Load::PacketRays(0), Load::PacketNodes(0)];
        assert_eq!(none.map(lost), [least; 4]);
        assert!(lost(Load::Pairs) > least && lost(Load::SingleRays(100)) > least);
    }

    #[test]
    fn losses_that_are_no_numbers_lead_nowhere() {
        for excess in [f64::NAN, f64::INFINITY] {
            assert!(matches!(decide(&charged(quiet(), &seen(excess)), &seen(excess)), Plan::Keep(_)));
        }
    }
}
