//! The loader of BART's scenes.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    pivot_tests::load_bytes("input.aff", bytes);
});
