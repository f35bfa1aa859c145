//! Simplification by edge collapses in order of quadric error (Garland and Heckbert 1997), which
//! leaves large triangles where a surface is flat and small ones where it bends, as on simplified
//! scans.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use glam::DVec3;
use indexmap::IndexSet;

use crate::shape::Mesh;

/// A sum of squared distances to planes, `p·A·p + 2 b·p + c` with A symmetric: xx, yy, zz, xy, xz
/// and yz of A, then b, then c.
type Quadric = [f64; 10];

fn plane(n: DVec3, offset: f64, weight: f64) -> Quadric {
    let [xx, yy, zz, xy, xz, yz] =
        [n.x * n.x, n.y * n.y, n.z * n.z, n.x * n.y, n.x * n.z, n.y * n.z].map(|v| v * weight);
    let b = n * (offset * weight);
    [xx, yy, zz, xy, xz, yz, b.x, b.y, b.z, offset * offset * weight]
}

fn sum(a: &Quadric, b: &Quadric) -> Quadric {
    std::array::from_fn(|i| a[i] + b[i])
}

fn error([xx, yy, zz, xy, xz, yz, bx, by, bz, c]: &Quadric, p: DVec3) -> f64 {
    let squares = xx * p.x * p.x + yy * p.y * p.y + zz * p.z * p.z;
    let products = xy * p.x * p.y + xz * p.x * p.z + yz * p.y * p.z;
    (squares + 2.0 * (products + (bx * p.x + by * p.y + bz * p.z)) + c).max(0.0)
}

struct Simplifier {
    positions: Vec<DVec3>,
    quadrics: Vec<Quadric>,
    triangles: Vec<[u32; 3]>,
    /// Triangles at each vertex, but for collapsed ones.
    around: Vec<Vec<u32>>,
    /// Counts the changes of a vertex; an edge queued before its ends changed is out of date.
    version: Vec<u32>,
    /// The edges, the least error first.
    queue: BinaryHeap<Candidate>,
    /// Error per length to the fourth of every edge, so that flat parts are not left with next to
    /// no triangles.
    evenness: f64,
}

/// Bits of an edge's error (never negative, so that they are in the order of the numbers), its two
/// ends, and the sum of their versions, which only grow.
type Candidate = Reverse<(u32, u32, u32, u32)>;

/// Collapses edges until at most `target` triangles are left, or no edge can go without folding the
/// surface.
pub(crate) fn decimate(mesh: &Mesh, target: usize) -> Mesh {
    let mut s = Simplifier::new(mesh, target);
    let mut left = mesh.triangles.len();
    while left > target {
        let Some(Reverse((_, a, b, versions))) = s.queue.pop() else { break };
        if s.versions(a, b) == versions && s.collapse(a, b) {
            left -= 2;
        }
    }
    s.finish()
}

impl Simplifier {
    fn new(mesh: &Mesh, target: usize) -> Self {
        let positions: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
        let mut quadrics = vec![Quadric::default(); positions.len()];
        let mut around = vec![Vec::new(); positions.len()];
        let mut area = 0.0;
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let [p, q, r] = triangle.map(|v| positions[v as usize]);
            let cross = (q - p).cross(r - p);
            area += 0.5 * cross.length();
            let normal = cross.normalize_or_zero();
            let quadric = plane(normal, -normal.dot(p), cross.length());
            for &v in triangle {
                quadrics[v as usize] = sum(&quadrics[v as usize], &quadric);
                around[v as usize].push(t as u32);
            }
        }
        let mut s = Self {
            version: vec![0; positions.len()],
            positions,
            quadrics,
            around,
            triangles: mesh.triangles.clone(),
            queue: BinaryHeap::new(),
            // Lets edges of flat parts grow to several times the length of those at curvature 1.
            evenness: 4e-5 * area / target.max(1) as f64,
        };
        let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        s.queue = edges.filter(|(a, b)| a < b).map(|(a, b)| s.candidate(a, b)).collect();
        s
    }

    fn candidate(&self, a: u32, b: u32) -> Candidate {
        let error = self.placed(a, b).1 as f32;
        Reverse((error.to_bits(), a, b, self.versions(a, b)))
    }

    fn versions(&self, a: u32, b: u32) -> u32 {
        self.version[a as usize] + self.version[b as usize]
    }

    /// Where the vertex of a collapsed edge goes (an end or the middle), and its error.
    fn placed(&self, a: u32, b: u32) -> (DVec3, f64) {
        let [p, q] = [a, b].map(|v| self.positions[v as usize]);
        let quadric = sum(&self.quadrics[a as usize], &self.quadrics[b as usize]);
        let tried = [0.5 * (p + q), p, q].map(|x| (x, error(&quadric, x)));
        let best = tried.into_iter().fold(tried[0], |best, x| if x.1 < best.1 { x } else { best });
        (best.0, best.1 + self.evenness * p.distance_squared(q) * p.distance_squared(q))
    }

    /// Collapses an edge, and with it two triangles, if the surface stays a surface.
    fn collapse(&mut self, a: u32, b: u32) -> bool {
        let (at, _) = self.placed(a, b);
        if !self.is_allowed(a, b, at) {
            return false;
        }
        for t in std::mem::take(&mut self.around[b as usize]) {
            let triangle = self.triangles[t as usize];
            self.triangles[t as usize] = triangle.map(|v| if v == b { a } else { v });
            if triangle.contains(&a) {
                // Left with two equal corners.
                triangle.iter().for_each(|&v| self.around[v as usize].retain(|&other| other != t));
            } else {
                self.around[a as usize].push(t);
            }
        }
        self.positions[a as usize] = at;
        self.quadrics[a as usize] = sum(&self.quadrics[a as usize], &self.quadrics[b as usize]);
        self.version[a as usize] += 1;
        self.version[b as usize] += 1;
        for v in self.neighbours(a) {
            self.queue.push(self.candidate(a.min(v), a.max(v)));
        }
        true
    }

    /// Two common neighbours across two triangles (the link condition), and no triangle turned
    /// over.
    fn is_allowed(&self, a: u32, b: u32, at: DVec3) -> bool {
        let shared =
            self.around[a as usize].iter().filter(|&&t| self.triangles[t as usize].contains(&b)).count();
        let common = self.neighbours(a).intersection(&self.neighbours(b)).count();
        shared == 2 && common == 2 && !self.turns_over(a, b, at) && !self.turns_over(b, a, at)
    }

    fn turns_over(&self, v: u32, other: u32, at: DVec3) -> bool {
        let triangles = self.around[v as usize].iter().map(|&t| self.triangles[t as usize]);
        triangles.filter(|t| !t.contains(&other)).any(|t| {
            let [p, q, r] = t.map(|w| self.positions[w as usize]);
            let [x, y, z] = t.map(|w| if w == v { at } else { self.positions[w as usize] });
            let (before, after) = ((q - p).cross(r - p), (y - x).cross(z - x));
            before.dot(after) <= 0.2 * before.length() * after.length()
        })
    }

    fn neighbours(&self, v: u32) -> BTreeSet<u32> {
        let triangles = self.around[v as usize].iter().map(|&t| self.triangles[t as usize]);
        triangles.flatten().filter(|&w| w != v).collect()
    }

    /// The triangles left, with vertices renumbered in order of first use.
    fn finish(self) -> Mesh {
        let mut used = IndexSet::new();
        let left = self.triangles.iter().filter(|&&[a, b, c]| a != b && b != c && c != a);
        let triangles = left.map(|t| t.map(|v| used.insert_full(v).0 as u32)).collect();
        let positions = used.iter().map(|&v| self.positions[v as usize].as_vec3()).collect();
        Mesh { positions, triangles }
    }
}

#[cfg(test)]
mod tests {
    use glam::vec3;

    use super::*;
    use crate::{dragon, meshing};

    fn volume(mesh: &Mesh) -> f32 {
        mesh.corners().map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum()
    }

    #[test]
    fn decimation_reaches_its_target_keeps_the_volume_and_makes_triangles_uneven() {
        let fine = meshing::mesh(&dragon::solid(), vec3(-6.6, -0.3, -6.2), vec3(6.6, 7.6, 5.6), 0.08);
        let target = fine.triangles.len() / 4;
        let coarse = decimate(&fine, target);
        assert!(coarse.triangles.len() <= target && coarse.triangles.len() + 2 > target);
        let (before, after) = (volume(&fine), volume(&coarse));
        assert!(before > 10.0 && (after / before - 1.0).abs() < 0.01, "{before} {after}");
        let spread = |mesh: &Mesh| {
            let mut areas: Vec<f32> =
                mesh.corners().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).collect();
            areas.sort_by(f32::total_cmp);
            areas[areas.len() * 99 / 100] / areas[areas.len() / 2]
        };
        println!("99th percentile of areas over median: {:.1}, was {:.1}", spread(&coarse), spread(&fine));
        assert!(spread(&coarse) > 2.0 * spread(&fine));
    }
}
