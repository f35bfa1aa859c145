//! When [`Auto`](crate::Auto) splits and merges leaves (`leaves.rs`).
//!
//! Merged leaves make rays and updates faster. They are *merged* in a tree whose leaves have been calm for so long that it
//! pays: what it costs must come back in as many updates as there have been since they came apart, or the tree is new. A
//! part of the tree is seen to in each update, until little comes of it. They are *split*, likewise in a few updates, when
//! their areas have grown and rays have lost as much to that as it costs; where that has not paid for itself, as where
//! primitives grow themselves, they may grow by twice as much until the next time. Where merging has not paid for itself by
//! then, the next one waits for twice as long, else for half as long.
//!
//! Repairs of the tree set leaves apart, too, where these have come apart with the nodes above them (`apart.rs`); once they
//! have taken a good part of what had merged, it may merge again.

use bvh_core::{Bvh, History, LeafHistory, Primitives};

use crate::apart::Apart;
use crate::best::LONGEST;
use crate::block::Tally;
use crate::cut::size_now;
use crate::decision::Decision;
use crate::model::{GAIN_LASTS, Model};
use crate::raw;
use crate::settle::{SettleScratch, settle};
use crate::strategy::{Rotate, Turn, options_like};

/// In how many updates all leaves are merged.
const TURNS: u32 = 8;
/// In how many updates all leaves are split that are better apart.
const SPLIT_TURNS: u32 = 2;
/// Updates before leaves are merged, at least.
const CALM: u32 = 4;
/// By what part areas of leaves grow before these are split, at least and at most.
const SLACK: [f64; 2] = [0.05, 0.8];
/// Part of the nodes seen to that merging has to save for it to go on.
const WORTH_WHILE: f64 = 0.05;
/// Once repairs have left less than this part of what had merged, it may merge again.
const MOSTLY_MERGED: f64 = 0.75;
/// What merging saves of what rays take, and of the nodes of the tree.
const RAYS_SAVED: f64 = 0.04;
const NODES_SAVED: f64 = 0.3;

/// Sees to leaves, if it is time to, and corrects what the pass before has found. Where a repair will take its time in
/// this update, and did not in the last, that waits for the next, but for the first turn of a split: frames are to be alike.
pub(crate) fn see_to_leaves<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    model: &Model,
    one_in: u32,
    is_busy: bool,
    tally: &mut Tally,
    scratch: &mut SettleScratch,
) -> Option<Decision> {
    let nodes = (tally.leaves + tally.inner) as f64;
    let History { is_hasty, is_beyond_repair, spare_pair, .. } = *bvh.history();
    // Of what does not move or will soon be built anew there is nothing to be had.
    if crate::ablation::is_off(6) || nodes == 0.0 || is_hasty || is_beyond_repair {
        return None;
    }
    let moving = nodes / bvh.nodes().len() as f64;
    let saved = model.saved(RAYS_SAVED * moving, nodes * NODES_SAVED, one_in);
    let unit = size_now(bvh, tally.leaf_area);
    let history = raw::parts(bvh).history;
    let good = history.reference * unit * if crate::ablation::is_off(3) { 1.0 } else { history.evenness.sqrt() };
    let leaves = &mut history.leaves;
    let price = nodes * model.weights.settle_node;
    let pays = f64::from(leaves.calm) * saved > price;
    leaves.has_paid = f64::from(leaves.calm.saturating_sub(leaves.merging_since)) * saved > price;
    leaves.regret += model.lost((tally.leaf_area - leaves.area) / good);
    let has_lost = leaves.regret > price;
    let decision = decide(leaves, tally.leaf_area, pays, has_lost, spare_pair > 0)?;
    let merges = matches!(decision, Decision::Merge { .. });
    if is_busy && (merges || leaves.splitting < SPLIT_TURNS) {
        return None;
    }
    let turn = if merges {
        leaves.turns += 1;
        Turn::new(Rotate { period: TURNS }, leaves.turns)
    } else {
        Turn::new(Rotate { period: SPLIT_TURNS }, leaves.splitting)
    };
    // New trees are to have leaves as they were.
    options_like(bvh);
    let change = settle(bvh, primitives, turn, merges, LONGEST as u32, unit, scratch);
    let (before, still_area) = (*tally, bvh.still_area());
    tally.area += change.all;
    tally.leaf_area += change.leaves;
    let history = raw::parts(bvh).history;
    let leaves = &mut history.leaves;
    leaves.spare_pair_count = history.spare_pair_count;
    (leaves.area, leaves.regret) = (tally.leaf_area, 0.0);
    leaves.is_merged |= tally.leaf_area != before.leaf_area;
    // A tree is held to what it was with leaves like these.
    let standard = if merges {
        if (change.fewer as f64) < WORTH_WHILE * change.seen as f64 {
            leaves.turns = TURNS;
            if !leaves.is_merged {
                // It may have been too early.
                (leaves.turns, leaves.calm, leaves.wait) = (0, 0, 2 * leaves.wait.clamp(CALM, u32::MAX / 4));
            }
        }
        leaves.growth = part_of((1.0 + leaves.growth) * (tally.leaf_area / before.leaf_area) - 1.0);
        let standard = (tally.area + still_area) / (before.area + still_area);
        leaves.cost = part_of((1.0 + leaves.cost) * standard - 1.0);
        standard
    } else {
        leaves.splitting -= 1;
        leaves.split_gain -= change.all / good;
        leaves.split_merged += change.merged;
        if leaves.splitting > 0 {
            return Some(decision);
        }
        let single = tally.leaf_area - leaves.split_merged;
        leaves.growth = if leaves.was_merged { 0.0 } else { part_of(leaves.split_merged / single) };
        let was_of_use = model.lost(leaves.split_gain) * GAIN_LASTS > price;
        was_split(leaves, was_of_use, leaves.has_paid);
        if was_of_use { 1.0 / (1.0 + std::mem::take(&mut leaves.cost)) } else { 1.0 }
    };
    if standard > 0.0 && standard.is_finite() {
        history.reference *= standard;
        history.measured *= standard;
    }
    Some(decision)
}

/// A repair after this pass has set leaves apart that had come apart with the nodes above them; `growth` is what that of
/// leaves was before.
pub(crate) fn were_set_apart(bvh: &mut Bvh, tally: &Tally, growth: f64, apart: &Apart) {
    if apart.count == 0 {
        return;
    }
    let History { spare_pair_count, leaves, .. } = raw::parts(bvh).history;
    // Leaves as calm as they were, had these been apart.
    let calm = leaves.area * ((1.0 + leaves.growth) / (1.0 + growth));
    let (before, now) = (tally.leaf_area - leaves.area, tally.leaf_area + apart.change - calm);
    leaves.regret *= if before > 0.0 { (now / before).clamp(0.0, 1.0) } else { 0.0 };
    leaves.area = calm.min(tally.leaf_area + apart.change);
    if f64::from(*spare_pair_count) < MOSTLY_MERGED * f64::from(leaves.spare_pair_count) {
        was_split(leaves, true, leaves.has_paid);
        leaves.spare_pair_count = *spare_pair_count;
    }
}

/// A part by which something has grown or shrunk; 0 where that is beyond numbers.
fn part_of(part: f64) -> f64 {
    if part > -1.0 && part.is_finite() { part } else { 0.0 }
}

/// What is to be done about leaves of this area.
fn decide(
    leaves: &mut LeafHistory,
    area: f64,
    pays: bool,
    has_lost: bool,
    can_split: bool,
) -> Option<Decision> {
    leaves.calm = leaves.calm.saturating_add(1);
    let is_merged = leaves.is_merged && can_split;
    if leaves.splitting > 0 {
        return Some(Decision::Split);
    }
    if is_merged && has_lost && area > leaves.area * (1.0 + leaves.slack.max(SLACK[0])) {
        (leaves.splitting, leaves.split_gain, leaves.split_merged) = (SPLIT_TURNS, 0.0, 0.0);
        return Some(Decision::Split);
    }
    leaves.area = if is_merged { leaves.area.min(area) } else { area };
    let starts = leaves.turns == 0 && pays && leaves.calm >= leaves.wait.max(CALM);
    if !starts && !(1..TURNS).contains(&leaves.turns) {
        return None;
    }
    if starts {
        leaves.merging_since = leaves.calm;
    }
    Some(Decision::Merge { one_in: TURNS })
}

/// All that are better apart have been split; since they were merged, that may have paid for itself.
fn was_split(leaves: &mut LeafHistory, was_of_use: bool, has_paid: bool) {
    if was_of_use {
        // Leaves that come apart by and by were merged but once.
        if leaves.turns > 0 {
            let wait = leaves.wait.max(CALM);
            leaves.wait = if has_paid { (wait / 2).max(CALM) } else { 2 * wait.min(u32::MAX / 4) };
        }
        (leaves.turns, leaves.calm, leaves.slack) = (0, 0, SLACK[0]);
    } else {
        leaves.slack = (2.0 * leaves.slack).clamp(2.0 * SLACK[0], SLACK[1]);
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::{Auto, Scratch, Strategy, update};

    const MERGE: Option<Decision> = Some(Decision::Merge { one_in: TURNS });
    const SPLIT: Option<Decision> = Some(Decision::Split);

    /// Each merge that is decided is made, and each split at once.
    fn play(leaves: &mut LeafHistory, areas: &[f64], pays: bool) -> Vec<Option<Decision>> {
        let decide = |&area: &f64| {
            let decision = decide(leaves, area, pays, true, true);
            leaves.turns += u32::from(decision == MERGE);
            leaves.splitting = 0;
            decision
        };
        areas.iter().map(decide).collect()
    }

    #[test]
    fn leaves_are_merged_in_turns_once_it_is_calm_and_pays_and_wait_longer_once_split() {
        let mut leaves = LeafHistory::default();
        assert_eq!(play(&mut leaves, &[1.0; 3], true), [None; 3]);
        assert_eq!(play(&mut leaves, &[1.0; 20], false), [None; 20]);
        assert_eq!(play(&mut leaves, &[1.0; 10], true)[6..], [MERGE, MERGE, None, None]);
        leaves.is_merged = true;
        for wait in [8, 16, 32] {
            (leaves.area, leaves.turns) = (1.0, TURNS);
            assert_eq!(play(&mut leaves, &[1.04, 1.06], true), [None, SPLIT]);
            was_split(&mut leaves, true, false);
            leaves.area = 1.06;
            let calm = play(&mut leaves, &vec![1.06; wait + 1], true);
            assert!(calm[..wait - 1].iter().all(Option::is_none), "{calm:?}");
            assert_eq!(calm[wait - 1..], [MERGE; 2]);
        }
    }

    #[test]
    fn a_split_that_has_begun_goes_on_until_all_have_had_their_turn() {
        let merged = LeafHistory { is_merged: true, area: 1.0, turns: TURNS, ..LeafHistory::default() };
        let mut leaves = merged;
        assert_eq!(decide(&mut leaves, 1.2, true, true, true), SPLIT);
        for left in (0..SPLIT_TURNS).rev() {
            leaves.splitting = left;
            let expected = if left > 0 { SPLIT } else { None };
            // Nothing has been lost since.
            assert_eq!(decide(&mut leaves, 1.0, true, false, true), expected, "{left}");
        }
    }

    #[test]
    fn leaves_that_grow_by_themselves_are_not_split_for_long() {
        let mut leaves = LeafHistory { turns: TURNS, is_merged: true, area: 1.0, ..LeafHistory::default() };
        let grows: Vec<f64> = (1..100).map(|i| 1.02f64.powi(i)).collect();
        let splits = grows.iter().filter(|&&area| {
            let splits = decide(&mut leaves, area, true, true, true) == SPLIT;
            if splits {
                leaves.splitting = 0;
                was_split(&mut leaves, false, false);
                leaves.area = area;
            }
            splits
        });
        assert!((3..8).contains(&splits.count()));
        was_split(&mut leaves, true, false);
        assert_eq!((leaves.slack, leaves.wait), (SLACK[0], 2 * CALM));
        leaves.turns = 1;
        was_split(&mut leaves, true, true);
        was_split(&mut leaves, true, false);
        assert_eq!(leaves.wait, CALM);
        // Single leaves are not split.
        let mut single = LeafHistory { is_merged: false, ..leaves };
        assert!(!play(&mut single, &grows, false).contains(&SPLIT));
    }

    #[test]
    fn leaves_that_repairs_set_apart_no_longer_count_and_may_merge_again_once_many_are() {
        let mut bvh = Bvh::default();
        let history = raw::parts(&mut bvh).history;
        let merged =
            LeafHistory { turns: TURNS, calm: 30, wait: 8, spare_pair_count: 1000, ..LeafHistory::default() };
        history.leaves = LeafHistory { area: 1.1, regret: 4.0, ..merged };
        history.spare_pair_count = 800;
        let tally = Tally { leaf_area: 1.3, ..Tally::default() };
        // What had grown by a tenth is single now, and by as much greater than it was.
        let apart = Apart { count: 100, change: -0.2, spare: 0 };
        were_set_apart(&mut bvh, &tally, 0.1, &apart);
        let LeafHistory { area, regret, turns, .. } = bvh.history().leaves;
        assert!(
            (area - 1.0).abs() < 1e-9 && (regret - 2.0).abs() < 1e-9 && turns == TURNS,
            "{area}, {regret}"
        );
        for _ in 0..2 {
            raw::parts(&mut bvh).history.spare_pair_count = 700;
            were_set_apart(&mut bvh, &tally, 0.0, &apart);
            let LeafHistory { turns, wait, spare_pair_count, .. } = bvh.history().leaves;
            assert_eq!((turns, wait, spare_pair_count), (0, 16, 700));
        }
    }

    #[test]
    fn nothing_merges_in_the_update_of_a_repair_unless_all_repair() {
        // Quadruplets that stay together and are scattered by and by, one after the other.
        let boxes = |step: usize| -> Vec<Aabb> {
            let place = |i: usize, k: usize| ((i + 1).wrapping_mul(k) % 9973) as f32 * 0.01;
            let corner = |i: usize| {
                let at = |k| Vec3::new(place(i / 4, k), place(i / 4, k + 12), place(i / 4, k + 30));
                let away = (40 * step).saturating_sub(i / 4 % 997).min(100) as f32 * 0.01;
                at(7919) + (at(6661) - at(7919)) * away
            };
            (0..20_000).map(corner).map(|corner| Aabb::new(corner, corner + 0.5)).collect()
        };
        let start = build(&boxes(0), Builder::Sweep, &BuildOptions::default(), None).expect("few");
        let play = |rays| {
            let (mut bvh, mut scratch) = (start.clone(), Scratch::new());
            let decide = |step| {
                let before = bvh.history().leaves.turns;
                let auto = Strategy::Auto(Auto { rays, ..Auto::default() });
                let told = update(&mut bvh, &boxes(step), &auto, &mut scratch).expect("same count");
                match told.decision {
                    Decision::Merge { .. } => 'm',
                    Decision::Regrow { .. } if bvh.history().leaves.turns > before => 'b',
                    Decision::Regrow { .. } => 'r',
                    _ => '.',
                }
            };
            (1..40).map(decide).collect::<String>()
        };
        // Every other update repairs, and those between merge; or all do, and some of them merge, too.
        let (some, all) = (play(1 << 16), play(1 << 24));
        assert!(some.contains("rmrmrmr") && !some.contains('b'), "{some}");
        assert!(all.contains("rrrbbbbbbbbrrr") && !all.contains('m'), "{all}");
    }
}
