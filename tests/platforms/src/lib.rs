//! Fingerprints of trees, hits and pictures. They are the same on every platform and at every SIMD
//! level: `fingerprints.txt` lists them, and `run` compares the list with what each platform
//! computes.
//!
//! The test meshes use integers, the four operations and nothing else, since functions such as the
//! sine differ from one system to the next. The scenes of the experiments take theirs from the
//! crate `libm`.

use bvh_build::{Builder, build};
use bvh_core::{Bvh, Ray, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use rt_cpu::{
    AmbientOcclusion, Bvh8, Camera, DiffuseBounces, Effects, Image, Mesh, PointLight, RenderOptions,
    Traversal, TriangleTest, any_hit, closest_hit, render,
};
use scenes::SceneOptions;
use stage::Stage;

mod wasm;

/// The committed list, one `name fingerprint` a line.
pub const LIST: &str = include_str!("../fingerprints.txt");

/// FNV-1a, 64 bits. By hand: the recorded fingerprints depend on it.
struct Fingerprint(u64);

impl Fingerprint {
    const START: Self = Self(0xcbf2_9ce4_8422_2325);

    fn word(&mut self, word: u32) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// The bits; all NaNs are one.
    fn number(&mut self, x: f32) {
        self.word(if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() });
    }

    fn numbers(&mut self, xs: impl IntoIterator<Item = f32>) {
        xs.into_iter().for_each(|x| self.number(x));
    }

    fn image(&mut self, image: &Image) {
        image.pixels().iter().for_each(|pixel| self.numbers(*pixel));
    }

    fn tree(&mut self, bvh: &Bvh) {
        bvh.visit(|_, node, _| {
            let aabb = node.aabb();
            self.numbers(aabb.min.to_array().into_iter().chain(aabb.max.to_array()));
            if node.is_leaf() {
                bvh.primitives(node).iter().for_each(|&p| self.word(p));
            }
            self.word(node.count() as u32);
        });
    }
}

/// A number from 0 to 1 that depends on `seed` and `i` only. Not from a crate: the recorded
/// fingerprints depend on the numbers.
fn noise(seed: u32, i: u32) -> f32 {
    let mut x = (seed ^ i.wrapping_mul(0x9e37_79b9)).wrapping_add(0x7f4a_7c15);
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    ((x ^ (x >> 16)) >> 8) as f32 / (1 << 24) as f32
}

fn point(seed: u32, i: u32) -> Vec3 {
    Vec3::new(noise(seed, 3 * i), noise(seed, 3 * i + 1), noise(seed, 3 * i + 2))
}

/// The test meshes by name.
const SCENES: [&str; 5] = ["soup", "sheet", "teleports", "not-finite", "huge"];
const FRAMES: usize = 6;

type Indices = Vec<[u32; 3]>;

fn scene(name: &str, frame: usize) -> (Vec<Vec3>, Indices) {
    let time = frame as f32;
    if name == "sheet" {
        const N: u32 = 20;
        let vertex = |i: u32| {
            let (x, z) = ((i % (N + 1)) as f32, (i / (N + 1)) as f32);
            let (a, b) = (x - 2.0 * time, z - 7.0);
            Vec3::new(x * 0.5, 4.0 / (1.0 + 0.1 * (a * a + b * b)), z * 0.5 + 0.05 * time * x)
        };
        let quad = |i: u32| {
            let a = i / N * (N + 1) + i % N;
            [[a, a + 1, a + N + 2], [a, a + N + 2, a + N + 1]]
        };
        return ((0..(N + 1) * (N + 1)).map(vertex).collect(), (0..N * N).flat_map(quad).collect());
    }
    let n = 400u32;
    let vertex = |i: u32| {
        let triangle = i / 3;
        let swapped = name == "teleports" && frame % 2 == 1 && triangle.is_multiple_of(2);
        let placed = if swapped { n - 1 - triangle } else { triangle };
        let drift = if name == "soup" { (point(2, triangle) - 0.5) * time } else { Vec3::X * time };
        let mut p = point(1, placed) * 10.0 + drift + point(3, i) * 0.8;
        if name == "not-finite" && (triangle + frame as u32).is_multiple_of(17) {
            p[triangle as usize % 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][frame % 3];
        }
        // Their areas overflow, and differences of these are no numbers.
        if name == "huge" && (triangle + frame as u32).is_multiple_of(5) {
            p *= 1e25;
        }
        p
    };
    ((0..3 * n).map(vertex).collect(), (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// Every strategy whose trees do not depend on time.
fn strategies() -> impl Iterator<Item = Strategy> {
    Strategy::all().into_iter().filter(|strategy| !strategy.name().ends_with("background"))
}

fn built(scene_name: &str, builder: Builder) -> Bvh {
    let (positions, indices) = scene(scene_name, 0);
    let triangles = Triangles { positions: &positions, indices: &indices };
    build(&triangles, builder).expect("few enough")
}

/// The tree after all frames.
fn updated(scene_name: &str, strategy: &Strategy, level: SimdLevel) -> Bvh {
    let mut bvh = built(scene_name, Builder::Sweep);
    let mut updater = Updater::with_level(Strategy::default(), level);
    for frame in 1..FRAMES {
        let (positions, indices) = scene(scene_name, frame);
        let triangles = Triangles { positions: &positions, indices: &indices };
        updater.set_strategy(*strategy).update(&mut bvh, &triangles).expect("same count");
    }
    bvh
}

fn hits(scene_name: &str, test: TriangleTest, level: SimdLevel) -> Fingerprint {
    let bvh = updated(scene_name, &"refit+rotate".parse().expect("a strategy"), level);
    let (positions, indices) = scene(scene_name, FRAMES - 1);
    let triangles = Triangles { positions: &positions, indices: &indices };
    let mut wide = Bvh8::default();
    wide.update(&bvh, &triangles);
    let mut found = Fingerprint::START;
    for i in 0..600 {
        let from = point(4, i) * 30.0 - 10.0;
        let ray = Ray::new(from, point(5, i) * 10.0 + Vec3::X * 5.0 - from);
        let answers =
            [closest_hit(&bvh, &triangles, &ray, f32::INFINITY, test), wide.closest_hit(&ray, 1.0, test)];
        for hit in answers.into_iter().flatten() {
            found.numbers([hit.t, hit.u, hit.v]);
            found.word(hit.primitive);
        }
        found.word(u32::from(any_hit(&bvh, &triangles, &ray, 1.0, test)));
        found.word(u32::from(wide.any_hit(&ray, 1.0, test)));
    }
    found
}

/// The effects of pictures, by name.
const EFFECTS: [&str; 3] = ["shadows", "ambient-occlusion", "diffuse-bounces"];

fn picture(traversal: Traversal, name: &str, level: SimdLevel) -> Fingerprint {
    const WIDTH: u32 = 48;
    let bvh = updated("sheet", &"refit+rotate".parse().expect("a strategy"), level);
    let (positions, indices) = scene("sheet", FRAMES - 1);
    let mesh = Mesh::new(Triangles { positions: &positions, indices: &indices });
    let camera =
        Camera::look_at(Vec3::new(3.0, 9.0, 16.0), Vec3::new(5.0, 0.5, 5.0), Vec3::Y, 0.75, WIDTH, WIDTH);
    let light = PointLight { position: Vec3::new(-4.0, 8.0, 2.0), color: [1.0, 0.9, 0.8] };
    let effects = match name {
        "ambient-occlusion" => Effects {
            ambient_occlusion: Some(AmbientOcclusion { samples: 4, distance: 5.0 }),
            ..Effects::default()
        },
        "diffuse-bounces" => Effects {
            diffuse_bounces: Some(DiffuseBounces { most: 3, sky: [0.5, 0.6, 0.7] }),
            ..Effects::default()
        },
        _ => Effects::default(),
    };
    let options = RenderOptions { traversal, simd: level, effects, ..RenderOptions::default() };
    let mut image = Image::new(WIDTH, WIDTH);
    render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
    let mut found = Fingerprint::START;
    found.image(&image);
    found
}

/// The scenes of the experiments.
const ANIMATIONS: [&str; 6] =
    ["bart-museum", "cloth-ball", "exploding-dragon", "fairy-forest", "lion", "n-body"];

/// A small scene of the experiments half-way through its loop, after updates by refit and
/// rotations, shaded as it calls for.
fn scene_picture(name: &str, level: SimdLevel) -> Fingerprint {
    const LOOP: usize = 9;
    const WIDTH: u32 = 64;
    const HEIGHT: u32 = 48;
    // Few steps and triangles: this takes seconds in an emulator, too.
    let options = SceneOptions {
        detail: Some(0.02),
        key_frames: Some(LOOP),
        substeps: Some(8),
        ..SceneOptions::default()
    };
    let mut stage = Stage::new(scenes::load(name, None, &options).expect("a scene")).expect("few enough");
    let mut bvh = Bvh::clone(&stage.first_tree);
    let mut updater = Updater::with_level("refit+rotate".parse().expect("a strategy"), level);
    for frame in 1..=LOOP / 2 {
        stage.pose(stage.time_of(frame, LOOP));
        updater.update(&mut bvh, &stage.triangles()).expect("same count");
    }
    stage.smooth();
    let options = RenderOptions { simd: level, ..stage.render_options() };
    let mut image = Image::new(WIDTH, HEIGHT);
    render(&bvh, &stage.mesh(), &stage.camera(WIDTH, HEIGHT), Some(&stage.light()), &options, &mut image);
    let mut found = Fingerprint::START;
    found.tree(&bvh);
    found.image(&image);
    found
}

/// All fingerprints at one SIMD level, in the order of the list.
#[must_use]
pub fn fingerprints(level: SimdLevel) -> Vec<(String, u64)> {
    let mut all = Vec::new();
    for scene in SCENES {
        for builder in Builder::ALL {
            let mut found = Fingerprint::START;
            found.tree(&built(scene, builder));
            all.push((format!("build/{scene}/{}", builder.name()), found.0));
        }
        for strategy in strategies() {
            let mut found = Fingerprint::START;
            found.tree(&updated(scene, &strategy, level));
            all.push((format!("update/{scene}/{}", strategy.name()), found.0));
        }
        for test in TriangleTest::ALL {
            all.push((format!("hits/{scene}/{}", test.name()), hits(scene, test, level).0));
        }
    }
    for effects in EFFECTS {
        for traversal in Traversal::ALL {
            let found = picture(traversal, effects, level);
            all.push((format!("picture/{effects}/{}", traversal.name()), found.0));
        }
    }
    for name in ANIMATIONS {
        all.push((format!("scene/{name}"), scene_picture(name, level).0));
    }
    all
}

/// The fingerprints as `fingerprints.txt` has them.
#[must_use]
pub fn text(fingerprints: &[(String, u64)]) -> String {
    fingerprints.iter().map(|(name, found)| format!("{name} {found:016x}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingerprints_are_those_of_the_list_at_every_simd_level() {
        for level in SimdLevel::available() {
            let found = text(&fingerprints(level));
            for (found, listed) in found.lines().zip(LIST.lines()) {
                assert_eq!(
                    found, listed,
                    "at {level}; where results changed on purpose: tests/platforms/run --new"
                );
            }
            assert_eq!(found.lines().count(), LIST.lines().count(), "at {level}");
        }
    }
}
