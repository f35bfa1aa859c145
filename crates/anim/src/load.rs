//! One entry for everything that can be loaded.

use std::path::Path;

use crate::Animation;
use crate::aff::load_aff;
use crate::error::LoadError;
use crate::gltf::{load_gltf, load_untextured};
use crate::mesh_file::{Format, load_mesh};
use crate::sequence::load_sequence;

/// Loads what is at `path`: a .glb or .gltf file ([`load_gltf`]), a directory of key frames
/// ([`load_sequence`]), a scene of BART in .aff files ([`load_aff`]), or a single .obj, .ply or
/// .stl file ([`load_mesh`]).
///
/// `clip` chooses a clip of a glTF file by name or number; nothing else has clips.
///
/// # Errors
/// As those functions; if it is nothing of the kind; if `clip` is given for something without
/// clips.
pub fn load(path: &Path, clip: Option<&str>) -> Result<Box<dyn Animation>, LoadError> {
    load_with(path, clip, true)
}

/// As [`load`], reading textures only if they are wanted; without them surfaces keep the factors of
/// their materials.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, clip: Option<&str>, textures: bool) -> Result<Box<dyn Animation>, LoadError> {
    let kind = std::fs::metadata(path).map_err(|source| LoadError::Io { file: path.to_owned(), source })?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if kind.is_file() && matches!(&*extension, "glb" | "gltf") {
        return Ok(Box::new(if textures { load_gltf(path, clip)? } else { load_untextured(path, clip)? }));
    }
    if !kind.is_file() && !kind.is_dir() {
        return Err(LoadError::Unsupported { file: path.to_owned(), found: "not a regular file".into() });
    }
    let is_aff = kind.is_file() && extension == "aff";
    if !is_aff && !kind.is_dir() && Format::of(path).is_none() {
        let found = if extension.is_empty() {
            "a file without extension".into()
        } else {
            format!("a .{extension} file")
        };
        return Err(LoadError::Unsupported { file: path.to_owned(), found });
    }
    if let Some(clip) = clip {
        return Err(LoadError::UnknownClip {
            file: path.to_owned(),
            wanted: clip.to_owned(),
            clips: Vec::new(),
        });
    }
    if is_aff {
        return Ok(Box::new(load_aff(path)?));
    }
    Ok(Box::new(if kind.is_dir() { load_sequence(path)? } else { load_mesh(path)? }))
}
