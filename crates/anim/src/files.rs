//! Reading whole files, and the files that they name, which must lie below their folder.

use std::path::{Component, Path, PathBuf};

use crate::error::{LoadError, Problem};

/// What kind of file a name says it is: its extension, in lower case.
pub(crate) fn extension(file: &Path) -> String {
    file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// The path that a relative name stands for, if that stays below the folder it is relative to.
pub(crate) fn below_folder(name: &str) -> Option<PathBuf> {
    let mut path = PathBuf::new();
    for component in Path::new(name).components() {
        match component {
            Component::Normal(part) => path.push(part),
            Component::CurDir => {}
            Component::ParentDir if path.pop() => {}
            _ => return None,
        }
    }
    (!path.as_os_str().is_empty()).then_some(path)
}

/// Reads a whole regular file that `file` names `relative` to its folder; a link that leads out of
/// that folder is refused.
pub(crate) fn read_beside(file: &Path, relative: &Path) -> Result<Vec<u8>, LoadError> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let named = folder.join(relative);
    let home = Path::new(".").join(folder).canonicalize().map_err(LoadError::io(&named))?;
    if !named.canonicalize().map_err(LoadError::io(&named))?.starts_with(home) {
        let found = "a link that leads out of the folder of the file that names it";
        return Err(Problem::new("path", found, "a file below that folder").in_file(&named));
    }
    read_file(&named)
}

/// The error for what is no regular file.
pub(crate) fn irregular(file: &Path) -> LoadError {
    Problem::new("kind of file", "a pipe, a device or a folder", "a regular file").in_file(file)
}

/// Reads a whole regular file. (Anything else, such as a device, may never end.)
pub(crate) fn read_file(file: &Path) -> Result<Vec<u8>, LoadError> {
    if !std::fs::metadata(file).map_err(LoadError::io(file))?.is_file() {
        return Err(irregular(file));
    }
    std::fs::read(file).map_err(LoadError::io(file))
}

/// A text without the byte order mark that some editors put at its start.
pub(crate) fn unmarked(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}
