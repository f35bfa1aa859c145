//! Effects that a scene does not call for cost nothing: no work is counted, nothing is allocated,
//! and the picture is the same, whether they are planned or not.

use anim::{Motion, PoseStats};
use bvh_core::Bvh;
use bvh_update::Updater;
use pivot_allocations::of_thread;
use rt_cpu::{Image, RenderStats, render};
use scenes::{Effects, LightEffects, Scene, SceneOptions};
use stage::Stage;

fn scene(name: &str) -> Scene {
    if name == "toys" {
        let path = "toys.glb".as_ref();
        let animation = anim::parse(path, &scenes::toys_glb(), &Default::default()).unwrap();
        return scenes::scene_of(path, animation);
    }
    let (detail, substeps, key_frames) = (Some(0.01), Some(4), Some(8));
    let options = SceneOptions { detail, substeps, key_frames, ..SceneOptions::default() };
    scenes::load(name, None, &options).unwrap()
}

/// What a frame of a scene did and allocated: a pose, then a picture, each for the second time.
struct Frame {
    posed: PoseStats,
    pose_allocations: usize,
    traced: RenderStats,
    trace_allocations: usize,
    image: Image,
}

fn frame(name: &str, effects: impl FnOnce(Effects) -> Effects) -> Frame {
    let mut scene = scene(name);
    scene.effects = effects(scene.effects);
    let mut stage = Stage::new(scene).unwrap();
    stage.pose(stage.time_of(1, 50));
    let time = stage.time_of(24, 50);
    let (pose_allocations, posed) = of_thread(|| stage.pose(time));
    let mut image = Image::new(64, 48);
    let (camera, light, options) = (stage.camera(64, 48), stage.light(), stage.render_options());
    let mut trace = || render(&stage.first_tree, &stage.mesh(), &camera, Some(&light), &options, &mut image);
    trace();
    let (trace_allocations, traced) = of_thread(&mut trace);
    Frame { posed, pose_allocations, traced, trace_allocations, image }
}

/// How often each kind of motion did something.
fn counts(stats: &PoseStats) -> [u64; 4] {
    [&stats.key_frames, &stats.morph, &stats.skin, &stats.rigid].map(|work| work.count)
}

#[test]
fn effects_that_nothing_calls_for_count_nothing_and_allocate_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let names = ["bart-museum", "cloth-ball", "exploding-dragon", "fairy-forest", "lion", "n-body", "toys"];
    for name in names {
        pool.install(|| {
            let own = frame(name, |effects| effects);
            let looks = LightEffects::TEXTURES | LightEffects::ALPHA | LightEffects::MIRROR;
            let all = frame(name, |own| Effects { motion: Motion::all(), light: own.light | looks, ..own });
            assert!(counts(&own.posed).iter().any(|&count| count > 0), "{name} moves");
            assert_eq!(counts(&all.posed), counts(&own.posed), "{name}");
            assert_eq!(all.traced, own.traced, "{name}");
            assert_eq!(all.pose_allocations, own.pose_allocations, "{name}");
            assert_eq!(all.trace_allocations, own.trace_allocations, "{name}");
            assert!(all.image.pixels() == own.image.pixels(), "{name}");

            let none = frame(name, |_| Effects::default());
            assert_eq!((none.posed, none.pose_allocations), (PoseStats::default(), 0), "{name}");
            let RenderStats {
                rays_shadow, rays_mirror, rays_bounce, rays_ambient_occlusion, textured, ..
            } = none.traced;
            let rays = [rays_shadow, rays_mirror, rays_bounce, rays_ambient_occlusion];
            assert_eq!((rays, textured), ([0; 4], 0), "{name}");
            assert!(none.trace_allocations <= own.trace_allocations, "{name}");
        });
    }
}

/// A vertex goes up by a morph target's weight and back: at rest no displacement is counted.
#[test]
fn normals_do_not_outlive_the_pose_that_they_are_of() {
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"targets":[{"POSITION":1}]}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":3},
            {"bufferView":0,"byteOffset":36,"componentType":5126,"type":"VEC3","count":3},
            {"bufferView":0,"byteOffset":72,"componentType":5126,"type":"SCALAR","count":3},
            {"bufferView":0,"byteOffset":84,"componentType":5126,"type":"SCALAR","count":3}],
        "animations":[{"channels":[{"sampler":0,"target":{"node":0,"path":"weights"}}],
            "samplers":[{"input":2,"output":3}]}],
        "bufferViews":[{"buffer":0,"byteLength":96}],
        "buffers":[{"byteLength":96,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAABAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAgD8AAABAAAAAAAAAgD8AAAAA"}]}"#;
    let path = "morph.gltf".as_ref();
    let animation = anim::parse(path, json.as_bytes(), &Default::default()).unwrap();
    let mut stage = Stage::new(scenes::scene_of(path, animation)).unwrap();
    stage.pose(1.0);
    stage.smooth();
    assert!(stage.mesh().normals.is_some() && stage.triangles().positions[0].z == 2.0);
    stage.pose(2.0);
    assert!(stage.mesh().normals.is_none() && stage.triangles().positions[0].z == 0.0);
}

#[test]
fn a_tree_is_updated_only_where_planned_motion_moves_it() {
    let dynamic = |motion: Motion| {
        let mut scene = scene("toys");
        scene.effects.motion = motion;
        let stage = Stage::new(scene).unwrap();
        let mut count = 0;
        stage.first_tree.visit(|_, node, _| count += usize::from(node.is_leaf() && node.is_dynamic()));
        count
    };
    let [skin, rest] = [Motion::SKIN, Motion::all() - Motion::SKIN];
    assert_eq!(dynamic(Motion::empty()), 0);
    assert!(dynamic(skin) > 0 && dynamic(rest) > 0);
    assert_eq!(dynamic(skin) + dynamic(rest), dynamic(Motion::all()));
}

#[test]
fn no_strategy_runs_where_nothing_moves() {
    let built_anew = |motion: Motion| {
        let mut scene = scene("toys");
        scene.effects.motion = motion;
        let mut stage = Stage::new(scene).unwrap();
        stage.pose(stage.time_of(24, 50));
        let mut tree = Bvh::clone(&stage.first_tree);
        stage.update(&mut tree, &mut Updater::new("sweep".parse().unwrap())).unwrap().rebuilt
    };
    assert_eq!([Motion::all(), Motion::empty()].map(built_anew), [true, false]);
}
