//! What measurements have in common: times, medians, pools of threads, test geometry.

use std::time::Instant;

/// Returns what `work` gives, and the nanoseconds that it takes.
pub fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let result = work();
    (start.elapsed().as_nanos() as f64, result)
}

/// Returns the median of some values, of an even number the greater of the two in the middle; NaN
/// of none.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Makes a pool of this number of threads.
///
/// # Panics
/// If the system gives no threads.
#[must_use]
pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// Returns a number between 0 and 1 for each `i`, the same in every run.
#[must_use]
pub fn noise(i: usize) -> f32 {
    let h = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
}

/// Returns the triangles of quads that share no corners: of each quad two corners, then the two
/// opposite ones.
#[must_use]
pub fn quads(count: usize) -> Vec<[u32; 3]> {
    let corners = (0..count as u32).map(|quad| 4 * quad);
    corners.flat_map(|c| [[c, c + 1, c + 2], [c + 1, c + 3, c + 2]]).collect()
}
