//! Key-framed sequences: a directory of mesh files of one topology, a key frame each.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{LoadError, Problem, read_file};
use crate::key_frames::{DEFAULT_SECONDS_PER_FRAME, KeyFrames, LoopMode};
use crate::mesh_file::{Mesh, format_of, read_mesh};

/// Loads the .ply or .obj files of the directory `directory` as the key frames of one animation.
///
/// Files are taken in the natural order of their names (`frame2` before `frame10`); all must have
/// the same vertices and faces, and be of the same kind. Key frames are
/// [`DEFAULT_SECONDS_PER_FRAME`] apart, see [`KeyFrames::with_seconds_per_frame`]. Two frames are
/// played back and forth (0, 1, 0), since a loop that jumps back after a single step would be no
/// motion; more are played from the first to the last, and a loop then jumps back to the first,
/// which is the paper's protocol (section 4). Other files in the directory are ignored. Materials
/// and names are those of the first file.
///
/// # Errors
/// If the directory cannot be read or holds no mesh files, a file cannot be loaded, or two files
/// differ in more than positions.
pub fn load_sequence(directory: &Path) -> Result<KeyFrames, LoadError> {
    load(directory, DVec3::ZERO)
}

/// As [`load_sequence`], relative to `origin`.
pub(crate) fn load(directory: &Path, origin: DVec3) -> Result<KeyFrames, LoadError> {
    let files = mesh_files(directory)?;
    let (first_file, others) = files.split_first().ok_or_else(|| LoadError::Unsupported {
        file: directory.to_owned(),
        found: "a directory without .ply or .obj files".into(),
    })?;
    let first = read_mesh(first_file, &read_file(first_file)?, origin)?;
    let mut frames = vec![first.positions];
    for file in others {
        let mesh = read_mesh(file, &read_file(file)?, origin)?;
        if let Some(difference) = difference(&mesh, &first.topology) {
            return Err(LoadError::TopologyMismatch {
                file: file.clone(),
                first: first_file.clone(),
                difference,
            });
        }
        frames.push(mesh.positions);
    }
    let loop_mode = if frames.len() == 2 { LoopMode::BackAndForth } else { LoopMode::Restart };
    KeyFrames::new(first.topology, frames, DEFAULT_SECONDS_PER_FRAME, loop_mode)
        .map_err(|problem| problem.in_file(directory))
}

/// The mesh files of `directory` in natural order.
fn mesh_files(directory: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let io = |source| LoadError::Io { file: directory.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(io)? {
        let file = entry.map_err(io)?.path();
        // Hidden files are what some systems leave beside the real ones.
        let hidden = file.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        // A frame that cannot be read must not be missed out, so that what is no folder is tried.
        if format_of(&file).is_some() && !hidden && !file.is_dir() {
            files.push(file);
        }
    }
    files.sort_by(|a, b| {
        let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        natural_order(&name(a), &name(b)).then_with(|| a.cmp(b))
    });
    if files.windows(2).any(|pair| format_of(&pair[0]) != format_of(&pair[1])) {
        return Err(
            Problem::new("files", "both .ply and .obj", "one kind in one sequence").in_file(directory)
        );
    }
    Ok(files)
}

/// Compares runs of digits by the number they stand for, everything else by character.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let ((number_a, rest_a), (number_b, rest_b)) = (a.split_at(digits(a)), b.split_at(digits(b)));
        if !number_a.is_empty() && !number_b.is_empty() {
            // Of any length: without leading zeros the longer number is the greater.
            let (x, y) = (number_a.trim_start_matches('0'), number_b.trim_start_matches('0'));
            match x.len().cmp(&y.len()).then_with(|| x.cmp(y)) {
                Ordering::Equal => (a, b) = (rest_a, rest_b),
                unequal => return unequal,
            }
            continue;
        }
        let (mut chars_a, mut chars_b) = (a.chars(), b.chars());
        match (chars_a.next(), chars_b.next()) {
            (Some(x), Some(y)) if x == y => (a, b) = (chars_a.as_str(), chars_b.as_str()),
            (x, y) => return x.cmp(&y),
        }
    }
}

/// What `mesh` has that the first key frame has otherwise.
fn difference(mesh: &Mesh, first: &crate::Topology) -> Option<String> {
    let found = &mesh.topology;
    let count = |what: &str, found: usize, first: usize| {
        (found != first).then(|| format!("{found} {what}, not {first}"))
    };
    let triangle = || {
        let (number, (a, b)) =
            found.triangles.iter().zip(&first.triangles).enumerate().find(|(_, (a, b))| a != b)?;
        Some(format!("triangle {number} joins vertices {a:?}, not {b:?}"))
    };
    let part = || {
        let differs = |(_, (a, b)): &(usize, (&crate::Part, &crate::Part))| {
            a.triangles != b.triangles || a.vertices != b.vertices
        };
        let (number, _) = found.parts.iter().zip(&first.parts).enumerate().find(differs)?;
        Some(format!("part {number} does not have the same range of triangles and vertices"))
    };
    count("vertices", found.vertex_count, first.vertex_count)
        .or_else(|| count("triangles", found.triangles.len(), first.triangles.len()))
        .or_else(|| count("parts", found.parts.len(), first.parts.len()))
        .or_else(triangle)
        .or_else(part)
}

#[cfg(test)]
mod tests;
