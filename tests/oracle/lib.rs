//! Naive oracles and small inputs for the cross-crate tests: everything here is written the obvious
//! way, in double precision, and shares no code with what it checks.
#![forbid(unsafe_code)]

mod bytes;
mod hits;
mod motion;

use bvh_core::glam::{DVec3, Vec3};
use bvh_core::{Bvh, Node};

pub use bytes::{load_bytes, play_bytes};
pub use hits::check_hit;
pub use motion::{Motion, Soup, noise};

/// Makes a pool of `threads` threads.
///
/// # Panics
/// If the system has no threads to give.
#[must_use]
pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// The nearest triangle that a ray hits, by testing them all in double precision (Möller and
/// Trumbore 1997): distance and number, or `None`. Triangles with a corner that is not finite are
/// not hit.
#[must_use]
pub fn closest_hit(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    from: Vec3,
    along: Vec3,
) -> Option<(f64, usize)> {
    let hit = |triangle: &[u32; 3]| {
        let ([u, v], t) = crossing(positions, *triangle, from, along);
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0 && t.is_finite()).then_some(t)
    };
    let hits = triangles.iter().enumerate().filter_map(|(i, t)| hit(t).map(|t| (t, i)));
    hits.min_by(|a, b| a.partial_cmp(b).expect("finite distances"))
}

/// How far inside of a triangle a ray crosses its plane: the least barycentric coordinate, in
/// double precision.
#[must_use]
pub fn margin(positions: &[Vec3], triangle: [u32; 3], from: Vec3, along: Vec3) -> f64 {
    let ([u, v], _) = crossing(positions, triangle, from, along);
    u.min(v).min(1.0 - u - v)
}

/// Two barycentric coordinates and the distance of where a ray crosses a triangle's plane; not
/// finite if it does not.
fn crossing(positions: &[Vec3], triangle: [u32; 3], from: Vec3, along: Vec3) -> ([f64; 2], f64) {
    let (from, along) = (from.as_dvec3(), along.as_dvec3());
    let [a, b, c] = triangle.map(|v| positions[v as usize].as_dvec3());
    let (ab, ac) = (b - a, c - a);
    let p = along.cross(ac);
    let det = ab.dot(p);
    let s = from - a;
    let q = s.cross(ab);
    ([s.dot(p) / det, along.dot(q) / det], ac.dot(q) / det)
}

/// SAH cost of a tree over triangles as they are now, from its structure and the triangles alone:
/// no box of the tree is read. Both constants are 1.
#[must_use]
pub fn sah_cost(bvh: &Bvh, positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    type Corners = (DVec3, DVec3);
    const NOTHING: Corners = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let union = |a: Corners, b: Corners| (a.0.min(b.0), a.1.max(b.1));
    let half_area = |(min, max): Corners| {
        let e: DVec3 = if min.x > max.x { DVec3::ZERO } else { max - min };
        e.x * e.y + e.y * e.z + e.z * e.x
    };
    fn sum(
        bvh: &Bvh,
        node: &Node,
        total: &mut f64,
        leaf: &impl Fn(&[u32]) -> Corners,
        union: &impl Fn(Corners, Corners) -> Corners,
        half_area: &impl Fn(Corners) -> f64,
    ) -> Corners {
        match bvh.children(node) {
            None => {
                let corners = leaf(bvh.primitives(node));
                *total += half_area(corners) * bvh.primitives(node).len() as f64;
                corners
            }
            Some([l, r]) => {
                let l = sum(bvh, l, total, leaf, union, half_area);
                let r = sum(bvh, r, total, leaf, union, half_area);
                *total += half_area(union(l, r));
                union(l, r)
            }
        }
    }
    let leaf = |primitives: &[u32]| {
        primitives.iter().fold(NOTHING, |corners, &p| {
            let points = triangles[p as usize].map(|v| positions[v as usize]);
            if points.iter().all(|p| p.is_finite()) {
                points.iter().fold(corners, |c, p| union(c, (p.as_dvec3(), p.as_dvec3())))
            } else {
                corners
            }
        })
    };
    let mut total = 0.0;
    let root = sum(bvh, bvh.root(), &mut total, &leaf, &union, &half_area);
    if half_area(root) > 0.0 { total / half_area(root) } else { 0.0 }
}
