//! `lion`: a stone falls on the statue of a lion, which breaks from the head down and collapses.

use anim::{Light, View};
use glam::{Vec3, vec3};

use crate::cache::recorded;
use crate::rigid;
use crate::statue::{Breaking, Colors, playback};
use crate::{Effects, LightEffects, MotionEffects, Scene, SceneError, SceneInfo, SceneOptions};
use crate::{decimate::decimate, lion_solid, meshing};

const FRAMES: usize = 120;
const SUBSTEPS: usize = 14;
const SECONDS: f64 = 5.0;
/// Triangles of the lion's surface before it is cut into shards, which have an inside and a rim too.
const SURFACE: f32 = 520_000.0;
const PIECES: f32 = 10_000.0;
/// Triangles of the ground.
const GROUND: usize = 512;

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "lion",
    about: "a stone falls on the statue of a lion, which shatters from the head down and collapses",
    triangles: 1_600_000,
    frames: FRAMES,
    effects: Effects {
        motion: MotionEffects {
            gravity: true,
            contact: true,
            fracture: true,
            rigid: true,
            ..MotionEffects::NONE
        },
        light: LightEffects::SHADOWS,
    },
    // About 9700 pieces come out of the cutting.
    key_bytes: FRAMES * 8427 * rigid::WORDS * size_of::<f32>(),
};

pub(crate) fn scene(options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let (keys, substeps) = (options.key_frames.unwrap_or(FRAMES), options.substeps.unwrap_or(SUBSTEPS));
    let detail = options.detail.unwrap_or(1.0);
    let mut notes = Vec::new();
    let parameters = format!("lion seed {} keys {keys} substeps {substeps} detail {detail}", options.seed);
    let record = recorded(&parameters, options, &mut notes, || {
        let (low, high) = (vec3(-3.2, -0.3, -4.2), vec3(3.2, 9.4, 4.2));
        let solid = lion_solid::solid();
        let fine = meshing::mesh(&solid, low, high, 0.022 / detail.sqrt());
        let breaking = Breaking {
            solid: &solid,
            surface: decimate(&fine, (SURFACE * detail) as usize),
            thickness: 0.12,
            pieces: (PIECES * detail) as usize,
            density: &|p| 0.3 + 0.1 * p.y,
            triangles: ((INFO.triangles - GROUND) as f32 * detail) as usize,
            stone: (vec3(-0.4, 10.2, 0.9), 1.0, 0.0),
            stone_density: 40.0,
            gravity: 12.0,
            delay: &|center, impact, random| {
                center.distance(impact) / 2.6 + wave(center) + 0.15 * random.f32() * random.f32()
            },
            kick: &crumble,
            seconds: SECONDS as f32,
            keys,
            substeps,
        };
        breaking.simulate(&mut fastrand::Rng::with_seed(options.seed), options)
    });
    let colors = Colors { statue: [0.78, 0.62, 0.42], stone: [0.35, 0.35, 0.38], ground: [0.55, 0.58, 0.5] };
    let (animation, measures) = playback(record, &colors, 70.0, SECONDS);
    Ok(Scene {
        name: INFO.name.to_owned(),
        about: INFO.about,
        key_bytes: size_of_val(&animation.keys[..]),
        animation: Box::new(animation),
        view: View {
            eye: vec3(9.5, 8.0, 16.0),
            target: vec3(0.0, 5.0, 0.0),
            up: Vec3::Y,
            fov_y: 42_f32.to_radians(),
        },
        light: Light { position: vec3(10.0, 26.0, 22.0), color: [1.0; 3] },
        effects: INFO.effects,
        frames: FRAMES,
        measures,
        notes,
    })
}

/// Seconds by which whole regions hold out longer than others, so that large pieces lose their hold.
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
