//! What measurements have in common: times, medians, test geometry.

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

/// Returns the triangles of quads that share no corners: of each quad two corners, then the two
/// opposite ones.
#[must_use]
pub fn quads(count: usize) -> Vec<[u32; 3]> {
    let corners = (0..count as u32).map(|quad| 4 * quad);
    corners.flat_map(|c| [[c, c + 1, c + 2], [c + 1, c + 3, c + 2]]).collect()
}
