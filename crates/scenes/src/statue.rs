//! A hollow statue that a falling stone breaks: from its surface to shards, their motion, and its
//! playback.

use std::collections::{BTreeSet, HashMap};

use anim::{Animation, Motion, vertex_normals};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::cache::{Record, recorded};
use crate::decimate::decimate;
use crate::fracture::{ALONE, patches, shards};
use crate::implicit::Solid;
use crate::rigid::{Key, RigidBodies};
use crate::shape::{Assembly, Mesh};
use crate::shatter::{Bodies, Body};
use crate::simulation::{self, Run, World};
use crate::{Effects, Measure, Scene, SceneInfo, SceneOptions, Simulated, meshing, shape};

/// Steps between checks for pieces that nothing holds up.
const SUPPORT: usize = 8;

/// What a scene with a breaking statue is made from.
pub(crate) struct Statue {
    pub(crate) info: &'static SceneInfo,
    pub(crate) seconds: f64,
    pub(crate) substeps: usize,
    pub(crate) solid: fn() -> Solid,
    /// Corners of the box that the solid is meshed in, and the size of a cell.
    pub(crate) meshed: (Vec3, Vec3, f32),
    /// Triangles of the surface before it is cut into shards, which have an inside and a rim too.
    pub(crate) surface: f32,
    /// Pieces asked for; fewer come out of the cutting.
    pub(crate) pieces: f32,
    /// Of the wall, where the solid is at least twice as thick.
    pub(crate) thickness: f32,
    /// Relative number of pieces per area.
    pub(crate) density: fn(Vec3) -> f32,
    /// Centre and radius of the stone at first, and its speed downwards.
    pub(crate) stone: (Vec3, f32, f32),
    /// Mass of the stone per area, that of the statue being 1.
    pub(crate) stone_density: f32,
    /// Seconds from the impact at a point to when a piece with a centre breaks off.
    pub(crate) delay: fn(Vec3, Vec3, &mut fastrand::Rng) -> f32,
    /// Velocity and spin of a piece as it breaks off, by centre and point of impact.
    pub(crate) kick: fn(Vec3, Vec3, &mut fastrand::Rng) -> (Vec3, Vec3),
    /// Colours of the statue, the stone and the ground.
    pub(crate) colors: [[f32; 3]; 3],
    pub(crate) ground: f32,
    /// Eye, and point looked at.
    pub(crate) seen: (Vec3, Vec3),
    pub(crate) light: Vec3,
}

/// Triangles of the ground.
const GROUND: usize = 512;

/// What a breaking statue calls for.
pub(crate) const EFFECTS: Effects = Effects::of_scene(simulation::effects::<Breaking>(), Motion::RIGID);

impl Statue {
    pub(crate) fn scene(&'static self, options: &SceneOptions<'_>) -> Scene {
        let info = self.info;
        let keys = options.key_frames.unwrap_or(info.frames);
        let substeps = options.substeps.unwrap_or(self.substeps);
        let detail = options.detail.unwrap_or(1.0);
        let parameters =
            format!("{} seed {} keys {keys} substeps {substeps} detail {detail}", info.name, options.seed);
        let dt = self.seconds as f32 / ((keys - 1) * substeps) as f32;
        let (record, notes) = recorded(&parameters, options, || {
            let mut breaking = Breaking::new(self, detail, dt, options.seed);
            let stats = simulation::simulate(&mut breaking, keys, substeps, options);
            let name = "greatest depth below the ground, a length".to_owned();
            let measures = vec![Measure { name, value: breaking.depth.into() }];
            Record { data: breaking.pieces, measures, stats }
        });
        let Record { data, measures, stats } = record;
        let key_bytes = keys * size_of_val(&data.keys[0][..]);
        let animation = self.playback(data);
        let scene = Scene::new(info, Box::new(animation), self.seen, 42_f32.to_radians(), self.light);
        Scene { key_bytes, measures, simulated: stats, notes, ..scene }
    }

    /// A rigid part per shard, the stone, and a still square of ground.
    fn playback(&self, Pieces { meshes, welds, keys }: Pieces) -> RigidBodies {
        let mut assembly = Assembly::default();
        let [statue, stone, earth] = self.colors.map(|color| assembly.material(color));
        let count = meshes.len();
        for (i, mesh) in meshes.iter().enumerate() {
            let (name, material) = if i + 1 < count { ("shard", statue) } else { ("stone", stone) };
            assembly.part(name, mesh, Motion::RIGID, material);
        }
        assembly.part("ground", &shape::square(self.ground, 16), Motion::empty(), earth);
        let mut animation = RigidBodies::new(assembly, Vec::new(), keys, self.seconds);
        animation.normals = welded_normals(&animation.topology().triangles, &animation.rest(), &welds);
        animation
    }

    /// The thickness at a point of the surface: less than half of the solid's own, so that no
    /// inside shows.
    fn wall(&self, solid: &Solid, p: Vec3, normal: Vec3) -> f32 {
        let near = solid.near(p, 2.0 * self.thickness);
        let mut depth = self.thickness;
        while depth > 0.05 * self.thickness && near.distance(p - normal * depth) > -0.7 * depth {
            depth *= 0.7;
        }
        depth
    }

    /// A lumpy stone.
    fn stone(&self, triangles: usize, random: &mut fastrand::Rng) -> (Body, Mesh) {
        let (center, radius, speed) = self.stone;
        let blend = 0.3 * radius;
        let mut solid = Solid::default();
        solid.ball(blend, center, 0.75 * radius);
        for _ in 0..14 {
            let mut number = || random.f32() - 0.5;
            let direction = Vec3::new(number(), number(), number()).normalize_or(Vec3::X);
            solid.ball(blend, center + direction * (0.5 * radius), radius * (0.3 + 0.15 * random.f32()));
        }
        let half = Vec3::splat(1.2 * radius);
        let cell = radius * (10.0 / triangles as f32).sqrt();
        let mesh = decimate(&meshing::mesh(&solid, center - half, center + half, cell), triangles);
        let (mut stone, mesh) = Body::new(mesh, self.stone_density);
        stone.free = true;
        stone.radius = radius;
        stone.velocity = Vec3::NEG_Y * speed;
        (stone, mesh)
    }
}

/// What a broken statue is played back from.
#[derive(Serialize, Deserialize)]
struct Pieces {
    /// Each shard and the stone, relative to their bodies.
    meshes: Vec<Mesh>,
    /// Of each vertex of the shards, which others it shares its normal with; see [`shards`].
    welds: Vec<u32>,
    /// Those of all bodies for each key frame.
    keys: Vec<Vec<Key>>,
}

/// A statue in pieces, with the stone that breaks it behind them.
struct Breaking {
    statue: &'static Statue,
    world: Bodies,
    pieces: Pieces,
    /// For each piece, those that touch it.
    beside: Vec<BTreeSet<usize>>,
    /// The pieces that rest on the ground at first.
    resting: Vec<usize>,
    /// Where the stone hit first, and when each piece is to break off; `None` before it has hit.
    hit: Option<(Vec3, Vec<f32>)>,
    random: fastrand::Rng,
    /// Greatest depth of a vertex below the ground so far.
    depth: f32,
}

impl World for Breaking {
    const STAGES: &'static [(Simulated, Run<Self>)] = &[
        (Simulated::FRACTURE, |w, step| w.break_off(step)),
        (Simulated::GRAVITY, |w, _| w.world.fall()),
        (Simulated::empty(), |w, _| w.world.drift()),
        (Simulated::CONTACT, |w, step| w.world.touch(step)),
    ];

    fn record(&mut self, _: usize) {
        self.pieces.keys.push(self.world.bodies.iter().map(|body| body.at.key()).collect());
        for (body, mesh) in self.world.bodies.iter().zip(&self.pieces.meshes) {
            if body.is_low() {
                let depths = mesh.positions.iter().map(|&p| -(body.at.position.y + body.at.turned(p).y));
                self.depth = depths.fold(self.depth, f32::max);
            }
        }
    }
}

impl Breaking {
    /// The statue before anything moves.
    fn new(statue: &'static Statue, detail: f32, dt: f32, seed: u64) -> Self {
        let mut random = fastrand::Rng::with_seed(seed);
        let (solid, (low, high, cell)) = ((statue.solid)(), statue.meshed);
        let fine = meshing::mesh(&solid, low, high, cell / detail.sqrt());
        let surface = decimate(&fine, (statue.surface * detail) as usize);
        let pieces = (statue.pieces * detail) as usize;
        let (patch, count) = patches(&surface, pieces, statue.density, &mut random);
        let shards = shards(&surface, &patch, count, |p, normal| statue.wall(&solid, p, normal));
        let (shards, welds): (Vec<Mesh>, Vec<Vec<u32>>) = shards.into_iter().unzip();
        let lowest = |m: &Mesh| m.positions.iter().map(|p| p.y).fold(f32::MAX, f32::min);
        let beside = adjacent_patches(&surface, &patch, count);
        let resting = (0..count).filter(|&i| lowest(&shards[i]) < statue.thickness).collect();
        let shard_triangles: usize = shards.iter().map(|m| m.triangles.len()).sum();
        let (mut bodies, mut meshes): (Vec<Body>, Vec<Mesh>) =
            shards.into_iter().map(|mesh| Body::new(mesh, 1.0)).unzip();
        // The stone takes what is left, so that the number of triangles does not hang on how the
        // cracks run.
        let triangles = ((statue.info.triangles - GROUND) as f32 * detail) as usize;
        let (stone, mesh) = statue.stone(triangles.saturating_sub(shard_triangles).max(200), &mut random);
        bodies.push(stone);
        meshes.push(mesh);
        let world = Bodies::new(bodies, 4.0 * statue.thickness, dt);
        let pieces = Pieces { meshes, welds: welds.concat(), keys: Vec::new() };
        Self { statue, world, pieces, beside, resting, hit: None, random, depth: 0.0 }
    }

    /// Frees the pieces whose time has come, that the stone hits, or that nothing holds up any
    /// more. Gives their number.
    fn break_off(&mut self, step: usize) -> usize {
        let Self { statue, beside, resting, hit, random, world, .. } = self;
        let time = step as f32 * world.dt;
        let Some((stone, shards)) = world.bodies.split_last_mut() else { return 0 };
        let touches =
            |b: &Body| !b.free && b.at.position.distance(stone.at.position) < b.radius + stone.radius;
        let touched: Vec<bool> = shards.iter().map(touches).collect();
        if hit.is_none() && touched.contains(&true) {
            let impact = stone.at.position - Vec3::Y * stone.radius;
            let due = |b: &Body| time + (statue.delay)(b.at.position, impact, random);
            *hit = Some((impact, shards.iter().map(due).collect()));
        }
        let Some((impact, due)) = &*hit else { return 0 };
        let mut loose: Vec<bool> =
            (0..shards.len()).map(|i| shards[i].free || touched[i] || due[i] <= time).collect();
        if step.is_multiple_of(SUPPORT) {
            loose = unsupported(beside, resting, &loose);
        }
        let mut freed = 0;
        for ((body, loose), touched) in shards.iter_mut().zip(loose).zip(touched) {
            if loose && !body.free {
                body.free = true;
                (body.velocity, body.spin) = (statue.kick)(body.at.position, *impact, random);
                freed += 1;
            }
            if touched {
                // The stone is slowed by what it hits.
                stone.velocity *= stone.mass / (stone.mass + 0.5);
            }
        }
        freed
    }
}

/// Normals of bodies that all stand as they were made; those of welded vertices are one.
fn welded_normals(triangles: &[[u32; 3]], positions: &[Vec3], weld: &[u32]) -> Vec<Vec3> {
    let mut first_of = HashMap::new();
    let mut stands_for: Vec<u32> = (0..positions.len() as u32).collect();
    for (v, &w) in stands_for.iter_mut().zip(weld).filter(|&(_, &w)| w != ALONE) {
        *v = *first_of.entry(w).or_insert(*v);
    }
    let joined: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
    let normals = vertex_normals(&joined, positions);
    stands_for.iter().map(|&v| normals[v as usize]).collect()
}

/// For each patch those that share a vertex with it.
fn adjacent_patches(mesh: &Mesh, patch: &[u32], count: usize) -> Vec<BTreeSet<usize>> {
    let mut first_at = HashMap::new();
    let mut beside = vec![BTreeSet::new(); count];
    for (triangle, &p) in mesh.triangles.iter().zip(patch) {
        for &v in triangle {
            let (p, q) = (p as usize, *first_at.entry(v).or_insert(p as usize));
            if p != q {
                beside[q].insert(p);
                beside[p].insert(q);
            }
        }
    }
    beside
}

/// Whether each patch lacks a way to one that rests on the ground, over patches that are not loose.
fn unsupported(beside: &[BTreeSet<usize>], resting: &[usize], loose: &[bool]) -> Vec<bool> {
    let mut unsupported = vec![true; loose.len()];
    let mut queue = resting.to_vec();
    while let Some(i) = queue.pop() {
        if !loose[i] && std::mem::take(&mut unsupported[i]) {
            queue.extend(&beside[i]);
        }
    }
    unsupported
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shatter::GRAVITY;

    /// Kinetic and potential energy, the second above the ground.
    fn energy(world: &Bodies) -> f64 {
        let of = |b: &Body| {
            let spin = b.at.turned_back(b.spin);
            let kinetic =
                0.5 * (b.mass * b.velocity.length_squared() + spin.dot(b.inverse_inertia.inverse() * spin));
            f64::from(kinetic + b.mass * GRAVITY * b.at.position.y)
        };
        world.bodies.iter().map(of).sum()
    }

    /// Only the fracture gives energy, by its kicks, but for contact: it lifts what overlaps. That
    /// came to 2.3 % at most (lion, 3840 steps).
    #[test]
    fn energy_stays_within_four_per_cent_of_what_was_put_in_at_every_step_size() {
        for statue in [&crate::exploding_dragon::DRAGON, &crate::lion::LION] {
            for steps in [60, 240, 960, 3840] {
                let mut w = Breaking::new(statue, 0.02, statue.seconds as f32 / steps as f32, 0);
                let (mut put_in, mut excess) = (energy(&w.world), 0.0_f64);
                for step in 0..steps {
                    for &(effect, run) in Breaking::STAGES {
                        let before = energy(&w.world);
                        run(&mut w, step);
                        if effect == Simulated::FRACTURE {
                            put_in += energy(&w.world) - before;
                        }
                    }
                    excess = excess.max(energy(&w.world) / put_in - 1.0);
                }
                let left = energy(&w.world) / put_in;
                println!("{}, {steps} steps: excess {excess:.2e}, {left:.3} left", statue.info.name);
                assert!(excess < 0.04, "{}, {steps} steps: {excess}", statue.info.name);
            }
        }
    }
}
