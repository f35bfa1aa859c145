//! Real files: counts, bounds and motion as measured by independent parsers. Skipped without
//! `PIVOT_DATA`.

use std::path::PathBuf;

use anim::glam::Vec3;
use anim::{Animation, LoadOptions, Motion, load};

fn data(path: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("PIVOT_DATA").filter(|d| !d.is_empty()) else {
        println!("skipped: PIVOT_DATA is not set");
        return None;
    };
    Some(PathBuf::from(root).join(path))
}

/// What must hold for everything that loads.
fn check(animation: &dyn Animation, name: &str) {
    let topology = animation.topology();
    let rest = animation.rest();
    assert_eq!(rest.len(), topology.vertex_count, "{name}");
    assert_eq!(topology.moves.len(), topology.triangles.len(), "{name}");
    assert!(!topology.materials.is_empty());
    let (mut triangle, mut vertex) = (0, 0);
    for part in &topology.parts {
        assert_eq!((part.triangles.start, part.vertices.start), (triangle, vertex), "{name}");
        (triangle, vertex) = (part.triangles.end, part.vertices.end);
        assert!((part.material as usize) < topology.materials.len());
        let range = part.triangles.start as usize..part.triangles.end as usize;
        for corner in topology.triangles[range.clone()].as_flattened() {
            assert!(part.vertices.contains(corner), "{name}: a part uses vertices of another");
        }
        assert_eq!(topology.moves[range].contains(&true), !part.motion.is_empty(), "{name}: {}", part.name);
    }
    assert_eq!(
        (triangle as usize, vertex as usize),
        (topology.triangles.len(), topology.vertex_count),
        "{name}"
    );

    let bits = |positions: &[Vec3]| -> Vec<[u32; 3]> {
        positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
    };
    let mut positions = rest.clone();
    animation.pose(0.0, &mut positions);
    assert_eq!(bits(&positions), bits(&rest), "{name}: the pose at 0 is the rest pose");

    // Sampled over the loop, in an order that is not that of time: what moves, and only that,
    // moves.
    let steps = if animation.duration() > 0.0 { 31 } else { 1 };
    let times = (0..steps).map(|step| animation.duration() * f64::from(step * 12 % steps) / f64::from(steps));
    let mut seen_moving = vec![false; topology.triangles.len()];
    for time in times {
        animation.pose(time, &mut positions);
        let mut afresh = rest.clone();
        animation.pose(time, &mut afresh);
        assert_eq!(bits(&positions), bits(&afresh), "{name}: a pose depends on earlier ones");
        for (seen, corners) in seen_moving.iter_mut().zip(&topology.triangles) {
            *seen |= corners.iter().any(|&corner| positions[corner as usize] != rest[corner as usize]);
        }
    }
    for (triangle, (&seen, &moves)) in seen_moving.iter().zip(&topology.moves).enumerate() {
        assert!(
            moves || !seen || !rest_is_finite(&rest, topology.triangles[triangle]),
            "{name}: triangle {triangle} moves"
        );
    }
    let (seen, declared) = (
        seen_moving.iter().filter(|&&seen| seen).count(),
        topology.moves.iter().filter(|&&moves| moves).count(),
    );
    assert!(declared == 0 || seen * 10 >= declared * 9, "{name}: {declared} triangles can move, {seen} do");
}

fn rest_is_finite(rest: &[Vec3], corners: [u32; 3]) -> bool {
    corners.iter().all(|&corner| rest[corner as usize].is_finite())
}

fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)))
}

#[test]
fn everything_loads_with_the_counts_of_the_manifest() {
    // Name, triangles, moving triangles, seconds (to a tenth).
    let expected = [
        ("gltf/BrainStem.glb", 61_666, 61_666, 34.9),
        ("gltf/CesiumMan.glb", 4_672, 4_672, 2.0),
        ("gltf/Fox.glb", 576, 576, 3.4),
        ("gltf/MorphStressTest.gltf", 2_412, 1_360, 9.3),
        ("gltf/AnimatedMorphCube/AnimatedMorphCube.gltf", 12, 10, 4.2),
        ("gltf/simple_skin/simple_skin.gltf", 8, 8, 5.5),
        ("static/2CylinderEngine.glb", 121_496, 0, 0.0),
        ("static/sponza_dabrovic.obj", 66_450, 0, 0.0),
        ("stanford/bunny.obj", 69_451, 0, 0.0),
        ("stanford/dragon_vrip_res2.ply", 202_520, 0, 0.0),
        ("hard/jacksboro_dem_utm16n.ply", 275_772, 0, 0.0),
        ("hard/AC14-FZK-Haus_ifcopenshell.obj", 36_290, 0, 0.0),
        ("hard/BoxWithInfinites.glb", 12, 0, 0.0),
        ("unc/cloth-ball", 92_230, 92_230, 2.0 / 24.0),
        ("unc/n-body", 146_480, 144_000, 2.0 / 24.0),
    ];
    for (name, triangles, moving, duration) in expected {
        let Some(path) = data(name) else { return };
        let animation = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let topology = animation.topology();
        let found = topology.moves.iter().filter(|&&moves| moves).count();
        println!(
            "{name}: {} triangles, {found} move, {:.2} s, {} parts",
            topology.triangles.len(),
            animation.duration(),
            topology.parts.len()
        );
        assert_eq!((topology.triangles.len(), found), (triangles, moving), "{name}");
        assert!((animation.duration() - duration).abs() < 0.05, "{name}: {} s", animation.duration());
        check(&*animation, name);
        let finite = animation.rest().iter().all(|position| position.is_finite());
        assert_eq!(finite, name != "hard/BoxWithInfinites.glb", "{name}");
    }
}

#[test]
fn brain_stem_stands_upright() {
    let Some(path) = data("gltf/BrainStem.glb") else { return };
    let animation = load(&path, &LoadOptions::default()).unwrap();
    let mut positions = animation.rest();
    for step in 0..=20 {
        animation.pose(animation.duration() * f64::from(step) / 20.0, &mut positions);
        let (min, max) = bounds(&positions);
        let size = max - min;
        assert!(positions.iter().all(|position| position.is_finite()));
        assert!((1.0..2.5).contains(&size.y), "as tall as a human: {size}");
        assert!(size.x < 2.5 && size.z < 2.5, "not taken apart: {size}");
        assert!((-0.5..0.5).contains(&min.y), "on the ground: {min}");
    }
}

#[test]
fn characters_keep_their_shape() {
    // Skinning turns and bends, but edges stay about as long as they are at rest.
    for (name, largest) in [("gltf/BrainStem.glb", 0.05), ("gltf/CesiumMan.glb", 0.05), ("gltf/Fox.glb", 0.1)]
    {
        let Some(path) = data(name) else { return };
        let animation = load(&path, &LoadOptions::default()).unwrap();
        let topology = animation.topology();
        let total = |positions: &[Vec3]| -> f64 {
            let edge = |a: u32, b: u32| f64::from(positions[a as usize].distance(positions[b as usize]));
            topology.triangles.iter().map(|&[a, b, c]| edge(a, b) + edge(b, c) + edge(c, a)).sum()
        };
        let mut positions = animation.rest();
        let at_rest = total(&positions);
        for step in 1..10 {
            animation.pose(animation.duration() * f64::from(step) / 10.0, &mut positions);
            let change = total(&positions) / at_rest - 1.0;
            assert!(change.abs() < largest, "{name}: edges changed by {change}");
        }
    }
}

#[test]
fn every_clip_of_the_fox() {
    let Some(path) = data("gltf/Fox.glb") else { return };
    let load = |clip| load(&path, &LoadOptions { clip: Some(clip), ..LoadOptions::default() });
    for clip in ["Survey", "Walk", "Run", "0", "1", "2"] {
        check(&*load(clip).unwrap(), clip);
    }
    let message = load("Fly").err().expect("there is no such clip").to_string();
    assert!(message.ends_with(r#"expected one of 0 "Survey", 1 "Walk", 2 "Run""#), "{message}");
}

#[test]
fn broken_files_fail_cleanly() {
    let mut count = 0;
    for folder in ["hard/invalid", "hard/gltf_invalid"] {
        let Some(folder) = data(folder) else { return };
        let mut waiting = vec![folder];
        while let Some(path) = waiting.pop() {
            if path.is_dir() {
                waiting.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
                continue;
            }
            let message =
                load(&path, &LoadOptions::default()).err().expect("a broken file loaded").to_string();
            println!("{message}");
            assert!(message.contains(&*path.display().to_string()) && !message.contains('\n'), "{message}");
            count += 1;
        }
    }
    assert!(count >= 10, "only {count} files found");
}

#[test]
fn bart_museum() {
    let Some(path) = data("bart/museum/museum5.aff") else { return };
    let animation = load(&path, &LoadOptions::default()).unwrap();
    check(&*animation, "museum5");
    let topology = animation.topology();
    let moving = topology.moves.iter().filter(|&&moves| moves).count();
    // 10,284 triangles in the files, and 8 cylinders of 32 each.
    assert_eq!((topology.triangles.len() - moving, moving), (10_284 + 8 * 32, 1024));
    assert_eq!((animation.duration(), animation.model().frames), (6.0, Some(300)));
    assert!(
        topology.parts.iter().all(|part| part.motion.is_empty() != part.motion.contains(Motion::KEY_FRAMES))
    );

    // The sculpture by a reader of its own: a word, the number of keys, then 19 numbers a key.
    let text = std::fs::read_to_string(path.with_file_name("animart5.aff")).unwrap();
    let shapes = text.split("tpa").skip(1).map(|triangle| {
        let numbers: Vec<f32> = triangle.split_whitespace().map(|word| word.parse().unwrap()).collect();
        assert_eq!(numbers[0], 5.0);
        numbers[1..].chunks(19).map(<[f32]>::to_vec).collect::<Vec<_>>()
    });
    let shapes: Vec<_> = shapes.collect();
    let part = topology.parts.iter().find(|part| part.motion.contains(Motion::KEY_FRAMES)).unwrap();
    let vertices = part.vertices.start as usize..part.vertices.end as usize;
    let mut positions = animation.rest();
    for shape in 0..5 {
        // The animation starts a second before the first shape.
        animation.pose(1.0 + shape as f64, &mut positions);
        for (triangle, corners) in shapes.iter().zip(positions[vertices.clone()].chunks(3)) {
            let key = &triangle[shape];
            assert_eq!(key[0], shape as f32);
            for (corner, &position) in corners.iter().enumerate() {
                assert_eq!(position, Vec3::from_slice(&key[1 + 6 * corner..]));
            }
        }
    }
    check_views(&*animation);
}

#[test]
fn bart_kitchen() {
    let Some(path) = data("bart/kitchen/kitchen.aff") else { return };
    let animation = load(&path, &LoadOptions::default()).unwrap();
    check(&*animation, "kitchen");
    let topology = animation.topology();
    assert_eq!(topology.triangles.len(), 110_561);
    assert_eq!(topology.moves.iter().filter(|&&moves| moves).count(), 7_218);
    assert_eq!((animation.duration(), animation.model().frames), (20.0, Some(800)));
    assert!(topology.parts.iter().all(|part| part.motion.is_empty() || part.motion.contains(Motion::RIGID)));
    check_views(&*animation);

    // The car is in the room all the time, at the file's keys where they say.
    let car: Vec<usize> = topology
        .parts
        .iter()
        .filter(|part| part.name == "car_body")
        .flat_map(|part| part.vertices.start as usize..part.vertices.end as usize)
        .collect();
    let mut positions = animation.rest();
    for (time, x, z) in [(0.0, 4.45, 2.75), (3.0, 4.45, 2.75), (9.8, 2.7, 0.55), (18.0, 1.4, 1.65)] {
        animation.pose(time, &mut positions);
        let (low, high) = car.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), &vertex| {
            (low.min(positions[vertex]), high.max(positions[vertex]))
        });
        let center = 0.5 * (low + high);
        assert!((center.x - x).abs() < 0.05 && (center.z - z).abs() < 0.05, "at {time}: {center}");
        assert!(low.y > -0.01 && high.y < 0.2, "at {time}: {low} to {high}");
    }
}

fn check_views(animation: &dyn Animation) {
    let mut last = animation.view(0.0).unwrap();
    for step in 1..=1000 {
        let time = animation.duration() * f64::from(step) / 1000.0;
        let mut positions = animation.rest();
        if step % 50 == 0 {
            animation.pose(time, &mut positions);
            assert!(positions.iter().all(|p| p.is_finite()));
        }
        let view = animation.view(time).unwrap();
        assert!(view.eye.distance(last.eye) < 0.3, "the camera jumps at {time}");
        let turn = (view.target - view.eye).angle_between(last.target - last.eye);
        assert!(turn < 0.3, "the camera spins at {time}");
        assert!(animation.light(time).is_some());
        last = view;
    }
}

/// Sizes and a texel as another decoder has them.
#[test]
fn textures_of_real_files() {
    for (name, sizes, [x, y], color) in TEXTURES {
        let Some(path) = data(name) else { return };
        let animation = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let topology = animation.topology();
        let found: Vec<_> = topology.textures.iter().map(|t| (t.width, t.height)).collect();
        assert_eq!(found, sizes, "{name}");
        assert_eq!(topology.texcoords.len(), topology.vertex_count, "{name}");
        assert!(topology.parts.iter().all(|part| {
            let material = topology.materials[part.material as usize];
            material.texture.is_some() && material.cutoff.is_none() && !material.mirror
        }));
        let texel = topology.textures[0].texels[(y * sizes[0].0 + x) as usize];
        let near = (0..3).all(|k| texel[k].abs_diff(color[k]) <= 3);
        assert!(near && texel[3] == 255, "{name}: {texel:?}");
    }
}

/// A file, the sizes of its textures, a place in the first and its colour there.
type Textured = (&'static str, &'static [(u32, u32)], [u32; 2], [u8; 3]);

const TEXTURES: [Textured; 3] = [
    ("gltf/CesiumMan.glb", &[(1024, 1024)], [460, 100], [107, 173, 223]),
    ("gltf/Fox.glb", &[(1024, 1024)], [91, 100], [83, 52, 16]),
    ("gltf/MorphStressTest.gltf", &[(64, 64), (64, 64)], [40, 20], [209, 209, 209]),
];
