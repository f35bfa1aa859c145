//! One entry for everything that can be loaded.

use std::path::Path;

use glam::DVec3;

use crate::error::{LoadError, read_file};
use crate::mesh_file::format_of;
use crate::{Animation, aff, gltf, mesh_file, sequence};

/// What of a file is loaded, and relative to which point; by default all of it, as it stands there.
#[derive(Clone, Copy, Debug)]
pub struct LoadOptions<'a> {
    /// A clip of a glTF file by name or number; nothing else has clips. `None` is the first.
    pub clip: Option<&'a str>,
    /// Whether textures are read; without them surfaces keep the factors of their materials.
    pub textures: bool,
    /// The point of the file that becomes the origin, in the file's unit.
    ///
    /// An `f32` at the earth's radius knows half a metre. A model there keeps details of a
    /// millimetre relative to an origin nearby, such as [`center`] gives: it is subtracted from
    /// coordinates in text and in PLY files, and from composed transforms, before they are rounded
    /// from `f64` to `f32`. Positions inside a mesh of a glTF file, and all of STL, are `f32` in
    /// the file.
    pub origin: DVec3,
}

impl Default for LoadOptions<'_> {
    fn default() -> Self {
        Self { clip: None, textures: true, origin: DVec3::ZERO }
    }
}

/// Loads what is at `path`: a .glb or .gltf file ([`load_gltf`](crate::load_gltf)), a directory of
/// key frames ([`load_sequence`](crate::load_sequence)), a scene of BART in .aff files
/// ([`load_aff`](crate::load_aff)), or a single .obj, .ply or .stl file
/// ([`parse_mesh`](crate::parse_mesh)).
///
/// # Errors
/// As those functions; if it is nothing of the kind; if `clip` is given for something without
/// clips.
pub fn load(path: &Path, clip: Option<&str>) -> Result<Box<dyn Animation>, LoadError> {
    load_with(path, &LoadOptions { clip, ..LoadOptions::default() })
}

/// As [`load`], by `options`.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, options: &LoadOptions<'_>) -> Result<Box<dyn Animation>, LoadError> {
    let kind = std::fs::metadata(path).map_err(|source| LoadError::Io { file: path.to_owned(), source })?;
    let unsupported = |found: &str| Err(LoadError::unsupported(path, found));
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    match &*extension {
        _ if kind.is_dir() => {}
        _ if !kind.is_file() => return unsupported("not a regular file"),
        "glb" | "gltf" => return Ok(Box::new(gltf::parse(path, &read_file(path)?, options)?)),
        "" => return unsupported("a file without extension"),
        "aff" => {}
        _ if format_of(path).is_some() => {}
        _ => return unsupported(&format!("a .{extension} file")),
    }
    if let Some(clip) = options.clip {
        let (file, wanted) = (path.to_owned(), clip.to_owned());
        return Err(LoadError::UnknownClip { file, wanted, clips: Vec::new() });
    }
    Ok(if kind.is_dir() {
        Box::new(sequence::load(path, options.origin)?)
    } else if extension == "aff" {
        Box::new(aff::load(path, options.origin)?)
    } else {
        Box::new(mesh_file::parse(path, &read_file(path)?, options.origin)?)
    })
}

/// The middle of the box around all finite positions at time 0, in whole units: an origin for
/// [`load_with`] that keeps the details of a model far away. O(vertices).
#[must_use]
pub fn center(animation: &dyn Animation) -> DVec3 {
    let rest = animation.rest();
    let finite = || rest.iter().filter(|position| position.is_finite()).map(|p| p.as_dvec3());
    let (low, high) = finite().fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    if low.cmple(high).all() { (0.5 * (low + high)).round() } else { DVec3::ZERO }
}
