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
    /// The file is of no supported kind, is malformed, or lacks the clip asked for.
    #[error("{}: {problem}", file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// What it says, and where.
        problem: Problem,
    },
}

/// What can be loaded.
const SUPPORTED: &str =
    ".glb or .gltf (glTF 2.0), .aff (BART), .obj, .ply, .stl, or a directory of .obj or .ply key frames";

impl LoadError {
    /// The error for a `file` that the system cannot read.
    pub(crate) fn io(file: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        |source| Self::Io { file: file.to_owned(), source }
    }

    pub(crate) fn unsupported(file: &Path, found: &str) -> Self {
        Problem::new("kind of file", found, SUPPORTED).in_file(file)
    }

    /// The error for a clip `wanted` that is none of `clips`.
    pub(crate) fn unknown_clip(file: &Path, wanted: &str, clips: &[String]) -> Self {
        let listed: Vec<String> = clips.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
        let expected = match &listed[..] {
            [] => "no clip to be asked for, as there are none".to_owned(),
            listed => format!("one of {}", listed.join(", ")),
        };
        Problem::new("clips", format!("no clip {wanted:?}"), expected).in_file(file)
    }
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
    list.get(number).ok_or_else(|| {
        let expected = format!("one of the {} there are, counted from 0", list.len());
        Problem::new(place.to_string(), format!("no {what} {number}"), expected)
    })
}

/// Returns the text without control characters, which a terminal would obey; line ends and tabs
/// stay. Names in files may hold any.
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
