//! Sequences of updates: strategies and motions as the bytes say, everything checked after each.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pivot_tests::play_bytes(bytes));
