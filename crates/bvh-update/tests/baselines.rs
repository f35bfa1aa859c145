//! Baselines: no event makes a strategy take a bad tree for a good one.

mod common;

use bvh_core::{Aabb, Primitives, Vec3};
use bvh_update::{Auto, BuildOptions, Builder, Decision, Load, PartialRebuild, Reason, Strategy, Updater};
use common::{noise, over_fresh, tree};

const N: usize = 4000;

/// The last tenth stays where it is.
fn burst(time: f32) -> Vec<Aabb> {
    common::burst(N, N * 9 / 10, time)
}

#[test]
fn bodies_that_fall_asleep_in_each_frame_hide_no_damage() {
    let play = |strategy: Strategy, falls_asleep: bool| {
        let (mut bvh, mut updater, mut repairs) = (tree(&burst(0.0)), Updater::default(), 0);
        for step in 1..=30 {
            if falls_asleep {
                bvh.set_dynamic(|p| p < N * 9 / 10 || (p + step) % 7 < 3);
            }
            let boxes = burst(step as f32 / 30.0);
            let report = updater.set_strategy(strategy).update(&mut bvh, &boxes).expect("same count");
            bvh.validate(&boxes).expect("valid");
            repairs += u32::from(matches!(report.decision, Decision::PartialRebuild { .. }));
        }
        (repairs, over_fresh(&bvh, &burst(1.0)))
    };
    let (_, refitted) = play(Strategy::Refit, false);
    let without_rotations = PartialRebuild::default().with_rotate(None);
    for strategy in [Strategy::Auto(Auto::default()), Strategy::PartialRebuild(without_rotations)] {
        let [awake, asleep] = [false, true].map(|falls_asleep| play(strategy, falls_asleep));
        assert!(refitted > 2.0 && awake.1 < 1.2 && asleep.1 < 1.2, "{refitted}, {awake:?}, {asleep:?}");
        assert!(asleep.0 > 0 && asleep.0.abs_diff(awake.0) < 5, "{}: {awake:?}, {asleep:?}", strategy.name());
    }
}

fn auto(rays: u64) -> Strategy {
    Strategy::Auto(Auto::default().with_load(Load::PacketRays(rays)))
}

/// A sheet that trembles for 10,000 frames, and then bursts, so that its tree costs twice as much:
/// it is good again soon, whatever repairs and rebuilds brought before. Where those that pay badly
/// made later ones wait, it took 50 to 130 frames.
#[test]
fn a_burst_after_a_long_calm_is_seen_soon() {
    for (rays, wild) in [(0, 0.5), (0, 0.2), (1 << 14, 0.5), (1 << 16, 0.2)] {
        let (mut bvh, mut updater) = (tree(&burst(0.0)), Updater::new(auto(rays)));
        let poor = (1..10_100).filter(|&step| {
            let has_burst = step >= 10_000;
            let still = burst(if has_burst { 0.02 } else { 0.0 });
            let trembling = still.iter().enumerate().map(|(i, aabb)| {
                let by = noise(i + step % 10 * N) * wild;
                Aabb::new(aabb.min + by, aabb.max + by)
            });
            let boxes: Vec<Aabb> = trembling.collect();
            updater.update(&mut bvh, &boxes).expect("same count");
            has_burst && over_fresh(&bvh, &boxes) > 1.1
        });
        let poor = poor.count();
        assert!(poor < 10, "{rays} rays, {wild}: {poor} frames with a poor tree");
    }
}

/// A regular sheet in which everything moves a little, each on its own way, and no further.
fn shaken(step: usize) -> Vec<Aabb> {
    let time = step.min(30) as f32 / 30.0;
    let place = |i: usize| Vec3::new((i % 64) as f32, (i / 64) as f32, 0.0) + noise(i) * 2.5 * time;
    (0..N).map(place).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

#[test]
fn rebuilds_end_with_the_motion() {
    for rays in [1 << 16, 1 << 17, 1 << 18] {
        let (mut bvh, mut updater) = (tree(&shaken(0)), Updater::new(auto(rays)));
        let rebuilds = (1..300).filter(|&step| {
            let boxes = shaken(step);
            let report = updater.update(&mut bvh, &boxes).expect("same count");
            bvh.validate(&boxes).expect("valid");
            let over = over_fresh(&bvh, &boxes);
            assert!(over < 1.35, "{over} at {step}");
            matches!(report.decision, Decision::Rebuild { .. } | Decision::Kept { .. })
        });
        let late = rebuilds.filter(|&step| step > 100).count();
        assert!(late < 3, "{late} rebuilds of what stands still");
    }
}

#[test]
fn a_tree_beyond_repair_is_good_again_in_the_end() {
    let scattered: Vec<Aabb> = (0..N).map(|i| noise(i) * 100.0).map(|p| Aabb::new(p, p + 0.8)).collect();
    let (mut bvh, mut updater) = (tree(&burst(0.0)), Updater::new(auto(32)));
    let mut play = |boxes: &[Aabb]| {
        updater.update(&mut bvh, boxes).expect("same count");
        over_fresh(&bvh, boxes)
    };
    play(&burst(0.0));
    assert!((0..200).map(|_| play(&scattered)).last() < Some(1.3));
    assert!((0..200).map(|_| play(&burst(0.0))).last() < Some(1.3));
}

#[test]
fn huge_boxes_leave_no_trace() {
    for rays in [0, 1 << 20, u64::MAX] {
        let (mut bvh, mut updater) = (tree(&burst(0.0)), Updater::new(auto(rays)));
        for step in 0..40 {
            let mut boxes = burst(0.0);
            if (3..6).contains(&step) {
                boxes[7] = Aabb::new(Vec3::splat(-1e30), Vec3::splat(1e30));
            }
            let report = updater.update(&mut bvh, &boxes).expect("same count");
            if let Some(Reason { lost_ms, price_ms, .. }) = report.reason {
                assert!(lost_ms.is_finite() && price_ms.is_finite(), "{step}: {report:?}");
            }
        }
        // A tree of Ploc has 1.109.
        assert!(over_fresh(&bvh, &burst(0.0)) < 1.12);
    }
}

/// Where areas are too large or too small for `f32`, all of them or most.
#[test]
fn trees_are_kept_good_at_every_scale() {
    for scale in [1e-25, 1e-23, 1e-22, 1.0, 1e17, 1e19, 1e30] {
        let boxes = |time: f32| -> Vec<Aabb> {
            burst(time).into_iter().map(|aabb| Aabb::new(aabb.min * scale, aabb.max * scale)).collect()
        };
        let (mut bvh, mut updater, mut late) = (tree(&boxes(0.0)), Updater::default(), 0);
        for step in 1..=60 {
            let report = updater.update(&mut bvh, &boxes(step.min(30) as f32 / 30.0)).expect("same count");
            let is_build = matches!(report.decision, Decision::Rebuild { .. } | Decision::Kept { .. });
            late += u32::from(is_build && step > 35);
        }
        let over = over_fresh(&bvh, &boxes(1.0));
        assert!(late < 3 && over < 1.2, "{late} builds of what stands still, {over} at {scale:e}");
    }
}

#[test]
fn another_number_of_primitives_gives_a_new_tree() {
    let (all, some) = (burst(0.5), &burst(0.5)[..N / 3]);
    let rebuild = Strategy::Rebuild(Builder::Lbvh, BuildOptions::default());
    let [mut bvh, _] = [Strategy::default(), rebuild].map(|strategy| {
        let (mut bvh, mut updater) = (tree(&burst(0.0)), Updater::new(strategy));
        bvh.set_dynamic(|p| p > 10);
        for (boxes, is_all_dynamic) in [(&all[..], false), (some, true), (&[], true), (&all, true)] {
            updater.update(&mut bvh, boxes).expect("a new tree");
            bvh.validate(boxes).expect("valid");
            assert_eq!(bvh.all_dynamic(), is_all_dynamic, "{strategy}, {} primitives", boxes.len());
        }
        bvh
    });
    let mut updater = Updater::default();
    // Trees that were new for their number are no rebuilds in a row. One may follow, by a better
    // builder.
    let rebuilds = (0..5).filter(|_| updater.update(&mut bvh, &all[..]).expect("updated").rebuilt).count();
    assert!(rebuilds < 2, "{rebuilds} rebuilds of what stands still");
    let error = Updater::new(Strategy::Refit).update(&mut bvh, some).expect_err("no new tree");
    assert!(error.to_string().contains("build a new tree"), "{error}");
}

#[test]
fn the_builder_for_another_number_does_not_depend_on_the_old_one() {
    let at = |i: usize| Vec3::new((i % 29) as f32, (i % 31) as f32, (i % 37) as f32);
    let boxes: Vec<_> = (0..20_000).map(at).map(|p| Aabb::new(p, p + 0.5)).collect();
    let [few, most] = [10, 19_999].map(|before| {
        let (mut bvh, mut updater) = (tree(&boxes[..before]), Updater::default());
        updater.report(Load::Pairs);
        for _ in 0..50 {
            updater.update(&mut bvh, &boxes[..before]).expect("updated");
        }
        updater.update(&mut bvh, &boxes).expect("a new tree").decision
    });
    assert_eq!(few, most);
}

/// Boxes with an `aabb` that forgets to sanitise.
struct Raw(Vec<Aabb>);

impl Primitives for Raw {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn bounds(&self, i: usize) -> Aabb {
        self.0[i]
    }

    fn aabb(&self, i: usize) -> Aabb {
        self.0[i]
    }
}

#[test]
fn primitives_that_forget_to_sanitise_break_no_tree() {
    for strategy in Strategy::all() {
        let mut bvh = tree(&burst(0.0));
        let mut updater = Updater::new(strategy);
        for step in 1..4 {
            let mut boxes = burst(step as f32 * 0.1);
            boxes[5].max.y = f32::INFINITY;
            boxes[70].min.x = f32::NEG_INFINITY;
            boxes[99] = Aabb::new(Vec3::NAN, Vec3::NAN);
            boxes[200] = Aabb::new(Vec3::splat(f32::NEG_INFINITY), Vec3::splat(f32::INFINITY));
            let done = updater.update(&mut bvh, &Raw(boxes.clone())).expect("same count");
            assert_eq!(done.dropped, 4, "{}", strategy.name());
            bvh.validate(boxes.as_slice()).expect("dropped, not spread");
        }
    }
}

/// Areas of 1e-46: a comparison of two of them has no digits. With rotations by such comparisons
/// `Auto` built a tree in every frame of the seventh input, for ever.
#[test]
fn a_still_scene_without_digits_is_built_no_more() {
    for seed in 0..10 {
        let way = |piece: usize| {
            let mut random = fastrand::Rng::with_seed(u64::rotate_left(seed, 32) ^ piece as u64);
            Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5
        };
        let boxes = |time: f32| -> Vec<Aabb> {
            let corner = |i: usize| {
                let away = if i < N * 9 / 10 { way(i / 50) * 400.0 * time } else { Vec3::ZERO };
                Vec3::new((i / 50) as f32, (i % 50) as f32, 0.0) + away
            };
            (0..N).map(corner).map(|c| Aabb::new(c * 1e-25, (c + 0.8) * 1e-25)).collect()
        };
        let (mut bvh, mut updater) = (tree(&boxes(0.0)), Updater::default());
        for step in 1..=70 {
            let report = updater.update(&mut bvh, &boxes(step.min(30) as f32 / 30.0)).expect("same count");
            let is_build = matches!(report.decision, Decision::Rebuild { .. } | Decision::Kept { .. });
            assert!(step < 50 || !is_build, "seed {seed}: {} in step {step}", report.decision);
        }
    }
}
