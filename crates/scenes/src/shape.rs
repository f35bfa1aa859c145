//! Triangle meshes made part by part: spheres and pillars, and how parts become a topology.

use std::f32::consts::{PI, TAU};

use anim::{Material, Motion, Topology};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Positions and the triangles between them.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of each triangle.
    pub(crate) fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize]))
    }

    /// Adds triangles with corners of their own.
    pub(crate) fn add(&mut self, triangles: &[[Vec3; 3]]) {
        for corners in triangles {
            let first = self.positions.len() as u32;
            self.positions.extend(corners);
            self.triangles.push([first, first + 1, first + 2]);
        }
    }

    /// The mesh with its vertices moved.
    pub(crate) fn moved(mut self, mut to: impl FnMut(Vec3) -> Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = to(*p));
        self
    }

    /// Adds another mesh.
    pub(crate) fn join(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
    }
}

/// Collects parts into one topology with positions.
#[derive(Default)]
pub(crate) struct Assembly {
    pub(crate) topology: Topology,
    pub(crate) positions: Vec<Vec3>,
}

impl Assembly {
    /// Adds a material and gives its number.
    pub(crate) fn material(&mut self, base_color: [f32; 3]) -> u32 {
        self.topology.materials.push(Material { base_color, ..Material::default() });
        self.topology.materials.len() as u32 - 1
    }

    /// Adds a part of its own vertices, all of which move if any does.
    ///
    /// # Panics
    /// If there are more triangles in all than 32 bits can number; scenes have 1.6 million.
    pub(crate) fn part(&mut self, name: &str, mesh: &Mesh, motion: Motion, material: u32) {
        let Self { topology, positions } = self;
        let part = topology.add_part(name.to_owned(), &mesh.triangles, mesh.positions.len(), material);
        let part = part.expect("few triangles");
        part.motion = motion;
        let first = part.triangles.start as usize;
        topology.moves[first..].fill(!motion.is_empty());
        positions.extend(&mesh.positions);
    }
}

/// A sphere about the origin with `2 * around * (down - 1)` triangles, poles on the y axis.
pub(crate) fn sphere(radius: f32, around: usize, down: usize) -> Mesh {
    let profile: Vec<(f32, f32)> = arc(PI, down).map(|(sin, cos)| (radius * sin, radius * cos)).collect();
    turned(&profile, around)
}

/// Sine and cosine of angles from 0 to `end` in equal steps.
pub(crate) fn arc(end: f32, steps: usize) -> impl Iterator<Item = (f32, f32)> {
    (0..=steps).map(move |i| libm::sincosf(end * i as f32 / steps as f32))
}

/// The point of the unit circle about the y axis at an angle from the x axis towards the z axis.
pub(crate) fn around(angle: f32) -> Vec3 {
    let (sin, cos) = libm::sincosf(angle);
    Vec3::new(cos, 0.0, sin)
}

/// The surface of revolution about the y axis of a profile of (distance from the axis, height), top
/// first.
///
/// The first and the last point of the profile are taken to lie on the axis.
pub(crate) fn turned(profile: &[(f32, f32)], around: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let (first, last) = (profile[0], profile[profile.len() - 1]);
    mesh.positions.push(Vec3::new(0.0, first.1, 0.0));
    for &(distance, y) in &profile[1..profile.len() - 1] {
        for j in 0..around {
            let (sin, cos) = libm::sincosf(TAU * j as f32 / around as f32);
            mesh.positions.push(Vec3::new(distance * cos, y, -distance * sin));
        }
    }
    mesh.positions.push(Vec3::new(0.0, last.1, 0.0));
    let rings = profile.len() - 2;
    let (bottom, at) = (1 + rings * around, |i: usize, j: usize| (1 + i * around + j % around) as u32);
    for j in 0..around {
        mesh.triangles.push([0, at(0, j), at(0, j + 1)]);
        for i in 1..rings {
            mesh.triangles.push([at(i - 1, j), at(i, j), at(i, j + 1)]);
            mesh.triangles.push([at(i - 1, j), at(i, j + 1), at(i - 1, j + 1)]);
        }
        mesh.triangles.push([at(rings - 1, j), bottom as u32, at(rings - 1, j + 1)]);
    }
    mesh
}

/// A horizontal square about the origin with `2 * cells * cells` triangles.
pub(crate) fn square(side: f32, cells: usize) -> Mesh {
    grid(cells, |row, column| {
        let [x, z] = [column, row].map(|k| side * (k as f32 / cells as f32 - 0.5));
        Vec3::new(x, 0.0, z)
    })
}

/// A square grid with its vertices where `place` puts each row and column, row after row; its
/// triangles face up if columns go along x and rows along z.
pub(crate) fn grid(cells: usize, mut place: impl FnMut(usize, usize) -> Vec3) -> Mesh {
    let vertices = (0..=cells).flat_map(|row| (0..=cells).map(move |column| (row, column)));
    let positions = vertices.map(|(row, column)| place(row, column)).collect();
    let at = |row: usize, column: usize| (row * (cells + 1) + column) as u32;
    let quads = (0..cells).flat_map(|row| (0..cells).map(move |column| (row, column)));
    let halves = |(row, column)| {
        let [a, b] = [at(row, column), at(row, column + 1)];
        let [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
        [[a, c, d], [a, d, b]]
    };
    Mesh { positions, triangles: quads.flat_map(halves).collect() }
}
