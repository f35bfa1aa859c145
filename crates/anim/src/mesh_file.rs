//! Single meshes from .obj, .ply and .stl files: positions, triangles and diffuse colours.

mod obj;
mod ply;
mod stl;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::DVec3;

use crate::error::{LoadError, Problem};
use crate::files::extension;
use crate::{DEFAULT_SECONDS_PER_FRAME, KeyFrames, Model};

/// Whether [`load`](crate::load) takes a file of this name for a mesh without an animation, camera
/// or lights: .obj, .ply or .stl, in upper or lower case.
#[must_use]
pub fn is_mesh_file(file: &Path) -> bool {
    matches!(&*extension(file), "obj" | "ply" | "stl")
}

/// Reads a mesh that stands still, relative to `origin`.
pub(crate) fn parse(file: &Path, bytes: &[u8], origin: DVec3) -> Result<KeyFrames, LoadError> {
    let model = read_mesh(file, bytes, origin)?;
    KeyFrames::new(model, Vec::new(), DEFAULT_SECONDS_PER_FRAME).map_err(|problem| problem.in_file(file))
}

/// Reads a mesh whose positions are relative to `origin`; it says nothing yet about what moves.
pub(crate) fn read_mesh(file: &Path, bytes: &[u8], origin: DVec3) -> Result<Model, LoadError> {
    if !is_mesh_file(file) {
        return Err(LoadError::unsupported(file, "another kind of mesh"));
    }
    let model = match &*extension(file) {
        _ if bytes.is_empty() => Err(Problem::new("start of file", "an empty file", "a mesh")),
        "obj" => obj::read(bytes, file, origin),
        "ply" => ply::read(bytes, file, origin),
        _ => stl::read(bytes, origin),
    };
    let model = model.map_err(|problem| problem.in_file(file))?;
    if model.topology.triangles.is_empty() {
        return Err(Problem::new("whole file", "no triangles", "at least one").in_file(file));
    }
    Ok(model)
}
