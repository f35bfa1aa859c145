//! Stamps the crate with a hash of its sources, so that key frames cached by other code are never
//! reused.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let mut files: Vec<PathBuf> = fs::read_dir("src")
        .expect("the crate has a src folder")
        .map(|e| e.expect("readable src").path())
        .collect();
    // What records rest on besides: normals that walls of shards follow, and versions of crates.
    let others = ["../anim/src/normals.rs", "../../Cargo.lock"].map(PathBuf::from);
    files.extend(others.into_iter().filter(|file| file.exists()));
    files.sort();
    let mut hasher = DefaultHasher::new();
    for file in &files {
        fs::read(file).expect("readable source").hash(&mut hasher);
    }
    env::var("CARGO_PKG_VERSION").expect("set by cargo").hash(&mut hasher);
    println!("cargo::rerun-if-changed=src");
    files.iter().for_each(|file| println!("cargo::rerun-if-changed={}", file.display()));
    println!("cargo::rustc-env=SCENES_SOURCE_HASH={:016x}", hasher.finish());
}
