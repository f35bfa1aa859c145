//! What a host of WebAssembly calls: numbers in, numbers out.
#![cfg(target_family = "wasm")]
#![expect(unsafe_code, reason = "exported names are global; these two are of this library alone")]

use std::sync::OnceLock;

use bvh_core::SimdLevel;

static FOUND: OnceLock<Vec<(String, u64)>> = OnceLock::new();

fn found() -> &'static [(String, u64)] {
    FOUND.get_or_init(|| crate::fingerprints(SimdLevel::best()))
}

/// Number of fingerprints.
#[unsafe(no_mangle)]
extern "C" fn fingerprint_count() -> u32 {
    found().len() as u32
}

/// Fingerprint `i` in the order of the list; 0 beyond the end.
#[unsafe(no_mangle)]
extern "C" fn fingerprint(i: u32) -> u64 {
    found().get(i as usize).map_or(0, |(_, found)| *found)
}
