//! `cloth-ball`: a square cloth falls onto a ball, which then turns and winds it up.

use anim::{KeyFrames, Light, LoopMode, Motion, View};
use glam::Vec3;

use crate::cache::{Record, recorded};
use crate::cloth::{Cloth, Fabric};
use crate::rigid::rotation;
use crate::shape::{Assembly, Mesh, grid_triangles, sphere};
use crate::{Effects, LightEffects, Measure, MotionEffects, Scene, SceneError, SceneInfo, SceneOptions};

const FRAMES: usize = 94;
const SUBSTEPS: usize = 80;
const SECONDS: f64 = 3.72;
/// Quads along a side of the cloth.
const SIDE: usize = 214;
/// Length of a side of the cloth.
const CLOTH: f32 = 39.0;
const RADIUS: f32 = 5.0;
const CENTER: Vec3 = Vec3::new(0.0, 6.68, 0.0);
/// Distance that the cloth keeps from ball and floor.
const SKIN: f32 = 0.08;
/// Coefficients of friction on the ball and on the floor.
const FRICTION: (f32, f32) = (0.65, 0.4);
/// Second at which the ball begins to turn, seconds until it is at full speed, and that speed in
/// radians per second.
const TURN: (f32, f32, f32) = (0.9, 0.5, 2.0);

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "cloth-ball",
    about: "a cloth falls onto a ball, which turns and winds it up",
    triangles: 2 * SIDE * SIDE + 760,
    frames: FRAMES,
    effects: Effects {
        motion: MotionEffects {
            cloth: true,
            gravity: true,
            contact: true,
            key_frames: true,
            ..MotionEffects::NONE
        },
        light: LightEffects::SHADOWS,
    },
    key_bytes: FRAMES * ((SIDE + 1) * (SIDE + 1) + 382) * size_of::<Vec3>(),
};

pub(crate) fn scene(options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let (keys, substeps) = (options.key_frames.unwrap_or(FRAMES), options.substeps.unwrap_or(SUBSTEPS));
    let side = ((SIDE as f32 * options.detail.unwrap_or(1.0).sqrt()).round() as usize).max(4);
    let mut notes = Vec::new();
    let parameters = format!("cloth-ball seed {} keys {keys} substeps {substeps} side {side}", options.seed);
    let Record { floats, measures, .. } =
        recorded(&parameters, options, &mut notes, || simulate(side, keys, substeps, options));
    let frames: Vec<Vec<Vec3>> =
        floats.into_iter().map(|x| x.as_chunks::<3>().0.iter().copied().map(Vec3::from).collect()).collect();

    let moving = Motion { key_frames: true, ..Motion::STILL };
    let mut assembly = Assembly::default();
    let fabric = assembly.material([0.65, 0.2, 0.22]);
    let ball = assembly.material([0.8, 0.75, 0.6]);
    assembly.part("cloth", &flat(side, options.seed), moving, fabric);
    assembly.part("ball", &sphere(RADIUS, 20, 20), moving, ball);
    let seconds_per_key = SECONDS / (keys - 1) as f64;
    Ok(Scene {
        name: INFO.name.to_owned(),
        about: INFO.about,
        key_bytes: keys * size_of::<Vec3>() * assembly.positions.len(),
        animation: Box::new(KeyFrames::new(assembly.topology, frames, seconds_per_key, LoopMode::Restart)?),
        view: View {
            eye: Vec3::new(15.0, 13.5, 41.0),
            target: Vec3::new(0.0, 6.0, 0.0),
            up: Vec3::Y,
            fov_y: 38_f32.to_radians(),
        },
        light: Light { position: Vec3::new(-18.0, 45.0, 22.0), color: [1.0; 3] },
        effects: INFO.effects,
        frames: FRAMES,
        measures,
        notes,
    })
}

/// The cloth before it falls: just above the ball, a little askew and not quite flat, as the seed
/// has it.
fn flat(side: usize, seed: u64) -> Mesh {
    let mut random = fastrand::Rng::with_seed(seed);
    let (sin, cos) = libm::sincosf(0.3 + 0.2 * random.f32());
    let off = Vec3::new(random.f32() - 0.5, 0.0, random.f32() - 0.5);
    let mut mesh = Mesh::default();
    for row in 0..=side {
        for column in 0..=side {
            let [u, v] = [column, row].map(|k| CLOTH * (k as f32 / side as f32 - 0.5));
            let top = CENTER.y + RADIUS + SKIN + 0.1 + 0.02 * random.f32();
            mesh.positions.push(off + Vec3::new(cos * u + sin * v, top, cos * v - sin * u));
        }
    }
    mesh.triangles = grid_triangles(side);
    mesh
}

fn simulate(side: usize, keys: usize, substeps: usize, options: &SceneOptions<'_>) -> Record {
    let spacing = CLOTH / side as f32;
    let fabric = Fabric {
        stretch: 0.0,
        shear: 4e-6,
        bend: 2e-5,
        drag: 0.3,
        gravity: 60.0,
        thickness: 0.8 * spacing,
        top_speed: 22.0,
    };
    let mut cloth = Cloth::new(side + 1, spacing, flat(side, options.seed).positions, fabric);
    let ball = sphere(RADIUS, 20, 20);
    let step_count = (keys - 1) * substeps;
    let dt = SECONDS as f32 / step_count as f32;
    let mut record = Record::default();
    let (mut mean_strain, mut most_strain) = (0.0_f64, 0.0_f64);
    for key in 0..keys {
        if let Some(progress) = options.progress {
            progress(key as f32 / (keys - 1) as f32);
        }
        if key > 0 {
            let first = (key - 1) * substeps;
            cloth.advance(substeps, dt, |step, before, now| {
                let step = first + step;
                contact(before, now, angle(step as f32 * dt), angle((step + 1) as f32 * dt))
            });
            let (mean, most) = cloth.strain();
            mean_strain = mean_strain.max(mean);
            most_strain = most_strain.max(most);
        }
        let turned = rotation(Vec3::Y, angle((key * substeps) as f32 * dt));
        let mut frame: Vec<f32> = cloth.positions.iter().flat_map(Vec3::to_array).collect();
        frame.extend(ball.positions.iter().flat_map(|&p| (CENTER + turned * p).to_array()));
        record.floats.push(frame);
    }
    record.measures = vec![
        Measure { name: "edge stretch, root mean square".to_owned(), value: mean_strain },
        Measure { name: "edge stretch, greatest".to_owned(), value: most_strain },
    ];
    record
}

/// How far the ball has turned, in radians.
fn angle(time: f32) -> f32 {
    let (start, ramp, speed) = TURN;
    let t = (time - start).max(0.0);
    if t < ramp { speed * t * t / (2.0 * ramp) } else { speed * (t - 0.5 * ramp) }
}

/// Pushes a particle out of ball and floor, and lets it slip no further than friction allows.
fn contact(before: Vec3, now: Vec3, angle_before: f32, angle_now: f32) -> Vec3 {
    let mut x = now;
    let out = x - CENTER;
    let distance = out.length();
    if distance < RADIUS + SKIN && distance > 0.0 {
        let normal = out / distance;
        let depth = RADIUS + SKIN - distance;
        let dragged = rotation(Vec3::Y, angle_now - angle_before) * (before - CENTER) + CENTER;
        x += normal * depth;
        x -= rub(x - dragged, normal, FRICTION.0 * depth);
    }
    if x.y < SKIN {
        let depth = SKIN - x.y;
        x.y = SKIN;
        x -= rub(x - before, Vec3::Y, FRICTION.1 * depth);
    }
    x
}

/// The part of the slip along a surface that friction undoes, at most `limit` long (Coulomb).
fn rub(slip: Vec3, normal: Vec3, limit: f32) -> Vec3 {
    (slip - normal * slip.dot(normal)).clamp_length_max(limit)
}
