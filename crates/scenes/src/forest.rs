//! The still part of the fairy's forest: ground, trees with leaves, mushrooms, and grass.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{DQuat, DVec3, Vec3, vec3};

use crate::rigid::rotated;
use crate::shape::{Mesh, arc, around, square, turned};

/// Side of the square of ground, centred on the origin.
const SIDE: f32 = 30.0;
const CELLS: usize = 64;
/// Radius of the clearing around the origin.
const CLEARING: f32 = 3.2;

/// Branches of a tree.
const BRANCHES: usize = 7;

/// Meshes by what they are made of, and the generator of all that is random in them.
pub(crate) struct Forest {
    /// Every part of the forest takes its numbers from here, in the order in which parts are made.
    pub(crate) random: fastrand::Rng,
    pub(crate) ground: Mesh,
    pub(crate) bark: Mesh,
    pub(crate) leaves: Mesh,
    pub(crate) stems: Mesh,
    pub(crate) caps: Mesh,
}

/// Height of the ground at a place.
pub(crate) fn ground_at(x: f32, z: f32) -> f32 {
    let hills = libm::sinf(0.45 * x + 1.0) * libm::sinf(0.38 * z) + 0.3 * libm::sinf(1.3 * x + 0.7 * z);
    0.35 * hills * ((x * x + z * z) / 40.0).min(1.0)
}

/// The forest without grass.
pub(crate) fn forest(trees: usize, seed: u64, eye: Vec3) -> Forest {
    let mut random = fastrand::Rng::with_seed(seed);
    let rough = |p: Vec3| p.with_y(ground_at(p.x, p.z) + 0.04 * (random.f32() - 0.5));
    let ground = square(SIDE, CELLS).moved(rough);
    let mut places: Vec<Vec3> = Vec::new();
    while places.len() < trees {
        let (x, z) = (20.0 * (random.f32() - 0.5), 16.0 * random.f32() - 12.0);
        let p = vec3(x, ground_at(x, z) - 0.05, z);
        let level = vec3(eye.x, p.y, eye.z);
        // Not in the clearing, not before the eye, not in one another.
        let sight = p.distance(level.lerp(vec3(0.0, p.y, 0.0), 0.5)) < 3.4;
        if !sight && p.length() > CLEARING && places.iter().all(|q| q.distance(p) > 2.6) {
            places.push(p);
        }
    }
    let [bark, leaves, stems, caps] = [(); 4].map(|()| Mesh::default());
    let mut forest = Forest { random, ground, bark, leaves, stems, caps };
    for place in places {
        forest.tree(place);
    }
    (0..26).for_each(|_| forest.mushroom());
    forest
}

/// One-triangle blades of grass.
pub(crate) fn grass(blades: usize, random: &mut fastrand::Rng) -> Mesh {
    let mut mesh = Mesh::default();
    for _ in 0..blades {
        let place = around(TAU * random.f32()) * (0.4 + 8.0 * random.f32());
        let foot = place.with_y(ground_at(place.x, place.z) - 0.03);
        let width = 0.015 * around(TAU * random.f32());
        let tip = vec3(0.12 * (random.f32() - 0.5), 0.1 + 0.25 * random.f32(), 0.12 * (random.f32() - 0.5));
        mesh.add(&[[foot - width, foot + width, foot + tip]]);
    }
    mesh
}

impl Forest {
    fn tree(&mut self, foot: Vec3) {
        let random = &mut self.random;
        let height = 6.0 + 2.5 * random.f32();
        let thick = 0.28 + 0.14 * random.f32();
        let mut trunk = vec![(foot - 0.3 * Vec3::Y, 1.7 * thick), (foot + 0.25 * Vec3::Y, 1.15 * thick)];
        let mut at = foot;
        for k in 1..=8 {
            at += vec3(0.3 * (random.f32() - 0.5), height / 8.0, 0.3 * (random.f32() - 0.5));
            trunk.push((at, thick * (1.0 - 0.095 * k as f32)));
        }
        tube(&mut self.bark, &trunk, 12);
        for b in 0..BRANCHES {
            let (from, radius) = trunk[3 + b * 6 / BRANCHES];
            let turn = TAU * (0.382 * b as f32 + 0.1 * self.random.f32());
            let direction = around(turn).with_y(0.35 + 0.5 * self.random.f32()).normalize();
            let reach = direction * (0.22 * height * (1.1 - 0.05 * b as f32));
            self.branch(from, reach, 0.45 * radius, 2);
        }
        let (top, radius) = trunk[trunk.len() - 1];
        self.branch(top, vec3(0.0, 1.0, 0.0), radius, 1);
    }

    /// A branch, its twigs, and at the ends leaves.
    fn branch(&mut self, from: Vec3, reach: Vec3, radius: f32, order: usize) {
        let mut path = vec![(from, radius)];
        let steps = 4;
        for k in 1..=steps {
            let wander = self.random_vector(0.3) * (0.12 * reach.length());
            let (last, _) = path[k - 1];
            path.push((last + reach / steps as f32 + wander, radius * (1.0 - 0.8 * k as f32 / steps as f32)));
        }
        tube(&mut self.bark, &path, 3 + 2 * order);
        if order == 0 {
            return self.foliage(&path[1..]);
        }
        for k in 0..4 {
            let (at, thick) = path[1 + k * steps / 4];
            let aside = self.random_vector(0.4).normalize_or(Vec3::Y);
            let reach = (reach.normalize() + 1.1 * aside).normalize() * (0.55 * reach.length());
            self.branch(at, reach, 0.6 * thick, order - 1);
        }
    }

    /// A random vector in a unit cube: x and z are from -0.5 to 0.5, y is from `-down` to
    /// `1 - down`.
    fn random_vector(&mut self, down: f32) -> Vec3 {
        let mut less = |part: f32| self.random.f32() - part;
        vec3(less(0.5), less(down), less(0.5))
    }

    /// Leaves along a twig, each two triangles folded at the midrib.
    fn foliage(&mut self, path: &[(Vec3, f32)]) {
        for (at, _) in path.iter().flat_map(|&at| [at; 3]) {
            let out = self.random_vector(0.5).normalize_or(Vec3::X);
            let stalk = at + 0.1 * out;
            let side = out.cross(self.random_vector(0.5)).normalize_or(Vec3::Z);
            let size = 0.16 + 0.09 * self.random.f32();
            let (tip, fold) = (stalk + 1.6 * size * out, 0.25 * size * out.cross(side));
            let middle = stalk + 0.7 * size * out + fold;
            let [left, right] = [middle - 0.5 * size * side, middle + 0.5 * size * side];
            self.leaves.add(&[[stalk, left, tip], [stalk, tip, right]]);
        }
    }

    fn mushroom(&mut self) {
        let random = &mut self.random;
        let place = around(TAU * random.f32()) * (1.3 + 4.5 * random.f32());
        let size = 0.12 + 0.3 * random.f32() * random.f32();
        let foot = place.with_y(ground_at(place.x, place.z) - 0.03);
        let up = vec3(random.f32() - 0.5, 4.0, random.f32() - 0.5).as_dvec3().normalize();
        let lean = DQuat::from_rotation_arc(DVec3::Y, up);
        let stem = [(0.0, 1.0), (0.16, 1.0), (0.13, 0.6), (0.2, 0.0), (0.0, 0.0)];
        let dome = arc(FRAC_PI_2, 8).map(|(sin, cos)| (0.62 * sin, 0.85 + 0.5 * cos));
        let cap: Vec<(f32, f32)> = dome.chain([(0.55, 0.8), (0.2, 0.92), (0.0, 0.95)]).collect();
        for (mesh, profile) in [(&mut self.stems, &stem[..]), (&mut self.caps, &cap[..])] {
            mesh.join(&turned(profile, 16).moved(|p| foot + rotated(lean, size * p)));
        }
    }
}

/// A tube through points with a radius at each, closed to a point at the end.
fn tube(mesh: &mut Mesh, path: &[(Vec3, f32)], around: usize) {
    let first = mesh.positions.len();
    let mut side = (path[1].0 - path[0].0).any_orthonormal_vector();
    for (i, &(at, radius)) in path.iter().enumerate() {
        let tangent =
            (path[(i + 1).min(path.len() - 1)].0 - path[i.saturating_sub(1)].0).normalize_or(Vec3::Y);
        side = (side - tangent * side.dot(tangent)).normalize_or(tangent.any_orthonormal_vector());
        let up = tangent.cross(side);
        for j in 0..around {
            let (sin, cos) = libm::sincosf(TAU * j as f32 / around as f32);
            mesh.positions.push(at + radius * (cos * side + sin * up));
        }
    }
    let at = |i: usize, j: usize| (first + i * around + j % around) as u32;
    for i in 1..path.len() {
        for j in 0..around {
            mesh.triangles.push([at(i - 1, j), at(i - 1, j + 1), at(i, j + 1)]);
            mesh.triangles.push([at(i - 1, j), at(i, j + 1), at(i, j)]);
        }
    }
    let (end, tip) = (path.len() - 1, mesh.positions.len() as u32);
    mesh.positions.push(path[end].0);
    for j in 0..around {
        mesh.triangles.push([at(end, j), at(end, j + 1), tip]);
    }
}
