//! Key-framed sequences: a directory of mesh files of one topology, a key frame each.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{LoadError, Problem};
use crate::files::{extension, read_beside};
use crate::mesh_file::read_mesh;
use crate::{DEFAULT_SECONDS_PER_FRAME, KeyFrames, Topology};

/// Loads the files of a directory as key frames, relative to `origin`.
pub(crate) fn load(directory: &Path, origin: DVec3) -> Result<KeyFrames, LoadError> {
    let files = mesh_files(directory)?;
    let none = || LoadError::unsupported(directory, "a directory without .ply or .obj files");
    let (first_file, others) = files.split_first().ok_or_else(none)?;
    let read = |file: &Path| read_beside(file, file.file_name().unwrap_or_default().as_ref());
    let first = read_mesh(first_file, &read(first_file)?, origin)?;
    let mut more = Vec::new();
    for file in others {
        let mesh = read_mesh(file, &read(file)?, origin)?;
        if let Some(difference) = difference(&mesh.topology, &first.topology) {
            let found = format!("{difference} as in {}", first_file.display());
            let expected = "the same vertices and faces in all key frames of a sequence";
            return Err(Problem::new("whole mesh", found, expected).in_file(file));
        }
        more.push(mesh.rest);
    }
    if more.len() == 1 {
        // Two frames go back and forth.
        more.push(first.rest.clone());
    }
    KeyFrames::new(first, more, DEFAULT_SECONDS_PER_FRAME).map_err(|problem| problem.in_file(directory))
}

/// The mesh files of `directory` in natural order.
fn mesh_files(directory: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let io = LoadError::io(directory);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(&io)? {
        let file = entry.map_err(&io)?.path();
        // Hidden files are what some systems leave beside the real ones.
        let hidden = file.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        // A frame that cannot be read must not be missed out, so that what is no folder is tried.
        if matches!(&*extension(&file), "obj" | "ply") && !hidden && !file.is_dir() {
            files.push(file);
        }
    }
    files.sort_by_cached_key(|file| (natural_order(&file.to_string_lossy()), file.clone()));
    if files.windows(2).any(|pair| extension(&pair[0]) != extension(&pair[1])) {
        let problem = Problem::new("files", "both .ply and .obj", "one kind in one sequence");
        return Err(problem.in_file(directory));
    }
    Ok(files)
}

/// What names are compared by: runs of digits by the number they stand for, which is greater if it
/// is longer without leading zeros, and everything else by character.
fn natural_order(name: &str) -> Vec<(char, usize, String)> {
    let chars: Vec<char> = name.chars().collect();
    let runs = chars.chunk_by(|a, b| a.is_ascii_digit() && b.is_ascii_digit());
    let order = runs.map(|run| match run[0] {
        '0'..='9' => {
            let number: String = run.iter().skip_while(|&&digit| digit == '0').collect();
            ('0', number.len(), number)
        }
        other => (other, 0, String::new()),
    });
    order.collect()
}

/// What a key frame has otherwise than the first.
fn difference(found: &Topology, first: &Topology) -> Option<String> {
    let counts = [
        ("vertices", found.vertex_count, first.vertex_count),
        ("triangles", found.triangles.len(), first.triangles.len()),
        ("parts", found.parts.len(), first.parts.len()),
    ];
    if let Some((what, found, first)) = counts.into_iter().find(|(_, found, first)| found != first) {
        return Some(format!("{found} {what}, not {first}"));
    }
    let mut triangles = found.triangles.iter().zip(&first.triangles).enumerate();
    if let Some((number, (a, b))) = triangles.find(|(_, (a, b))| a != b) {
        return Some(format!("triangle {number} joins vertices {a:?}, not {b:?}"));
    }
    let mut parts = found.parts.iter().zip(&first.parts);
    let number = parts.position(|(a, b)| (&a.triangles, &a.vertices) != (&b.triangles, &b.vertices))?;
    Some(format!("part {number} does not have the same range of triangles and vertices"))
}

#[cfg(test)]
mod tests;
