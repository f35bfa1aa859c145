//! The fairy: a body of blended limbs with a dress, skinned to a skeleton that dances, and wings
//! that morph.

use std::f32::consts::{PI, TAU};

use glam::{DQuat, Vec3, vec3};

use crate::decimate::decimate;
use crate::glb::{Glb, Influence};
use crate::implicit::Solid;
use crate::meshing;
use crate::rigid::rotation;
use crate::shape::{Mesh, grid};

/// Keys of every track of the dance.
const KEYS: usize = 49;

/// A joint: name, number of the parent, place in the bind pose, end of its bone.
type Joint = (&'static str, Option<usize>, Vec3, Vec3);

/// The skeleton, parents first. Left is +x; the fairy looks along +z.
const SKELETON: [Joint; 15] = [
    ("hips", None, vec3(0.0, 0.92, 0.0), vec3(0.0, 1.02, 0.0)),
    ("chest", Some(0), vec3(0.0, 1.05, 0.0), vec3(0.0, 1.26, 0.0)),
    ("head", Some(1), vec3(0.0, 1.34, 0.0), vec3(0.0, 1.6, 0.0)),
    ("left arm", Some(1), vec3(0.14, 1.28, 0.0), vec3(0.37, 1.22, 0.0)),
    ("left forearm", Some(3), vec3(0.38, 1.22, 0.0), vec3(0.58, 1.18, 0.02)),
    ("left hand", Some(4), vec3(0.6, 1.18, 0.02), vec3(0.7, 1.17, 0.02)),
    ("right arm", Some(1), vec3(-0.14, 1.28, 0.0), vec3(-0.37, 1.22, 0.0)),
    ("right forearm", Some(6), vec3(-0.38, 1.22, 0.0), vec3(-0.58, 1.18, 0.02)),
    ("right hand", Some(7), vec3(-0.6, 1.18, 0.02), vec3(-0.7, 1.17, 0.02)),
    ("left thigh", Some(0), vec3(0.08, 0.88, 0.0), vec3(0.09, 0.53, 0.01)),
    ("left shin", Some(9), vec3(0.09, 0.5, 0.01), vec3(0.09, 0.12, -0.01)),
    ("left foot", Some(10), vec3(0.09, 0.09, -0.01), vec3(0.09, 0.02, 0.12)),
    ("right thigh", Some(0), vec3(-0.08, 0.88, 0.0), vec3(-0.09, 0.53, 0.01)),
    ("right shin", Some(12), vec3(-0.09, 0.5, 0.01), vec3(-0.09, 0.12, -0.01)),
    ("right foot", Some(13), vec3(-0.09, 0.09, -0.01), vec3(-0.09, 0.02, 0.12)),
];
const CHEST: usize = 1;
const HEAD: usize = 2;

/// Adds the fairy to a file, dancing above a place.
pub(crate) fn add(glb: &mut Glb, place: Vec3) {
    let root = glb.node("fairy", None, place, DQuat::IDENTITY);
    let mut joints: Vec<usize> = Vec::new();
    for (name, parent, at, _) in SKELETON {
        let (above, offset) = parent.map_or((root, at), |p| (joints[p], at - SKELETON[p].2));
        joints.push(glb.node(name, Some(above), offset, DQuat::IDENTITY));
    }
    let [skin, cloth, blond, membrane, dark] =
        [[0.85, 0.6, 0.45], [0.3, 0.6, 0.75], [0.85, 0.62, 0.2], [0.8, 0.75, 0.9], [0.08, 0.06, 0.1]]
            .map(|color| glb.material(color));
    let places = SKELETON.map(|(_, _, at, _)| at);
    let body =
        decimate(&meshing::mesh(&body(), vec3(-0.8, -0.06, -0.2), vec3(0.8, 1.75, 0.3), 0.009), 12_000);
    for (name, mesh, material) in [("body", body, skin), ("dress", dress(), cloth)] {
        glb.skinned(name, &mesh, influence, (&joints, &places), material);
    }
    for (name, solid, triangles, material) in [("hair", hair(), 2400, blond), ("eyes", eyes(), 400, dark)] {
        let fine = meshing::mesh(&solid, vec3(-0.25, 1.2, -0.35), vec3(0.25, 1.9, 0.25), 0.006);
        let mesh = decimate(&fine, triangles).moved(|p| p - SKELETON[HEAD].2);
        glb.mesh(name, Some(joints[HEAD]), &mesh, material);
    }
    for side in [-1.0, 1.0] {
        for (reach, rise) in [(0.85, 0.75), (0.62, -0.35)] {
            let [open, back] = [0.25, 1.25].map(|sweep| wing(side, reach, rise, sweep));
            let node = glb.morphed("wing", Some(joints[CHEST]), &open, &[back.positions], membrane);
            let beats = (0..=96).map(|k| [0.5 - 0.5 * libm::cosf(TAU * k as f32 / 8.0)]);
            glb.morph(node, beats);
        }
    }
    dance(glb, &joints);
}

fn body() -> Solid {
    let mut half = Solid::default();
    let arm = [(vec3(0.12, 1.28, 0.0), 0.05), (vec3(0.38, 1.22, 0.0), 0.036), (vec3(0.6, 1.18, 0.02), 0.026)];
    half.limb(0.03, &arm);
    half.ellipsoid(0.03, vec3(0.65, 1.175, 0.02), vec3(0.05, 0.018, 0.032));
    let leg =
        [(vec3(0.075, 0.9, 0.0), 0.088), (vec3(0.09, 0.5, 0.01), 0.052), (vec3(0.09, 0.09, -0.01), 0.033)];
    half.limb(0.03, &leg);
    for k in 0..3 {
        let z = 0.0 + 0.02 * k as f32;
        half.limb(0.015, &[(vec3(0.67, 1.175, z), 0.011), (vec3(0.735, 1.165, z * 1.3 - 0.004), 0.008)]);
    }
    half.limb(0.015, &[(vec3(0.62, 1.175, 0.04), 0.012), (vec3(0.65, 1.17, 0.085), 0.008)]);
    half.limb(0.015, &[(vec3(0.09, 0.055, -0.03), 0.034), (vec3(0.095, 0.035, 0.11), 0.026)]);
    // Pointed ears.
    half.limb(0.015, &[(vec3(0.095, 1.49, 0.0), 0.026), (vec3(0.155, 1.58, -0.04), 0.005)]);
    let mut all = Solid::default();
    let trunk = [(vec3(0.0, 0.93, 0.0), 0.115), (vec3(0.0, 1.08, 0.0), 0.085), (vec3(0.0, 1.22, 0.0), 0.105)];
    all.limb(0.05, &trunk);
    all.limb(0.03, &[(vec3(0.0, 1.28, 0.0), 0.05), (vec3(0.0, 1.42, 0.01), 0.04)]);
    all.ellipsoid(0.03, vec3(0.0, 1.5, 0.01), vec3(0.1, 0.13, 0.115));
    all.ellipsoid(0.03, vec3(0.0, 1.43, 0.04), vec3(0.065, 0.06, 0.07));
    all.limb(0.012, &[(vec3(0.0, 1.515, 0.115), 0.012), (vec3(0.0, 1.475, 0.137), 0.015)]);
    all.ellipsoid(0.012, vec3(0.0, 1.425, 0.103), vec3(0.03, 0.011, 0.014));
    all.both_sides(&half);
    all
}

fn hair() -> Solid {
    let mut hair = Solid::default();
    hair.ellipsoid(0.03, vec3(0.0, 1.545, -0.035), vec3(0.112, 0.115, 0.11));
    hair.ball(0.03, vec3(0.0, 1.68, -0.08), 0.055);
    for k in 0..9 {
        let (sin, cos) = libm::sincosf(PI * (k as f32 - 4.0) / 9.0);
        let from = vec3(0.1 * sin, 1.55, -0.04 - 0.09 * cos);
        let strand = [
            (from, 0.035),
            (vec3(0.11 * sin, 1.4, -0.05 - 0.11 * cos), 0.028),
            (vec3(0.13 * sin, 1.27, -0.07 - 0.13 * cos), 0.006),
        ];
        hair.limb(0.03, &strand);
    }
    hair
}

fn eyes() -> Solid {
    let mut eyes = Solid::default();
    for side in [-1.0, 1.0] {
        eyes.ellipsoid(0.0, vec3(side * 0.042, 1.52, 0.107), vec3(0.017, 0.022, 0.01));
    }
    eyes
}

/// From below the arms to a hem of petals; an open surface with `2 * 40 * 40` triangles.
fn dress() -> Mesh {
    const CELLS: usize = 40;
    grid(CELLS, |row, column| {
        let t = row as f32 / CELLS as f32;
        let angle = -TAU * (column % CELLS) as f32 / CELLS as f32;
        let (sin, cos) = libm::sincosf(angle);
        let petal = libm::fabsf(libm::sinf(4.0 * angle));
        let skirt = ((t - 0.35) / 0.65).max(0.0);
        let waist = 0.118 - 0.02 * libm::sinf(PI * (t / 0.45).min(1.0));
        let radius = waist + skirt * (0.2 + 0.06 * petal);
        let y = 1.21 - 0.62 * t - 0.1 * petal * skirt * skirt;
        vec3(radius * cos, y, 0.92 * radius * sin)
    })
}

/// The four joints with the nearest bones, weighted by the inverse fourth power of distance.
fn influence(p: Vec3) -> Influence {
    let distance = |(_, _, from, to): &Joint| {
        let axis = *to - *from;
        let along = ((p - *from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        p.distance(*from + along * axis)
    };
    let mut near: Vec<(f32, usize)> =
        SKELETON.iter().map(distance).enumerate().map(|(j, d)| (d, j)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let weights: [f32; 4] = std::array::from_fn(|k| (0.01 + near[k].0).powi(-4));
    let sum: f32 = weights.iter().sum();
    (std::array::from_fn(|k| near[k].1 as u8), weights.map(|w| w / sum))
}

/// A butterfly's wing from the chest, swept back by an angle; `2 * 14 * 14` triangles.
fn wing(side: f32, reach: f32, rise: f32, sweep: f32) -> Mesh {
    const CELLS: usize = 14;
    let (sin, cos) = libm::sincosf(sweep);
    let axis = vec3(1.0, rise, 0.0).normalize();
    let across = vec3(-axis.y, axis.x, 0.0);
    grid(CELLS, |row, column| {
        let t = row as f32 / CELLS as f32;
        let width = 0.42 * reach * libm::sinf(PI * t.sqrt() * 0.97) + 0.01;
        let s = column as f32 / CELLS as f32 - 0.5;
        let flat = reach * t * (1.0 - 0.3 * s * s) * axis + width * s * across;
        let bow = 0.08 * reach * libm::sinf(PI * t);
        vec3(side * (0.03 + flat.x * cos), 0.14 + flat.y, -0.08 - flat.x * sin - bow)
    })
}

/// Keys for every joint: the hips rise, sink, and turn once; arms and legs swing, in time with
/// them.
fn dance(glb: &mut Glb, joints: &[usize]) {
    let angles = (0..KEYS).map(|k| TAU * k as f32 / (KEYS - 1) as f32);
    let turn = |x: f32, y: f32, z: f32| rotation(Vec3::Y, y) * rotation(Vec3::X, x) * rotation(Vec3::Z, z);
    let sin = libm::sinf;
    let (_, _, hips, _) = SKELETON[0];
    let rise = |a: f32| hips + vec3(0.25 * sin(a), 0.16 * sin(2.0 * a), 0.2 * sin(a + 1.5));
    glb.translate(joints[0], angles.clone().map(rise));
    let moves: [&dyn Fn(f32) -> DQuat; 15] = [
        &|a| turn(0.15 * sin(2.0 * a), 0.35 + 0.9 * sin(a), 0.12 * sin(a)),
        &|a| turn(0.15 * sin(2.0 * a + 0.5), 0.35 * sin(2.0 * a), 0.15 * sin(a + 1.0)),
        &|a| turn(0.15 * sin(2.0 * a), 0.4 * sin(a + 2.0), 0.2 * sin(a)),
        &|a| turn(0.0, -0.3 + 0.4 * sin(2.0 * a), 0.5 + 0.6 * sin(a)),
        &|a| turn(0.0, -0.5 + 0.4 * sin(2.0 * a + 0.7), 0.4 + 0.3 * sin(a)),
        &|a| turn(0.0, 0.0, 0.4 * sin(2.0 * a)),
        &|a| turn(0.0, 0.3 + 0.4 * sin(2.0 * a + 1.0), -0.5 + 0.6 * sin(a)),
        &|a| turn(0.0, 0.5 + 0.4 * sin(2.0 * a), -0.4 + 0.3 * sin(a)),
        &|a| turn(0.0, 0.0, 0.4 * sin(2.0 * a + 1.0)),
        &|a| turn(-0.35 + 0.45 * sin(a), 0.0, 0.2),
        &|a| turn(0.7 + 0.5 * sin(a + 0.8), 0.0, 0.0),
        &|_| turn(0.7, 0.0, 0.0),
        &|a| turn(-0.25 - 0.45 * sin(a), 0.0, -0.2),
        &|a| turn(0.6 - 0.5 * sin(a + 0.8), 0.0, 0.0),
        &|_| turn(0.7, 0.0, 0.0),
    ];
    for (joint, value) in joints.iter().zip(moves) {
        glb.rotate(*joint, angles.clone().map(value));
    }
}
