//! `lion`: a stone falls on the statue of a lion, which breaks from the head down and collapses.

use glam::{Vec3, vec3};

use crate::rigid::Key;
use crate::statue::{EFFECTS, Statue};
use crate::{Make, SceneInfo, lion_solid};

const FRAMES: usize = 120;

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "lion",
    about: "a stone falls on the statue of a lion, which shatters from the head down and collapses",
    triangles: 1_600_000,
    frames: FRAMES,
    effects: EFFECTS,
    // 8427 bodies.
    key_bytes: FRAMES * 8427 * size_of::<Key>(),
    make: &[("", Make::Whole(|options| Ok(LION.scene(options))))],
};

pub(crate) static LION: Statue = Statue {
    info: &INFO,
    seconds: 5.0,
    substeps: 14,
    solid: lion_solid::solid,
    meshed: (vec3(-3.2, -0.3, -4.2), vec3(3.2, 9.4, 4.2), 0.022),
    surface: 520_000.0,
    pieces: 10_000.0,
    thickness: 0.12,
    density: |p| 0.3 + 0.1 * p.y,
    stone: (vec3(-0.4, 10.2, 0.9), 1.0, 0.0),
    stone_density: 40.0,
    delay: |center, impact, random| {
        center.distance(impact) / 2.6 + wave(center) + 0.15 * random.f32() * random.f32()
    },
    kick: crumble,
    colors: [[0.78, 0.62, 0.42], [0.35, 0.35, 0.38], [0.55, 0.58, 0.5]],
    ground: 70.0,
    seen: (vec3(9.5, 8.0, 16.0), vec3(0.0, 5.0, 0.0)),
    light: vec3(10.0, 26.0, 22.0),
};

/// Seconds by which whole regions hold out longer than others, so that large pieces lose their
/// hold.
fn wave(p: Vec3) -> f32 {
    let [x, y, z] = [p.x + 0.4 * p.y, p.y - 0.5 * p.z, p.z + 0.3 * p.x].map(|v| libm::sinf(2.3 * v));
    0.35 * (1.0 + x * y * z)
}

/// Mostly down and a little outwards.
fn crumble(center: Vec3, _: Vec3, random: &mut fastrand::Rng) -> (Vec3, Vec3) {
    let mut number = || 2.0 * random.f32() - 1.0;
    let outwards = vec3(center.x, 0.0, center.z).normalize_or_zero();
    let velocity = outwards * (0.8 + 0.8 * number()) + 0.4 * vec3(number(), number(), number());
    (velocity, 3.0 * vec3(number(), number(), number()))
}
