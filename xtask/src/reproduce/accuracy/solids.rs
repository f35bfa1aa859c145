//! Closed meshes: found in a scene, and what is known of them without any triangle test.
//!
//! A mesh is closed if every edge is run along as often in one direction as in the other. The number of times that it
//! winds around a point is then a whole number, the sum of its triangles' solid angles over 4 pi (van Oosterom and
//! Strackee, *The Solid Angle of a Plane Triangle*, 1983); where that is not zero, every ray from the point hits.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use bvh_core::Vec3;
use bvh_core::glam::DVec3;

/// Closed pieces of a scene, with a point inside each: edges of length 1 to 2 on average, around the origin.
#[derive(Default)]
pub(super) struct Solids {
    /// In `f64`, but numbers that single precision holds.
    pub(super) positions: Vec<DVec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// The number of triangles of each piece, in their order, and a point inside.
    pub(super) pieces: Vec<(usize, DVec3)>,
}

/// A piece of fewer triangles is no solid worth the name.
const LEAST: usize = 8;

impl Solids {
    /// Closed pieces of a moving mesh, as they are at the first of two moments, of at most `budget` triangles, from all
    /// over it. Vertices in one place at both moments are one.
    pub(super) fn find(moments: [&[Vec3]; 2], triangles: &[[u32; 3]], budget: usize) -> Self {
        let (positions, triangles) = welded(moments, triangles);
        let components = components(positions.len(), &triangles);
        let mut solids = Self::default();
        // Any few numbers that are first in the order of their multiples of the golden section are spread evenly.
        let mut order: Vec<usize> = (0..components.len()).collect();
        let place = |&i: &usize| (i as f64 * 0.618_033_988_749_895).fract();
        order.sort_by(|a, b| place(a).total_cmp(&place(b)));
        for component in order.into_iter().map(|i| &components[i]) {
            let room = budget - solids.triangles.len();
            if (LEAST..=room).contains(&component.len()) {
                let faces: Vec<[u32; 3]> = component.iter().map(|&t| triangles[t as usize]).collect();
                solids.push(&positions, &faces);
            }
        }
        solids.normalized()
    }

    /// Takes a piece, if it is closed and has an inside.
    fn push(&mut self, positions: &[Vec3], faces: &[[u32; 3]]) {
        let mut number = HashMap::new();
        let mut corners = Vec::new();
        let mut at = |v: u32| {
            *number.entry(v).or_insert_with(|| {
                corners.push(positions[v as usize].as_dvec3());
                corners.len() as u32 - 1
            })
        };
        let faces: Vec<[u32; 3]> = faces.iter().map(|face| face.map(&mut at)).collect();
        if !closed(&faces) || !corners.iter().all(|p| p.is_finite()) {
            return;
        }
        let Some(inside) = point_inside(&corners, &faces) else { return };
        let base = self.positions.len() as u32;
        self.positions.extend(corners);
        self.triangles.extend(faces.iter().map(|face| face.map(|corner| base + corner)));
        self.pieces.push((faces.len(), inside));
    }

    /// Around the origin, and scaled by a power of two.
    fn normalized(mut self) -> Self {
        let edges = self
            .triangles
            .iter()
            .map(|&[a, b, _]| self.positions[a as usize].distance(self.positions[b as usize]));
        let mean = edges.sum::<f64>() / self.triangles.len().max(1) as f64;
        let center = self.positions.iter().sum::<DVec3>() / self.positions.len().max(1) as f64;
        let scale = (-mean.log2().floor()).exp2();
        let rounded = |p: DVec3| ((p - center) * scale).as_vec3().as_dvec3();
        self.positions.iter_mut().for_each(|p| *p = rounded(*p));
        self.pieces.iter_mut().for_each(|(_, p)| *p = (*p - center) * scale);
        self
    }
}

/// Triangles that hang together by shared vertices, as lists of their numbers.
fn components(vertices: usize, triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    let find = |parent: &mut Vec<u32>, mut v: u32| {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    };
    for &[a, b, c] in triangles {
        let root = find(&mut parent, a);
        for corner in [b, c] {
            let other = find(&mut parent, corner);
            parent[other as usize] = root;
        }
    }
    let mut number = HashMap::new();
    let mut components: Vec<Vec<u32>> = Vec::new();
    for (t, &[a, _, _]) in triangles.iter().enumerate() {
        let root = find(&mut parent, a);
        let at = *number.entry(root).or_insert_with(|| {
            components.push(Vec::new());
            components.len() - 1
        });
        components[at].push(t as u32);
    }
    components
}

/// A mesh with one vertex for all that are in one place at both moments, at the first of them. Triangles that are left
/// without an inside go: what is around them stays closed.
fn welded([first, second]: [&[Vec3]; 2], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut number = HashMap::new();
    let mut positions = Vec::new();
    // Adding zero makes the two zeros one.
    let bits = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    let places = first.iter().zip(second).map(|(&p, &q)| {
        *number.entry([bits(p), bits(q)]).or_insert_with(|| {
            positions.push(p);
            positions.len() as u32 - 1
        })
    });
    let places: Vec<u32> = places.collect();
    let triangles = triangles.iter().map(|face| face.map(|v| places[v as usize]));
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    (positions, triangles)
}

/// Whether every edge is run along as often in one direction as in the other.
fn closed(faces: &[[u32; 3]]) -> bool {
    let mut runs: HashMap<(u32, u32), i32> = HashMap::new();
    for &[a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (edge, run) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            *runs.entry(edge).or_default() += run;
        }
    }
    runs.values().all(|&runs| runs == 0)
}

/// The middle of the corners, or else a point a little below one of the triangles.
fn point_inside(corners: &[DVec3], faces: &[[u32; 3]]) -> Option<DVec3> {
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let below = faces.iter().step_by(faces.len().div_ceil(8)).flat_map(|face| {
        let [a, b, c] = face.map(|i| corners[i as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let edge = (b - a).length();
        [-0.2, 0.2, -0.05, 0.05, -0.01, 0.01].map(|part| (a + b + c) / 3.0 + normal * (part * edge))
    });
    let is_inside = |p: &DVec3| winds_around(*p, faces.iter().map(|f| f.map(|i| corners[i as usize])));
    [middle].into_iter().chain(below).find(is_inside)
}

/// Whether a closed mesh winds around a point, with certainty: not if it is on the surface, nor if that cannot be told.
pub(super) fn winds_around(point: DVec3, triangles: impl Iterator<Item = [DVec3; 3]>) -> bool {
    let mut turns = 0.0;
    for corners in triangles {
        let [a, b, c] = corners.map(|p| p - point);
        let (x, y, z) = (a.length(), b.length(), c.length());
        let volume = a.dot(b.cross(c));
        let half = volume.atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y);
        // Half of all directions: the point is in the triangle, or in one of its corners.
        if half.abs() > 0.999 * PI || x * y * z == 0.0 {
            return false;
        }
        turns += half / TAU;
    }
    turns.round() != 0.0 && (turns - turns.round()).abs() < 1e-3
}

/// The distance at which a ray first hits, by testing every triangle: where it meets the plane, and on which side of it the
/// edges are, in `f64` throughout.
pub(super) fn nearest(
    origin: DVec3,
    direction: DVec3,
    triangles: impl Iterator<Item = [DVec3; 3]>,
) -> Option<f64> {
    let distances = triangles.filter_map(|corners| {
        let [a, b, c] = corners.map(|p| p - origin);
        let sides = [a.cross(b), b.cross(c), c.cross(a)].map(|normal| direction.dot(normal));
        if sides.iter().any(|&s| s < 0.0) && sides.iter().any(|&s| s > 0.0) {
            return None;
        }
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a) / normal.dot(direction);
        (t >= 0.0 && t.is_finite()).then_some(t)
    });
    distances.min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron, its corners written three times, at `x`.
    fn tetrahedron(x: f32) -> Vec<Vec3> {
        let [a, b, c, d] = [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]]
            .map(|p: [f32; 3]| Vec3::from(p) + Vec3::X * x);
        vec![a, c, b, a, b, d, a, d, c, b, c, d]
    }

    #[test]
    fn points_are_inside_or_outside_and_rays_hit_where_they_must() {
        let corners: Vec<DVec3> = tetrahedron(0.0).iter().map(|p| p.as_dvec3()).collect();
        let triangles = || corners.as_chunks::<3>().0.iter().copied();
        let inside = DVec3::splat(0.5);
        assert!(winds_around(inside, triangles()));
        assert!(!winds_around(DVec3::splat(1.1), triangles()));
        assert!(!winds_around(DVec3::new(0.0, 0.5, 0.5), triangles()), "on a face");
        assert!(!winds_around(DVec3::ZERO, triangles()), "in a corner");
        let flat = [triangles().next().unwrap(), triangles().next().map(|[a, b, c]| [a, c, b]).unwrap()];
        assert!(
            !winds_around(DVec3::new(0.5, 0.5, 0.0), flat.into_iter()),
            "between two faces that coincide"
        );
        assert!(!winds_around(DVec3::new(-1e-9, 0.5, 0.5), triangles()));
        assert_eq!(nearest(inside, DVec3::NEG_X, triangles()), Some(0.5));
        let oblique = nearest(inside, DVec3::new(2.0, 1.0, 0.0), triangles()).unwrap();
        assert!((oblique - 0.5).abs() < 1e-15);
        assert_eq!(nearest(inside, -inside, triangles()), Some(1.0), "a corner");
        assert_eq!(nearest(DVec3::splat(2.0), DVec3::ONE, triangles()), None);
        assert!(closed(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]));
        assert!(!closed(&[[0, 2, 1], [0, 1, 3], [0, 3, 2]]));
    }

    #[test]
    fn closed_pieces_are_found_and_open_ones_left_out() {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for ball in 0..6 {
            // An octahedron split once, with two of its faces missing in every second one.
            let corners = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
            let base = positions.len() as u32;
            positions.extend(corners.map(|c| c * 5.0 + Vec3::Y * 20.0 * ball as f32));
            let faces =
                [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
            let open = if ball % 2 == 1 { 2 } else { 0 };
            triangles.extend(faces[open..].iter().map(|f| f.map(|i| base + i)));
        }
        let solids = Solids::find([&positions, &positions], &triangles, 1000);
        assert_eq!(solids.pieces.iter().map(|p| p.0).collect::<Vec<_>>(), [8, 8, 8]);
        let edge = solids.positions[0].distance(solids.positions[2]);
        assert!((1.0..2.0).contains(&edge), "{edge}");
        assert_eq!(Solids::find([&positions, &positions], &triangles, 17).pieces.len(), 2);
        assert!(Solids::find([&[], &[]], &[], 10).pieces.is_empty());
        let together: Vec<Vec3> = positions.iter().map(|p| p.with_y(p.y.rem_euclid(20.0))).collect();
        let pieces = |moments| Solids::find(moments, &triangles, 1000).pieces.len();
        assert_eq!((pieces([&together, &positions]), pieces([&together, &together])), (3, 0));
        positions[0] = Vec3::NAN;
        assert_eq!(Solids::find([&positions, &positions], &triangles, 1000).pieces.len(), 2);
    }
}
