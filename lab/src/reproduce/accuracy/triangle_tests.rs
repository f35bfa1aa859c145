//! Triangle tests, near the origin and far from it: rays that leak out of a closed mesh, and errors
//! of distance.
//!
//! The mesh is a closed bumpy sphere around the point that all rays start from, so every ray must
//! hit it. Distances are compared with a test of every triangle in `f64`, which shares no code with
//! the tests measured.

use std::f64::consts::{PI, TAU};

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::glam::DVec3;
use bvh_core::{Bvh, Ray, Triangles, Vec3};
use rayon::prelude::*;
use rt_cpu::{Bvh8, Hit, TriangleTest};

use super::bench::{Bench, fastest};
use super::point::Point;
use crate::interrupt;

/// How far the mesh is moved along each axis, where its edges are about 1 long.
const OFFSETS: [(&str, f64); 6] =
    [("the origin", 0.0), ("1e3", 1e3), ("1e4", 1e4), ("1e5", 1e5), ("1e6", 1e6), ("1e7", 1e7)];

/// Rays from inside the mesh, and every test.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let (positions, triangles) = bumpy_sphere(bench.effort.solid_triangles);
    for (i, (condition, offset)) in OFFSETS.into_iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        let moved: Vec<Vec3> = positions.iter().map(|&p| (p + DVec3::splat(offset)).as_vec3()).collect();
        let from = DVec3::splat(offset).as_vec3();
        at_offset(bench, &Triangles { positions: &moved, indices: &triangles }, from, condition)?;
        bench.done(i + 1, OFFSETS.len());
    }
    Ok(())
}

/// A closed mesh of about `triangles` triangles that all face the origin.
fn bumpy_sphere(triangles: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (rings, around) =
        ((triangles as f64 / 4.0).sqrt() as u32 + 2, 2 * ((triangles as f64 / 4.0).sqrt() as u32 + 2));
    let radius = f64::from(around) / TAU;
    let at = |ring: u32, i: u32| {
        let (polar, angle) =
            (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(i) / f64::from(around));
        let bump = 1.0 + 0.1 * (5.0 * angle).sin() * (3.0 * polar).sin().powi(2) * polar.sin();
        let point = DVec3::new(polar.sin() * angle.cos(), polar.cos(), polar.sin() * angle.sin());
        (radius * bump * point).as_vec3().as_dvec3()
    };
    let mut positions = vec![at(0, 0), at(rings, 0)];
    positions.extend((1..rings).flat_map(|ring| (0..around).map(move |i| at(ring, i))));
    let number = |ring: u32, i: u32| match ring {
        0 => 0,
        ring if ring == rings => 1,
        ring => 2 + (ring - 1) * around + i % around,
    };
    let quads = (0..rings).flat_map(|ring| (0..around).map(move |i| (ring, i)));
    let faces = quads.flat_map(|(ring, i)| {
        let [a, b, c, d] =
            [(ring, i), (ring, i + 1), (ring + 1, i), (ring + 1, i + 1)].map(|(r, i)| number(r, i));
        [[a, b, c], [b, d, c]]
    });
    (positions, faces.filter(|[a, b, c]| a != b && b != c && c != a).collect())
}

/// Rays to places in triangles taken at random; `weights` chooses the place.
fn rays(
    triangles: &Triangles<'_>,
    from: Vec3,
    count: usize,
    random: &mut fastrand::Rng,
    mut weights: impl FnMut(&mut fastrand::Rng) -> [f64; 3],
) -> Vec<Ray> {
    let aim = |_| {
        let corners = triangles.corners(random.usize(0..triangles.indices.len()));
        let to: DVec3 = corners.iter().zip(weights(random)).map(|(c, w)| c.as_dvec3() * w).sum();
        Ray::new(from, (to - from.as_dvec3()).as_vec3())
    };
    (0..count).map(aim).filter(Ray::is_valid).collect()
}

/// On an edge, or, one time in four, in a corner.
fn on_an_edge(random: &mut fastrand::Rng) -> [f64; 3] {
    let along = if random.u8(..) < 64 { 0.0 } else { random.f64() };
    let mut weights = [1.0 - along, along, 0.0];
    weights.rotate_left(random.usize(0..3));
    weights
}

/// Anywhere well within the triangle.
fn within(random: &mut fastrand::Rng) -> [f64; 3] {
    let weights = [0; 3].map(|_| 0.05 + random.f64());
    weights.map(|w| w / weights.iter().sum::<f64>())
}

fn at_offset(bench: &mut Bench<'_>, triangles: &Triangles<'_>, from: Vec3, condition: &str) -> Result<()> {
    let tree = build(triangles, Builder::Sweep).context("no tree")?;
    let mut random = fastrand::Rng::with_seed(bench.effort.seed);
    let [edge_rays, distance_rays] = bench.effort.rays;
    let at_edges = rays(triangles, from, edge_rays, &mut random, on_an_edge);
    let at_faces = rays(triangles, from, distance_rays, &mut random, within);
    let exact: Vec<Option<f64>> = at_faces.par_iter().map(|ray| nearest(ray, triangles)).collect();
    // In turn, so that other work of the machine slows all alike.
    let mut least = TriangleTest::ALL.map(|_| f64::INFINITY);
    for _ in 0..bench.effort.repeats {
        for (least, test) in least.iter_mut().zip(TriangleTest::ALL) {
            *least = least.min(trace(&tree, triangles, &at_edges, test).1);
        }
    }
    for (test, time_ms) in TriangleTest::ALL.into_iter().zip(least) {
        let leaks = trace(&tree, triangles, &at_edges, test).0.iter().filter(|hit| hit.is_none()).count();
        let (hits, _) = trace(&tree, triangles, &at_faces, test);
        let pairs =
            hits.iter().zip(&exact).filter_map(|(hit, exact)| Some((f64::from(hit.as_ref()?.t), (*exact)?)));
        let squares: Vec<f64> = pairs.map(|(t, exact)| (t / exact - 1.0).powi(2)).collect();
        let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        for (error_name, error, unit) in [
            (
                "rays leaking out of a closed mesh",
                1e6 * leaks as f64 / at_edges.len().max(1) as f64,
                "in a million",
            ),
            ("rms distance error against f64", rms, "fraction of the distance"),
        ] {
            bench.add(Point {
                knob: format!("triangle test at {condition}"),
                setting: test.name().to_owned(),
                is_default: test == TriangleTest::default(),
                error_name: error_name.to_owned(),
                error,
                unit: unit.to_owned(),
                time_ms,
                note: format!(
                    "time of tracing {} rays from inside a closed mesh to edges and corners; distances of {} rays to faces",
                    at_edges.len(),
                    at_faces.len()
                ),
                ..Point::default()
            })?;
        }
    }
    Ok(())
}

/// The distance at which a ray first hits, by testing every triangle: where it meets the plane, and
/// on which side of it the edges are.
fn nearest(ray: &Ray, triangles: &Triangles<'_>) -> Option<f64> {
    let (origin, direction) = (ray.origin().as_dvec3(), ray.direction().as_dvec3());
    let distances = (0..triangles.indices.len()).filter_map(|i| {
        let [a, b, c] = triangles.corners(i).map(|p| p.as_dvec3() - origin);
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

/// What rays hit, and the milliseconds that took.
fn trace(tree: &Bvh, triangles: &Triangles<'_>, rays: &[Ray], test: TriangleTest) -> (Vec<Option<Hit>>, f64) {
    let mut hits = vec![None; rays.len()];
    let t_max = vec![f32::INFINITY; rays.len()];
    let mut wide = Bvh8::new();
    wide.update(tree, triangles);
    let time_ms = fastest(1, || wide.closest_hits(rays, &t_max, test, &mut hits));
    (hits, time_ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_closed_and_every_ray_from_its_middle_hits() {
        let (positions, triangles) = bumpy_sphere(2000);
        let mut runs = std::collections::HashMap::new();
        for &[a, b, c] in &triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *runs.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        assert!(runs.values().all(|&runs| runs == 0), "every edge is run in both directions");
        let positions: Vec<Vec3> = positions.iter().map(|p| p.as_vec3()).collect();
        let triangles = Triangles { positions: &positions, indices: &triangles };
        let mut random = fastrand::Rng::with_seed(1);
        for ray in rays(&triangles, Vec3::ZERO, 200, &mut random, within) {
            let t = nearest(&ray, &triangles).expect("a hit");
            let length = f64::from(ray.direction().length());
            let reach = t * length;
            assert!((6.0..10.0).contains(&reach), "{reach}");
        }
    }
}
