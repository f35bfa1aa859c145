//! For each cluster the one nearby with which its hull is smallest.

use bvh_core::glam::{Mat4, Vec4};
use rayon::prelude::*;

use crate::item::Item;
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
    /// Area and rank of each with another, as an `f32` whose order is that of areas and of equal ones of ranks.
    keys: [f32; Window::SIZE],
    /// The least key.
    least: [f32; Window::SIZE],
    /// Place of the first.
    start: usize,
    len: usize,
}

impl Window {
    const SIZE: usize = PART + 2 * MAX_RADIUS;

    fn new() -> Self {
        let zeros = [0.0; Self::SIZE];
        Self { bounds: [zeros; 6], keys: zeros, least: zeros, start: 0, len: 0 }
    }

    fn fill(&mut self, clusters: &[Item], start: usize) {
        (self.start, self.len) = (start, clusters.len());
        let [min_x, min_y, min_z, max_x, max_y, max_z] = &mut self.bounds;
        for (four, i) in clusters.chunks(4).zip((0..).step_by(4)) {
            let hulls = [0, 1, 2, 3].map(|k| four.get(k).unwrap_or(&four[0]).hull());
            let [min, max] = [hulls.map(|h| h.min), hulls.map(|h| h.max)].map(columns);
            let to = [&mut *min_x, min_y, min_z, max_x, max_y, max_z];
            for (to, from) in
                to.into_iter().zip([min.x_axis, min.y_axis, min.z_axis, max.x_axis, max.y_axis, max.z_axis])
            {
                to[i..i + 4].copy_from_slice(&from.to_array());
            }
        }
    }

    /// Finds the least keys of all, within `radius` and the window. One code for all SIMD levels: loops over plain
    /// arrays, which compilers turn into vector instructions.
    #[inline(always)]
    pub(crate) fn search(&mut self, radius: usize) {
        let n = self.len;
        self.least[..n].fill(f32::INFINITY);
        for distance in 1..=radius.min(n - 1) {
            let m = n - distance;
            let [near, far] = [0, distance].map(|i| self.bounds.each_ref().map(|b| &b[i..i + m]));
            let first = self.start as u32;
            let shift = distance.trailing_zeros();
            let rank = 2 * (distance as u32 - 1);
            let min = |a: f32, b: f32| if a < b { a } else { b };
            let max = |a: f32, b: f32| if a > b { a } else { b };
            let keys = &mut self.keys[..m];
            for i in 0..m {
                let extent =
                    |axis: usize| max(near[axis + 3][i], far[axis + 3][i]) - min(near[axis][i], far[axis][i]);
                let (x, y, z) = (extent(0), extent(1), extent(2));
                let area = x * y + (x + y) * z;
                let parity = (first + i as u32) >> shift & 1;
                keys[i] = f32::from_bits(area.to_bits() & !RANK | rank | parity);
            }
            for (least, &key) in self.least.iter_mut().zip(&*keys) {
                *least = min(*least, key);
            }
            for (least, &key) in self.least[distance..].iter_mut().zip(&*keys) {
                *least = min(*least, key);
            }
        }
    }

    /// The place that belongs to a least key.
    #[inline]
    fn nearest(&self, i: usize) -> u32 {
        let rank = self.least[i].to_bits() & RANK;
        let distance = rank / 2 + 1;
        let place = (self.start + i) as u32;
        let parity = place >> distance.trailing_zeros() & 1;
        if parity == rank & 1 { place + distance } else { place - distance }
    }
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
        raw::search(window, radius);
        for (i, nearest) in nearest.iter_mut().enumerate() {
            *nearest = window.nearest(start - first + i);
        }
    };
    if threads > 1 {
        nearest.par_chunks_mut(PART).enumerate().for_each_init(Window::new, find);
    } else {
        let mut window = Window::new();
        nearest.chunks_mut(PART).enumerate().for_each(|part| find(&mut window, part));
    }
}
