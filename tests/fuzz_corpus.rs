//! What the fuzzer starts from and what it once broke, and random bytes besides: none of it may
//! panic.

use std::path::Path;

use pivot_tests::{load_bytes, play_bytes};
use proptest::prelude::*;

/// Runs every input of a target's corpus; gives how many there are.
fn each(target: &str, run: impl Fn(&[u8])) -> usize {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target);
    let files: Vec<_> = folder.read_dir().expect("a corpus").map(|f| f.expect("readable").path()).collect();
    for file in &files {
        println!("{}", file.display());
        run(&std::fs::read(file).expect("readable"));
    }
    files.len()
}

fn mesh(bytes: &[u8]) {
    if let Some((kind, bytes)) = bytes.split_first() {
        load_bytes(["input.ply", "input.obj"][usize::from(kind % 2)], bytes);
    }
}

#[test]
fn corpus_of_updates() {
    assert!(each("updates", play_bytes) >= 8);
}

#[test]
fn corpus_of_gltf() {
    assert!(each("gltf", |bytes| load_bytes("input.glb", bytes)) >= 1);
}

#[test]
fn corpus_of_meshes() {
    assert!(each("mesh", mesh) >= 3);
}

#[test]
fn corpus_of_aff() {
    assert!(each("aff", |bytes| load_bytes("input.aff", bytes)) >= 2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn random_sequences_of_updates(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
        play_bytes(&bytes);
    }

    #[test]
    fn corpus_with_bytes_changed(changes in prop::collection::vec((any::<u16>(), any::<u8>()), 1..8)) {
        let changed = |bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            for &(at, to) in &changes {
                let at = usize::from(at) % bytes.len().max(1);
                bytes[at] = to;
            }
            bytes
        };
        each("gltf", |bytes| load_bytes("input.glb", &changed(bytes)));
        each("mesh", |bytes| mesh(&changed(bytes)));
        each("aff", |bytes| load_bytes("input.aff", &changed(bytes)));
    }
}
