//! `exploding-dragon`: a stone drops onto a hollow dragon, which bursts into thousands of pieces.

use anim::{KeyFrames, Motion};
use glam::{Vec3, vec3};

use crate::rigid::Key;
use crate::statue::{EFFECTS, Statue};
use crate::{Effects, Make, Scene, SceneError, SceneInfo, SceneOptions, dragon};

const FRAMES: usize = 96;

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "exploding-dragon",
    about: "a stone drops onto a dragon, which bursts into thousands of pieces",
    triangles: 252_000,
    frames: FRAMES,
    effects: EFFECTS,
    // 2359 bodies.
    key_bytes: FRAMES * 2359 * size_of::<Key>(),
    make: &[("", Make::Whole(|options| Ok(DRAGON.scene(options)))), (":blended", Make::Whole(blended))],
};

pub(crate) static DRAGON: Statue = Statue {
    info: &INFO,
    seconds: 2.6,
    substeps: 16,
    solid: dragon::solid,
    meshed: (vec3(-6.6, -0.3, -6.2), vec3(6.6, 7.6, 5.6), 0.04),
    surface: 82_000.0,
    pieces: 2600.0,
    thickness: 0.07,
    density: |p| 0.4 + 2.0 / (1.0 + (p - vec3(0.0, 3.2, 0.9)).length_squared()),
    stone: (vec3(0.0, 7.9, 0.9), 1.1, 3.0),
    stone_density: 20.0,
    delay: |center, impact, random| center.distance(impact) / 14.0 + 0.04 * random.f32(),
    kick: burst,
    colors: [[0.25, 0.5, 0.32], [0.5, 0.47, 0.45], [0.75, 0.7, 0.62]],
    ground: 60.0,
    seen: (vec3(9.5, 7.0, 14.0), vec3(0.0, 3.4, -0.3)),
    light: vec3(14.0, 24.0, 16.0),
};

/// Key frames of the original.
const BLENDED_KEYS: usize = 16;

/// The scene from few key frames, between which vertices go straight, as those of the original do:
/// pieces that spin shear and shrink on the way from one to the next.
fn blended(options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let rigid = DRAGON.scene(options);
    let seconds = rigid.animation.duration() / (BLENDED_KEYS - 1) as f64;
    let pose = |key: usize| {
        let mut positions = rigid.animation.rest();
        rigid.animation.pose(key as f64 * seconds, &mut positions);
        positions
    };
    let more = (1..BLENDED_KEYS).map(pose).collect();
    let model = rigid.animation.model().clone();
    let moving = model.topology.parts.iter().filter(|part| !part.motion.is_empty());
    let key_bytes = BLENDED_KEYS * moving.map(|part| part.vertices.len()).sum::<usize>() * size_of::<Vec3>();
    let animation = KeyFrames::new(model, more, seconds)?;
    let effects = Effects { motion: Motion::KEY_FRAMES, ..EFFECTS };
    Ok(Scene { animation: Box::new(animation), key_bytes, effects, ..rigid })
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
