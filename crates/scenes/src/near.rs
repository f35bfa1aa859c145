//! Points near points: lists of neighbours from a hash grid.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// Finds for each point `i` all other points `j` within `reach` for which `wanted(i, j)`.
///
/// Points are sorted by the hash of their cell of a grid (Teschner et al. 2003), one in which cells
/// that follow each other along x have hashes that do: what is near is read from nine runs. A list
/// is in an order that depends on nothing but the positions.
pub(crate) fn neighbours(
    points: &[Vec3],
    reach: f32,
    wanted: impl Fn(usize, usize) -> bool + Sync,
) -> Vec<Vec<u32>> {
    let buckets = points.len().next_power_of_two().max(4);
    let hash = |c: IVec3| {
        let mixed = c.y.wrapping_mul(73_856_093) ^ c.z.wrapping_mul(19_349_663);
        mixed.wrapping_add(c.x) as u32 as usize & (buckets - 1)
    };
    let cells: Vec<IVec3> = points.iter().map(|&p| (p / reach).floor().as_ivec3()).collect();
    let mut first = vec![0_u32; buckets + 1];
    for &c in &cells {
        first[hash(c) + 1] += 1;
    }
    for b in 0..buckets {
        first[b + 1] += first[b];
    }
    let mut next = first.clone();
    let mut sorted = vec![(Vec3::ZERO, 0_u32); points.len()];
    for (i, (&p, &c)) in points.iter().zip(&cells).enumerate() {
        let slot = &mut next[hash(c)];
        sorted[*slot as usize] = (p, i as u32);
        *slot += 1;
    }
    let list = |i: usize| {
        let mut near = Vec::new();
        for (y, z) in (-1..=1).flat_map(|y| (-1..=1).map(move |z| (y, z))) {
            let row = cells[i] + IVec3::new(-1, y, z);
            let begin = hash(row);
            for bucket in (begin..begin + 3).map(|b| b & (buckets - 1)) {
                for &(p, j) in &sorted[first[bucket] as usize..first[bucket + 1] as usize] {
                    let close = p.distance_squared(points[i]) < reach * reach && j as usize != i;
                    // Another row may have the same hash.
                    let here = |c: IVec3| (c.y, c.z) == (row.y, row.z);
                    if close && here(cells[j as usize]) && wanted(i, j as usize) {
                        near.push(j);
                    }
                }
            }
        }
        near
    };
    (0..points.len()).into_par_iter().with_min_len(512).map(list).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn search_finds_what_comparing_all_pairs_finds() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut number = || 4.0 * random.f32() - 2.0;
        let points: Vec<Vec3> = (0..400).map(|_| Vec3::new(number(), number(), number())).collect();
        let mut pairs = 0;
        for (i, mut found) in neighbours(&points, 0.6, |i, j| (i + j) % 3 != 0).into_iter().enumerate() {
            found.sort_unstable();
            let all: Vec<u32> = (0..points.len())
                .filter(|&j| j != i && (i + j) % 3 != 0 && points[i].distance(points[j]) < 0.6)
                .map(|j| j as u32)
                .collect();
            assert_eq!(found, all);
            pairs += all.len();
        }
        assert!(pairs > 1000);
    }
}
