//! The strategy that chooses: what to do about a tree, from counted work and measured cost.
//!
//! The model of a frame's time is the work of the update plus what its rays take, which grows with the SAH cost of the
//! tree over what that was when the tree was good; the more so, the more of the cost lies in a few large primitives, such
//! as the walls around what is looked at. What rays take, and how fast that grows, is learned from counts of visited nodes,
//! if the caller tells them (`slope.rs`). Constant weights (`clock.rs`) put both on one scale, so that decisions are
//! reproducible; only where the caller asks for it, the clock corrects them.
//!
//! * *Rotations* are worth while if the cost that they saved in this update, kept for some frames, pays for trying.
//!   If they are not, each node is tried half as often, down to every eighth update; if they are, twice as often.
//! * *Repairs* follow a ski-rental rule: the time that rays have lost to excess cost since the last repair is added up,
//!   and once it exceeds the price of a repair, the tree is regrown (`regrow.rs`). So no schedule that knows the
//!   future is more than about twice as good. What a repair costs is taken to be what the last one did. One that finds
//!   nothing worth opening is tried again once twice as much has been lost, and then opens what pays for itself in twice as
//!   many frames; until that would be a large part of the tree.
//! * The same rule holds for what rays lose where the cost of the whole tree does not show it: where they visit more nodes
//!   than in the tree when it was new, as far as new trees have brought that down before (`growth.rs`). Then the tree is
//!   built anew, without a pass before.
//! * *Leaves* are merged where the tree has been calm for long (`merge.rs`).
//! * *A new tree* is built where a regrown top would be a large part of the tree; and where that has happened in a row,
//!   without trying anything else first. So it is where the cost has fallen to half of what it was when it was measured:
//!   what was scattered then has gathered, and that is no standard any more. It is built by PLOC where the better tree
//!   pays for it in one frame; else in haste, by LBVH, and then it counts as a tree with excess from the start.

use bvh_build::Builder;
use bvh_core::{Bvh, History, Primitives};

use crate::block::Tally;
use crate::clock::{Weights, Work};
use crate::cut::{Regrown, excess, excess_by, good_area, over_good, reference, sum_of, take_references};
use crate::decision::Decision;
use crate::merge::{see_to_leaves, were_set_apart};
use crate::model::{Found, GAIN_LASTS, HASTY, Model, Standing, doubled};
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::regrow::{LARGEST_CUT, SOON, rebuild_all, regrow};
use crate::strategy::{Rotate, Update, UpdateError};

/// Settings of [`Strategy::Auto`](crate::Strategy::Auto).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Auto {
    /// How many rays will be cast through the tree before the next update; the default is two for each pixel of
    /// 1024 x 1024. The more there are, the more a better tree is worth.
    pub rays: u64,
    /// Whether the weights of the model are corrected by the clock: by the time that updates take, and what the caller
    /// tells of rays ([`Scratch::traced`]). [`Scratch::calibration`] says by how much. Decisions, and with them trees,
    /// are then not reproducible. False by default.
    pub clock: bool,
    /// Mechanisms left out.
    pub without: u32,
}

impl Default for Auto {
    fn default() -> Self {
        Self { rays: 2 << 20, clock: false, without: 0 }
    }
}

/// How often opening a subtree is to pay for itself. Those that do so but once hardly matter to the mean, and make up much
/// of the longest updates. With 4 rays visit 3 % more nodes on the lion and 3 % on the dragon, and leaves must be split.
const PAYS_BACK: f64 = 2.0;
/// A tree whose cost has fallen to this part of what it was when measured is of a scene that has gathered.
const GATHERED: f64 = 0.5;
/// Excess with which a tree is not beyond repair.
const LITTLE: f64 = 0.05;
/// After as many rebuilds in a row, further ones are made without a pass before; but for one in `LOOK_AGAIN`.
const IN_A_ROW: u32 = 2;
const LOOK_AGAIN: u32 = 16;

/// Builds a new tree.
fn new_tree<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    model: Model,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let before = *bvh.history();
    let update = build_anew(bvh, primitives, builder, scratch)?;
    has_new_tree(bvh, &before, builder, model, scratch);
    Ok(update)
}

/// Builds a new tree and keeps it if it is better than the one that there is, which a pass has fitted. That time was lost
/// may be the motion's fault.
fn better_tree<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    model: Model,
    tally: &Tally,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let standing = Standing::of(bvh, tally);
    let old = bvh.clone();
    let update = build_anew(bvh, primitives, builder, scratch)?;
    if crate::ablation::is_off(12) || sum_of(bvh) < standing.sum {
        has_new_tree(bvh, old.history(), builder, model, scratch);
        return Ok(update);
    }
    *bvh = old;
    is_as_good_as_it_gets(bvh, &standing, scratch);
    let history = raw::parts(bvh).history;
    history.trees_in_vain = history.trees_in_vain.saturating_add(1);
    Ok(Update { decision: Decision::Kept { builder }, ..tally.update(bvh) })
}

/// From now on the tree is held to what it is.
fn is_as_good_as_it_gets(bvh: &mut Bvh, standing: &Standing, scratch: &mut Scratch) {
    let reference = reference(standing.sum, standing.size);
    let history = raw::parts(bvh).history;
    *history = History {
        reference,
        measured: reference,
        regret: 0.0,
        is_beyond_repair: false,
        looks_in_vain: 0,
        ..*history
    };
    scratch.clock.excess = 0.0;
    scratch.clock.slope.repaired();
}

fn build_anew<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let start = (scratch.clock.now)();
    let update = rebuild_all(bvh, primitives, builder, scratch)?;
    let took = (scratch.clock.now)().saturating_duration_since(start);
    let (work, weight) = if builder == HASTY {
        (Work::Haste, Weights::MODEL.hasty_primitive)
    } else {
        (Work::Rebuild, Weights::MODEL.rebuild_primitive)
    };
    scratch.clock.learn(work, bvh.len() as f64 * weight, took);
    Ok(update)
}

/// A new tree has taken the place of one with this history.
fn has_new_tree(bvh: &mut Bvh, before: &History, builder: Builder, model: Model, scratch: &mut Scratch) {
    let is_hasty = builder == HASTY;
    let clock = &mut scratch.clock;
    if before.leaves.cost == 0.0 {
        clock.slope.renewed(before.reference, || excess_by(before, bvh));
    } else {
        // Merged leaves have fewer nodes above them, which is no merit of the tree.
        clock.slope.repaired();
        clock.growth.tells_nothing();
    }
    if is_hasty {
        clock.growth.tells_nothing();
    }
    clock.excess = if is_hasty { model.hasty_excess() } else { 0.0 };
    raw::parts(bvh).history.is_hasty = is_hasty;
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    auto: Auto,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    crate::ablation::WITHOUT.store(auto.without, std::sync::atomic::Ordering::Relaxed);
    scratch.clock.growth.is_of(bvh);
    let update = choose(bvh, primitives, auto, scratch)?;
    scratch.clock.growth.end(bvh, &update);
    Ok(update)
}

fn choose<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    auto: Auto,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let weights = if auto.clock { scratch.clock.weights() } else { scratch.clock.counted() };
    let model = Model { rays: auto.rays, weights, slope: scratch.clock.slope.get() };
    let history = *bvh.history();
    let is_time_to_look = !crate::ablation::is_off(5) && history.rebuilds_in_a_row.is_multiple_of(LOOK_AGAIN);
    let (_, price_of_new) = model.builder(bvh.len() as f64, history.since_repair);
    let lost = if crate::ablation::is_off(0) { 0.0 } else { 1.0 } * scratch.clock.growth.charge(model.rays as f64 * model.weights.ray);
    if history.is_due || (!crate::ablation::is_off(0) && scratch.clock.growth.regret() > price_of_new) {
        // A tree that was built in haste and has not degraded since is to be built well.
        let frames = if history.is_hasty { u32::MAX } else { history.since_repair };
        let (builder, _) = model.builder(bvh.len() as f64, frames);
        let update = new_tree(bvh, primitives, builder, model, scratch)?;
        if lost <= price_of_new {
            // It could wait: that does not make a row.
            raw::parts(bvh).history.rebuilds_in_a_row = 0;
        }
        return Ok(update);
    }
    if history.rebuilds_in_a_row >= IN_A_ROW && !is_time_to_look {
        let (builder, _) = model.builder(bvh.len() as f64, 1);
        return new_tree(bvh, primitives, builder, model, scratch);
    }
    take_references(bvh);
    let before = *bvh.history();
    let one_in = 1 << bvh.history().rotation_pause;
    let start = (scratch.clock.now)();
    let mut tally = pass(bvh, primitives, Some(Rotate { period: one_in }), scratch);
    let nodes = (tally.leaves + tally.inner) as f64;
    let per_node = Weights::MODEL.fit_node + Weights::MODEL.rotate_node / f64::from(one_in);
    let took = (scratch.clock.now)().saturating_duration_since(start);
    scratch.clock.learn(Work::Pass, nodes * per_node, took);
    let price = model.price_of_repair(bvh.history(), nodes, bvh.len() as f64);
    let history = bvh.history();
    let is_to_be_repaired =
        history.regret + model.lost(model.excess(&Standing::of(bvh, &tally), history)) > price;
    // Where every update repairs, frames are alike as they are.
    let is_busy = is_to_be_repaired && history.since_repair > 0;
    let with_leaves_as_they_were = tally.area;
    let leaves = see_to_leaves(bvh, primitives, &model, one_in, is_busy, &mut tally, &mut scratch.settle);
    let has_other_leaves = tally.area != with_leaves_as_they_were;
    if has_other_leaves {
        scratch.clock.growth.leaves_changed();
    }
    let decision = leaves.unwrap_or(Decision::Refit { one_in });
    let refitted = |bvh: &Bvh| Update { decision, ..tally.update(bvh) };

    let standing = Standing::of(bvh, &tally);
    let Standing { size, sum, .. } = standing;
    let found = Found {
        primitives: bvh.len() as f64,
        nodes,
        gain: over_good(bvh.history(), tally.gain, size),
        excess: model.excess(&standing, bvh.history()),
    };
    scratch.clock.excess = found.excess.max(0.0);
    let history = raw::parts(bvh).history;
    history.since_repair = history.since_repair.saturating_add(1);
    model.choose_pause(history, &found);
    let now = reference(sum, size);
    if now > 0.0 {
        // A tree that has become better is from now on held to that. One that was built over points is no measure, nor is
        // one of what was scattered then: it may be bad and still be better than that.
        let pays = model.lost(1.0) * GAIN_LASTS > model.builder(found.primitives, u32::MAX).1;
        history.is_due = history.reference == 0.0 || !crate::ablation::is_off(4) && pays && now < GATHERED * history.measured;
        history.reference = history.reference.min(now);
    }
    history.size = size;
    scratch.clock.slope.fitted(standing.excess, history.reference);
    if history.is_due {
        return Ok(refitted(bvh));
    }
    if history.is_beyond_repair && found.excess < LITTLE {
        // What was out of place is back, or there is not much of it anywhere.
        (history.is_beyond_repair, history.regret) = (false, 0.0);
        history.looks_in_vain = history.looks_in_vain.saturating_add(1);
    }
    history.regret += model.lost(found.excess);
    let (builder, price_of_new) = model.builder(found.primitives, 1);
    // This update has had its pass. A new tree can wait for the next, unless a frame with this one costs more than that.
    let is_urgent = model.lost(standing.excess) > price_of_new;
    if decision == Decision::Split && !is_urgent {
        // One thing at a time: frames are to be alike.
        return Ok(refitted(bvh));
    }
    let is_new = history.rebuilds_in_a_row > 0 && history.since_repair <= SOON;
    let is_looked_at = is_new && is_time_to_look;
    if (history.is_hasty || history.is_beyond_repair) && !is_looked_at && is_urgent {
        return better_tree(bvh, primitives, builder, model, &tally, scratch);
    }
    if history.is_hasty && !is_looked_at {
        history.is_due = history.regret > model.builder(found.primitives, u32::MAX).1;
        return Ok(refitted(bvh));
    }
    let (lasting, price_of_lasting) = model.builder(found.primitives, history.since_repair);
    let price_of_lasting = price_of_lasting * doubled(history.trees_in_vain);
    let is_hopeless = history.is_beyond_repair && !is_looked_at;
    if history.regret <= if is_hopeless { price.max(price_of_lasting) } else { price } {
        return Ok(refitted(bvh));
    }
    // Where a new tree is bad again at once, little of it is worth keeping.
    let part = if is_new && !is_time_to_look { 0.5 * LARGEST_CUT } else { LARGEST_CUT };
    let most = part * found.primitives;
    let threshold = model.threshold(history) * good_area(history, size);
    let growth = history.leaves.growth;
    let start = (scratch.clock.now)();
    let regrown = regrow(bvh, primitives, &tally, if crate::ablation::is_off(11) { 1.0 } else { PAYS_BACK } * threshold, most as usize, scratch);
    let took = (scratch.clock.now)().saturating_duration_since(start);
    match regrown {
        Regrown::Top { subtrees: 0, .. } => {
            let history = raw::parts(bvh).history;
            (history.regret, history.looks_in_vain) = (0.0, history.looks_in_vain.saturating_add(1));
            Ok(refitted(bvh))
        }
        Regrown::Top { subtrees, change, apart } => {
            were_set_apart(bvh, &tally, growth, &apart);
            let Weights { cut_node, graft_subtree, .. } = Weights::MODEL;
            let expected = found.nodes * cut_node + subtrees as f64 * graft_subtree;
            scratch.clock.learn(Work::Repair, expected, took);
            if has_other_leaves {
                scratch.clock.slope.repaired();
            } else {
                // By the standard of the tree before, as rays have seen it.
                scratch.clock.slope.renewed(before.reference, || excess(&before, sum + change, size));
            }
            scratch.clock.excess = 0.0;
            let decision = Decision::Regrow { subtrees };
            Ok(Update { decision, sah_cost: None, ..refitted(bvh) })
        }
        Regrown::TooMuch if is_urgent => better_tree(bvh, primitives, builder, model, &tally, scratch),
        Regrown::TooMuch if bvh.history().looks_in_vain > 0 => {
            // What there still is to gain lies in very many subtrees, so small that rotations see to them.
            is_as_good_as_it_gets(bvh, &standing, scratch);
            Ok(refitted(bvh))
        }
        Regrown::TooMuch => {
            let history = raw::parts(bvh).history;
            history.is_beyond_repair = true;
            if history.regret <= price_of_lasting {
                return Ok(refitted(bvh));
            }
            better_tree(bvh, primitives, lasting, model, &tally, scratch)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::time::{Duration, Instant};

    use bvh_build::{BuildOptions, build};
    use bvh_core::{Aabb, Vec3, sah_cost};

    use super::*;
    use crate::Strategy;

    const N: usize = 2000;

    thread_local!(static START: Instant = Instant::now());

    /// Boxes that jump to new places at every step.
    fn chaos(step: usize) -> Vec<Aabb> {
        let place = |i: usize, k: usize| {
            let h = (i * 3 + k + 7919 * step).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32 * 50.0
        };
        (0..N)
            .map(|i| Vec3::new(place(i, 0), place(i, 1), place(i, 2)))
            .map(|corner| Aabb::new(corner, corner + 0.8))
            .collect()
    }

    /// Plays some steps of chaos, telling after each that a ray takes so many nanoseconds; gives the builder of the last
    /// new tree, the number of these, and the tree.
    fn play(auto: Auto, now: fn() -> Instant, ray: Option<f64>) -> (Option<Builder>, usize, Bvh, Scratch) {
        let mut bvh = build(&chaos(0), Builder::Sweep, &BuildOptions::default(), None).expect("few");
        let mut scratch = Scratch::new();
        scratch.clock.now = now;
        let mut builders = Vec::new();
        for step in 1..=8 {
            let told = crate::update(&mut bvh, &chaos(step), &Strategy::Auto(auto), &mut scratch);
            if let Decision::Rebuild { builder } = told.expect("updated").decision {
                builders.push(builder);
            }
            if let Some(ns) = ray {
                scratch.traced(1 << 20, Duration::from_secs_f64(ns * f64::from(1 << 20) * 1e-9));
            }
        }
        (builders.last().copied(), builders.len(), bvh, scratch)
    }

    #[test]
    fn the_slower_rays_are_by_the_clock_the_better_the_builder_and_without_it_they_do_not_matter() {
        let stopped = || START.with(|start| *start);
        let auto = Auto { rays: 1 << 13, ..Auto::default() };
        let (builder, _, plain, _) = play(auto, stopped, None);
        assert_eq!(builder, Some(Builder::Lbvh));
        let (.., told, scratch) = play(auto, stopped, Some(1e4));
        assert_eq!(plain.hash(), told.hash());
        assert!(scratch.calibration().rays.is_some_and(|factor| factor > 1.0));
        // A clock that stands still and rays that are not told of leave the model as it is.
        let auto = Auto { clock: true, ..auto };
        assert_eq!(plain.hash(), play(auto, stopped, None).2.hash());
        assert_eq!(play(auto, stopped, Some(1e4)).0, Some(Builder::Ploc));
        let few = Auto { rays: 1 << 9, ..auto };
        assert!(play(few, stopped, Some(1e-3)).1 < play(few, stopped, None).1);
        assert_eq!(play(Auto { rays: 0, ..auto }, stopped, Some(f64::from(u32::MAX))).1, 0);
    }

    /// Boxes on their way from one chaos to another.
    fn apart(part: f32) -> Vec<Aabb> {
        let between = |(a, b): (&Aabb, &Aabb)| {
            let corner = a.min + (b.min - a.min) * part;
            Aabb::new(corner, corner + 0.8)
        };
        chaos(0).iter().zip(&chaos(1)).map(between).collect()
    }

    #[test]
    fn what_excess_costs_rays_is_learned_from_their_visits() {
        // Drifts apart and comes together again, while rays visit more nodes by so much for each part of the cost that is
        // above a fresh tree's: gives how often the tree was repaired, and by whom it was built anew.
        let play = |slope: f64, rays: u64| {
            let mut bvh = build(&apart(0.0), Builder::Sweep, &BuildOptions::default(), None).expect("few");
            let (mut scratch, mut repairs, mut builders) = (Scratch::new(), 0, Vec::new());
            for step in 1..=80 {
                let boxes = apart(0.02 * (step % 10) as f32);
                let strategy = Strategy::Auto(Auto { rays, ..Auto::default() });
                let told = crate::update(&mut bvh, &boxes, &strategy, &mut scratch).expect("updated");
                repairs +=
                    u32::from(matches!(told.decision, Decision::Regrow { .. } | Decision::Rebuild { .. }));
                if let Decision::Rebuild { builder } = told.decision {
                    builders.push(builder);
                }
                let fresh = build(&boxes, Builder::Sweep, &BuildOptions::default(), None).expect("few");
                let excess = sah_cost(&bvh) / sah_cost(&fresh) - 1.0;
                scratch.visited(1000, (1e6 * (1.0 + slope * excess)) as u64, 0.025);
            }
            (repairs, builders, scratch.visits_per_excess().expect("there were new trees"), bvh.hash())
        };
        for rays in [1 << 12, 1 << 14] {
            let (few, _, little, _) = play(0.1, rays);
            let (many, builders, much, hash) = play(2.5, rays);
            assert!((0.0625..0.3).contains(&little) && (1.5..4.0).contains(&much), "{little}, {much}");
            assert!(few < many, "{few}, {many}");
            assert_eq!(play(2.5, rays).3, hash);
            assert!(builders.contains(&Builder::Lbvh) || rays > 1 << 12, "{builders:?}");
        }
    }

    #[test]
    fn what_rays_lose_to_a_tree_of_unchanged_cost_is_learned_from_their_visits() {
        // Everything jumps once, so that the tree is built anew, and hardly moves again; yet rays visit more nodes from
        // frame to frame: gives how often the tree is built anew after that.
        let play = |is_due_to_the_tree: bool| {
            let mut bvh = build(&chaos(0), Builder::Sweep, &BuildOptions::default(), None).expect("few");
            let (mut scratch, mut built, mut rebuilds, mut in_a_row) = (Scratch::new(), 0, 0, 0);
            let strategy = Strategy::Auto(Auto { rays: 1 << 14, ..Auto::default() });
            for step in 0..60 {
                let mut boxes = chaos(usize::from(step > 3));
                boxes.iter_mut().for_each(|aabb| aabb.max += 1e-4 * step as f32);
                let told = crate::update(&mut bvh, &boxes, &strategy, &mut scratch).expect("updated");
                if told.rebuilt {
                    built = step;
                    rebuilds += u32::from(step > 14);
                }
                in_a_row = in_a_row.max(bvh.history().rebuilds_in_a_row);
                // That it may be due to the tree is learned in any case.
                let frames = if is_due_to_the_tree || step < 14 { step - built } else { step };
                scratch.visited(100, 1000 * (10 + frames as u64), 25.0 / 100.0);
            }
            (rebuilds, in_a_row)
        };
        let [due, motion] = [true, false].map(play);
        assert!((8..30).contains(&due.0) && (1..6).contains(&motion.0), "{due:?}, {motion:?}");
        // One could always wait.
        assert!(due.1 <= 1 && motion.1 <= 1, "{due:?}, {motion:?}");
    }

    #[test]
    fn work_is_measured_by_the_clock() {
        thread_local!(static TIME: Cell<u32> = const { Cell::new(0) });
        // A millisecond between one look and the next.
        let ticking =
            || START.with(|start| *start + Duration::from_millis(u64::from(TIME.replace(TIME.get() + 1))));
        let (.., scratch) = play(Auto { clock: true, ..Auto::default() }, ticking, None);
        let calibration = scratch.calibration();
        let over = |expected: f64| (1e6 / expected).min(64.0);
        let rebuild = calibration.rebuild.expect("chaos is built anew");
        assert!((rebuild - over(N as f64 * Weights::MODEL.rebuild_primitive)).abs() < 1e-9, "{calibration}");
        assert!(calibration.pass.is_some_and(|pass| pass > 10.0), "{calibration}");
        assert_eq!(calibration.rays, None);
    }
}
