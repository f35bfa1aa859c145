//! Finding the library.
#![expect(unsafe_code, reason = "loading a library runs its initialisers")]

use std::env;
use std::fs;
use std::mem;
use std::path::{Path, PathBuf};

use libloading::Library;

use super::api::Api;
use super::not_found::{NotFound, VARIABLE};

/// Names that the system's loader may know, best first.
const NAMES: [&str; 7] = [
    "libembree4.so.4",
    "libembree4.so",
    "libembree3.so.3",
    "libembree3.so",
    "libembree4.dylib",
    "libembree4.4.dylib",
    "embree4.dll",
];

pub(super) fn load(path: Option<&Path>) -> Result<Api, NotFound> {
    let named = path
        .map(Path::to_owned)
        .or_else(|| env::var_os(VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from));
    match named {
        Some(path) => {
            let file = find(&path, 2).ok_or(NotFound::NotThere(path))?;
            file.parent().into_iter().for_each(load_tbb);
            open(&file)
        }
        None => {
            let found = NAMES.iter().find_map(|name| open(Path::new(name)).ok());
            found.ok_or(NotFound::Nowhere)
        }
    }
}

/// The library itself, or the best one in a folder or those in it.
fn find(path: &Path, depth: u32) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_owned());
    }
    let mut all: Vec<PathBuf> = fs::read_dir(path).ok()?.filter_map(|e| Some(e.ok()?.path())).collect();
    all.sort();
    let is_version = |file: &PathBuf, version| {
        let stem = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let stem = stem.strip_prefix("lib").unwrap_or(stem);
        file.is_file() && stem.starts_with(version)
    };
    let here = ["embree4", "embree3"].iter().find_map(|v| all.iter().find(|f| is_version(f, v)).cloned());
    let folders = all.iter().filter(|f| depth > 0 && f.is_dir());
    here.or_else(|| folders.filter_map(|f| find(f, depth - 1)).next())
}

/// Loads a TBB that lies in a folder, for good; that it fails shows when Embree is loaded.
fn load_tbb(folder: &Path) {
    let files = fs::read_dir(folder).into_iter().flatten().filter_map(|e| Some(e.ok()?.path()));
    let is_tbb = |file: &PathBuf| {
        let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        name.starts_with("libtbb.") || name.starts_with("libtbb-") || name.starts_with("tbb12.")
    };
    for file in files.filter(is_tbb) {
        // SAFETY: its initialisers are those that loading Embree would run.
        if let Ok(library) = unsafe { Library::new(file) } {
            mem::forget(library);
        }
    }
}

fn open(path: &Path) -> Result<Api, NotFound> {
    let broken = |error: libloading::Error| NotFound::Broken {
        path: path.to_owned(),
        reason: error.to_string().split_whitespace().collect::<Vec<_>>().join(" "),
    };
    // SAFETY: the caller asked for this library; Embree's initialisers have no preconditions.
    let library = unsafe { Library::new(path) }.map_err(broken)?;
    Api::new(library).map_err(broken)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_library_is_refused_in_one_line() {
        let missing = load(Some(Path::new("no/such/place"))).err().expect("not there").to_string();
        assert!(missing.contains("no/such/place") && missing.contains("libembree4"), "{missing}");
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let broken = load(Some(&here)).err().expect("no library").to_string();
        assert!(broken.contains("Cargo.toml") && !broken.contains('\n'), "{broken}");
        assert!(!NotFound::Nowhere.to_string().contains("  "));
    }
}
