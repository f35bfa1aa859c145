//! Every strategy, through every kind of motion: valid and tight trees, costs as reported, and the
//! hits of brute force.

use bvh_build::{BuildOptions, Builder, build, build_with};
use bvh_core::{Bvh, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use pivot_tests::{Motion, Soup, check_hit, noise, pool, sah_cost};
use proptest::prelude::*;

/// Casts rays through a soup and compares them with the oracle; gives the number of hits.
fn check_hits(bvh: &Bvh, triangles: &Triangles<'_>, seed: u64, rays: usize) -> usize {
    let hits = |&i: &usize| {
        let (from, to) = (noise(seed, i) * 30.0 - 10.0, noise(seed ^ 9, i) * 10.0);
        check_hit(bvh, triangles, from, to - from)
    };
    (0..rays).filter(hits).count()
}

/// Plays some frames with every strategy on some threads.
fn play(n: usize, seed: u64, motion: Motion, frames: usize, threads: usize, max_leaf_size: u32) {
    let soup = Soup::new(n, seed);
    let start = soup.pose(motion, 0);
    let primitives = Triangles { positions: &start, indices: &soup.triangles };
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    let built = build_with(&primitives, Builder::Binned, &options).expect("few enough");
    pool(threads).install(|| {
        for strategy in Strategy::all() {
            let (mut bvh, mut updater) = (built.clone(), Updater::default());
            for frame in 1..=frames {
                let positions = soup.pose(motion, frame);
                let primitives = Triangles { positions: &positions, indices: &soup.triangles };
                let done = updater.set_strategy(strategy).update(&mut bvh, &primitives).expect("same count");
                bvh.validate(&primitives).expect("valid and tight");
                let cost = sah_cost(&bvh, &positions, &soup.triangles);
                let reported = done.sah_cost.unwrap_or_else(|| bvh_core::sah_cost(&bvh));
                assert!(
                    (reported - cost).abs() <= 1e-5 * cost,
                    "{strategy:?}, {motion:?}: reported {reported}, is {cost}"
                );
                check_hits(&bvh, &primitives, seed ^ frame as u64, 20);
            }
        }
    });
}

#[test]
fn all_motions_at_a_thousand_triangles() {
    for motion in Motion::ALL {
        for threads in [1, 3] {
            play(1000, 11, motion, 5, threads, 1);
        }
        play(1000, 12, motion, 3, 2, 4);
    }
}

#[test]
fn rays_do_hit() {
    let soup = Soup::new(2000, 3);
    let positions = soup.pose(Motion::Smooth, 0);
    let primitives = Triangles { positions: &positions, indices: &soup.triangles };
    let bvh = build(&primitives, Builder::Sweep).expect("few enough");
    assert!(check_hits(&bvh, &primitives, 1, 300) > 100, "a test of hits needs some");
}

#[test]
fn one_hash_for_all_thread_counts() {
    for motion in Motion::ALL {
        let soup = Soup::new(20_000, 5);
        let start = soup.pose(motion, 0);
        let primitives = Triangles { positions: &start, indices: &soup.triangles };
        let options = BuildOptions::default();
        let built = build_with(&primitives, Builder::Binned, &options).expect("few enough");
        // Trees from the background depend on how long they take.
        for strategy in Strategy::all().into_iter().filter(|s| !matches!(s, Strategy::Background(_))) {
            let hashes = [1, 2, 3, 8].map(|threads| {
                pool(threads).install(|| {
                    let (mut bvh, mut updater) = (built.clone(), Updater::default());
                    for frame in 1..3 {
                        let positions = soup.pose(motion, frame);
                        let primitives = Triangles { positions: &positions, indices: &soup.triangles };
                        updater.set_strategy(strategy).update(&mut bvh, &primitives).expect("same count");
                    }
                    bvh.fingerprint()
                })
            });
            assert!(hashes.iter().all(|&h| h == hashes[0]), "{strategy:?} {motion:?} {hashes:x?}");
        }
    }
}

#[test]
fn empty_and_tiny_scenes() {
    for n in [0, 1, 2] {
        for motion in Motion::ALL {
            play(n, 1, motion, 3, 2, 1);
        }
    }
}

#[test]
fn all_triangles_at_one_point() {
    let positions = vec![Vec3::ONE; 3];
    let triangles = vec![[0, 1, 2]; 500];
    let primitives = Triangles { positions: &positions, indices: &triangles };
    for strategy in Strategy::all() {
        let mut bvh = build(&primitives, Builder::Binned).expect("few enough");
        let done = Updater::new(strategy).update(&mut bvh, &primitives).expect("same count");
        bvh.validate(&primitives).expect("valid and tight");
        assert_eq!((done.rotations_applied(), bvh_core::sah_cost(&bvh)), (0, 0.0));
        assert!(done.sah_cost.is_none_or(|cost| cost == 0.0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn any_soup_any_motion(
        n in 0usize..400, seed: u64, motion in prop::sample::select(&Motion::ALL[..]),
        threads in 1usize..5, max_leaf_size in 1u32..5
    ) {
        play(n, seed, motion, 3, threads, max_leaf_size);
    }
}
