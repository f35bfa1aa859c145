//! Single meshes from .obj, .ply and .stl files: positions, triangles and diffuse colours.

mod obj;
mod ply;
mod stl;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::{DVec3, Vec3};

use crate::error::{LoadError, NUMBERED, Problem, read_file};
use crate::key_frames::{DEFAULT_SECONDS_PER_FRAME, KeyFrames, LoopMode};
use crate::{Material, Topology};

/// A mesh as it comes from a file; its topology says nothing yet about what moves.
pub(crate) struct Mesh {
    pub(crate) topology: Topology,
    pub(crate) positions: Vec<Vec3>,
}

/// The kind of mesh file, by the extension of its name in upper or lower case.
pub(crate) fn format_of(file: &Path) -> Option<&'static str> {
    let extension = file.extension()?.to_str()?;
    ["obj", "ply", "stl"].into_iter().find(|format| extension.eq_ignore_ascii_case(format))
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
    load(file, DVec3::ZERO)
}

/// As [`load_mesh`], relative to `origin`.
pub(crate) fn load(file: &Path, origin: DVec3) -> Result<KeyFrames, LoadError> {
    still(file, read_mesh(file, &read_file(file)?, origin)?)
}

/// As [`load_mesh`], from the `bytes` of the file; the extension of `file` says what they are.
///
/// # Errors
/// As [`load_mesh`].
pub fn parse_mesh(file: &Path, bytes: &[u8]) -> Result<KeyFrames, LoadError> {
    still(file, read_mesh(file, bytes, DVec3::ZERO)?)
}

fn still(file: &Path, Mesh { topology, positions }: Mesh) -> Result<KeyFrames, LoadError> {
    KeyFrames::new(topology, vec![positions], DEFAULT_SECONDS_PER_FRAME, LoopMode::Restart)
        .map_err(|problem| problem.in_file(file))
}

/// Reads a mesh whose positions are relative to `origin`.
pub(crate) fn read_mesh(file: &Path, bytes: &[u8], origin: DVec3) -> Result<Mesh, LoadError> {
    let Some(format) = format_of(file) else {
        return Err(LoadError::Unsupported {
            file: file.to_owned(),
            found: "not an .obj, .ply or .stl file".into(),
        });
    };
    if bytes.is_empty() {
        return Err(Problem::new("start of file", "an empty file", "a mesh").in_file(file));
    }
    let mesh = match format {
        "obj" => obj::read(bytes, file, origin),
        "ply" => ply::read(bytes, file, origin),
        _ => stl::read(bytes, origin),
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

    /// Adds a part whose `triangles` number its own `positions`.
    fn add_part(
        &mut self,
        name: String,
        triangles: &[[u32; 3]],
        positions: impl ExactSizeIterator<Item = Vec3>,
        material: usize,
    ) -> Result<(), Problem> {
        let wrong = || Problem::new("whole file", "too many vertices or triangles", NUMBERED);
        self.topology.add_part(name, triangles, positions.len(), material as u32).ok_or_else(wrong)?;
        self.positions.extend(positions);
        Ok(())
    }
}
