//! Where files go, and files that appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// The root of the workspace.
pub(crate) fn workspace() -> &'static Path {
    let xtask = Path::new(env!("CARGO_MANIFEST_DIR"));
    xtask.parent().unwrap_or(xtask)
}

/// Folder for recorded simulations.
pub(crate) fn scene_cache() -> PathBuf {
    workspace().join("target/scenes")
}

/// Makes a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("{}: cannot be made a folder", path.display()))
}

/// Checks that there is a regular file at a path, or nothing: a folder cannot be replaced, and a device must not be.
pub(crate) fn ensure_replaceable(path: &Path) -> Result<()> {
    let free = fs::metadata(path).map_or(true, |kind| kind.is_file());
    ensure!(free, "{}: is no regular file, so it cannot be replaced by one", path.display());
    Ok(())
}

/// Writes a file beside its final place and renames it.
pub(crate) fn write_whole(path: &Path, content: &[u8]) -> Result<()> {
    ensure_replaceable(path)?;
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.partial", std::process::id()));
    let partial = path.with_file_name(name);
    File::create(&partial)
        .and_then(|mut file| {
            file.write_all(content)?;
            // Some file systems say as late as this that the disk is full.
            file.sync_all()
        })
        .and_then(|()| fs::rename(&partial, path))
        .inspect_err(|_| {
            // It may not even exist, and the first error is the one to tell.
            let _ = fs::remove_file(&partial);
        })
        .with_context(|| format!("{}: cannot be written", path.display()))
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
    for entry in entries {
        let entry = entry.with_context(|| format!("{}: cannot be read", folder.display()))?;
        if entry.file_name().to_str().is_some_and(&is_old) {
            remove_old(&entry.path())?;
        }
    }
    Ok(())
}

/// A path as the user would name it: from the workspace's root, if it is below it.
pub(crate) fn shown(path: &Path) -> String {
    path.strip_prefix(workspace()).unwrap_or(path).display().to_string()
}

/// Prints a line to standard output; a reader that has left is an error.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{text}").and_then(|()| out.flush()).context("standard output: cannot be written")
}

/// Prints a line to standard error, as far as that can be written: a remark is not worth ending a run.
pub(crate) fn tell(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
