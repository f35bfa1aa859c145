//! The mesh loaders: the first byte chooses PLY, OBJ or STL.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some((kind, bytes)) = bytes.split_first() {
        pivot_tests::load_bytes(["input.ply", "input.obj", "input.stl"][usize::from(kind % 3)], bytes);
    }
});
