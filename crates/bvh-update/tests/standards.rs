//! What trees are held to: that no event makes a strategy take a bad tree for a good one.

use bvh_core::{Aabb, Bvh, Vec3, sah_cost};
use bvh_update::{Auto, BuildOptions, Builder, Decision, Open, Regrow, Scratch, Strategy, update};

const N: usize = 4000;

fn noise(i: usize) -> Vec3 {
    let hash = |k: usize| {
        let h = (i * 3 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (i << 7);
        ((h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
    };
    Vec3::new(hash(0), hash(1), hash(2))
}

fn tree(boxes: &[Aabb]) -> Bvh {
    bvh_build::build(boxes, Builder::Sweep, &BuildOptions::default(), None).expect("built")
}

fn over_fresh(bvh: &Bvh, boxes: &[Aabb]) -> f64 {
    sah_cost(bvh) / sah_cost(&tree(boxes))
}

/// A sheet in pieces, each of which flies off as one; the last tenth stays where it is.
fn burst(time: f32) -> Vec<Aabb> {
    let place = |i: usize| {
        let away = if i < N * 9 / 10 { (noise(i / 50) - 0.5) * 400.0 * time } else { Vec3::ZERO };
        Vec3::new((i / 50) as f32, (i % 50) as f32, 0.0) + away
    };
    (0..N).map(place).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

#[test]
fn bodies_that_fall_asleep_in_each_frame_hide_no_damage() {
    let play = |strategy: Strategy, falls_asleep: bool| {
        let (mut bvh, mut scratch, mut repairs) = (tree(&burst(0.0)), Scratch::new(), 0);
        for step in 1..=30 {
            if falls_asleep {
                bvh.set_moving(|p| p < N * 9 / 10 || (p + step) % 7 < 3);
            }
            let boxes = burst(step as f32 / 30.0);
            let told = update(&mut bvh, &boxes, &strategy, &mut scratch).expect("same count");
            bvh.validate(&boxes).expect("valid");
            repairs += u32::from(matches!(told.decision, Decision::Regrow { .. }));
        }
        (repairs, over_fresh(&bvh, &burst(1.0)))
    };
    let (_, refitted) = play(Strategy::Refit, false);
    let regrow = |open| Strategy::Regrow(Regrow { rotate: None, open, ..Regrow::default() });
    for strategy in [Strategy::Auto(Auto::default()), regrow(Open::Grown), regrow(Open::Divergent)] {
        let [awake, asleep] = [false, true].map(|falls_asleep| play(strategy, falls_asleep));
        assert!(refitted > 2.0 && awake.1 < 1.2 && asleep.1 < 1.2, "{refitted}, {awake:?}, {asleep:?}");
        assert!(asleep.0 > 0 && asleep.0.abs_diff(awake.0) < 5, "{}: {awake:?}, {asleep:?}", strategy.name());
    }
}

fn auto(rays: u64) -> Strategy {
    Strategy::Auto(Auto { rays, ..Auto::default() })
}

#[test]
fn what_pays_in_the_long_run_is_mended_after_a_few_looks_in_vain() {
    // Within each of many cells everything changes places once; what is above the cells is as good as before.
    let boxes = |shift: usize| -> Vec<Aabb> {
        let cell = |i: usize| Vec3::new((i / 20 % 20) as f32, (i / 400) as f32, 0.0) * 30.0;
        let corner = |i: usize| cell(i) + noise(i + shift) * Vec3::new(18.0, 18.0, 4.0);
        (0..N).map(corner).map(|corner| Aabb::new(corner, corner + 0.3)).collect()
    };
    let (before, after) = (boxes(0), boxes(N));
    let (mut bvh, mut scratch) = (tree(&before), Scratch::new());
    let (mut looks, mut repairs) = (Vec::new(), Vec::new());
    for step in 0..2000 {
        let in_vain = bvh.history().looks_in_vain;
        let told = update(&mut bvh, &after, &auto(1 << 13), &mut scratch).expect("same count");
        if bvh.history().looks_in_vain > in_vain {
            looks.push(step);
        }
        if matches!(told.decision, Decision::Regrow { .. }) {
            repairs.push(step);
        }
    }
    // The longer it lasts the more it pays to open, and the longer one waits for the next look.
    let waits: Vec<usize> = looks.windows(2).map(|looks| looks[1] - looks[0]).collect();
    assert!(
        repairs.len() == 2 && looks.iter().any(|look| (repairs[0]..repairs[1]).contains(look)),
        "{repairs:?}"
    );
    assert!((3..10).contains(&looks.len()) && waits.last() > Some(&100), "{looks:?}");
    assert!(over_fresh(&bvh, &after) < 1.01);
}

/// A regular sheet in which everything moves a little, each on its own way, and no further.
fn shaken(step: usize) -> Vec<Aabb> {
    let time = step.min(30) as f32 / 30.0;
    let place = |i: usize| Vec3::new((i % 64) as f32, (i / 64) as f32, 0.0) + noise(i) * 2.5 * time;
    (0..N).map(place).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

#[test]
fn a_new_tree_is_kept_only_if_it_is_better_and_tried_ever_more_rarely_if_it_is_not() {
    let mut kept = Vec::new();
    for rays in [1 << 16, 1 << 17, 1 << 18] {
        let (mut bvh, mut scratch) = (tree(&shaken(0)), Scratch::new());
        for step in 1..300 {
            let (boxes, mut fitted) = (shaken(step), bvh.clone());
            let told = update(&mut bvh, &boxes, &auto(rays), &mut scratch).expect("same count");
            bvh.validate(&boxes).expect("valid");
            assert!(over_fresh(&bvh, &boxes) < 1.25, "{step}");
            match told.decision {
                Decision::Kept { builder } => {
                    assert!(!told.rebuilt && told.sah_cost.is_some());
                    let new = bvh_build::build(&boxes, builder, &BuildOptions::default(), None);
                    assert!(sah_cost(&bvh) <= sah_cost(&new.expect("built")), "{step}");
                    kept.push(step);
                }
                Decision::Rebuild { .. } => {
                    update(&mut fitted, &boxes, &Strategy::Refit, &mut Scratch::new()).expect("same count");
                    assert!(sah_cost(&bvh) < sah_cost(&fitted), "{step}");
                }
                _ => {}
            }
        }
    }
    assert!((3..15).contains(&kept.len()) && kept.iter().all(|&step| step < 50), "{kept:?}");
}

#[test]
fn a_tree_is_not_beyond_repair_for_ever() {
    let scattered: Vec<Aabb> = (0..N).map(|i| noise(i) * 100.0).map(|p| Aabb::new(p, p + 0.8)).collect();
    let (mut bvh, mut scratch) = (tree(&burst(0.0)), Scratch::new());
    let mut play = |boxes: &[Aabb]| {
        update(&mut bvh, boxes, &auto(32), &mut scratch).expect("same count");
        (bvh.history().is_beyond_repair, over_fresh(&bvh, boxes))
    };
    play(&burst(0.0));
    assert!(play(&scattered).0);
    // Everything is back in its place, but rotations have left something behind.
    let after: Vec<_> = (0..2000).map(|_| play(&burst(0.0))).collect();
    assert!(after[0].0 && !after[1999].0 && after[1999].1 < 1.1, "{:?}, {:?}", after[0], after[1999]);
}

#[test]
fn what_is_beyond_numbers_is_lived_with_and_leaves_no_trace() {
    for rays in [0, 1 << 20, u64::MAX] {
        let (mut bvh, mut scratch) = (tree(&burst(0.0)), Scratch::new());
        for step in 0..40 {
            let mut boxes = burst(0.0);
            if (3..6).contains(&step) {
                boxes[7] = Aabb::new(Vec3::splat(-1e30), Vec3::splat(1e30));
            }
            update(&mut bvh, &boxes, &auto(rays), &mut scratch).expect("same count");
            let history = bvh.history();
            let numbers =
                [history.regret, history.reference, history.size, history.leaves.regret, history.leaves.area];
            assert!(numbers.iter().all(|n| !n.is_nan()), "{step}: {history:?}");
        }
        assert!(over_fresh(&bvh, &burst(0.0)) < 1.1);
    }
}

#[test]
fn merged_leaves_that_are_to_be_split_do_not_put_off_a_new_tree() {
    // Quadruplets that have been calm for long, so that they merge; then everything is elsewhere, alone.
    let calm: Vec<Aabb> =
        (0..N).map(|i| noise(i / 4) * 100.0 + noise(i) * 0.1).map(|p| Aabb::new(p, p + 0.8)).collect();
    let elsewhere: Vec<Aabb> = (N..2 * N).map(|i| noise(i) * 100.0).map(|p| Aabb::new(p, p + 0.8)).collect();
    let (mut bvh, mut scratch) = (tree(&calm), Scratch::new());
    for _ in 0..40 {
        update(&mut bvh, &calm, &auto(1 << 20), &mut scratch).expect("same count");
    }
    assert!(bvh.history().leaves.is_merged);
    let told = update(&mut bvh, &elsewhere, &auto(1 << 20), &mut scratch).expect("same count");
    assert!(over_fresh(&bvh, &elsewhere) < 1.3, "{}", told.decision);
}
