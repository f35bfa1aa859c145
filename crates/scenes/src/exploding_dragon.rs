//! `exploding-dragon`: a stone drops onto a hollow dragon, which bursts into thousands of pieces.

use anim::{Light, View};
use glam::{Vec3, vec3};

use crate::cache::recorded;
use crate::rigid;
use crate::statue::{Breaking, Colors, playback};
use crate::{Effects, LightEffects, MotionEffects, Scene, SceneError, SceneInfo, SceneOptions};
use crate::{decimate::decimate, dragon, meshing};

const FRAMES: usize = 96;
const SUBSTEPS: usize = 16;
const SECONDS: f64 = 2.6;
/// Triangles of the dragon's surface before it is cut into shards, which have an inside and a rim too.
const SURFACE: f32 = 82_000.0;
const PIECES: f32 = 2600.0;
/// Triangles of the ground.
const GROUND: usize = 512;

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "exploding-dragon",
    about: "a stone drops onto a dragon, which bursts into thousands of pieces",
    triangles: 252_000,
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
    // About 2500 pieces come out of the cutting.
    key_bytes: FRAMES * 2359 * rigid::WORDS * size_of::<f32>(),
};

pub(crate) fn scene(options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let (keys, substeps) = (options.key_frames.unwrap_or(FRAMES), options.substeps.unwrap_or(SUBSTEPS));
    let detail = options.detail.unwrap_or(1.0);
    let mut notes = Vec::new();
    let parameters =
        format!("exploding-dragon seed {} keys {keys} substeps {substeps} detail {detail}", options.seed);
    let record = recorded(&parameters, options, &mut notes, || {
        let solid = dragon::solid();
        let fine = meshing::mesh(&solid, vec3(-6.6, -0.3, -6.2), vec3(6.6, 7.6, 5.6), 0.04 / detail.sqrt());
        let mut random = fastrand::Rng::with_seed(options.seed);
        let breaking = Breaking {
            solid: &solid,
            surface: decimate(&fine, (SURFACE * detail) as usize),
            thickness: 0.07,
            pieces: (PIECES * detail) as usize,
            density: &|p| 0.4 + 2.0 / (1.0 + (p - vec3(0.0, 3.2, 0.9)).length_squared()),
            triangles: ((INFO.triangles - GROUND) as f32 * detail) as usize,
            stone: (vec3(0.0, 7.9, 0.9), 1.1, 3.0),
            stone_density: 20.0,
            gravity: 12.0,
            delay: &|center, impact, random| center.distance(impact) / 14.0 + 0.04 * random.f32(),
            kick: &burst,
            seconds: SECONDS as f32,
            keys,
            substeps,
        };
        breaking.simulate(&mut random, options)
    });
    let colors = Colors { statue: [0.25, 0.5, 0.32], stone: [0.5, 0.47, 0.45], ground: [0.75, 0.7, 0.62] };
    let (animation, measures) = playback(record, &colors, 60.0, SECONDS);
    Ok(Scene {
        name: INFO.name.to_owned(),
        about: INFO.about,
        key_bytes: size_of_val(&animation.keys[..]),
        animation: Box::new(animation),
        view: View {
            eye: vec3(9.5, 7.0, 14.0),
            target: vec3(0.0, 3.4, -0.3),
            up: Vec3::Y,
            fov_y: 42_f32.to_radians(),
        },
        light: Light { position: vec3(14.0, 24.0, 16.0), color: [1.0; 3] },
        effects: INFO.effects,
        frames: FRAMES,
        measures,
        notes,
    })
}

/// Away from the stone and up, faster where it is near, and spinning.
fn burst(center: Vec3, impact: Vec3, random: &mut fastrand::Rng) -> (Vec3, Vec3) {
    let mut number = || 2.0 * random.f32() - 1.0;
    let away = center - impact;
    let jitter = vec3(number(), number(), number());
    let speed = 11.0 / (1.0 + 0.12 * away.length_squared());
    let up = vec3(0.0, 2.0 + 1.5 * number(), 0.0);
    let velocity = (away.normalize_or_zero() + 0.4 * jitter) * (2.0 + speed) + up;
    (velocity, 12.0 * vec3(number(), number(), number()))
}
