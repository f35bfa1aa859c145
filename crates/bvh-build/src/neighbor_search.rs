//! For each cluster the nearby cluster with which its common bounds are smallest.

use bvh_core::glam::{Mat4, Vec4};
use bvh_core::slab::{max, min};
use rayon::prelude::*;

use crate::prim_ref::{Bounds, PrimRef};
use crate::raw;

/// Largest search radius.
pub(crate) const MAX_RADIUS: usize = 32;

/// Clusters that are handled at a time.
// Half and double: docs/TUNING.md.
const PART: usize = 256;

/// The rank, which takes the place of the lowest bits of an area. It decides between areas whose
/// other bits are equal. Its higher bits are the distance. Its lowest bit separates the two
/// clusters at one distance: it is the parity of the lower of the two places, in units of the
/// greatest power of two that divides the distance.
const RANK: u32 = 2 * MAX_RADIUS as u32 - 1;

/// Boxes of some clusters and of those near them, coordinate by coordinate.
#[repr(align(32))]
pub(crate) struct Window {
    /// Minima and maxima.
    coordinates: [[f32; Window::SIZE]; 6],
    /// For each, behind [`MAX_RADIUS`] that are greatest, area and rank with another at some
    /// distance behind it, as bits whose order is that of areas and of equal ones of ranks.
    keys: [u32; Window::SIZE + MAX_RADIUS],
    /// The least key.
    least: [u32; Window::SIZE],
    /// How far apart clusters may be.
    radius: usize,
    /// Place of the first.
    start: usize,
    len: usize,
}

impl Window {
    const SIZE: usize = PART + 2 * MAX_RADIUS;

    /// For clusters at most `radius` places apart, up to [`MAX_RADIUS`].
    pub(crate) fn new(radius: usize) -> Self {
        Self {
            coordinates: [[0.0; Self::SIZE]; 6],
            keys: [u32::MAX; Self::SIZE + MAX_RADIUS],
            least: [u32::MAX; Self::SIZE],
            radius,
            start: 0,
            len: 0,
        }
    }

    pub(crate) fn fill(&mut self, clusters: &[PrimRef], start: usize) {
        (self.start, self.len) = (start, clusters.len());
        let (fours, rest) = clusters.as_chunks::<4>();
        for (i, four) in fours.iter().enumerate() {
            let boxes = four.each_ref().map(PrimRef::bounds);
            let min = columns(boxes.map(|bounds| bounds.min));
            let max = columns(boxes.map(|bounds| bounds.max));
            let axes = [min.x_axis, min.y_axis, min.z_axis, max.x_axis, max.y_axis, max.z_axis];
            for (to, axis) in self.coordinates.iter_mut().zip(axes) {
                to[4 * i..4 * i + 4].copy_from_slice(&axis.to_array());
            }
        }
        for (i, prim) in (4 * fours.len()..).zip(rest) {
            let Bounds { min, max } = prim.bounds();
            let coordinates = [min.x, min.y, min.z, max.x, max.y, max.z];
            for (to, bound) in self.coordinates.iter_mut().zip(coordinates) {
                to[i] = bound;
            }
        }
    }

    /// For the clusters from place `from` on, finds the places of those with the least keys, within
    /// the radius and the window. One code for all SIMD levels: loops over plain arrays, which
    /// compilers turn into vector instructions.
    #[inline(always)]
    pub(crate) fn search(&mut self, from: usize, nearest: &mut [u32]) {
        let &mut Self { ref coordinates, ref mut keys, ref mut least, radius, start, len } = self;
        least[..len].fill(u32::MAX);
        for distance in 1..=radius.min(len - 1) {
            let m = len - distance;
            let [a, b, c, d, e, f] = coordinates.each_ref().map(|b| &b[..m]);
            let [a2, b2, c2, d2, e2, f2] = coordinates.each_ref().map(|b| &b[distance..][..m]);
            let first = start as u32;
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
            // Not in the loop above, where a vector of keys at an odd place would span two that are
            // still to be stored.
            keys[MAX_RADIUS + m..][..distance].fill(u32::MAX);
            let forward = keys[MAX_RADIUS..][..len].iter();
            let backward = keys[MAX_RADIUS - distance..][..len].iter();
            for ((least, &forward), &backward) in least[..len].iter_mut().zip(forward).zip(backward) {
                *least = (*least).min(forward).min(backward);
            }
        }
        let count = nearest.len();
        let least = &least[from - start..][..count];
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

fn columns(rows: [Vec4; 4]) -> Mat4 {
    let [a, b, c, d] = rows;
    Mat4::from_cols(a, b, c, d).transpose()
}

/// Finds for each of at least two clusters the place of the one, within the window's radius, with
/// which it has the smallest bounds. One thread uses `window`; several, each its own.
pub(crate) fn find(clusters: &[PrimRef], nearest: &mut [u32], window: &mut Window, threads: usize) {
    let find = |window: &mut Window, (part, nearest): (usize, &mut [u32])| {
        let start = part * PART;
        let first = start.saturating_sub(window.radius);
        let end = clusters.len().min(start + PART + window.radius);
        window.fill(&clusters[first..end], first);
        raw::search(window, start, nearest);
    };
    if threads > 1 {
        nearest.par_chunks_mut(PART).enumerate().for_each_init(|| Window::new(window.radius), find);
    } else {
        nearest.chunks_mut(PART).enumerate().for_each(|part| find(window, part));
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};
    use proptest::prelude::*;

    use super::*;

    fn clusters(boxes: &[Aabb]) -> Vec<PrimRef> {
        let bounds = |b: &Aabb| Bounds { min: b.min.extend(0.0), max: b.max.extend(0.0) };
        boxes.iter().zip(0..).map(|(b, i)| PrimRef::cluster(bounds(b), i, 1)).collect()
    }

    fn nearest(clusters: &[PrimRef], radius: usize, threads: usize) -> Vec<u32> {
        let mut nearest = vec![u32::MAX; clusters.len()];
        find(clusters, &mut nearest, &mut Window::new(radius), threads);
        nearest
    }

    proptest! {
        #[test]
        fn none_nearby_is_nearer(
            corners in prop::collection::vec(prop::array::uniform3(0f32..1.0), 2..700),
            radius in 1..=MAX_RADIUS,
        ) {
            let boxes: Vec<_> = corners.iter().map(|&c| Aabb::new(c.into(), Vec3::from(c) + 0.01)).collect();
            let clusters = clusters(&boxes);
            let nearest = nearest(&clusters, radius, 1);
            for (i, &j) in nearest.iter().enumerate() {
                let area = |j: usize| clusters[i].bounds().union(clusters[j].bounds()).half_area();
                let near = (i.saturating_sub(radius)..boxes.len().min(i + radius + 1)).filter(|&k| k != i);
                let least = near.map(area).fold(f32::INFINITY, f32::min);
                prop_assert!(j as usize != i && (j as usize).abs_diff(i) <= radius);
                // All but the bits of the rank.
                prop_assert!(area(j as usize) <= least * (1.0 + 2e-5), "{i} chose {j}");
            }
            prop_assert!((0..).zip(&nearest).any(|(i, &j)| nearest[j as usize] == i), "no two chose each other");
        }
    }

    #[test]
    fn equal_areas_pair_neighbours_across_windows_and_tasks() {
        let clusters = clusters(&vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 3 * PART + 1]);
        let neighbours = |i: u32| if i as usize == 3 * PART { i - 1 } else { i ^ 1 };
        let expected: Vec<_> = (0..clusters.len() as u32).map(neighbours).collect();
        for (radius, threads) in [(1, 1), (8, 1), (8, 3), (MAX_RADIUS, 3)] {
            assert_eq!(nearest(&clusters, radius, threads), expected);
        }
    }
}
