//! Where files go, and files that appear whole or not at all.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anim::printable;
use anyhow::{Context, Result, anyhow, ensure};

/// Returns the root of the workspace.
pub fn workspace() -> &'static Path {
    let lab = Path::new(env!("CARGO_MANIFEST_DIR"));
    lab.parent().unwrap_or(lab)
}

/// Folder for recorded simulations.
pub(crate) fn scene_cache() -> PathBuf {
    workspace().join("target/scenes")
}

/// Makes a folder and those above it.
///
/// # Errors
///
/// If that fails; the message names the folder.
pub fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("{}: cannot be made a folder", path.display()))
}

/// The folder that a file lies in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Checks that there is a regular file at a path, or nothing: a folder cannot be replaced, and a
/// device must not be.
pub(crate) fn ensure_replaceable(path: &Path) -> Result<()> {
    let free = fs::metadata(path).map_or(true, |kind| kind.is_file());
    ensure!(free, "{}: is no regular file, so it cannot be replaced by one", path.display());
    Ok(())
}

/// Checks before long work that a file can be written after it; makes its folder.
pub(crate) fn ensure_writable(path: &Path) -> Result<()> {
    make_folder(folder_of(path))?;
    ensure_replaceable(path)?;
    if path.exists() { Ok(()) } else { write_whole(path, b"").and_then(|()| remove_old(path)) }
}

/// Writes a file under a short temporary name beside its final place and renames it.
pub(crate) fn write_whole(path: &Path, content: &[u8]) -> Result<()> {
    ensure_replaceable(path)?;
    let written = scenes::write_whole(folder_of(path), path, content);
    written.map_err(|error| {
        // The error also names the temporary file, which users do not know.
        let error = error.to_string();
        let cause = error.split(" at path ").next().unwrap_or_default();
        anyhow!("{}: cannot be written: {cause}", path.display())
    })
}

/// Writes a file whole, and prints its name.
pub(crate) fn write_and_name(path: &Path, content: &[u8]) -> Result<()> {
    write_whole(path, content)?;
    print(&shown(path))
}

/// Reads a file.
///
/// # Errors
///
/// If that fails; the message names the file.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))
}

/// Held by the run that writes to a folder, and a sign that the folder is of runs.
pub(crate) const LOCK: &str = ".pivot-lock";

/// Locks a folder for one run at a time; the lock ends with the returned file. Nothing if the file
/// system has no locks, which is no reason to refuse a run.
pub(crate) fn lock(folder: &Path) -> Result<Option<File>> {
    let path = folder.join(LOCK);
    let file = File::create(&path).with_context(|| format!("{}: cannot be written", path.display()))?;
    match file.try_lock() {
        Err(fs::TryLockError::WouldBlock) => {
            anyhow::bail!("{}: another run writes there; name another --out", folder.display())
        }
        Err(fs::TryLockError::Error(_)) => Ok(None),
        Ok(()) => Ok(Some(file)),
    }
}

/// Removes a file of an earlier run, if there is one.
pub(crate) fn remove_old(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be replaced", path.display()))
        }
        _ => Ok(()),
    }
}

/// Removes the files of a folder whose names `is_old` knows.
pub(crate) fn remove_all(folder: &Path, is_old: impl Fn(&str) -> bool) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    for entry in entries.flatten().filter(|entry| entry.file_name().to_str().is_some_and(&is_old)) {
        remove_old(&entry.path())?;
    }
    Ok(())
}

/// A path as the user would name it: from the current folder, if it is below it.
pub(crate) fn shown(path: &Path) -> String {
    let here = std::env::current_dir().unwrap_or_default();
    printable(&path.strip_prefix(here).unwrap_or(path).display().to_string())
}

/// Prints a line to standard output; a reader that has left is an error.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", printable(text))
        .and_then(|()| out.flush())
        .context("standard output: cannot be written")
}

/// Prints a line to standard error, if that can be written: a remark is not worth ending a run.
pub fn remark(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", printable(text));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_may_be_as_long_as_names_can_be() {
        let folder = tempfile::tempdir().unwrap();
        let long = folder.path().join("n".repeat(251) + ".png");
        write_whole(&long, b"content").unwrap();
        assert_eq!(fs::read(&long).unwrap(), b"content");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
    }

    #[test]
    fn errors_name_the_file() {
        let error = write_whole(Path::new("no-such-directory/a.png"), b"").unwrap_err().to_string();
        assert!(error.contains("no-such-directory"), "{error}");
    }
}
