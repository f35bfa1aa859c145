//! What to do about a tree: a pure function of what was lost so far and what a pass has seen.
//!
//! Each remedy has an account of what its absence has cost ([`SkiRental`](crate::ski_rental::SkiRental)), and is due once that
//! exceeds its price:
//!
//! ```text
//! a new top         lost: excess of the tree over its baseline      price: finding the frontier, building the top
//! a new tree        lost: the same, and what a fast build costs     price: a build
//! merged leaves     lost: what they would save                      price: looking at every leaf
//! split leaves      lost: growth of merged leaves                   price: the same
//! ```

use bvh_build::Builder;

use super::cost_model::{self, QueryCost, TOP_SUBTREE};
use crate::report::Reason;
use crate::state::Ledger;

/// After this number of rebuilds in a row, each soon enough that one in every frame is cheaper, the next ones need no pass.
const IN_A_ROW: u32 = 2;
/// One in this many rebuilds in a row is made after a pass that looks whether it is needed.
const LOOK_AGAIN: u32 = 16;
/// A subtree is opened if that pays within the frames since the last repair, but at most within this many.
const LONGEST_PAYBACK: u32 = 8;

/// What a pass has seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub(super) primitives: f64,
    /// Nodes visited: the dynamic ones.
    pub(super) nodes: f64,
    /// By what part the tree costs more than its baseline.
    pub(super) excess: f64,
    /// By what part of the baseline the dynamic leaves have grown since they were last merged or split.
    pub(super) leaf_growth: f64,
    /// Whether the baseline says nothing: the tree had no cost when it was built, or far more than now.
    pub(super) has_no_baseline: bool,
    pub(super) queries: QueryCost,
}

impl Observation {
    /// The builder for a new tree now, and what that costs.
    fn rebuild(&self, ledger: &Ledger) -> (Builder, f64) {
        let builder = self.queries.builder(self.primitives, ledger.since_repair);
        (builder, cost_model::rebuild(builder, self.primitives))
    }

    /// What merging or splitting all leaves costs.
    pub(super) fn price_of_leaves(&self) -> f64 {
        cost_model::change_leaves(self.nodes)
    }
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Plan {
    Keep,
    /// Build the tree again above the subtrees whose excess, as part of the baseline, is at most `threshold`; if there are
    /// more than `most`, the whole of it.
    Repair {
        threshold: f64,
        most: usize,
        or_rebuild: Option<Builder>,
    },
    Rebuild(Builder),
    MergeLeaves,
    SplitLeaves,
}

/// The builder of a tree that is built without a pass before, since trees were bad again at once.
pub(super) fn decide_blindly(ledger: &Ledger, primitives: f64, queries: QueryCost) -> Option<Builder> {
    let row = ledger.rebuilds_in_a_row;
    (row >= IN_A_ROW && !row.is_multiple_of(LOOK_AGAIN)).then(|| queries.builder(primitives, 1))
}

/// Whether a new tree in every frame costs less than passes and a new tree now and then.
///
/// ```text
/// rate  = 2 lost / (k (k + 1))            lost in k frames, of which each loses as much more than the one before
/// cycle = pass + sqrt(2 price rate)       per frame, if a tree is rebuilt as soon as as much is lost as that costs
/// ```
pub(super) fn pays_every_frame(ledger: &Ledger, seen: &Observation) -> bool {
    let (_, price_of_rebuild) = seen.rebuild(ledger);
    let frames = f64::from(ledger.since_repair.max(1));
    let rate = 2.0 * ledger.repair.lost() / (frames * (frames + 1.0));
    let cycle = cost_model::pass(seen.nodes) + (2.0 * price_of_rebuild * rate).sqrt();
    cycle > seen.queries.rebuild_every_frame(seen.primitives)
}

/// What to do after a pass, with its losses already charged.
pub(super) fn decide(ledger: &Ledger, seen: &Observation) -> Plan {
    let (builder, price_of_rebuild) = seen.rebuild(ledger);
    let rebuild = ledger.rebuild.is_due(price_of_rebuild).then_some(builder);
    if seen.has_no_baseline {
        return Plan::Rebuild(builder);
    }
    match rebuild {
        Some(builder) if ledger.is_beyond_repair != 0 || ledger.is_fast_build != 0 => {
            return Plan::Rebuild(builder);
        }
        _ => {}
    }
    let is_merged = ledger.is_merged != 0;
    // No repair reaches what tears open within leaves.
    if ledger.split_turns > 0 || is_merged && ledger.split.is_due(seen.price_of_leaves()) {
        return Plan::SplitLeaves;
    }
    if ledger.is_beyond_repair == 0 && ledger.repair.is_due(cost_model::repair(seen.nodes, ledger.kept)) {
        let frames = f64::from(ledger.since_repair.clamp(1, LONGEST_PAYBACK)) * ledger.repair.patience();
        let threshold = TOP_SUBTREE / (seen.queries.lost(1.0) * frames);
        let most = cost_model::most_subtrees(seen.nodes, price_of_rebuild);
        return Plan::Repair { threshold, most, or_rebuild: rebuild };
    }
    if ledger.merge_turns > 0 || !is_merged && ledger.merge.is_due(seen.price_of_leaves()) {
        Plan::MergeLeaves
    } else {
        Plan::Keep
    }
}

/// What `decide` compares for a new top, or for a new tree where the top is beyond repair.
pub(super) fn reason(ledger: &Ledger, seen: &Observation) -> Reason {
    let (account, price) = if ledger.is_beyond_repair == 0 {
        (ledger.repair, cost_model::repair(seen.nodes, ledger.kept))
    } else {
        (ledger.rebuild, seen.rebuild(ledger).1)
    };
    let ms = 1e-6;
    Reason { lost_ms: account.lost() * ms, price_ms: price * account.patience() * ms, excess: seen.excess }
}

impl Ledger {
    /// Charges what this frame loses.
    pub(super) fn charge(&mut self, seen: &Observation) {
        let lost = seen.queries.lost(seen.excess.max(0.0));
        self.repair.charge(lost);
        self.rebuild.charge(lost);
        // A fast build in the place of a fast build gains nothing.
        if self.is_fast_build != 0
            && seen.queries.builder(seen.primitives, self.since_repair) != Builder::Lbvh
        {
            self.rebuild.charge(seen.queries.lost_to_fast_build());
        }
        self.merge.charge(seen.queries.saved_by_merging());
        if self.is_merged != 0 {
            self.split.charge(seen.queries.lost(seen.leaf_growth.max(0.0)));
        }
        self.since_repair = self.since_repair.saturating_add(1);
    }

    /// A new top stands above `subtrees` subtrees.
    pub(super) fn repaired(&mut self, subtrees: usize) {
        self.repair.paid_off();
        // A new top does not replace a fast build.
        if self.is_fast_build == 0 {
            self.rebuild.paid_off();
        }
        (self.kept, self.since_repair) = (subtrees as u32, 0);
        (self.rebuilds_in_a_row, self.is_beyond_repair) = (0, 0);
    }

    /// A new tree has taken the place of one with the ledger `before`; whether it is better is known after a pass. If it
    /// came soon, it is in a row with the rebuild before.
    pub(super) fn rebuilt(before: &Self, builder: Builder, is_better: Option<bool>, is_soon: bool) -> Self {
        let mut rebuild = before.rebuild;
        match is_better {
            Some(true) => rebuild.paid_off(),
            Some(false) => rebuild.failed(),
            None => rebuild.restart(),
        }
        let mut merge = before.merge;
        if before.is_merged != 0 || before.merge_turns > 0 {
            merge.failed();
        }
        Self {
            rebuild,
            merge,
            kept: before.kept,
            rebuilds_in_a_row: if is_soon { before.rebuilds_in_a_row.saturating_add(1) } else { 0 },
            is_fast_build: u32::from(builder == Builder::Lbvh),
            ..Self::default()
        }
    }

    /// Leaves have been split; merging them has paid for itself or not.
    pub(super) fn leaves_split(&mut self, price: f64) {
        if self.merge.lost() > price {
            self.merge.paid_off();
        } else {
            self.merge.failed();
        }
        self.split.paid_off();
        self.is_merged = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::super::cost_model::Load;
    use super::*;

    const N: f64 = 1000.0;

    fn seen(excess: f64) -> Observation {
        let queries = QueryCost::new(Load::SingleRays(1000), N, 0.0);
        Observation {
            primitives: N,
            nodes: 2.0 * N,
            excess,
            leaf_growth: 0.0,
            has_no_baseline: false,
            queries,
        }
    }

    /// A ledger that nothing is due in, after ten quiet frames.
    fn quiet() -> Ledger {
        let mut ledger = Ledger { since_repair: 10, ..Ledger::default() };
        ledger.merge.failed();
        ledger
    }

    /// A ledger after one frame.
    fn after(mut ledger: Ledger, seen: &Observation) -> Ledger {
        ledger.charge(seen);
        ledger
    }

    #[test]
    fn a_good_tree_is_kept_and_a_bad_one_repaired_once_that_pays() {
        let price = cost_model::repair(2.0 * N, 0);
        let little = price / seen(0.0).queries.lost(1.0);
        for (excess, expected) in [(0.0, false), (0.5 * little, false), (1.5 * little, true)] {
            let plan = decide(&after(quiet(), &seen(excess)), &seen(excess));
            assert_eq!(matches!(plan, Plan::Repair { .. }), expected, "{excess}: {plan:?}");
        }
        // Twice half of it.
        let ledger = after(after(quiet(), &seen(0.6 * little)), &seen(0.6 * little));
        assert!(matches!(decide(&ledger, &seen(0.6 * little)), Plan::Repair { or_rebuild: None, .. }));
    }

    #[test]
    fn a_failed_repair_waits_twice_as_long_and_opens_more() {
        let mut ledger = after(quiet(), &seen(1.0));
        let Plan::Repair { threshold, .. } = decide(&ledger, &seen(1.0)) else { panic!("{ledger:?}") };
        ledger.repair.failed();
        let price = cost_model::repair(2.0 * N, 0);
        ledger.repair.charge(1.5 * price);
        assert_eq!(decide(&ledger, &seen(0.0)), Plan::Keep);
        ledger.repair.charge(price);
        let Plan::Repair { threshold: lower, .. } = decide(&ledger, &seen(0.0)) else { panic!("{ledger:?}") };
        assert_eq!(lower, 0.5 * threshold);
    }

    #[test]
    fn a_tree_beyond_repair_is_rebuilt_once_that_pays() {
        let beyond = Ledger { is_beyond_repair: 1, ..quiet() };
        assert_eq!(decide(&after(beyond, &seen(0.01)), &seen(0.01)), Plan::Keep);
        assert!(matches!(decide(&after(beyond, &seen(0.1)), &seen(0.1)), Plan::Rebuild(_)));
    }

    #[test]
    fn a_fast_build_is_replaced_by_a_good_one() {
        let mut ledger = Ledger { is_fast_build: 1, since_repair: 0, ..quiet() };
        let rebuilds = (0..100).find_map(|frame| {
            ledger.charge(&seen(0.0));
            match decide(&ledger, &seen(0.0)) {
                Plan::Rebuild(builder) => Some((frame, builder)),
                _ => None,
            }
        });
        assert!(matches!(rebuilds, Some((_, Builder::Ploc))), "{rebuilds:?}");
    }

    #[test]
    fn a_tree_without_a_baseline_is_rebuilt_at_once() {
        let seen = Observation { has_no_baseline: true, ..seen(0.0) };
        assert!(matches!(decide(&quiet(), &seen), Plan::Rebuild(_)));
    }

    #[test]
    fn a_tree_that_is_bad_at_once_had_better_be_new_in_every_frame() {
        let bad = cost_model::rebuild(Builder::Ploc, N) / seen(0.0).queries.lost(1.0);
        let pays = |since_repair, excess| {
            let ledger = after(Ledger { since_repair, ..quiet() }, &seen(excess));
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
        let row = Ledger { rebuilds_in_a_row: 3, ..quiet() };
        let after = |is_soon| Ledger::rebuilt(&row, Builder::Lbvh, None, is_soon).rebuilds_in_a_row;
        assert_eq!([true, false].map(after), [4, 0]);
    }

    #[test]
    fn calm_leaves_merge_and_torn_ones_split() {
        let price = cost_model::change_leaves(2.0 * N);
        let mut ledger = Ledger::default();
        ledger.merge.charge(1.1 * price);
        assert_eq!(decide(&ledger, &seen(0.0)), Plan::MergeLeaves);
        let mut merged = Ledger { is_merged: 1, ..ledger };
        assert_eq!(decide(&merged, &seen(0.0)), Plan::Keep);
        merged.split.charge(1.1 * price);
        assert_eq!(decide(&merged, &seen(0.0)), Plan::SplitLeaves);
        // Merging paid for itself, so it may come again as soon; else it waits twice as long.
        let mut again = merged;
        again.leaves_split(price);
        assert_eq!((again.is_merged, again.merge.patience()), (0, 1.0));
        merged.leaves_split(2.0 * price);
        assert_eq!(merged.merge.patience(), 2.0);
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
            assert_eq!(decide(&after(quiet(), &seen(excess)), &seen(excess)), Plan::Keep);
        }
    }
}
