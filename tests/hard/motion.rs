//! Hard motion.

use bvh_build::{BuildOptions, Builder, build, build_with};
use bvh_core::{Bvh, Triangles, Vec3, sah_cost};
use bvh_update::{Strategy, Updater};
use pivot_tests::{Motion, Soup, noise, pool};

use crate::check::{Case, hold};

fn case(motion: Motion, n: usize, frames: usize) -> Case {
    let soup = Soup::new(n, 21);
    Case { triangles: soup.triangles.clone(), frames: (0..frames).map(|f| soup.pose(motion, f)).collect() }
}

#[test]
fn teleports_of_half_the_primitives() {
    hold(&case(Motion::Teleporting, 400, 5));
}

#[test]
fn collapse_to_a_point_and_back() {
    hold(&case(Motion::Collapsing, 400, 6));
}

#[test]
fn primitives_drifting_apart() {
    hold(&case(Motion::Divergent, 400, 5));
}

#[test]
fn not_finite_in_some_frames_only() {
    hold(&case(Motion::PartlyNonFinite, 400, 6));
}

#[test]
fn not_finite_at_build_and_finite_later() {
    let mut case = case(Motion::Smooth, 400, 4);
    for (i, p) in case.frames[0].iter_mut().enumerate().filter(|(i, _)| i % 100 == 7) {
        p[i % 3] = [f32::NAN, f32::INFINITY][i % 2];
    }
    hold(&case);
}

#[test]
fn all_not_finite_and_back() {
    let mut case = case(Motion::Smooth, 100, 5);
    for frame in [0, 2] {
        case.frames[frame].iter_mut().for_each(|p| *p = Vec3::NAN);
    }
    hold(&case);
}

#[test]
fn growth_beyond_f32_and_back() {
    let mut case = case(Motion::Smooth, 200, 4);
    for (frame, scale) in [(1, 1e19), (2, 1e37)] {
        case.frames[frame].iter_mut().for_each(|p| *p *= scale);
    }
    hold(&case);
}

#[test]
fn the_jump_from_the_last_frame_to_the_first() {
    let soup = Soup::new(300, 4);
    let frames = (0..3).flat_map(|_| [0, 8, 16]).map(|f| soup.pose(Motion::Divergent, f)).collect();
    hold(&Case { triangles: soup.triangles, frames });
}

/// A grid of small triangles, waved about and torn into strips: one loop in `per_loop` frames.
fn strips(n: usize, frame: usize, per_loop: usize) -> Vec<Vec3> {
    let t = (frame % per_loop) as f32 / per_loop as f32;
    let vertex = |i: usize| {
        let (triangle, corner) = (i / 3, i % 3);
        let (x, y) = ((triangle % 20) as f32, (triangle / 20) as f32);
        let strip = (triangle / 100) as f32;
        let drift = Vec3::new((strip * 2.4).cos(), (strip * 1.3).sin(), strip.sin()) * 15.0;
        let wave = (x * 0.7 + t * std::f32::consts::TAU).sin();
        Vec3::new(x, y, wave)
            + drift * (t * std::f32::consts::TAU).sin().abs()
            + noise(9, 3 * triangle + corner) * 0.9
    };
    (0..3 * n).map(vertex).collect()
}

/// A tree is plain data. What is not finite in some frames leaves nothing behind in what it
/// remembers: a copy of it goes on as it does, with other memory and on other threads, and so do
/// two whose primitives are reordered.
#[test]
fn copies_go_on_alike_after_frames_that_are_not_finite() {
    const FRAMES: usize = 9;
    let soup = Soup::new(3000, 31);
    for strategy in Strategy::all().into_iter().filter(|s| !matches!(s, Strategy::Background(_))) {
        let start = soup.pose(Motion::PartlyNonFinite, 0);
        let mut indices = soup.triangles.clone();
        let first = Triangles { positions: &start, indices: &indices };
        let bvh = build(&first, Builder::Binned).expect("few enough");
        let mut trees = [bvh.clone(), bvh];
        let mut updaters = [Updater::default(), Updater::default()];
        for frame in 1..FRAMES {
            let mut positions = soup.pose([Motion::PartlyNonFinite, Motion::Divergent][frame / 3 % 2], frame);
            if frame == FRAMES / 2 {
                positions.fill(Vec3::NAN);
            }
            if frame % 3 == 2 {
                trees[1] = trees[0].clone();
                updaters[1] = Updater::default();
            }
            if frame == FRAMES / 2 + 1 {
                let [was, same] = trees.each_mut().map(Bvh::reorder_primitives);
                assert_eq!(was, same);
                indices = was.iter().map(|&p| indices[p as usize]).collect();
            }
            let primitives = Triangles { positions: &positions, indices: &indices };
            for (i, (tree, updater)) in trees.iter_mut().zip(&mut updaters).enumerate() {
                pool(1 + i)
                    .install(|| updater.set_strategy(strategy).update(tree, &primitives))
                    .expect("same count");
            }
            trees[0].validate(&primitives).unwrap_or_else(|e| panic!("{}, {frame}: {e}", strategy.name()));
            assert!(trees[0].update_state() == trees[1].update_state(), "{}, {frame}", strategy.name());
            assert_eq!(trees[0].fingerprint(), trees[1].fingerprint(), "{}, {frame}", strategy.name());
        }
    }
}

/// The short form of `cargo xtask soak`.
#[test]
fn ten_thousand_frames_in_a_loop() {
    const N: usize = 300;
    const PER_LOOP: usize = 50;
    let soup = Soup::new(N, 0);
    let poses: Vec<_> = (0..PER_LOOP).map(|frame| strips(N, frame, PER_LOOP)).collect();
    let at = |frame: usize| Triangles { positions: &poses[frame % PER_LOOP], indices: &soup.triangles };
    let options = BuildOptions::default();
    let fresh: Vec<_> =
        (0..PER_LOOP).map(|f| build_with(&at(f), Builder::Sweep, &options).expect("few enough")).collect();
    for strategy in Strategy::all() {
        // What rebuilds each frame knows nothing of the frames before.
        let frames = if matches!(strategy, Strategy::Rebuild(..)) { 1500 } else { 10_000 };
        let mut bvh = fresh[0].clone();
        let nodes = bvh.nodes().len();
        let mut updater = Updater::default();
        let mut early = [0.0f64; 2];
        let mut late = [0.0f64; 2];
        for frame in 1..=frames {
            updater.set_strategy(strategy).update(&mut bvh, &at(frame)).expect("same count");
            if frame <= 500 || frame > frames - 500 {
                let sums = if frame <= 500 { &mut early } else { &mut late };
                let over = sah_cost(&bvh) / sah_cost(&fresh[frame % PER_LOOP]);
                *sums = [sums[0] + over / 500.0, sums[1].max(f64::from(bvh.height()))];
            }
            if frame % 1000 == 1 {
                bvh.validate(&at(frame)).expect("valid and tight");
            }
        }
        assert_eq!(bvh.nodes().len(), nodes, "{}: more nodes", strategy.name());
        // The cost of what comes from the background depends on how fast that is.
        let is_steady = late[0] <= early[0] * 1.1 || matches!(strategy, Strategy::Background(_));
        assert!(is_steady, "{}: cost grows from {early:?} to {late:?}", strategy.name());
        assert!(late[1] <= early[1] + 12.0, "{}: height grows from {early:?} to {late:?}", strategy.name());
    }
}
