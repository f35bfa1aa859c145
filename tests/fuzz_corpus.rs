//! What the fuzzer starts from and what it once broke, and random bytes besides: none of it may
//! panic.

use std::cell::Cell;
use std::path::Path;

use pivot_tests::{load_bytes, play_bytes};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

/// The files of a target's corpus.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target);
    let files = folder.read_dir().expect("a corpus").map(|f| f.expect("readable").path());
    files.map(|file| std::fs::read(file).expect("readable")).collect()
}

/// Whether the loader of a target takes the bytes.
fn loads(target: &str, bytes: &[u8]) -> bool {
    match (target, bytes.split_first()) {
        ("mesh", None) => false,
        ("mesh", Some((kind, bytes))) => {
            load_bytes(["input.ply", "input.obj", "input.stl"][usize::from(kind % 3)], bytes)
        }
        ("gltf", _) => load_bytes("input.glb", bytes),
        _ => load_bytes("input.aff", bytes),
    }
}

const LOADERS: [(&str, usize); 3] = [("gltf", 1), ("mesh", 5), ("aff", 2)];

#[test]
fn recorded_update_sequences_keep_every_promise() {
    let corpus = corpus("updates");
    assert!(corpus.len() >= 8);
    corpus.iter().for_each(|bytes| play_bytes(bytes));
}

#[test]
fn every_corpus_file_loads_and_poses_at_any_time() {
    for (target, least) in LOADERS {
        let corpus = corpus(target);
        assert!(corpus.len() >= least, "{target}");
        let refused = corpus.iter().filter(|bytes| !loads(target, bytes)).count();
        assert_eq!(refused, 0, "{target}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn random_sequences_of_updates_keep_every_promise(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
        play_bytes(&bytes);
    }
}

#[test]
fn corpus_files_with_bytes_changed_load_or_are_refused() {
    let loaded = LOADERS.map(|_| Cell::new(0));
    // Digits, too: texts with any other byte seldom load.
    let byte = prop_oneof![any::<u8>(), b'0'..=b'9'];
    let changes = prop::collection::vec((any::<u16>(), byte), 1..8);
    let config = ProptestConfig { source_file: Some(file!()), ..ProptestConfig::with_cases(200) };
    let result = TestRunner::new(config).run(&changes, |changes| {
        for ((target, _), loaded) in LOADERS.iter().zip(&loaded) {
            for mut bytes in corpus(target) {
                for &(at, to) in &changes {
                    let at = usize::from(at) % bytes.len();
                    bytes[at] = to;
                }
                loaded.set(loaded.get() + u32::from(loads(target, &bytes)));
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    assert!(loaded.iter().all(|loaded| loaded.get() > 0), "{loaded:?} of the changed files load");
}
