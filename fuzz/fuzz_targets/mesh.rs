//! The mesh loaders: the first byte chooses PLY or OBJ.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some((kind, bytes)) = bytes.split_first() {
        pivot_tests::load_bytes(["input.ply", "input.obj"][usize::from(kind % 2)], bytes);
    }
});
