//! One entry for everything that can be loaded.

use std::path::Path;

use glam::{DVec3, Vec3};

use crate::error::LoadError;
use crate::files::{extension, irregular, read_file};
use crate::{Animation, LoadOptions, aff, gltf, mesh_file, sequence};

/// Loads what is at `path`.
///
/// * A .glb or .gltf file: a clip of glTF 2.0, with the buffers and images that the file names
///   beside it. Without clips it stands still. Memory stays below a fixed multiple of the size of
///   the input (plus 1 GiB), that of a tree over the triangles included.
/// * An .obj, .ply or .stl file: a mesh that stands still. Polygons become fans of triangles. PLY
///   may be ascii or binary of either byte order, with coordinates of any number type (rounded to
///   the nearest f32). An OBJ file gives a part for each run of faces of one object and material,
///   with the `Kd` of its .mtl file, if that is beside it. An STL file gives a part for each solid;
///   corners of its triangles with the same bits become one vertex.
/// * A directory: its .ply or .obj files are the key frames of one animation, in the natural order
///   of their names (`frame2` before `frame10`). All must have the same vertices and faces, and be
///   of the same kind; other files are ignored. Key frames are
///   [`DEFAULT_SECONDS_PER_FRAME`](crate::DEFAULT_SECONDS_PER_FRAME) apart. Two frames are played
///   back and forth (0, 1, 0), since a loop that jumps back after a single step would be no motion;
///   more are played from the first to the last, and a loop then jumps back to the first, which is
///   the paper's protocol (section 4). Materials and names are those of the first file.
/// * An .aff file: a scene of BART, for those who have it, with the files it includes. These are
///   looked for beside the file that includes them, and must lie below the folder of the first. The
///   format is that of J. Lext, U. Assarsson and T. Möller, "A Benchmark for Animated Ray Tracing"
///   (IEEE Computer Graphics and Applications 21(2), 2001), which extends E. Haines' NFF. Spheres
///   and cones are cut into triangles. What a `visibility` key hides shrinks to a point. Materials
///   keep their diffuse colour, or their specular one if that is all they have; textures are
///   ignored. Without an `a` statement the animation lasts as long as its keys.
///
/// # Errors
/// If a file cannot be read, is malformed, has no triangles, or needs an extension of glTF that is
/// not supported; if key frames differ in more than positions; if a link leads out of the folder of
/// the file that names it; if files include each other in a circle, or so often that the scene
/// outgrows them; if `path` is nothing of the kind, or does not have the clip. An image that is
/// missing, lies behind such a link, or cannot be decoded as PNG or JPEG is left out instead, with
/// a note.
pub fn load(path: &Path, options: &LoadOptions<'_>) -> Result<Box<dyn Animation>, LoadError> {
    let kind = std::fs::metadata(path).map_err(LoadError::io(path))?;
    let extension = extension(path);
    match &*extension {
        _ if kind.is_dir() => Ok(Box::new(sequence::load(path, origin_without_clip(path, options)?)?)),
        "aff" => Ok(Box::new(aff::load(path, origin_without_clip(path, options)?)?)),
        "glb" | "gltf" | "obj" | "ply" | "stl" => parse(path, &read_file(path)?, options),
        _ if !kind.is_file() => Err(irregular(path)),
        "" => Err(LoadError::unsupported(path, "a file without extension")),
        _ => Err(LoadError::unsupported(path, &format!("a .{extension} file"))),
    }
}

/// Loads the `bytes` of a .glb, .gltf, .obj, .ply or .stl file as [`load`] does. The extension of
/// `file` says what they are, `file` names them in errors, and other files are sought beside it.
///
/// # Errors
/// As [`load`].
pub fn parse(file: &Path, bytes: &[u8], options: &LoadOptions<'_>) -> Result<Box<dyn Animation>, LoadError> {
    Ok(match &*extension(file) {
        "glb" | "gltf" => Box::new(gltf::parse(file, bytes, options)?),
        _ => Box::new(mesh_file::parse(file, bytes, origin_without_clip(file, options)?)?),
    })
}

/// The origin for something without clips; a clip of it is refused.
fn origin_without_clip(file: &Path, options: &LoadOptions<'_>) -> Result<DVec3, LoadError> {
    options.clip.map_or(Ok(options.origin), |wanted| Err(LoadError::unknown_clip(file, wanted, &[])))
}

/// Returns the middle of the box around all finite positions at time 0, in whole units: an origin
/// for [`load`] that keeps the details of a model far away. O(vertices).
#[must_use]
pub fn center(animation: &dyn Animation) -> DVec3 {
    let middle = |(low, high): (Vec3, Vec3)| (0.5 * (low.as_dvec3() + high.as_dvec3())).round();
    animation.model().bounds().map_or(DVec3::ZERO, middle)
}
