//! The whole loop on real models, found through the environment variable `PIVOT_DATA`; skipped
//! where it is unset.

use std::path::PathBuf;

use bvh_build::{Builder, build};
use bvh_core::{Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use pivot_tests::{check_hit, noise};

fn data() -> Option<PathBuf> {
    let data = std::env::var_os("PIVOT_DATA").filter(|d| !d.is_empty()).map(PathBuf::from);
    if data.is_none() {
        println!("skipped: PIVOT_DATA is not set");
    }
    data
}

/// Plays a file with every strategy for 2.3 loops of `per_loop` frames, as the paper does with 100:
/// valid trees, the hits of brute force, and rotations that pay.
fn play(file: &str, per_loop: usize, moves: bool, rotation_pays: bool) {
    let Some(data) = data() else { return };
    let animation = anim::load(&data.join(file), &Default::default()).expect("loads");
    let topology = animation.topology();
    let mut positions = animation.rest();
    let frames = per_loop * 23 / 10;
    let time = |frame: usize| animation.duration() * (frame % per_loop) as f64 / per_loop as f64;
    let start = Triangles { positions: &positions, indices: &topology.triangles };
    let mut built = build(&start, Builder::Sweep).expect("few enough");
    built.set_dynamic(|p| topology.moves[p]);
    let with_tree = |strategy| (strategy, built.clone(), Updater::default());
    let mut trees: Vec<_> = Strategy::all().into_iter().map(with_tree).collect();
    let (mut rotations, mut costs, mut moved, mut hits) = (0, [0.0; 2], false, 0);
    for i in 1..=frames {
        let before: Vec<Vec3> = positions.clone();
        animation.pose(time(i), &mut positions);
        moved |= positions != before;
        let triangles = Triangles { positions: &positions, indices: &topology.triangles };
        for (strategy, bvh, updater) in &mut trees {
            let done = updater.set_strategy(*strategy).update(bvh, &triangles).expect("same count");
            if i % 4 == 1 {
                bvh.validate(&triangles).expect("valid and tight");
            }
            match strategy {
                Strategy::Refit => costs[0] += bvh_core::sah_cost(bvh),
                Strategy::RefitRotate(_) => {
                    costs[1] += bvh_core::sah_cost(bvh);
                    rotations += done.rotations_applied();
                }
                _ => {}
            }
        }
        if i % 6 == 0 && i < 40 {
            let bounds = trees[0].1.root().aabb();
            for ray in 0..20 {
                let within = |n: Vec3, grow: f32| bounds.center() + (n - 0.5) * bounds.extent() * grow;
                let (from, to) = (within(noise(1, ray), 3.0), within(noise(2, ray), 0.8));
                for (_, bvh, _) in &trees {
                    hits += usize::from(check_hit(bvh, &triangles, from, to - from));
                }
            }
        }
    }
    println!(
        "{file}: {rotations} rotations, cost {:.2} refitted, {:.2} rotated",
        costs[0] / frames as f64,
        costs[1] / frames as f64
    );
    assert!(hits > 0, "{file}: no ray hits anything");
    assert_eq!(moved, moves, "{file}");
    if rotation_pays {
        assert!(rotations > 0 && costs[1] < costs[0], "{file}: {rotations} rotations, costs {costs:?}");
    }
    if !moves {
        assert_eq!(rotations, 0, "{file} stands still");
    }
}

macro_rules! animations {
    ($($name:ident: $file:literal, $per_loop:literal, $moves:literal, $pays:literal;)*) => {
        $(#[test] fn $name() { play($file, $per_loop, $moves, $pays); })*
    };
}

animations! {
    unc_n_body: "unc/n-body", 10, true, true;
    unc_cloth_ball: "unc/cloth-ball", 10, true, true;
    brain_stem: "gltf/BrainStem.glb", 10, true, true;
    cesium_man: "gltf/CesiumMan.glb", 100, true, true;
    fox: "gltf/Fox.glb", 100, true, true;
    morph_stress_test: "gltf/MorphStressTest.gltf", 100, true, true;
    animated_morph_cube: "gltf/AnimatedMorphCube/AnimatedMorphCube.gltf", 100, true, false;
    engine: "static/2CylinderEngine.glb", 10, false, false;
    sponza: "static/sponza_dabrovic.obj", 10, false, false;
}
