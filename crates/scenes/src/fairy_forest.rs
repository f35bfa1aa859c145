//! `fairy-forest`: in a still forest a skinned fairy dances, a dragonfly circles, and a caterpillar
//! creeps.
//!
//! The scene is a glTF file made here and played back as any other file is.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

use anim::{LoadOptions, Motion};
use glam::{DQuat, Vec3, vec3};

use crate::cache::{Record, recorded};
use crate::decimate::decimate;
use crate::forest::{forest, grass, ground_at};
use crate::glb::Glb;
use crate::implicit::Solid;
use crate::rigid::rotation;
use crate::shape::Mesh;
use crate::{Effects, Make, Scene, SceneError, SceneInfo, SceneOptions, Simulated, fairy, meshing};

const TRIANGLES: usize = 174_117;
const TREES: usize = 16;
const FRAMES: usize = 96;
const SECONDS: f32 = 4.0;
const EYE: Vec3 = vec3(0.6, 1.25, 4.6);
const TARGET: Vec3 = vec3(0.0, 1.45, 0.0);
const FOV_Y: f32 = 0.95;
const LIGHT: Vec3 = vec3(3.5, 9.5, 7.0);

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "fairy-forest",
    about: "a fairy dances, a dragonfly circles, and a caterpillar creeps in a still forest",
    triangles: TRIANGLES,
    frames: FRAMES,
    effects: Effects::of_scene(Simulated::empty(), Motion::all().difference(Motion::KEY_FRAMES)),
    key_bytes: 0,
    make: &[("", Make::Clip(scene))],
};

/// Returns the bytes of the fairy forest as a binary glTF 2.0 file (.glb) of 174,117 triangles.
///
/// The same seed gives the same bytes. Takes a few seconds.
#[must_use]
pub fn fairy_forest_glb(seed: u64) -> Vec<u8> {
    with_trees(TREES, seed)
}

/// The same with fewer trees, and then without grass.
fn with_trees(trees: usize, seed: u64) -> Vec<u8> {
    let mut glb = Glb::new(SECONDS);
    fairy::add(&mut glb, vec3(0.0, 0.35, 0.0));
    dragonfly(&mut glb);
    caterpillar(&mut glb);

    let mut forest = forest(trees, seed, EYE);
    let still = [
        ("ground", forest.ground, [0.2, 0.24, 0.1]),
        ("bark", forest.bark, [0.33, 0.24, 0.17]),
        ("leaves", forest.leaves, [0.2, 0.45, 0.12]),
        ("mushroom stems", forest.stems, [0.85, 0.8, 0.7]),
        ("mushroom caps", forest.caps, [0.75, 0.12, 0.08]),
    ];
    for (name, mesh, color) in still {
        let material = glb.material(color);
        glb.mesh(name, None, &mesh, material);
    }
    if trees == TREES {
        // Blades of grass make up the number.
        let blades = TRIANGLES.saturating_sub(glb.triangles);
        let green = glb.material([0.3, 0.55, 0.15]);
        glb.mesh("grass", None, &grass(blades, &mut forest.random), green);
    }
    glb.camera(EYE, TARGET, FOV_Y);
    glb.point_light(LIGHT);
    glb.finish()
}

fn scene(clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let trees = (TREES as f32 * options.detail.unwrap_or(1.0)).ceil() as usize;
    let parameters = format!("fairy-forest seed {} trees {trees}", options.seed);
    let (record, notes) = recorded(&parameters, options, || Record {
        data: with_trees(trees, options.seed),
        ..Record::default()
    });
    let load = LoadOptions { clip, ..LoadOptions::default() };
    let animation = anim::parse(Path::new("fairy-forest.glb"), &record.data, &load)?;
    Ok(Scene { notes, ..Scene::new(&INFO, animation, (EYE, TARGET), FOV_Y, LIGHT) })
}

/// A body that circles, with four wings that beat: nodes and nothing else.
fn dragonfly(glb: &mut Glb) {
    let mut solid = Solid::default();
    let trunk = [(vec3(0.0, 0.0, 0.1), 0.045), (vec3(0.0, 0.01, 0.0), 0.05), (vec3(0.0, 0.0, -0.1), 0.03)];
    solid.limb(0.02, &trunk);
    solid.limb(0.02, &[(vec3(0.0, 0.0, -0.1), 0.022), (vec3(0.0, -0.02, -0.45), 0.014)]);
    solid.ball(0.005, vec3(0.03, 0.015, 0.15), 0.035);
    solid.ball(0.005, vec3(-0.03, 0.015, 0.15), 0.035);
    let half = vec3(0.12, 0.1, 0.0);
    let body = meshing::mesh(&solid, -half - 0.55 * Vec3::Z, half + 0.25 * Vec3::Z, 0.005);
    let [blue, glass] = [[0.1, 0.3, 0.65], [0.75, 0.85, 0.9]].map(|color| glb.material(color));
    let node = glb.node("dragonfly", None, Vec3::ZERO, DQuat::IDENTITY);
    glb.mesh("dragonfly body", Some(node), &decimate(&body, 3000), blue);

    let place = |a: f32| {
        vec3(1.35 * libm::cosf(a) - 0.2, 1.45 + 0.25 * libm::sinf(3.0 * a), 0.3 + 1.3 * libm::sinf(a))
    };
    let facing = |a: f32| {
        let ahead = place(a - 0.01) - place(a + 0.01);
        rotation(Vec3::Y, libm::atan2f(ahead.x, ahead.z))
    };
    let angles = (0..=48).map(|k| -TAU * k as f32 / 48.0);
    glb.translate(node, angles.clone().map(place));
    glb.rotate(node, angles.map(facing));
    for side in [-1.0, 1.0] {
        for (z, ahead) in [(0.03, 0.12), (-0.05, -0.15)] {
            let hinge = glb.node("dragonfly wing", Some(node), vec3(side * 0.03, 0.05, z), DQuat::IDENTITY);
            glb.mesh("membrane", Some(hinge), &dragonfly_wing(side, ahead), glass);
            let beat = |k| rotation(Vec3::Z, side * 0.6 * libm::sinf(PI * (k as f32 + 2.0 * z) / 2.0));
            glb.rotate(hinge, (0..=128).map(beat));
        }
    }
}

fn dragonfly_wing(side: f32, ahead: f32) -> Mesh {
    let mut wing = Mesh::default();
    let rib = |t: f32, s: f32| {
        let width = 0.05 * libm::sinf(PI * (0.08 + 0.9 * t)) + 0.004;
        vec3(side * 0.45 * t, 0.0, ahead * t + width * s)
    };
    for k in 0..16 {
        let [t, u] = [k as f32 / 16.0, (k + 1) as f32 / 16.0];
        let [a, b, c, d] = [rib(t, -1.0), rib(u, -1.0), rib(u, 1.0), rib(t, 1.0)];
        wing.add(&[[a, c, b], [a, d, c]]);
    }
    wing
}

/// A row of balls that stretches and arches: morph targets and nothing else.
fn caterpillar(glb: &mut Glb) {
    let mut solid = Solid::default();
    for k in 0..10 {
        let x = 0.085 * k as f32;
        solid.ball(0.02, vec3(x, 0.055 + 0.002 * (k % 2) as f32, 0.0), 0.058);
        for side in [-1.0, 1.0] {
            solid.limb(0.005, &[(vec3(x, 0.03, side * 0.03), 0.018), (vec3(x, 0.0, side * 0.045), 0.012)]);
        }
    }
    solid.ball(0.02, vec3(0.85, 0.09, 0.0), 0.075);
    for side in [-1.0, 1.0] {
        solid.limb(0.02, &[(vec3(0.87, 0.14, side * 0.03), 0.012), (vec3(0.9, 0.22, side * 0.06), 0.008)]);
    }
    let fine = meshing::mesh(&solid, vec3(-0.1, -0.05, -0.12), vec3(0.98, 0.26, 0.12), 0.009);
    let body = decimate(&fine, 5000).moved(|p| p * 0.8);
    let arch = |height: f32, shorter: f32| -> Vec<Vec3> {
        let along = |p: &Vec3| (p.x / 0.72).clamp(0.0, 1.0);
        let moved = |p: &Vec3| vec3(p.x * shorter, p.y + height * libm::sinf(PI * along(p)), p.z);
        body.positions.iter().map(moved).collect()
    };
    let wave: Vec<Vec3> =
        body.positions.iter().map(|p| *p + vec3(0.0, 0.0, 0.06 * libm::sinf(TAU * p.x / 0.72))).collect();
    let green = glb.material([0.55, 0.75, 0.15]);
    let [x, z] = [-1.5, 2.0];
    let place =
        glb.node("caterpillar", None, vec3(x, ground_at(x, z) + 0.03, z), rotation(Vec3::Y, FRAC_PI_2 * 0.3));
    let node = glb.morphed("caterpillar body", Some(place), &body, &[arch(0.22, 0.7), wave], green);
    let angles = (0..=24).map(|k| TAU * k as f32 / 12.0);
    glb.morph(node, angles.map(|a| [0.5 - 0.5 * libm::cosf(a), libm::sinf(0.5 * a)]));
}
