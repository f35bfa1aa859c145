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

#[test]
fn damage_below_many_small_nodes_is_mended_once_it_has_cost_enough() {
    // Within each of many cells everything changes places once; what is above the cells is as good as before.
    let cell = |i: usize| Vec3::new((i / 20 % 20) as f32, (i / 400) as f32, 0.0) * 30.0;
    let boxes = |shift: usize| -> Vec<Aabb> {
        let corner = |i: usize| cell(i) + noise(i + shift) * Vec3::new(18.0, 18.0, 4.0);
        (0..N).map(corner).map(|corner| Aabb::new(corner, corner + 0.3)).collect()
    };
    let (before, after) = (boxes(0), boxes(N));
    for rays in (8..22).map(|bits| 1u64 << bits) {
        let (mut bvh, mut scratch) = (tree(&before), Scratch::new());
        let auto = Strategy::Auto(Auto { rays, clock: false });
        let mut decisions = String::new();
        let mut costs = vec![];
        for step in 0..4000 {
            let told = update(&mut bvh, &after, &auto, &mut scratch).expect("same count");
            if matches!(told.decision, Decision::Regrow { .. }) {
                decisions += &format!(" r{step}");
            }
            if told.rebuilt {
                decisions += &format!(" N{step}");
            }
            if step % 500 == 9 {
                costs.push(over_fresh(&bvh, &after));
            }
        }
        eprintln!("{rays} {decisions} {costs:.2?} {:?}", bvh.history().looks_in_vain);
    }
}
