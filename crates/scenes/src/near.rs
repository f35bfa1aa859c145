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
    /// Points are sorted by the hash of their cell of a grid (Teschner et al. 2003); a list is in an order that
    /// depends on nothing but the positions.
    pub(crate) fn search(
        &mut self,
        points: &[Vec3],
        reach: f32,
        wanted: impl Fn(usize, usize) -> bool + Sync,
    ) {
        let buckets = points.len().next_power_of_two();
        let cell = |p: Vec3| (p / reach).floor().as_ivec3();
        let hash = |c: IVec3| {
            let mixed =
                c.x.wrapping_mul(73_856_093) ^ c.y.wrapping_mul(19_349_663) ^ c.z.wrapping_mul(83_492_791);
            mixed as u32 as usize & (buckets - 1)
        };
        let mut first = vec![0_u32; buckets + 1];
        for &p in points {
            first[hash(cell(p)) + 1] += 1;
        }
        for b in 0..buckets {
            first[b + 1] += first[b];
        }
        let mut next = first.clone();
        let mut sorted = vec![0_u32; points.len()];
        for (i, &p) in points.iter().enumerate() {
            let slot = &mut next[hash(cell(p))];
            sorted[*slot as usize] = i as u32;
            *slot += 1;
        }
        let list = |i: usize| {
            let mut near = Vec::new();
            let mut seen = [usize::MAX; 27];
            for (k, bucket) in around(cell(points[i])).map(hash).enumerate() {
                if seen.contains(&bucket) {
                    continue;
                }
                seen[k] = bucket;
                for &j in &sorted[first[bucket] as usize..first[bucket + 1] as usize] {
                    let close = points[j as usize].distance_squared(points[i]) < reach * reach;
                    if close && j as usize != i && wanted(i, j as usize) {
                        near.push(j);
                    }
                }
            }
            near
        };
        let lists: Vec<Vec<u32>> = (0..points.len()).into_par_iter().with_min_len(512).map(list).collect();
        self.start.clear();
        self.of.clear();
        self.start.push(0);
        for list in lists {
            self.of.extend(list);
            self.start.push(self.of.len() as u32);
        }
    }
}

/// A cell and the 26 around it.
fn around(cell: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |k| cell + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))
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
