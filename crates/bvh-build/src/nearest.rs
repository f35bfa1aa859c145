//! For each cluster the one nearby with which its hull is smallest.

use bvh_core::glam::{Mat4, Vec4};
use rayon::prelude::*;

use crate::item::{Hull, Item};
use crate::raw;

/// Largest search radius.
pub(crate) const MAX_RADIUS: usize = 32;

/// Clusters that are handled at a time.
const PART: usize = 256;

/// Of a cluster's place and another's: which is the nearest is decided by area and then by this, in the lowest bits of
/// the area. First the distance, then, as there are two at each, the parity of the lower place in units of the
/// greatest power of two that divides the distance. The two have different ones.
const RANK: u32 = 2 * MAX_RADIUS as u32 - 1;

/// Boxes of some clusters and of those near them, coordinate by coordinate.
#[repr(align(32))]
pub(crate) struct Window {
    /// Minima and maxima.
    bounds: [[f32; Window::SIZE]; 6],
    /// For each, behind [`MAX_RADIUS`] that are greatest, area and rank with another at some distance behind it, as
    /// bits whose order is that of areas and of equal ones of ranks.
    keys: [u32; Window::SIZE + MAX_RADIUS],
    /// The least key.
    least: [u32; Window::SIZE],
    /// Place of the first.
    start: usize,
    len: usize,
}

impl Window {
    const SIZE: usize = PART + 2 * MAX_RADIUS;

    fn new() -> Self {
        Self {
            bounds: [[0.0; Self::SIZE]; 6],
            keys: [u32::MAX; Self::SIZE + MAX_RADIUS],
            least: [u32::MAX; Self::SIZE],
            start: 0,
            len: 0,
        }
    }

    fn fill(&mut self, clusters: &[Item], start: usize) {
        (self.start, self.len) = (start, clusters.len());
        let (fours, rest) = clusters.as_chunks::<4>();
        for (i, four) in fours.iter().enumerate() {
            let hulls = four.each_ref().map(|item| item.hull());
            let min = columns(hulls.map(|hull| hull.min));
            let max = columns(hulls.map(|hull| hull.max));
            let axes = [min.x_axis, min.y_axis, min.z_axis, max.x_axis, max.y_axis, max.z_axis];
            for (to, axis) in self.bounds.iter_mut().zip(axes) {
                to[4 * i..4 * i + 4].copy_from_slice(&axis.to_array());
            }
        }
        for (i, item) in (4 * fours.len()..).zip(rest) {
            let Hull { min, max } = item.hull();
            let bounds = [min.x, min.y, min.z, max.x, max.y, max.z];
            for (to, bound) in self.bounds.iter_mut().zip(bounds) {
                to[i] = bound;
            }
        }
    }

    /// For the clusters from place `from` on, finds the places of those with the least keys, within `radius` and the
    /// window. One code for all SIMD levels: loops over plain arrays, which compilers turn into vector instructions.
    #[inline(always)]
    pub(crate) fn search(&mut self, radius: usize, from: usize, nearest: &mut [u32]) {
        let Self { bounds, keys, least, start, len } = self;
        let n = *len;
        least[..n].fill(u32::MAX);
        for distance in 1..=radius.min(n - 1) {
            let m = n - distance;
            let [a, b, c, d, e, f] = bounds.each_ref().map(|b| &b[..m]);
            let [a2, b2, c2, d2, e2, f2] = bounds.each_ref().map(|b| &b[distance..][..m]);
            let first = *start as u32;
            let shift = distance.trailing_zeros();
            let rank = 2 * (distance as u32 - 1);
            let forward = &mut keys[MAX_RADIUS..][..m];
            for i in 0..m {
                let x = max(d[i], d2[i]) - min(a[i], a2[i]);
                let y = max(e[i], e2[i]) - min(b[i], b2[i]);
                let z = max(f[i], f2[i]) - min(c[i], c2[i]);
                let area = x * y + (x + y) * z;
                let parity = (first + i as u32) >> shift & 1;
                forward[i] = area.to_bits() & !RANK | rank | parity;
            }
            // Not in the loop above, where a vector of keys at an odd place would span two that are still to be stored.
            keys[MAX_RADIUS + m..][..distance].fill(u32::MAX);
            let forward = keys[MAX_RADIUS..][..n].iter();
            let backward = keys[MAX_RADIUS - distance..][..n].iter();
            for ((least, &forward), &backward) in least[..n].iter_mut().zip(forward).zip(backward) {
                *least = (*least).min(forward).min(backward);
            }
        }
        let count = nearest.len();
        let least = &least[from - *start..][..count];
        let from = from as u32;
        for i in 0..count {
            let place = from + i as u32;
            let rank = least[i] & RANK;
            let distance = rank / 2 + 1;
            let unit = distance & distance.wrapping_neg();
            let is_upper = (u32::from(place & unit != 0) ^ rank) & 1;
            nearest[i] = place + distance - 2 * distance * is_upper;
        }
    }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn columns(rows: [Vec4; 4]) -> Mat4 {
    let [a, b, c, d] = rows;
    Mat4::from_cols(a, b, c, d).transpose()
}

/// Finds for each of at least two clusters the place of the one, at most `radius` places away, with which it has the
/// smallest hull.
pub(crate) fn find(clusters: &[Item], radius: usize, nearest: &mut [u32], threads: usize) {
    let find = |window: &mut Window, (part, nearest): (usize, &mut [u32])| {
        let start = part * PART;
        let first = start.saturating_sub(radius);
        let end = clusters.len().min(start + PART + radius);
        window.fill(&clusters[first..end], first);
        raw::search(window, radius, start, nearest);
    };
    if threads > 1 {
        nearest.par_chunks_mut(PART).enumerate().for_each_init(Window::new, find);
    } else {
        let mut window = Window::new();
        nearest.chunks_mut(PART).enumerate().for_each(|part| find(&mut window, part));
    }
}
