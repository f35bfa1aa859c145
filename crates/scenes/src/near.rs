//! Points near points: lists of neighbours from a hash grid.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// For each point, the others within a distance.
#[derive(Default)]
pub(crate) struct Neighbours {
    start: Vec<u32>,
    of: Vec<u32>,
}

impl Neighbours {
    pub(crate) fn of(&self, i: usize) -> &[u32] {
        &self.of[self.start[i] as usize..self.start[i + 1] as usize]
    }

    /// Finds for each point `i` all other points `j` within `reach` for which `wanted(i, j)`.
    ///
    /// Points are sorted by the hash of their cell of a grid (Teschner et al. 2003), one in which
    /// cells that follow each other along x have hashes that do: what is near is read from nine
    /// runs. A list is in an order that depends on nothing but the positions.
    pub(crate) fn search(
        &mut self,
        points: &[Vec3],
        reach: f32,
        wanted: impl Fn(usize, usize) -> bool + Sync,
    ) {
        /// Points whose lists are made together.
        const CHUNK: usize = 512;
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
        let lists = |chunk: usize| {
            let (mut near, mut ends) = (Vec::new(), Vec::new());
            for i in chunk * CHUNK..points.len().min((chunk + 1) * CHUNK) {
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
                ends.push(near.len() as u32);
            }
            (near, ends)
        };
        let lists: Vec<_> = (0..points.len().div_ceil(CHUNK)).into_par_iter().map(lists).collect();
        self.start.clear();
        self.of.clear();
        self.start.push(0);
        for (near, ends) in lists {
            let before = self.of.len() as u32;
            self.start.extend(ends.into_iter().map(|end| before + end));
            self.of.extend(near);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn search_finds_what_comparing_all_pairs_finds() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut number = || 4.0 * random.f32() - 2.0;
        let points: Vec<Vec3> = (0..400).map(|_| Vec3::new(number(), number(), number())).collect();
        let mut neighbours = Neighbours::default();
        neighbours.search(&points, 0.6, |i, j| (i + j) % 3 != 0);
        let mut pairs = 0;
        for i in 0..points.len() {
            let mut found = neighbours.of(i).to_vec();
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
