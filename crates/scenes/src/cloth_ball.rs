//! `cloth-ball`: a square cloth falls onto a ball, which then turns and winds it up.

use anim::{KeyFrames, Model, Motion};
use glam::{DQuat, DVec3, Vec3};

use crate::cache::{Record, recorded};
use crate::cloth::Cloth;
use crate::rigid::rotation;
use crate::shape::{Assembly, Mesh, grid, sphere};
use crate::simulation::{self, Run, World};
use crate::{Effects, Make, Measure, Scene, SceneError, SceneInfo, SceneOptions, Simulated};

const FRAMES: usize = 94;
const SUBSTEPS: usize = 80;
const SECONDS: f64 = 3.72;
/// Quads along a side of the cloth.
const SIDE: usize = 214;
/// Length of a side of the cloth.
const CLOTH: f64 = 39.0;
const RADIUS: f64 = 5.0;
const CENTER: DVec3 = DVec3::new(0.0, 6.68, 0.0);
/// Distance that the cloth keeps from ball and floor.
const SKIN: f64 = 0.08;
/// Coefficients of friction on the ball and on the floor.
const FRICTION: (f64, f64) = (0.65, 0.4);
/// Second at which the ball begins to turn, seconds until it is at full speed, and that speed in
/// radians per second.
const TURN: (f64, f64, f64) = (0.9, 0.5, 2.0);

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "cloth-ball",
    about: "a cloth falls onto a ball, which turns and winds it up",
    triangles: 2 * SIDE * SIDE + 760,
    frames: FRAMES,
    effects: Effects::of_scene(simulation::effects::<Winding>(), Motion::KEY_FRAMES),
    key_bytes: FRAMES * ((SIDE + 1) * (SIDE + 1) + 382) * size_of::<Vec3>(),
    make: &[("", Make::Whole(scene))],
};

fn scene(options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let (keys, substeps) = (options.key_frames.unwrap_or(FRAMES), options.substeps.unwrap_or(SUBSTEPS));
    let side = ((SIDE as f32 * options.detail.unwrap_or(1.0).sqrt()).round() as usize).max(4);
    let parameters = format!("cloth-ball seed {} keys {keys} substeps {substeps} side {side}", options.seed);
    let (Record { data: frames, measures, stats }, notes) =
        recorded(&parameters, options, || simulate(side, keys, substeps, options));

    let mut assembly = Assembly::default();
    let fabric = assembly.material([0.65, 0.2, 0.22]);
    let ball = assembly.material([0.8, 0.75, 0.6]);
    assembly.part("cloth", &flat(side, options.seed), Motion::KEY_FRAMES, fabric);
    assembly.part("ball", &sphere(RADIUS as f32, 20, 20), Motion::KEY_FRAMES, ball);
    let seconds_per_key = SECONDS / (keys - 1) as f64;
    let key_bytes = keys * size_of::<Vec3>() * assembly.positions.len();
    let mut frames = frames.into_iter();
    let rest = frames.next().unwrap_or_default();
    let model = Model { topology: assembly.topology, rest, ..Model::default() };
    let animation = KeyFrames::new(model, frames.collect(), seconds_per_key)?;
    let (eye, target) = (Vec3::new(15.0, 13.5, 41.0), Vec3::new(0.0, 6.0, 0.0));
    let (fov_y, light) = (38_f32.to_radians(), Vec3::new(-18.0, 45.0, 22.0));
    let scene = Scene::new(&INFO, Box::new(animation), (eye, target), fov_y, light);
    Ok(Scene { key_bytes, measures, simulated: stats, notes, ..scene })
}

/// The cloth before it falls: just above the ball, a little askew and not quite flat, as the seed
/// has it.
fn flat(side: usize, seed: u64) -> Mesh {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut random = || f64::from(random.f32());
    let (sin, cos) = libm::sincos(0.3 + 0.2 * random());
    let off = DVec3::new(random() - 0.5, 0.0, random() - 0.5);
    grid(side, |row, column| {
        let [u, v] = [column, row].map(|k| CLOTH * (k as f64 / side as f64 - 0.5));
        let top = CENTER.y + RADIUS + SKIN + 0.1 + 0.02 * random();
        (off + DVec3::new(cos * u + sin * v, top, cos * v - sin * u)).as_vec3()
    })
}

/// The cloth and the ball that winds it up.
struct Winding {
    cloth: Cloth,
    ball: Mesh,
    substeps: usize,
    frames: Vec<Vec<Vec3>>,
    /// Greatest so far of the mean and of the greatest strain.
    strain: (f64, f64),
}

impl World for Winding {
    const STAGES: &'static [(Simulated, Run<Self>)] = &[
        (Simulated::CONTACT, |w, step| {
            w.cloth.find_folds(step % w.substeps);
            0
        }),
        (Simulated::GRAVITY, |w, _| w.cloth.fall()),
        (Simulated::empty(), |w, _| w.cloth.drift()),
        (Simulated::CLOTH, |w, _| w.cloth.hold_together()),
        (Simulated::CONTACT, |w, _| w.cloth.keep_folds_apart()),
        (Simulated::CONTACT, |w, step| {
            let [start, end] = [step, step + 1].map(|step| w.angle(step));
            let turned = rotation(Vec3::Y, end - start);
            w.cloth.touch(|before, now| contact(before, now, turned))
        }),
        (Simulated::empty(), |w, _| {
            w.cloth.set_velocities();
            0
        }),
    ];

    fn record(&mut self, key: usize) {
        if key > 0 {
            let ((mean, most), strain) = (self.cloth.strain(), &mut self.strain);
            *strain = (strain.0.max(mean), strain.1.max(most));
        }
        let turned = rotation(Vec3::Y, self.angle(key * self.substeps));
        let ball = self.ball.positions.iter().map(|p| CENTER + turned * p.as_dvec3());
        let all = self.cloth.positions.iter().copied().chain(ball);
        self.frames.push(all.map(DVec3::as_vec3).collect());
    }
}

impl Winding {
    /// How far the ball has turned at the start of a step, in radians.
    fn angle(&self, step: usize) -> f64 {
        let (start, ramp, speed) = TURN;
        let t = (step as f64 * self.cloth.dt - start).max(0.0);
        if t < ramp { speed * t * t / (2.0 * ramp) } else { speed * (t - 0.5 * ramp) }
    }
}

fn simulate(side: usize, keys: usize, substeps: usize, options: &SceneOptions<'_>) -> Record<Vec<Vec<Vec3>>> {
    let spacing = CLOTH / side as f64;
    let dt = SECONDS / ((keys - 1) * substeps) as f64;
    let positions = flat(side, options.seed).positions.iter().map(|p| p.as_dvec3()).collect();
    let cloth = Cloth::new(side + 1, spacing, positions, dt);
    let ball = sphere(RADIUS as f32, 20, 20);
    let mut world = Winding { cloth, ball, substeps, frames: Vec::new(), strain: (0.0, 0.0) };
    let stats = simulation::simulate(&mut world, keys, substeps, options);
    let (mean, most) = world.strain;
    let measures = vec![
        Measure { name: "edge stretch, root mean square".to_owned(), value: mean },
        Measure { name: "edge stretch, greatest".to_owned(), value: most },
    ];
    Record { data: world.frames, measures, stats }
}

/// Pushes a particle out of ball and floor, and lets it slip no further than friction allows.
/// In this step the ball has turned by `turned`.
fn contact(before: DVec3, now: DVec3, turned: DQuat) -> DVec3 {
    let mut x = now;
    let out = x - CENTER;
    let distance = out.length();
    if distance < RADIUS + SKIN && distance > 0.0 {
        let normal = out / distance;
        let depth = RADIUS + SKIN - distance;
        let dragged = turned * (before - CENTER) + CENTER;
        x += normal * depth;
        x -= rub(x - dragged, normal, FRICTION.0 * depth);
    }
    if x.y < SKIN {
        let depth = SKIN - x.y;
        x.y = SKIN;
        x -= rub(x - before, DVec3::Y, FRICTION.1 * depth);
    }
    x
}

/// The part of the slip along a surface that friction undoes, at most `limit` long (Coulomb).
fn rub(slip: DVec3, normal: DVec3, limit: f64) -> DVec3 {
    (slip - normal * slip.dot(normal)).clamp_length_max(limit)
}
