//! Why a file could not be loaded: the file, the place in it, what was found and what was expected.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Why something could not be loaded. Every message is one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file or directory could not be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Io {
        /// What was to be read.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The kind of file is not one that can be loaded.
    #[error(
        "{}: {found}; supported are .glb and .gltf (glTF 2.0), .aff (BART), .obj, .ply, .stl, and a directory of .obj or .ply key frames",
        file.display()
    )]
    Unsupported {
        /// What was to be loaded.
        file: PathBuf,
        /// What it is instead.
        found: String,
    },
    /// The file says something that cannot be.
    #[error("{}: {problem}", file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// What it says, and where.
        problem: Problem,
    },
    /// The clip asked for is not in the file.
    #[error("{}: no clip {wanted:?}; {}", file.display(), list_clips(clips))]
    UnknownClip {
        /// The file.
        file: PathBuf,
        /// The name or number asked for.
        wanted: String,
        /// Names of the clips there are, in order.
        clips: Vec<String>,
    },
}

impl LoadError {
    pub(crate) fn unsupported(file: &Path, found: impl Into<String>) -> Self {
        Self::Unsupported { file: file.to_owned(), found: found.into() }
    }

    pub(crate) fn unknown_clip(file: &Path, wanted: &str, clips: Vec<String>) -> Self {
        Self::UnknownClip { file: file.to_owned(), wanted: wanted.to_owned(), clips }
    }
}

fn list_clips(clips: &[String]) -> String {
    if clips.is_empty() {
        return "there are no clips to choose from".into();
    }
    let listed: Vec<String> = clips.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
    format!("there are: {}", listed.join(", "))
}

/// How many vertices or triangles there may be.
pub(crate) const NUMBERED: &str = "as many as 32 bits can number";

/// What is wrong inside of a file or a mesh.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct Problem {
    /// Where, by the names and numbers the file uses.
    pub place: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub expected: String,
}

impl Problem {
    /// `found` may be the message of a parsing library.
    pub(crate) fn new(place: impl Into<String>, found: impl Display, expected: impl Into<String>) -> Self {
        Self { place: place.into(), found: one_line(&found.to_string()), expected: expected.into() }
    }

    pub(crate) fn in_file(self, file: &Path) -> LoadError {
        LoadError::Invalid { file: file.to_owned(), problem: self }
    }
}

/// The element of `list` that `place` names by a number.
pub(crate) fn numbered<'a, T>(
    list: &'a [T],
    number: usize,
    what: &str,
    place: impl Display,
) -> Result<&'a T, Problem> {
    let (found, expected) = (|| format!("no {what} {number}"), || format!("a number below {}", list.len()));
    list.get(number).ok_or_else(|| Problem::new(place.to_string(), found(), expected()))
}

/// Text without control characters, which a terminal would obey; line ends and tabs stay. Names in
/// files may hold any.
#[must_use]
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && c != '\n' && c != '\t' { '\u{fffd}' } else { c }).collect()
}

/// The start of a text, as one line. Parsers quote what they choke on, line breaks, binary and all,
/// and a uri may hold megabytes.
pub(crate) fn one_line(message: &str) -> String {
    const LONGEST: usize = 200;
    let words = message.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let line = words.collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &line[..end]),
        None => line,
    }
}
