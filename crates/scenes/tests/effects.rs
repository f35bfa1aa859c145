//! What a scene calls for runs, what it does not call for does not, and any effect can be left out.

use anim::glam::Vec3;
use anim::{Animation, Motion, PoseStats};
use scenes::{Scene, SceneOptions, Simulated, SimulationStats, list, load};

/// The effects of simulations.
const SIMULATED: [Simulated; 4] =
    [Simulated::CLOTH, Simulated::GRAVITY, Simulated::CONTACT, Simulated::FRACTURE];

fn small(name: &str, without: Simulated) -> Scene {
    let (detail, substeps, key_frames) = (Some(0.01), Some(8), Some(40));
    let options = SceneOptions { detail, substeps, key_frames, without, ..SceneOptions::default() };
    load(name, None, &options).unwrap()
}

/// The counters of what can be declared, in the order of [`SIMULATED`].
fn counters(SimulationStats { cloth, gravity, contact, fracture, .. }: SimulationStats) -> [u64; 4] {
    [cloth, gravity, contact, fracture]
}

/// Which of [`SIMULATED`] a scene declares.
fn declared(simulated: Simulated) -> [bool; 4] {
    SIMULATED.map(|effect| simulated.contains(effect))
}

fn at_end(scene: &Scene) -> Vec<Vec3> {
    let mut positions = scene.animation.rest();
    scene.animation.pose(scene.animation.duration(), &mut positions);
    positions
}

#[test]
fn what_a_scene_declares_is_simulated_and_nothing_else() {
    for info in list() {
        let scene = small(info.name, Simulated::empty());
        let ran = counters(scene.simulated).map(|count| count > 0);
        assert_eq!(ran, declared(info.effects.simulated), "{}: {:?}", info.name, scene.simulated);
        assert_eq!(scene.simulated.drift > 0, ran.contains(&true), "{}", info.name);
    }
}

#[test]
fn an_effect_left_out_is_not_simulated_and_changes_the_motion() {
    for info in list() {
        let full = small(info.name, Simulated::empty());
        let ends = at_end(&full);
        for (i, &effect) in SIMULATED.iter().enumerate() {
            if !declared(info.effects.simulated)[i] {
                continue;
            }
            let scene = small(info.name, effect);
            assert_eq!(counters(scene.simulated)[i], 0, "{} without {effect:?}", info.name);
            assert!(!declared(scene.effects.simulated)[i], "{} without {effect:?}", info.name);
            let positions = at_end(&scene);
            assert!(positions.iter().all(|p| p.is_finite()), "{} without {effect:?}", info.name);
            assert!(positions != ends, "{} without {effect:?} moves as with it", info.name);

            let alone = counters(small(info.name, Simulated::all() - effect).simulated);
            let mut rest = alone;
            rest[i] = 0;
            assert_eq!(rest, [0; 4], "{} with {effect:?} alone", info.name);
        }
    }
}

/// The kinds of playback, and the counter of each.
type Kind = (Motion, fn(&PoseStats) -> u64);
const KINDS: [Kind; 4] = [
    (Motion::SKIN, |stats| stats.skin.count),
    (Motion::MORPH, |stats| stats.morph.count),
    (Motion::RIGID, |stats| stats.rigid.count),
    (Motion::KEY_FRAMES, |stats| stats.key_frames.count),
];

/// Of all kinds.
fn total(stats: &PoseStats) -> u64 {
    KINDS.iter().map(|(_, counter)| counter(stats)).sum()
}

/// Poses what was at rest at 0.48 of its loop.
fn posed(animation: &dyn Animation, kinds: Motion) -> (Vec<Vec3>, PoseStats) {
    let mut positions = animation.rest();
    let stats = animation.pose_by(kinds, 0.48 * animation.duration(), &mut positions);
    (positions, stats)
}

fn check_playback(animation: &dyn Animation, name: &str) {
    let rest = animation.rest();
    let (full, all) = posed(animation, Motion::all());
    let (none, nothing) = posed(animation, Motion::empty());
    assert!(none == rest && nothing == PoseStats::default(), "{name}: nothing moves by no kind");
    for (kind, counter) in KINDS {
        let parts = &animation.topology().parts;
        let calls = parts.iter().any(|part| part.motion.contains(kind));
        let (only, stats) = posed(animation, kind);
        assert_eq!((counter(&all) > 0, counter(&stats) > 0), (calls, calls), "{name}, {kind:?}");
        assert_eq!(total(&stats), counter(&stats), "{name}: {kind:?} alone");
        let (left, stats) = posed(animation, Motion::all() - kind);
        assert_eq!(counter(&stats), 0, "{name} without {kind:?}");
        assert_eq!(total(&stats), total(&all) - counter(&all), "{name} without {kind:?}");
        for part in parts {
            let vertices = part.vertices.start as usize..part.vertices.end as usize;
            let same = |a: &[Vec3], b: &[Vec3]| a[vertices.clone()] == b[vertices.clone()];
            let called = part.motion & kind;
            assert!(!called.is_empty() || same(&only, &rest), "{name}: {} by {kind:?}", part.name);
            assert!(!called.is_empty() || same(&left, &full), "{name}: {} without {kind:?}", part.name);
            assert!(called != part.motion || same(&left, &rest), "{name}: {} without {kind:?}", part.name);
            assert!(called != part.motion || same(&only, &full), "{name}: {} by {kind:?}", part.name);
        }
    }
}

#[test]
fn each_kind_of_motion_can_be_left_out_of_a_pose() {
    for info in list() {
        check_playback(&*small(info.name, Simulated::empty()).animation, info.name);
    }
    let toys = anim::parse("toys.glb".as_ref(), &scenes::toys_glb(), &Default::default()).unwrap();
    check_playback(&*toys, "toys");
}

/// Files that are not part of the repository: named by `PIVOT_DATA`.
#[test]
fn each_kind_of_motion_can_be_left_out_of_a_pose_of_real_files() {
    let Some(data) = std::env::var_os("PIVOT_DATA") else {
        println!("skipped: PIVOT_DATA names no folder");
        return;
    };
    for file in [
        "gltf/BrainStem.glb",
        "gltf/CesiumMan.glb",
        "gltf/Fox.glb",
        "gltf/MorphStressTest.gltf",
        "bart/museum/museum5.aff",
        "bart/kitchen/kitchen.aff",
    ] {
        let path = std::path::Path::new(&data).join(file);
        check_playback(&*anim::load(&path, &Default::default()).unwrap(), file);
    }
}
