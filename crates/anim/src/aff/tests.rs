//! Small scenes, one construct each; what is wrong with broken ones; and noise.

use std::f32::consts::FRAC_1_SQRT_2;

use glam::vec3;
use tempfile::TempDir;

use super::*;
use crate::{LoadOptions, Material};

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    folder
}

fn load_text(text: &str) -> AffAnimation {
    load_files(&[("root.aff", text)])
}

/// The first file is the root.
fn load_files(files: &[(&str, &str)]) -> AffAnimation {
    load(&folder(files).path().join(files[0].0), DVec3::ZERO).unwrap()
}

/// The message, which must be one line that starts with the file's name; that is left out.
#[track_caller]
fn error(files: &[(&str, &str)]) -> String {
    let folder = folder(files);
    let Err(error) = load(&folder.path().join(files[0].0), DVec3::ZERO) else { panic!("it loads") };
    let message = error.to_string();
    assert!(!message.contains('\n'), "{message}");
    let folder = format!("{}{}", folder.path().display(), std::path::MAIN_SEPARATOR);
    message.strip_prefix(&folder).unwrap_or_else(|| panic!("{message}")).to_owned()
}

fn at(animation: &AffAnimation, time: f64) -> Vec<Vec3> {
    let mut positions = animation.rest();
    animation.pose(time, &mut positions);
    positions
}

#[track_caller]
fn assert_close(a: &[Vec3], b: &[Vec3]) {
    assert!(a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.distance(*b) < 1e-5), "{a:?} is not {b:?}");
}

const TRIANGLE: &str = "p 3  0 0 0  1 0 0  0 1 0\n";
const CORNERS: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

/// A track of translations along x, by key.
fn along_x(name: &str, keys: &[(f64, f64)]) -> String {
    let keys: String = keys.iter().map(|(time, x)| format!("{time} {x} 0 0  0 0 0\n")).collect();
    format!("k {name} {{\n transl {}\n{keys}}}\n", keys.lines().count())
}

#[test]
fn triangles_of_all_kinds() {
    let animation = load_text(
        "# a comment\n% another\nb 0 0 0\nam 1 1 1 # and one after a statement\n\
         p 4  0 0 0  1 0 0  1 1 0  0 1 0\n\
         pp 3  0 0 1 0 0 1  1 0 1 0 0 1  0 1 1 0 0 1\n\
         tt wood.ppm  0 0 2 0 0  1 0 2 1 0  0 1 2 0 1\n\
         ttp wood.ppm  0 0 3 0 0 1 0 0  1 0 3 0 0 1 1 0  0 1 3 0 0 1 0 1\n\
         m vertices 3  0 0 4  1 0 4  0 1 4\n triangles 1  2 1 0\n\
         m vertices 3  0 0 5  1 0 5  0 1 5\n normals 1  0 0 1\n texturecoords 1 wood.ppm  0 0\n\
         triangles 2  0 1 2  0 0 0  0 0 0   2 1 0  0 0 0  0 0 0\n",
    );
    let triangles = &animation.topology().triangles;
    assert_eq!(
        triangles[..],
        [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12], [15, 14, 13], [16, 17, 18], [18, 17, 16]]
    );
    let rest = animation.rest();
    for (z, &[a, _, _]) in [0.0, 0.0, 1.0, 2.0, 3.0].into_iter().zip(triangles) {
        assert_eq!(rest[a as usize].z, z);
    }
    assert_eq!(rest[13..16], [vec3(0.0, 0.0, 4.0), vec3(1.0, 0.0, 4.0), vec3(0.0, 1.0, 4.0)]);
    assert_eq!(animation.duration(), 0.0);
    assert!(animation.topology().moves.iter().all(|&moves| !moves));
    assert_eq!(animation.topology().parts.len(), 1);
    assert_eq!(animation.topology().parts[0].name, "root");
    assert!(animation.view(0.0).is_none() && animation.light(0.0).is_none());
}

#[test]
fn spheres_and_cones() {
    let animation = load_text("s 1 2 3 -0.5\nc 0 0 0 2  0 0 3 0");
    let topology = animation.topology();
    assert_eq!(topology.triangles.len(), 224 + 32);
    let center = vec3(1.0, 2.0, 3.0);
    let rest = animation.rest();
    let (sphere, cone) = rest.split_at(9 * 16);
    assert!(sphere.iter().all(|p| (p.distance(center) - 0.5).abs() < 1e-6));
    assert!(cone.iter().all(|p| (p.truncate().length() - 2.0 + p.z * 2.0 / 3.0).abs() < 1e-6));
}

#[test]
fn materials_start_parts() {
    let animation = load_text(&format!(
        "{TRIANGLE} f 1 0.5 0.25  0.5 0 0 0 0 {TRIANGLE} {TRIANGLE}
         fm 0 0 0  2 0 -1  1 1 1  0 0 0 {TRIANGLE} fm 0 0 0  0 0 0  0 1 0  0 0 0 {TRIANGLE} f 1 0.5 0.25  0.5 0 0 0 0 {TRIANGLE}"
    ));
    let topology = animation.topology();
    let colors = topology.parts.iter().map(|part| topology.materials[part.material as usize].base_color);
    let shaded = [0.5, 0.25, 0.125];
    assert_eq!(
        colors.collect::<Vec<_>>(),
        [Material::default().base_color, shaded, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], shaded]
    );
    assert_eq!(topology.materials.len(), 4);
    assert_eq!(topology.parts[1].triangles, 1..3);
}

#[test]
fn fixed_transforms_scale_then_rotate_then_move() {
    let animation = load_text(&format!(
        "xs 2 1 1  0 0 3 90  10 0 0 {{ xs 1 1 1  0 0 0 0  0 0 5 {{ {TRIANGLE} }} }} {TRIANGLE}"
    ));
    let moved = [vec3(10.0, 0.0, 5.0), vec3(10.0, 2.0, 5.0), vec3(9.0, 0.0, 5.0)];
    assert_close(&animation.rest(), &[moved, CORNERS].concat());
    assert!(animation.topology().parts.iter().all(|part| part.motion.is_empty()));
}

#[test]
fn animated_transforms_move_what_they_hold() {
    let slide = along_x("slide", &[(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0)]);
    // The track may come before or after, and a transform without one stands still.
    let animation = load_text(&format!(
        "{TRIANGLE} x slide {{ {TRIANGLE} xs 1 1 1 0 0 1 0  0 0 7 {{ x turn {{ {TRIANGLE} }} }} }}
         x nothing {{ xs 1 1 1 0 0 1 0  0 9 0 {{ {TRIANGLE} }} }} {slide}
         k turn {{ rot 4  -1 0 0 1 0 0 0 0  0 0 0 1 0 0 0 0  2 0 0 1 90 0 0 0  3 0 0 1 90 0 0 0 }}
         a 0 2 41"
    ));
    let topology = animation.topology();
    assert_eq!(topology.moves, [false, true, true, false]);
    assert_eq!(
        topology.parts.iter().map(|part| part.motion.contains(Motion::RIGID)).collect::<Vec<_>>(),
        [false, true, true, false]
    );
    assert_eq!((animation.duration(), animation.model().frames), (2.0, Some(41)));
    let still = CORNERS.map(|p| p + Vec3::Y * 9.0);
    let slid = |x: f32| CORNERS.map(|p| p + Vec3::X * x);
    let turned = |x: f32, cosine: f32, sine: f32| {
        [Vec3::ZERO, vec3(cosine, sine, 0.0), vec3(-sine, cosine, 0.0)].map(|p| p + vec3(x, 0.0, 7.0))
    };
    assert_close(&animation.rest(), &[CORNERS, slid(0.0), turned(0.0, 1.0, 0.0), still].concat());
    let middle = turned(1.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    assert_close(&at(&animation, 1.0), &[CORNERS, slid(1.0), middle, still].concat());
    let end = [CORNERS, slid(2.0), turned(2.0, 0.0, 1.0), still].concat();
    for time in [2.0, 3.0, f64::INFINITY] {
        assert_close(&at(&animation, time), &end);
    }
    assert_eq!(at(&animation, f64::NAN), animation.rest());
    // Still vertices are not written.
    let mut positions = vec![Vec3::NAN; 12];
    animation.pose(1.0, &mut positions);
    let written: Vec<bool> = positions.iter().map(|p| p.is_finite()).collect();
    assert_eq!(written, [[false; 3], [true; 3], [true; 3], [false; 3]].concat());
}

#[test]
fn time_starts_where_the_file_says() {
    let slide = along_x("slide", &[(-9.0, 0.0), (-3.0, -3.0), (0.0, 0.0), (3.0, 3.0), (9.0, 9.0)]);
    let body = format!("x slide {{ {TRIANGLE} }} {slide}");
    let animation = load_text(&format!("{body} a -3 0 10"));
    assert_eq!(animation.duration(), 3.0);
    assert_close(&animation.rest(), &CORNERS.map(|p| p - 3.0 * Vec3::X));
    assert_close(&at(&animation, 3.0), &CORNERS);
    // Without times, those of the keys that are reached.
    let animation = load_text(&body);
    assert_eq!((animation.duration(), animation.model().frames), (6.0, None));
    assert_close(&at(&animation, 3.0), &CORNERS);
}

#[test]
fn animated_triangles_under_transforms() {
    let patch =
        "tpa 2\n 1  0 0 0 0 0 1  1 0 0 0 0 1  0 1 0 0 0 1\n 2  0 0 4 0 0 1  1 0 4 0 0 1  0 1 4 0 0 1\n";
    let alone = "tpa 1\n 1  0 0 0 0 0 1  1 0 0 0 0 1  0 1 0 0 0 1\n";
    let slide = along_x("slide", &[(-1.0, 0.0), (0.0, 0.0), (4.0, 4.0), (5.0, 5.0)]);
    let animation = load_text(&format!(
        "xs 2 2 2 0 0 0 0 0 0 0 {{ {patch} {alone} }} x slide {{ {patch} }} {slide} a 0 4 5"
    ));
    let topology = animation.topology();
    assert_eq!(topology.moves, [true, false, true]);
    assert!(
        topology.parts[0].motion.contains(Motion::KEY_FRAMES)
            && !topology.parts[0].motion.contains(Motion::RIGID)
    );
    assert!(
        topology.parts[1].motion.contains(Motion::KEY_FRAMES)
            && topology.parts[1].motion.contains(Motion::RIGID)
    );
    let double = |z: f32| CORNERS.map(|p| 2.0 * p + Vec3::Z * z);
    for (time, z) in [(0.0, 0.0), (1.0, 0.0), (1.5, 2.0), (2.0, 4.0), (4.0, 4.0)] {
        let positions = at(&animation, time);
        assert_close(&positions[..6], &[double(2.0 * z), double(0.0)].concat());
        assert!(positions[6..].iter().all(|p| (p.z - z).abs() < 1e-6), "at {time}");
    }
    assert_close(&at(&animation, 4.0)[6..], &CORNERS.map(|p| p + 4.0 * vec3(1.0, 0.0, 1.0)));
}

#[test]
fn keys_of_visibility_count_as_keys() {
    let animation = load_text(&format!("x it {{ {TRIANGLE} }} k it {{ visibility 2  1 0  3 1 }}"));
    assert_eq!(animation.duration(), 2.0);
}

#[test]
fn hidden_objects_shrink_to_a_point() {
    let animation = load_text(&format!("x it {{ {TRIANGLE} }} k it {{ visibility 2  1 0  2 1 }} a 0 3 4"));
    assert_eq!(animation.topology().moves, [true]);
    assert_eq!(animation.rest(), CORNERS);
    assert_eq!(at(&animation, 1.5), [Vec3::ZERO; 3]);
    assert_eq!(at(&animation, 2.0), CORNERS);
}

const VIEW: &str = "v from 0 1 5 at 0 1 0 up 0 1 0 angle 90 hither 0.1 resolution 800 600\n";

#[test]
fn cameras_move_by_the_keys_of_their_transform() {
    let view = load_text(&format!("{VIEW} {TRIANGLE}")).view(0.0).unwrap();
    assert_eq!((view.eye, view.up), (vec3(0.0, 1.0, 5.0), Vec3::Y));
    assert_close(&[(view.target - view.eye).normalize()], &[Vec3::NEG_Z]);
    assert!((view.fov_y - std::f32::consts::FRAC_PI_2).abs() < 1e-6);

    let slide = along_x("camera", &[(-1.0, 0.0), (0.0, 0.0), (2.0, 2.0), (3.0, 3.0)]);
    let turn = "rot 4  -1 0 1 0 0 0 0 0  0 0 1 0 0 0 0 0  2 0 1 0 90 0 0 0  3 0 1 0 90 0 0 0 }";
    let animation =
        load_text(&format!("{VIEW} {TRIANGLE} {} {turn}", slide.trim_end().trim_end_matches('}')));
    assert_eq!(animation.duration(), 2.0);
    assert!(animation.topology().moves == [false]);
    let [start, end] = [0.0, 2.0].map(|time| animation.view(time).unwrap());
    assert_close(&[start.eye, end.eye], &[Vec3::ZERO, 2.0 * Vec3::X]);
    assert_close(&[start, end].map(|view| (view.target - view.eye).normalize()), &[Vec3::NEG_Z, Vec3::NEG_X]);
}

#[test]
fn lights_add_up_and_move_with_what_carries_them() {
    let slide = along_x("lamp", &[(-2.0, -2.0), (0.0, 0.0), (2.0, 2.0), (4.0, 4.0)]);
    let still = load_text(&format!("l 1 2 3 0.5 0.25 0.125\nl 0 0 0 0.75 0.25 0.25\n{TRIANGLE}"));
    let expected = Light { position: vec3(1.0, 2.0, 3.0), color: [1.0, 0.5, 0.375] };
    assert_eq!(still.light(0.0), Some(expected));
    let moving = load_text(&format!("la lamp 7 7 7\n{TRIANGLE} {slide}"));
    let light = moving.light(1.0).unwrap();
    assert_close(&[light.position], &[Vec3::X]);
    assert_eq!(light.color, [1.0; 3]);
    let carried = load_text(&format!("x lamp {{ l 0 1 0 {TRIANGLE} }} {slide}"));
    assert_close(&[carried.light(2.0).unwrap().position], &[vec3(2.0, 1.0, 0.0)]);
}

#[test]
fn includes_below_the_folder() {
    let files = [
        ("root.aff", "i 0 parts/a.aff\n i 1 missing.aff d 1 xs 1 1 1 0 0 0 0 0 0 1 { i 1 parts/a.aff }"),
        ("parts/a.aff", "i 0 ../b.aff\n f 1 1 1 1 0 0 0 0\n i 0 b.aff"),
        ("b.aff", TRIANGLE),
        ("parts/b.aff", TRIANGLE),
    ];
    let animation = load_files(&files);
    let z: Vec<f32> = animation.rest().iter().map(|p| p.z).collect();
    assert_eq!(z, [[0.0; 6], [1.0; 6]].concat());
    let parts = &animation.topology().parts;
    assert_eq!(parts[0].name, "b");
    // The material outlives the file that sets it.
    let materials: Vec<u32> = parts.iter().map(|part| part.material).collect();
    assert_eq!(materials, [0, 1]);
}

#[test]
fn includes_that_must_not_be() {
    let message = error(&[("root.aff", "\ni 0 a.aff"), ("a.aff", "i 0 root.aff")]);
    assert_eq!(
        message,
        "a.aff: line 1: found include in a circle of \"root.aff\", expected a file that is not being read already"
    );
    let message = error(&[("root.aff", "\n\ni 0 none.aff")]);
    assert!(
        message.starts_with("root.aff: line 3: found include of a file that cannot be read"),
        "{message}"
    );
    let message = error(&[("below/root.aff", "i 0 ../a.aff"), ("a.aff", TRIANGLE)]);
    assert!(message.ends_with("expected a file below the folder of the first file"), "{message}");
    assert!(error(&[("root.aff", "i 0 .")]).contains("expected a regular file"));

    let name = |level: usize| format!("{level}.aff");
    let include = |level: usize, times: usize| format!("i 0 {}\n", name(level)).repeat(times);
    let chain: Vec<_> = (0..70).map(|level| (name(level), include(level + 1, 1))).collect();
    let chain: Vec<_> =
        chain.iter().map(|(name, text)| (&**name, &**text)).chain([("70.aff", TRIANGLE)]).collect();
    assert!(error(&chain).contains("expected files at most 64 deep"));

    // 16^20 triangles.
    let bomb: Vec<_> = (0..20).map(|level| (name(level), include(level + 1, 16))).collect();
    let bomb: Vec<_> =
        bomb.iter().map(|(name, text)| (&**name, &**text)).chain([("20.aff", TRIANGLE)]).collect();
    let message = error(&bomb);
    // The budget ends at a line or as the next file is opened.
    let is_placed = [".aff: line ", ".aff: whole scene: "].iter().any(|place| message.contains(place));
    assert!(is_placed && message.contains("decoded data"), "{message}");

    // Paths of 4 KB take long to look up: 10^5 of them took minutes.
    let way = "a/../".repeat(100);
    let include = |level: usize| format!("i 0 {way}{level}.aff\n").repeat(10);
    let bomb = [1, 2, 3, 4, 5].map(|level| (name(level - 1), include(level)));
    let bomb: Vec<_> = bomb.iter().map(|(name, text)| (&**name, &**text)).collect();
    let message = error(&[&bomb[..], &[("5.aff", TRIANGLE), ("a/empty", "")]].concat());
    assert!(message.contains("decoded data"), "{message}");
}

#[test]
fn many_spheres_are_not_too_many() {
    assert_eq!(load_text(&"s 0 0 0 1 ".repeat(20_000)).topology().triangles.len(), 224 * 20_000);
}

#[test]
fn what_is_wrong_and_where() {
    for (text, expected) in [
        ("", "whole scene: found no triangles, expected at least one"),
        ("a 0 1 2", "whole scene: found no triangles, expected at least one"),
        ("\n\nfoo 1", "line 3: found \"foo\", expected a statement: a, am,"),
        ("p 2 0 0 0 1 1 1", "line 1: found 2, expected a number of vertices from 3 up"),
        ("p -3", "line 1: found \"-3\", expected a number of vertices from 3 up"),
        ("p 3 0 0 0\n 0 0 0\n 0 0", "line 3: found the end of the file, expected a finite number"),
        ("p 3 0 0 0\n 0 nan 0\n 0 0 0", "line 2: found \"nan\", expected a finite number"),
        ("p 4000000000 0 0 0", "line 1: found the end of the file, expected a finite number"),
        ("m vertices 1 0 0 0 triangles 1 0 0 1", "line 1: found 1, expected the number of a vertex below 1"),
        ("m normals", "line 1: found \"normals\", expected \"vertices\""),
        ("m vertices 1 0 0 0 }", "line 1: found \"}\", expected \"triangles\""),
        ("tpa 0", "line 1: found 0, expected a number of keys from 1 up"),
        ("xs 1 1 1 0 1 0 90 0 0 0\np 3", "line 2: found \"p\", expected \"{\""),
        ("x { }", "line 1: found \"{\", expected the name of a transform"),
        ("x a {\n", "line 2: found the end of the file, expected \"}\""),
        ("}", "line 1: found \"}\", expected a statement, as no brace is open"),
        ("k a { transl 3", "line 1: found 3, expected a number of keys from 4 up"),
        ("k a { spin 3", "line 1: found \"spin\", expected transl, rot, scale, visibility or \"}\""),
        ("k a { visibility 1 0 2", "line 1: found \"2\", expected 0 (invisible) or 1 (visible)"),
        ("a 2 1 10", "line 1: found an end 1 before the start 2, expected the start, then the end"),
        (
            "v from 0 0 0 at 0 0 0 up 0 1 0 angle 180",
            "found 180, expected an angle between 0 and 180 degrees",
        ),
        ("i 0", "line 1: found the end of the file, expected the name of a file"),
    ] {
        let message = error(&[("root.aff", text)]);
        let message = message.strip_prefix("root.aff: ").unwrap();
        assert!(message.contains(expected), "{text:?}: {message}");
    }
    // Braces close in the file that opens them.
    let message = error(&[("root.aff", "x a { i 0 b.aff"), ("b.aff", "}")]);
    assert!(message.starts_with("b.aff: line 1"), "{message}");
}

#[test]
fn keys_out_of_order_are_sorted_and_reported() {
    let triangle = "x a { p 3 0 0 0 1 0 0 0 1 0 }\n";
    let scene = |keys: &[(f64, f64)]| load_text(&format!("{}{triangle}", along_x("a", keys)));
    let sorted = scene(&[(0.0, 0.0), (0.5, 2.0), (1.0, 3.0), (2.0, 7.0)]);
    let shuffled = scene(&[(0.0, 0.0), (1.0, 3.0), (0.5, 2.0), (2.0, 7.0)]);
    assert_close(&at(&shuffled, 0.2), &at(&sorted, 0.2));
    assert!(sorted.model().notes.is_empty());
    assert!(shuffled.model().notes[0].contains("1 list of keys"), "{:?}", shuffled.model().notes);
}

#[test]
fn by_the_extension() {
    let folder = folder(&[("Scene.AFF", TRIANGLE)]);
    let file = folder.path().join("Scene.AFF");
    let options = LoadOptions::default();
    assert_eq!(crate::load(&file, &options).unwrap().topology().triangles.len(), 1);
    let clip = LoadOptions { clip: Some("clip"), ..options };
    let message = crate::load(&file, &clip).err().unwrap().to_string();
    assert!(message.ends_with("expected no clip to be asked for, as there are none"), "{message}");
}

/// Everything at once, to be damaged.
fn everything() -> String {
    let slide = along_x("slide", &[(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]);
    format!(
        "{VIEW} l 1 2 3 # c\n la slide 0 0 0 1 1 1 fm 0 0 0 1 1 1 0 0 0 0 0 0 f 1 1 1 1 0 0 0 0
         s 0 0 0 1 c 0 0 0 1 0 0 1 0.5 {TRIANGLE} xs 1 2 3 0 1 0 45 1 2 3 {{ x slide {{
         m vertices 3 0 0 4 1 0 4 0 1 4 normals 1 0 0 1 triangles 1 2 1 0 0 0 0 }} }} {slide}
         k camera {{ rot 4 -1 0 1 0 0 0 0 0 0 0 1 0 0 0 0 0 2 0 1 0 90 0 0.5 0 3 0 1 0 90 0 0 0
         visibility 2 0 1 1 0 }} tpa 2 0 0 0 0 0 0 1 1 0 0 0 0 1 0 1 0 0 0 1
         1 0 0 4 0 0 1 1 0 4 0 0 1 0 1 4 0 0 1 a 0 1 20"
    )
}

#[test]
fn noise_does_not_panic() {
    let whole = everything().into_bytes();
    let folder = folder(&[]);
    let file = folder.path().join("root.aff");
    let try_load = |bytes: &[u8]| {
        // Some file systems are slow to write over a file.
        _ = std::fs::remove_file(&file);
        std::fs::write(&file, bytes).unwrap();
        let Ok(animation) = load(&file, DVec3::ZERO) else { return false };
        for time in [0.0, 0.3, 1e9] {
            assert_eq!(at(&animation, time).len(), animation.topology().vertex_count);
            assert!(animation.view(time).is_none_or(|view| view.eye.is_finite()));
            assert!(animation.light(time).is_none_or(|light| light.position.is_finite()));
        }
        true
    };
    assert!(try_load(&whole));
    for length in 0..whole.len() {
        try_load(&whole[..length]);
    }
    let mut random = fastrand::Rng::with_seed(1);
    let alphabet = b"0123456789-.e {}#%\nxkpmavls\xff\0";
    let mut loaded = 0;
    for _ in 0..3000 {
        let mut bytes = whole.clone();
        for _ in 0..=random.usize(..4) {
            let place = random.usize(..bytes.len());
            match random.usize(..3) {
                0 => bytes[place] = alphabet[random.usize(..alphabet.len())],
                1 => bytes.insert(place, alphabet[random.usize(..alphabet.len())]),
                _ => drop(bytes.remove(place)),
            }
        }
        loaded += usize::from(try_load(&bytes));
    }
    assert!(loaded > 100, "only {loaded} of the damaged files load, so poses are hardly tried");
}
