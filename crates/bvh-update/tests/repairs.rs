//! Strategies that repair: that they do, that they leave the tree right, and that `Auto` chooses
//! sensibly.

mod common;

use std::time::{Duration, Instant};

use bvh_build::build;
use bvh_core::{Aabb, Bvh, Vec3, sah_cost};
use bvh_update::{
    Auto, Background, BuildOptions, Builder, Decision, Degraded, Load, PartialRebuild, Reinsertion, Rotate,
    Strategy, Updater,
};
use common::{noise, over_fresh, tree};

const N: usize = 2000;

/// How long a test waits for a tree from the background.
const PATIENCE: Duration = Duration::from_secs(60);

fn burst(time: f32) -> Vec<Aabb> {
    common::burst(N, N, time)
}

/// Boxes that jump to new places at every step.
fn chaos(step: usize) -> Vec<Aabb> {
    (0..N).map(|i| noise(i + 7919 * step) * 50.0).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

/// Checks that a leaf is dynamic if one of its primitives moves, and else is not.
fn check_mask(bvh: &Bvh, moves: impl Fn(usize) -> bool, what: &str) {
    bvh.visit(|n, node, _| {
        if node.count() > 0 {
            let expected = bvh.primitives(node).iter().any(|&p| moves(p as usize));
            assert_eq!(node.is_dynamic(), expected, "{what}, leaf {n}");
        }
    });
}

/// Plays the burst; gives the decisions, and the greatest cost over that of a fresh tree.
fn play(strategy: Strategy, moves: impl Fn(usize) -> bool) -> (Vec<Decision>, f64) {
    let mut bvh = tree(&burst(0.0));
    bvh.set_dynamic(&moves);
    let mut updater = Updater::default();
    let mut worst = 0.0f64;
    let decisions = (1..=20).map(|step| {
        let (still, moved) = (burst(0.0), burst(step as f32 / 20.0));
        let boxes: Vec<_> = (0..N).map(|i| if moves(i) { moved[i] } else { still[i] }).collect();
        let report = updater.set_strategy(strategy).update(&mut bvh, boxes.as_slice()).expect("updated");
        bvh.validate(boxes.as_slice()).expect("valid");
        check_mask(&bvh, &moves, strategy.name());
        if let Some(cost) = report.sah_cost {
            let real = sah_cost(&bvh);
            assert!((cost - real).abs() <= 1e-5 * real, "{} report {cost} for {real}", strategy.name());
        }
        worst = worst.max(over_fresh(&bvh, &boxes));
        report.decision
    });
    (decisions.collect(), worst)
}

fn regrown(decisions: &[Decision]) -> usize {
    decisions.iter().filter(|d| matches!(d, Decision::PartialRebuild { .. })).count()
}

fn is_rebuild(decision: &Decision) -> bool {
    matches!(decision, Decision::Rebuild { .. })
}

/// Whether a new top or a new tree was built, a tree also if it was given up.
fn is_repair(decision: &Decision) -> bool {
    is_rebuild(decision) || matches!(decision, Decision::PartialRebuild { .. } | Decision::Kept { .. })
}

fn auto(load: Load) -> Strategy {
    Strategy::Auto(Auto::default().with_load(load))
}

fn degraded(threshold: f64) -> Strategy {
    Strategy::Degraded(Degraded::default().with_threshold(threshold))
}

fn partial(rotate: Option<Rotate>) -> Strategy {
    Strategy::PartialRebuild(PartialRebuild::default().with_rotate(rotate))
}

#[test]
fn partial_rebuilds_keep_a_burst_nearly_as_good_as_new() {
    let (_, refitted) = play(Strategy::Refit, |_| true);
    for rotate in [None, Some(Rotate::default())] {
        let strategy = partial(rotate);
        let (decisions, worst) = play(strategy, |_| true);
        assert!(regrown(&decisions) > 0, "{}: {decisions:?}", strategy.name());
        assert!(worst < 1.25, "{worst} with {}", strategy.name());
        assert!(refitted > 3.0 * worst, "nothing to repair: {refitted}");
    }
}

/// One box flies far off for one frame. What a tree cost with it is no measure afterwards.
#[test]
fn a_stray_box_does_not_end_repairs() {
    let mut bvh = tree(&burst(0.0));
    let mut updater = Updater::new(Strategy::PartialRebuild(PartialRebuild::default()));
    let mut update = |boxes: &Vec<Aabb>| {
        updater.update(&mut bvh, boxes).expect("as many");
        over_fresh(&bvh, boxes)
    };
    let mut stray = burst(0.0);
    stray[7] = Aabb::new(Vec3::splat(1e6), Vec3::splat(1e6 + 1.0));
    update(&stray);
    let worst = (0..=20).map(|step| update(&burst(step as f32 / 20.0))).fold(0.0, f64::max);
    assert!(worst < 1.25, "{worst}");
}

#[test]
fn partial_rebuilds_keep_static_primitives_static() {
    // The mask and the reported costs are checked on the way.
    let (decisions, _) = play(Strategy::PartialRebuild(PartialRebuild::default()), |i| i % 100 < 50);
    assert!(regrown(&decisions) > 0, "{decisions:?}");
}

#[test]
fn a_degraded_tree_is_rebuilt() {
    let (decisions, worst) = play(degraded(0.02), |_| true);
    let rebuilds = decisions.iter().filter(|d| is_rebuild(d)).count();
    assert!((1..20).contains(&rebuilds), "{rebuilds} rebuilds");
    let (decisions, refitted) = play(degraded(f64::INFINITY), |_| true);
    assert!(decisions.iter().all(|d| *d == Decision::AsAlways));
    assert!(worst < refitted);
}

#[test]
fn new_trees_have_no_larger_leaves_than_those_they_replace_but_as_large_ones() {
    // Two boxes in each place, close enough to share a leaf.
    let pairs = |step: usize| -> Vec<Aabb> {
        let boxes = chaos(step);
        (0..N).map(|i| boxes[i / 2]).collect()
    };
    let largest = |bvh: &Bvh| bvh.nodes().iter().map(bvh_core::Node::count).max();
    let strategies = [
        Strategy::Auto(Auto::default()),
        Strategy::PartialRebuild(PartialRebuild::default()),
        degraded(0.0),
        Strategy::Background(Background::default()),
    ];
    for (strategy, max_leaf_size) in strategies.iter().flat_map(|s| [(s, 1), (s, 2)]) {
        let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
        let mut bvh = bvh_build::build_with(&pairs(0), Builder::Sweep, &options).expect("built");
        let mut updater = Updater::default();
        let is_new = (1..2000).any(|step| {
            let boxes = pairs(step);
            let report = updater.set_strategy(*strategy).update(&mut bvh, &boxes).expect("updated");
            bvh.validate(&boxes).expect("valid");
            report.rebuilt
        });
        assert!(is_new, "{}", strategy.name());
        assert_eq!(largest(&bvh), Some(max_leaf_size as usize), "{}", strategy.name());
    }
}

#[test]
fn reinserting_helps_a_burst() {
    let (_, refitted) = play(Strategy::Refit, |_| true);
    let strategy = Strategy::Reinsert(Reinsertion::default().with_rotate(None).with_part(0.05));
    let (_, worst) = play(strategy, |i| i % 3 > 0);
    assert!(worst < 0.7 * refitted, "{worst} for {refitted}");
}

#[test]
fn auto_repairs_a_burst_where_rays_pay_for_it() {
    let (decisions, worst) = play(auto(Load::PacketRays(2 << 20)), |_| true);
    assert!(regrown(&decisions) > 0 && worst < 1.3, "{worst}: {decisions:?}");
    // Without any load the tree does not rot.
    let (_, worst) = play(auto(Load::PacketRays(0)), |_| true);
    assert!(worst < 2.0, "{worst}");
}

#[test]
fn auto_stops_looking_in_chaos_and_rests_where_nothing_moves() {
    let strategy = Strategy::Auto(Auto::default());
    let mut updater = Updater::default();
    let mut bvh = tree(&chaos(0));
    let mut decide = |bvh: &mut Bvh, boxes: &[Aabb]| {
        let report = updater.set_strategy(strategy).update(bvh, boxes).expect("updated");
        bvh.validate(boxes).expect("valid");
        report
    };
    let report: Vec<_> = (1..=12).map(|step| decide(&mut bvh, &chaos(step))).collect();
    assert!(report[1..].iter().filter(|t| is_rebuild(&t.decision)).count() >= 9, "{report:?}");
    // A decision without a look at the tree has no reason.
    let blind = report[4..].iter().filter(|t| t.reason.is_none()).count();
    assert!(blind > 4, "{report:?}");
    assert!(over_fresh(&bvh, &chaos(12)) < 1.3);

    let boxes = chaos(12);
    let report: Vec<_> = (0..20).map(|_| decide(&mut bvh, &boxes)).collect();
    assert!(report[18..].iter().all(|t| !t.rebuilt), "{report:?}");
}

#[test]
fn the_more_rays_the_more_auto_repairs_and_the_better_the_builder() {
    let play_with = |rays| play(auto(Load::PacketRays(rays)), |_| true);
    let repairs = [1 << 8, 1 << 14, 2 << 20].map(|rays| {
        let (decisions, worst) = play_with(rays);
        (decisions.iter().filter(|d| is_repair(d)).count(), worst)
    });
    assert!(repairs[0].0 < repairs[2].0, "{repairs:?}");
    assert!(repairs.is_sorted_by(|a, b| a.1 >= b.1) && repairs[0].1 > repairs[2].1, "{repairs:?}");

    // In chaos: a fast build for few rays, a good one for many.
    let builders = [1 << 13, 2 << 20].map(|rays| {
        let mut bvh = tree(&chaos(0));
        let mut updater = Updater::default();
        let decisions: Vec<_> = (1..=8)
            .map(|step| {
                let boxes = chaos(step);
                let strategy = auto(Load::PacketRays(rays));
                updater.set_strategy(strategy).update(&mut bvh, boxes.as_slice()).expect("updated").decision
            })
            .collect();
        decisions.into_iter().rev().find(is_rebuild)
    });
    let by = |builder| Some(Decision::Rebuild { builder });
    assert_eq!(builders, [by(Builder::Lbvh), by(Builder::Ploc)]);
}

/// Links, boxes, heights and dynamic bits.
fn shape(bvh: &Bvh) -> Vec<(usize, Aabb, u32, bool)> {
    let mut shape = Vec::new();
    bvh.visit(|_, node, _| shape.push((node.first(), node.aabb(), node.height(), node.is_dynamic())));
    shape
}

#[test]
fn a_tree_that_costs_little_more_than_a_new_one_is_refitted_and_rotated() {
    let moves = |i: usize| !i.is_multiple_of(3);
    let strategy = auto(Load::PacketRays(2 << 20));
    let (mut bvh, mut kept) = (tree(&burst(0.0)), 0);
    bvh.set_dynamic(moves);
    let mut updater = Updater::new(strategy);
    // One updater for trees of two sizes.
    let (mut small, few) = (tree(&burst(0.0)[..9]), burst(1.0)[..9].to_vec());
    for step in 1..=30 {
        let (still, moved) = (burst(0.0), burst(step.min(20) as f32 / 20.0));
        let boxes: Vec<_> = (0..N).map(|i| if moves(i) { moved[i] } else { still[i] }).collect();
        let mut rotated = bvh.clone();
        let update = updater.update(&mut bvh, &boxes).expect("updated");
        updater.update(&mut small, &few).expect("updated");
        bvh.validate(&boxes).expect("valid");
        small.validate(&few).expect("valid");
        check_mask(&bvh, moves, "kept or not");
        if let Decision::Kept { builder } = update.decision {
            kept += 1;
            bvh_update::refit_and_rotate(&mut rotated, &boxes).expect("updated");
            assert_eq!((shape(&bvh), bvh.order()), (shape(&rotated), rotated.order()), "step {step}");
            assert_eq!(bvh.static_area(), rotated.static_area(), "step {step}");
            let new = sah_cost(&build(&boxes, builder).expect("built"));
            let cost = update.sah_cost.expect("known");
            assert!(0.98 * cost <= new * (1.0 + 1e-6), "step {step}: {cost} is kept, a new tree costs {new}");
            assert!(!update.rebuilt && update.reason.is_some());
        }
        assert!(step < 25 || update.decision == Decision::AsAlways, "{} at rest", update.decision);
    }
    assert!(kept > 0, "nothing was kept");
}

#[test]
fn a_fast_build_is_compared_with_a_good_one_once_the_chaos_is_over() {
    let strategy = auto(Load::PacketRays(1 << 13));
    let mut bvh = tree(&chaos(0));
    let mut updater = Updater::default();
    let mut decide =
        |boxes: &[Aabb]| updater.set_strategy(strategy).update(&mut bvh, boxes).expect("updated").decision;
    let chaotic: Vec<_> = (1..=6).map(|step| decide(&chaos(step))).collect();
    assert_eq!(chaotic[5], Decision::Rebuild { builder: Builder::Lbvh }, "{chaotic:?}");
    let calm: Vec<_> = (0..90).map(|_| decide(&chaos(6))).collect();
    // It takes a while until it looks whether the chaos is over.
    let last = calm.iter().rev().find(|d| is_repair(d)).copied();
    assert_eq!(last, Some(Decision::Kept { builder: Builder::Ploc }), "rotations have mended it: {calm:?}");
    assert!(!calm[60..].iter().any(is_repair), "{calm:?}");
    assert!(over_fresh(&bvh, &chaos(6)) < 1.1);
}

#[test]
fn static_primitives_stay_static_in_every_new_tree() {
    let moves = |i: usize| !i.is_multiple_of(3);
    let still = burst(0.0);
    for strategy in Strategy::all() {
        let mut bvh = tree(&still);
        bvh.set_dynamic(moves);
        let mut updater = Updater::new(strategy);
        let mut rebuilds = 0;
        for step in 1..=12 {
            let moved = chaos(step);
            let boxes: Vec<_> = (0..N).map(|i| if moves(i) { moved[i] } else { still[i] }).collect();
            let report = updater.update(&mut bvh, boxes.as_slice()).expect("updated");
            bvh.validate(boxes.as_slice()).expect("valid");
            assert!(!bvh.all_dynamic(), "{strategy}, step {step}");
            check_mask(&bvh, moves, strategy.name());
            rebuilds += usize::from(report.rebuilt);
        }
        let builds = matches!(
            strategy,
            Strategy::Rebuild(..) | Strategy::Degraded(_) | Strategy::PartialRebuild(_) | Strategy::Auto(_)
        );
        // Trees from the background come when they are ready.
        assert!(rebuilds > 0 || !builds, "{strategy} built no tree");
    }
}

#[test]
fn reported_loads_take_the_place_of_that_of_auto() {
    let [few, many] = [1 << 13, 2 << 20].map(Load::PacketRays);
    let play = |load, reports: &[Option<Load>]| {
        let (mut bvh, mut updater) = (tree(&chaos(0)), Updater::new(auto(load)));
        reports.iter().for_each(|&load| updater.report(load));
        [1, 2, 3, 4, 5, 6].map(|step| {
            let report = updater.update(&mut bvh, &chaos(step)).expect("updated");
            (report.decision, bvh.fingerprint())
        })
    };
    assert_ne!(play(few, &[]), play(many, &[]));
    assert_eq!(play(few, &[Some(many)]), play(many, &[]));
    assert_eq!(play(few, &[Some(many), None]), play(few, &[]));
}

#[test]
fn a_strategy_does_not_trust_what_another_has_measured() {
    // The ratio that one goes by is below 1, the sum of areas that the other goes by far above.
    let (areas, ratios) = (partial(None), Strategy::Degraded(Degraded::default()));
    for [first, second] in [[areas, ratios], [ratios, areas]] {
        let mut bvh = tree(&burst(0.0));
        let mut updater = Updater::default();
        let mut report = |time: f32, strategy: &Strategy| {
            updater
                .set_strategy(*strategy)
                .update(&mut bvh, burst(time).as_slice())
                .expect("updated")
                .decision
        };
        assert_eq!([report(0.0, &first), report(0.0, &second)], [Decision::AsAlways; 2]);
        assert!(is_repair(&report(0.5, &second)), "{} after {}", second.name(), first.name());
    }
}

#[test]
fn decisions_and_reasons_say_what_and_why_in_one_line() {
    let mut bvh = tree(&burst(0.0));
    let mut updater = Updater::default();
    let mut trees = 0;
    for step in 1..=20 {
        let report = updater.update(&mut bvh, burst(step as f32 / 20.0).as_slice()).expect("updated");
        let reason = report.reason.expect("decided after a pass");
        let line = format!("{}: {reason}", report.decision);
        assert!(line.lines().count() == 1 && line.contains(" ms"), "{line}");
        // Of a tree that was built, also where a new top was tried first, it is what that tree
        // costs.
        let builds = matches!(report.decision, Decision::Rebuild { .. } | Decision::Kept { .. });
        trees += u32::from(builds);
        if builds || matches!(report.decision, Decision::PartialRebuild { .. }) {
            assert!(reason.lost_ms > reason.price_ms, "{line}");
        }
        if builds {
            let builds_alone = [32.0, 85.0].map(|ns| 1e-6 * ns * bvh.len() as f64);
            let is_one = |price: f64| builds_alone.iter().any(|p| [p, &(2.0 * p)].contains(&&price));
            assert!(is_one(reason.price_ms), "{line}, not {builds_alone:?}");
        }
        if reason.lost_ms > reason.price_ms {
            assert_ne!(report.decision, Decision::AsAlways, "{line}");
        }
    }
    assert!(trees > 0, "no tree was built");
}

#[test]
fn repairs_do_not_depend_on_threads() {
    let regrow = Strategy::PartialRebuild(PartialRebuild::default());
    for strategy in [regrow, Strategy::Auto(Auto::default())] {
        let hashes = [1, 2, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| {
                let mut bvh = tree(&burst(0.0));
                let mut updater = Updater::default();
                for step in 1..=6 {
                    let boxes = burst(step as f32 / 6.0);
                    updater.set_strategy(strategy).update(&mut bvh, boxes.as_slice()).expect("updated");
                }
                bvh.fingerprint()
            })
        });
        assert!(hashes.iter().all(|h| *h == hashes[0]), "{}", strategy.name());
    }
}

#[test]
fn trees_from_the_background_take_over_and_none_waits_or_is_mistaken() {
    [Builder::Binned, Builder::BinnedParallel].into_iter().for_each(trees_take_over);
}

fn trees_take_over(builder: Builder) {
    let background = Background::default().with_rotate(Some(Rotate::default())).with_builder(builder);
    let strategy = Strategy::Background(background);
    let mut updater = Updater::default();
    let mut trees = [tree(&burst(0.0)), tree(&chaos(0))];
    let mut swaps = [0; 2];
    let start = Instant::now();
    // Two trees of one size share the memory, which is allowed, if of no use.
    for step in 0.. {
        let which = step / 300 % 2;
        let boxes = if which == 0 { burst((step % 300) as f32 / 300.0) } else { chaos(step / 100) };
        let report =
            updater.set_strategy(strategy).update(&mut trees[which], boxes.as_slice()).expect("updated");
        trees[which].validate(boxes.as_slice()).expect("valid");
        swaps[which] += u32::from(report.decision == Decision::Swap);
        let cost = updater.background_cost();
        assert_eq!(cost.is_some(), swaps != [0; 2]);
        if let Some(cost) = cost {
            // Two nodes, a slot, a box, and a builder's own box and number.
            assert!(cost.bytes >= N * (68 + 24 + 32) && cost.bytes < N * 400, "{cost:?}");
            assert!(cost.delay > 0 && cost.delay <= step as u32, "{cost:?}");
        }
        if swaps.iter().all(|&n| n >= 3) {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "only {swaps:?} trees took over");
    }
}

/// A sheet of two boxes in each place, which rises and falls, and in between bursts into single
/// boxes.
fn frayed(step: usize) -> Vec<Aabb> {
    (0..N)
        .map(|i| {
            let at = Vec3::new((i / 2 / 40) as f32, (i / 2 % 40) as f32, (step as f32 * 0.1).sin());
            let corner = at + (noise(i) - 0.5) * if step / 20 == 1 { 100.0 } else { 0.1 };
            Aabb::new(corner, corner + 0.8)
        })
        .collect()
}

/// `Auto` keeps a tree good over boxes that scatter and meet again, at once or slowly, and knows
/// what it costs.
#[test]
fn auto_follows_boxes_that_scatter_and_meet_again() {
    // Pairs of boxes that part and meet again.
    let parting = |step: usize| -> Vec<Aabb> {
        let apart = (step as f32 - 20.0).clamp(0.0, 40.0).min(80.0 - step as f32) * 0.05;
        let by = |i: usize| (noise(i / 2) - 0.5) * if i.is_multiple_of(2) { apart } else { -apart };
        let moved = |(i, aabb): (usize, Aabb)| Aabb::new(aabb.min + by(i), aabb.max + by(i));
        frayed(0).into_iter().enumerate().map(moved).collect()
    };
    for (which, pose) in [&frayed as &dyn Fn(usize) -> Vec<Aabb>, &parting].into_iter().enumerate() {
        let mut bvh = tree(&pose(0));
        let mut updater = Updater::default();
        for step in 1..160 {
            let boxes = pose(step % 80);
            let report = updater.update(&mut bvh, boxes.as_slice()).expect("updated");
            bvh.validate(boxes.as_slice()).expect("valid");
            let real = sah_cost(&bvh);
            assert!(
                report.sah_cost.is_none_or(|report| (report - real).abs() <= 1e-5 * real),
                "{report:?}, {real}"
            );
            // Chaos begins and ends within a few steps.
            let settles = which == 0 && step % 20 < 4;
            let over = over_fresh(&bvh, &boxes);
            assert!(over < 1.5 || settles, "{over} at {step}, {which}");
        }
    }
}

/// Built over points, a tree is any tree; once they have burst apart it must not be held for a good
/// one.
#[test]
fn auto_rebuilds_a_tree_built_over_points() {
    let points = vec![Aabb::new(Vec3::ONE, Vec3::ONE); N];
    for (first, steps) in [(points.clone(), 0), (chaos(0), 3)] {
        let mut bvh = tree(&first);
        let mut updater = Updater::default();
        let auto = Strategy::Auto(Auto::default());
        for _ in 0..steps {
            updater.set_strategy(auto).update(&mut bvh, &points).expect("updated");
        }
        for _ in 0..3 {
            updater.set_strategy(auto).update(&mut bvh, &chaos(1)).expect("updated");
        }
        let over = over_fresh(&bvh, &chaos(1));
        assert!(over < 1.3, "{over} after {steps} steps over points");
    }
}

/// What is built in the background knows primitives by the numbers they had.
#[test]
fn no_tree_of_old_numbers_takes_over() {
    let mut bvh = tree(&chaos(0));
    let mut updater = Updater::default();
    let background = Strategy::Background(Background::default());
    updater.set_strategy(background).update(&mut bvh, &chaos(0)).expect("updated");
    let order = bvh.reorder_primitives();
    let boxes: Vec<_> = order.iter().map(|&p| chaos(0)[p as usize]).collect();
    let (fresh, start) = (sah_cost(&bvh), Instant::now());
    let mut has_swapped = false;
    while !has_swapped {
        assert!(start.elapsed() < PATIENCE, "no tree took over");
        std::thread::sleep(Duration::from_millis(1));
        let report = updater.set_strategy(background).update(&mut bvh, &boxes).expect("updated");
        assert!(sah_cost(&bvh) < 1.5 * fresh, "a tree over other numbers");
        has_swapped = report.decision == Decision::Swap;
    }
}

/// The mask of what is dynamic changes now and then, before a tree from the background takes over
/// or after it. Two trees take turns.
#[test]
fn trees_from_the_background_have_the_latest_dynamic_mask() {
    let background = Strategy::Background(Background::default());
    let mut trees = [0, 1].map(|_| tree(&chaos(0)));
    let mut updater = Updater::new(background);
    let (mut swaps, mut asked, start) = (0, [1; 2], Instant::now());
    for step in 0.. {
        let which = step / 10 % 2;
        let bvh = &mut trees[which];
        if step % 23 == 0 {
            asked[which] = 1 + step % 3;
            let period = asked[which];
            bvh.set_dynamic(|p| p.is_multiple_of(period));
        }
        let marked = bvh.update_state().changes.dynamic;
        let report = updater.update(bvh, &chaos(0)).expect("updated");
        bvh.validate(&chaos(0)).expect("valid");
        let is_swap = report.decision == Decision::Swap;
        // `SleepDelay` learns of the swap by that.
        assert_eq!(bvh.update_state().changes.dynamic > marked, is_swap, "step {step}");
        swaps += usize::from(is_swap);
        assert_eq!(bvh.all_dynamic(), asked[which] == 1, "step {step}");
        check_mask(bvh, |p| p.is_multiple_of(asked[which]), "a tree from the background");
        if step >= 300 && swaps > 2 {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "only {swaps} trees took over");
        if step % 2 == 0 {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Three boxes in a row, nearly regular: which two are a pair makes a difference of 1e-8 of the
/// cost.
#[test]
fn trees_that_are_equal_but_for_rounding_are_not_exchanged_for_ever() {
    let row = |corners: [[[f32; 3]; 2]; 3]| corners.map(|[min, max]| Aabb::new(min.into(), max.into()));
    let boxes = row([
        [[1.166_276_3e-7, 3.636_046_7e-7, 8.269_298e-8], [0.900_000_9, 0.900_001_1, 0.900_000_8]],
        [[1.100_001, 1.100_000_5, 1.100_000_6], [2.000_001_2, 2.000_000_7, 2.000_000_7]],
        [[2.200_000_5, 2.200_001, 2.200_001], [3.100_001, 3.100_001_6, 3.100_001_6]],
    ]);
    let mut bvh = build(&boxes, Builder::Ploc).expect("built");
    let mut updater = Updater::new(Strategy::Reinsert(Reinsertion::default()));
    let hashes = [0; 200].map(|_| {
        updater.update(&mut bvh, &boxes).expect("as many");
        bvh.fingerprint()
    });
    assert!(hashes[100..].iter().all(|&hash| hash == hashes[199]));
    // Areas that have few digits in `f32`.
    for seed in 0..10 {
        // Not from a crate: the check came with these boxes, and others may not show the failure.
        let at = |i: u32, k: u32| (i.wrapping_mul(k).wrapping_add(seed * 7919) % 99_991) as f32 * 1e-5;
        let corner = |i: u32| Vec3::new(at(i, 7919), at(i, 104_729), at(i, 1_299_709));
        let boxes: Vec<Aabb> =
            (0..300).map(corner).map(|p| Aabb::new(p * 1e-22, (p + 0.05) * 1e-22)).collect();
        let mut bvh = build(&boxes, Builder::Lbvh).expect("built");
        let hashes: Vec<_> = (0..400)
            .map(|_| {
                updater.update(&mut bvh, &boxes).expect("as many");
                bvh.fingerprint()
            })
            .collect();
        assert!(hashes[350..].iter().all(|&hash| hash == hashes[399]), "{seed}");
    }
}

/// What moves after a build began, and rests when its tree takes over, has its box where it rests.
#[test]
fn trees_from_the_background_fit_what_came_to_rest_meanwhile() {
    let mut bvh = tree(&chaos(0));
    let mut updater = Updater::new(Strategy::Background(Background::default()));
    for step in 0..2 {
        updater.update(&mut bvh, &chaos(step)).expect("updated");
    }
    bvh.set_dynamic(|p| p == 0);
    let start = Instant::now();
    while updater.update(&mut bvh, &chaos(1)).expect("updated").decision != Decision::Swap {
        assert!(start.elapsed() < PATIENCE, "no tree took over");
    }
    bvh.validate(&chaos(1)).expect("valid");
    check_mask(&bvh, |p| p == 0, "a tree from the background");
}
