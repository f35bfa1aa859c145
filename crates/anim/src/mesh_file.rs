//! Single meshes from .obj, .ply and .stl files: positions, triangles and diffuse colours.

mod obj;
mod ply;
mod stl;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::Vec3;

use crate::error::{LoadError, Problem, read_file};
use crate::key_frames::{DEFAULT_SECONDS_PER_FRAME, KeyFrames, LoopMode};
use crate::{Material, Motion, Part, Topology};

/// A mesh as it comes from a file; its topology says nothing yet about what moves.
pub(crate) struct Mesh {
    pub(crate) topology: Topology,
    pub(crate) positions: Vec<Vec3>,
}

/// The kinds of mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Obj,
    Ply,
    Stl,
}

impl Format {
    /// By the extension of the name, in upper or lower case.
    pub(crate) fn of(file: &Path) -> Option<Self> {
        let extension = file.extension()?.to_str()?;
        match () {
            () if extension.eq_ignore_ascii_case("obj") => Some(Self::Obj),
            () if extension.eq_ignore_ascii_case("ply") => Some(Self::Ply),
            () if extension.eq_ignore_ascii_case("stl") => Some(Self::Stl),
            () => None,
        }
    }
}

/// Loads one mesh from an .obj, .ply or .stl file, which then stands still.
///
/// PLY may be ascii or binary of either byte order, with coordinates of any number type (rounded to
/// the nearest f32). Polygons become fans of triangles. An OBJ file gives a part for each run of
/// faces of one object and material, with the `Kd` of its .mtl file, if that is beside it. Corners
/// of STL triangles in one place become one vertex.
///
/// # Errors
/// If the file cannot be read, is malformed, or has no triangles.
pub fn load_mesh(file: &Path) -> Result<KeyFrames, LoadError> {
    parse_mesh(file, &read_file(file)?)
}

/// As [`load_mesh`], from the `bytes` of the file; the extension of `file` says what they are.
///
/// # Errors
/// As [`load_mesh`].
pub fn parse_mesh(file: &Path, bytes: &[u8]) -> Result<KeyFrames, LoadError> {
    let Mesh { topology, positions } = read_mesh(file, bytes)?;
    KeyFrames::new(topology, vec![positions], DEFAULT_SECONDS_PER_FRAME, LoopMode::Restart)
        .map_err(|error| Problem::from_parser("mesh", &error, "a consistent mesh").in_file(file))
}

pub(crate) fn read_mesh(file: &Path, bytes: &[u8]) -> Result<Mesh, LoadError> {
    let Some(format) = Format::of(file) else {
        return Err(LoadError::Unsupported {
            file: file.to_owned(),
            found: "not an .obj, .ply or .stl file".into(),
        });
    };
    if bytes.is_empty() {
        return Err(Problem::new("start of file", "an empty file", "a mesh").in_file(file));
    }
    let mesh = match format {
        Format::Obj => obj::read(bytes, file),
        Format::Ply => ply::read(bytes, file),
        Format::Stl => stl::read(bytes),
    };
    let mesh = mesh.map_err(|problem| problem.in_file(file))?;
    if mesh.topology.triangles.is_empty() {
        return Err(Problem::new("whole file", "no triangles", "at least one").in_file(file));
    }
    Ok(mesh)
}

impl Mesh {
    fn with_materials(materials: Vec<Material>) -> Self {
        Self { topology: Topology { materials, ..Topology::default() }, positions: Vec::new() }
    }

    /// Adds a part whose `triangles` number its own `positions`. `None` if there are too many in
    /// all.
    fn add_part(
        &mut self,
        name: String,
        triangles: &[[u32; 3]],
        positions: &[Vec3],
        material: usize,
    ) -> Option<()> {
        let topology = &mut self.topology;
        let first_triangle = u32::try_from(topology.triangles.len()).ok()?;
        let first_vertex = u32::try_from(self.positions.len()).ok()?;
        let triangles_end = first_triangle.checked_add(u32::try_from(triangles.len()).ok()?)?;
        let vertices_end = first_vertex.checked_add(u32::try_from(positions.len()).ok()?)?;
        topology
            .triangles
            .extend(triangles.iter().map(|corners| corners.map(|corner| first_vertex + corner)));
        topology.moves.resize(topology.triangles.len(), false);
        self.positions.extend_from_slice(positions);
        topology.vertex_count = self.positions.len();
        topology.parts.push(Part {
            name,
            triangles: first_triangle..triangles_end,
            vertices: first_vertex..vertices_end,
            motion: Motion::STILL,
            material: material as u32,
        });
        Some(())
    }
}

fn too_large() -> Problem {
    Problem::new("whole file", "too many vertices or triangles", "as many as 32 bits can number")
}
