//! The glTF loader: any bytes are an error or an animation that can be posed.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    pivot_tests::load_bytes("input.glb", bytes);
});
