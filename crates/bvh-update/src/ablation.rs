//! Switches that take one mechanism out of `Auto`, for one measurement.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

pub(crate) static WITHOUT: AtomicU32 = AtomicU32::new(0);

/// Names of the mechanisms, by bit.
pub const MECHANISMS: [&str; 13] = [
    "growth", "slope", "ray cost", "leaf uniformity", "clustered-scene rule", "periodic looks", "leaves",
    "fast builder", "good builder", "rotation schedule", "waits", "pays back twice", "keep the better tree",
];

pub(crate) fn is_off(bit: u32) -> bool {
    WITHOUT.load(Relaxed) >> bit & 1 == 1
}
