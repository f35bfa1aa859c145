//! `n-body`: balls under mutual gravity that collide with one another, with still pillars, and with
//! the walls.

use std::f32::consts::FRAC_PI_2;

use anim::{Motion, vertex_normals};
use glam::{DVec3, Quat, Vec3};

use crate::cache::{Record, recorded};
use crate::rigid::{Key, RigidBodies};
use crate::shape::{Assembly, arc, sphere, turned};
use crate::simulation::{self, Run};
use crate::{Effects, Make, Measure, Scene, SceneInfo, SceneOptions, Simulated};

const BALLS: usize = 300;
const FRAMES: usize = 100;
const SUBSTEPS: usize = 32;
const SECONDS: f64 = 4.0;
/// Corners of the box that the balls are kept in.
const BOX: [DVec3; 2] = [DVec3::new(-5.3, 0.0, -5.3), DVec3::new(5.3, 10.0, 5.3)];
/// Time simulated. Over 100 frames the balls then go as far a frame as those of the original, whose
/// loop has 76 frames, would over 100: 75 steps of its over 99.
const SPAN: f64 = 75.0 / 99.0;
/// Product of the gravitational constant and the mean mass, in units of length^3 per unit of
/// time^2.
const GRAVITY: f64 = 30.0;
/// Length below which gravity fades, about a ball's diameter.
const SOFTENING: f64 = 0.5;
/// Standard deviation of each component of the first velocities, in units of length per unit of
/// time.
const FIRST_SPEED: f64 = 26.0;
/// Foot, radius, and height of each pillar.
const PILLARS: [(f64, f64, f64, f64); 5] = [
    (0.0, 0.0, 2.5, 3.0),
    (-3.0, -3.0, 1.5, 6.0),
    (-3.0, 3.0, 0.75, 3.0),
    (3.0, -3.0, 1.0, 7.0),
    (3.0, 3.0, 0.5, 5.0),
];

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "n-body",
    about: "300 balls under mutual gravity collide among five still pillars",
    triangles: BALLS * 480 + PILLARS.len() * 496,
    frames: FRAMES,
    effects: Effects::of_scene(simulation::effects::<World>(), Motion::RIGID),
    key_bytes: FRAMES * BALLS * size_of::<Key>(),
    make: &[("", Make::Whole(|options| Ok(scene(options))))],
};

struct Ball {
    radius: f64,
    mass: f64,
    position: DVec3,
    velocity: DVec3,
}

fn scene(options: &SceneOptions<'_>) -> Scene {
    let (keys, substeps) = (options.key_frames.unwrap_or(FRAMES), options.substeps.unwrap_or(SUBSTEPS));
    let parameters = format!("n-body span {SPAN} seed {} keys {keys} substeps {substeps}", options.seed);
    let (record, notes) = recorded(&parameters, options, || simulate(keys, substeps, options));
    let Record { data: (radii, keys), measures, stats } = record;

    let mut assembly = Assembly::default();
    let colors = [[0.85, 0.3, 0.2], [0.9, 0.7, 0.25], [0.25, 0.5, 0.8], [0.35, 0.7, 0.4], [0.85, 0.85, 0.8]]
        .map(|color| assembly.material(color));
    let stone = assembly.material([0.55, 0.55, 0.6]);
    let steps = (16.0 * options.detail.unwrap_or(1.0).sqrt()).round().max(4.0) as usize;
    for (&radius, &color) in radii.iter().zip(colors.iter().cycle()) {
        assembly.part("ball", &sphere(radius, steps, steps), Motion::RIGID, color);
    }
    for (x, z, radius, height) in PILLARS {
        let foot = Vec3::new(x as f32, 0.0, z as f32);
        let pillar = turned(&pillar_profile(radius as f32, height as f32), 31).moved(|p| p + foot);
        assembly.part("pillar", &pillar, Motion::empty(), stone);
    }
    let key_bytes = keys.len() * size_of_val(&keys[0][..]);
    let normals = vertex_normals(&assembly.topology.triangles, &assembly.positions);
    let animation = RigidBodies::new(assembly, normals, keys, SECONDS);
    let seen = (Vec3::new(7.0, 10.5, 18.0), Vec3::new(0.0, 4.4, 0.0));
    let scene =
        Scene::new(&INFO, Box::new(animation), seen, 40_f32.to_radians(), Vec3::new(10.0, 22.0, 16.0));
    Scene { key_bytes, measures, simulated: stats, notes, ..scene }
}

/// A pillar with a domed top and a closed foot, 496 triangles when turned in 31 steps.
fn pillar_profile(radius: f32, height: f32) -> Vec<(f32, f32)> {
    let straight = height - radius;
    let dome = arc(FRAC_PI_2, 5).map(|(sin, cos)| (radius * sin, straight + radius * cos));
    let shaft = (1..=3).map(|i| (radius, straight * (1.0 - i as f32 / 3.0)));
    dome.chain(shaft).chain([(0.0, 0.0)]).collect()
}

fn first_balls(seed: u64) -> Vec<Ball> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
    let mut balls: Vec<Ball> = Vec::with_capacity(BALLS);
    while balls.len() < BALLS {
        let radius = between(0.225, 0.375);
        let [low, high] = BOX;
        let inside = |axis: usize| between(low[axis] + radius, high[axis] - radius);
        let position = DVec3::from_array([0, 1, 2].map(inside));
        // The sum of three uniform numbers is close enough to normal.
        let mut normal = || FIRST_SPEED * (between(-1.0, 1.0) + between(-1.0, 1.0) + between(-1.0, 1.0));
        let velocity = DVec3::new(normal(), normal(), normal());
        let ball = Ball { radius, mass: (radius / 0.3).powi(3), position, velocity };
        let free = balls.iter().all(|b| b.position.distance(position) > b.radius + radius)
            && PILLARS.iter().all(|&p| position.distance(nearest_on_axis(p, position)) > p.2 + radius);
        if free {
            balls.push(ball);
        }
    }
    balls
}

/// The point of a pillar's axis nearest to a point: a pillar is all within its radius of its axis.
fn nearest_on_axis((x, z, radius, height): (f64, f64, f64, f64), point: DVec3) -> DVec3 {
    DVec3::new(x, point.y.min(height - radius), z)
}

/// The balls, stepped by kick, drift, kick (Verlet 1967): symplectic, so that the energy error
/// stays bounded.
struct World {
    balls: Vec<Ball>,
    force: Vec<DVec3>,
    dt: f64,
    potential: f64,
    /// Energy at first, and what its drift is measured by.
    first: (f64, f64),
    drift: f64,
    keys: Vec<Vec<Key>>,
}

impl simulation::World for World {
    const STAGES: &'static [(Simulated, Run<Self>)] = &[
        (Simulated::GRAVITY, |w, _| w.kick()),
        (Simulated::empty(), |w, _| {
            w.balls.iter_mut().for_each(|ball| ball.position += ball.velocity * w.dt);
            w.balls.len()
        }),
        (Simulated::GRAVITY, |w, _| {
            w.potential = gravity(&w.balls, &mut w.force);
            w.kick()
        }),
        (Simulated::CONTACT, |w, _| collide(&mut w.balls)),
    ];

    fn record(&mut self, _: usize) {
        // Frictionless balls never begin to spin.
        let key = |ball: &Ball| (ball.position.as_vec3().to_array(), Quat::IDENTITY.to_array());
        self.keys.push(self.balls.iter().map(key).collect());
        let (first, scale) = self.first;
        self.drift = self.drift.max(((self.potential + kinetic(&self.balls) - first) / scale).abs());
    }
}

impl World {
    /// Accelerates all balls for half a step.
    fn kick(&mut self) -> usize {
        for (ball, f) in self.balls.iter_mut().zip(&self.force) {
            ball.velocity += *f * (0.5 * self.dt / ball.mass);
        }
        self.balls.len()
    }
}

fn simulate(keys: usize, substeps: usize, options: &SceneOptions<'_>) -> Record<(Vec<f32>, Vec<Vec<Key>>)> {
    let balls = first_balls(options.seed);
    let mut force = vec![DVec3::ZERO; BALLS];
    let potential = gravity(&balls, &mut force);
    let first = (potential + kinetic(&balls), kinetic(&balls) + potential.abs());
    let dt = SPAN / ((keys - 1) * substeps) as f64;
    let mut world = World { balls, force, dt, potential, first, drift: 0.0, keys: Vec::new() };
    let stats = simulation::simulate(&mut world, keys, substeps, options);
    let radii = world.balls.iter().map(|b| b.radius as f32).collect();
    let measures = vec![Measure { name: "energy drift".to_owned(), value: world.drift }];
    Record { data: (radii, world.keys), measures, stats }
}

fn kinetic(balls: &[Ball]) -> f64 {
    balls.iter().map(|b| 0.5 * b.mass * b.velocity.length_squared()).sum()
}

/// Sets the forces of softened mutual gravity (Plummer 1911) and gives the potential energy.
fn gravity(balls: &[Ball], force: &mut [DVec3]) -> f64 {
    force.fill(DVec3::ZERO);
    let mut potential = 0.0;
    for i in 0..balls.len() {
        for j in 0..i {
            let apart = balls[j].position - balls[i].position;
            let inverse = (apart.length_squared() + SOFTENING * SOFTENING).sqrt().recip();
            let strength = GRAVITY * balls[i].mass * balls[j].mass * inverse;
            let f = apart * (strength * inverse * inverse);
            force[i] += f;
            force[j] -= f;
            potential -= strength;
        }
    }
    potential
}

/// Elastic, frictionless collisions: whatever touches and approaches has its normal velocity
/// reversed. Gives the number of contacts.
///
/// Only velocities change, and kinetic energy is kept exactly.
fn collide(balls: &mut [Ball]) -> usize {
    let mut contacts = 0;
    for i in 0..balls.len() {
        let (before, rest) = balls.split_at_mut(i);
        let a = &mut rest[0];
        for b in before {
            let apart = b.position - a.position;
            let distance = apart.length();
            if distance < a.radius + b.radius && distance > 0.0 {
                let normal = apart / distance;
                let approach = (a.velocity - b.velocity).dot(normal);
                if approach > 0.0 {
                    contacts += 1;
                    let impulse = 2.0 * approach * a.mass * b.mass / (a.mass + b.mass);
                    a.velocity -= normal * (impulse / a.mass);
                    b.velocity += normal * (impulse / b.mass);
                }
            }
        }
        for &pillar in &PILLARS {
            let apart = a.position - nearest_on_axis(pillar, a.position);
            let distance = apart.length();
            if distance < pillar.2 + a.radius && distance > 0.0 {
                contacts += reflect(&mut a.velocity, apart / distance);
            }
        }
        let [low, high] = BOX;
        for normal in DVec3::AXES {
            if (a.position - low).dot(normal) < a.radius {
                contacts += reflect(&mut a.velocity, normal);
            } else if (high - a.position).dot(normal) < a.radius {
                contacts += reflect(&mut a.velocity, -normal);
            }
        }
    }
    contacts
}

/// Turns the part of a velocity that goes against the normal. Gives 1 if there is one, else 0.
fn reflect(velocity: &mut DVec3, normal: DVec3) -> usize {
    let along = velocity.dot(normal).min(0.0);
    *velocity -= normal * (2.0 * along);
    usize::from(along < 0.0)
}
