//! Triangle tests, near the origin and far from it: rays that leak out of closed meshes, and errors of distance.

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::glam::DVec3;
use bvh_core::{Bvh, Ray, Triangles, Vec3};
use rayon::prelude::*;
use rt_cpu::{Bvh8, Hit, TriangleTest};

use super::bench::{Bench, fastest};
use super::point::Point;
use super::solids::{Solids, nearest, winds_around};
use crate::interrupt;

/// How far the meshes are moved along each axis, where their edges are 1 to 2 long.
const OFFSETS: [(&str, f64); 6] =
    [("the origin", 0.0), ("1e3", 1e3), ("1e4", 1e4), ("1e5", 1e5), ("1e6", 1e6), ("1e7", 1e7)];

/// Closed pieces of the scene, rays from inside them, and every test.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    bench.stage.pose(0.0);
    let first = bench.stage.triangles().positions.to_vec();
    bench.stage.pose(bench.stage.scene.animation.duration());
    let triangles = bench.stage.triangles();
    let solids = Solids::find([&first, triangles.positions], triangles.indices, bench.effort.solid_triangles);
    if solids.pieces.is_empty() {
        return Ok(());
    }
    for (i, (condition, offset)) in OFFSETS.into_iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        let moved = Moved::new(&solids, offset);
        if !moved.inside.is_empty() {
            at_offset(bench, &moved, condition)?;
        }
        bench.done(i + 1, OFFSETS.len());
    }
    Ok(())
}

/// Closed meshes moved away from the origin, and rounded there.
struct Moved<'a> {
    solids: &'a Solids,
    offset: DVec3,
    positions: Vec<Vec3>,
    /// Points that are still inside, and the triangles of the pieces they are inside of.
    inside: Vec<(Vec3, std::ops::Range<usize>)>,
}

impl<'a> Moved<'a> {
    fn new(solids: &'a Solids, offset: f64) -> Self {
        let offset = DVec3::splat(offset);
        let positions: Vec<Vec3> = solids.positions.iter().map(|&p| (p + offset).as_vec3()).collect();
        let mut inside = Vec::new();
        let mut first = 0;
        for &(count, point) in &solids.pieces {
            let piece = first..first + count;
            first += count;
            let point = (point + offset).as_vec3();
            let faces = solids.triangles[piece.clone()].iter();
            let corners = faces.map(|face| face.map(|i| positions[i as usize].as_dvec3()));
            if winds_around(point.as_dvec3(), corners) {
                inside.push((point, piece));
            }
        }
        Self { solids, offset, positions, inside }
    }

    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.solids.triangles }
    }

    /// Rays from all points inside in turn, to places in a triangle of the piece that `weights` chooses. Directions of no
    /// length are left out.
    fn rays(
        &self,
        count: usize,
        random: &mut fastrand::Rng,
        mut weights: impl FnMut(&mut fastrand::Rng) -> [f64; 3],
    ) -> Vec<Ray> {
        let aim = |i: usize| {
            let (from, piece) = &self.inside[i % self.inside.len()];
            let corners = self.triangles().corners(random.usize(piece.clone()));
            let weights = weights(random);
            let to: DVec3 = corners.iter().zip(weights).map(|(c, w)| c.as_dvec3() * w).sum();
            Ray::new(*from, (to - from.as_dvec3()).as_vec3())
        };
        (0..count).map(aim).filter(Ray::is_valid).collect()
    }

    /// The exact distances along rays, to the mesh as it is and to what it would be, had moving it not rounded it.
    fn distances(&self, rays: &[Ray]) -> Vec<[Option<f64>; 2]> {
        let exact = |ray: &Ray| {
            let (origin, direction) = (ray.origin().as_dvec3(), ray.direction().as_dvec3());
            let triangles = || self.solids.triangles.iter();
            let rounded = triangles().map(|face| face.map(|i| self.positions[i as usize].as_dvec3()));
            let unrounded = triangles().map(|face| face.map(|i| self.solids.positions[i as usize]));
            [nearest(origin, direction, rounded), nearest(origin - self.offset, direction, unrounded)]
        };
        rays.par_iter().map(exact).collect()
    }
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

fn at_offset(bench: &mut Bench<'_>, moved: &Moved<'_>, condition: &str) -> Result<()> {
    let triangles = moved.triangles();
    let tree = build(&triangles, Builder::Sweep).context("no tree")?;
    let mut random = fastrand::Rng::with_seed(bench.effort.seed);
    let [edge_rays, distance_rays] = bench.effort.rays;
    let at_edges = moved.rays(edge_rays, &mut random, on_an_edge);
    let at_faces = moved.rays(distance_rays, &mut random, within);
    let exact = moved.distances(&at_faces);
    // In turn, so that what else the machine does hits all alike.
    let mut least = TriangleTest::ALL.map(|_| f64::INFINITY);
    for _ in 0..bench.effort.repeats {
        for (least, test) in least.iter_mut().zip(TriangleTest::ALL) {
            *least = least.min(trace(&tree, &triangles, &at_edges, test).1);
        }
    }
    for (test, time_ms) in TriangleTest::ALL.into_iter().zip(least) {
        let (hits, _) = trace(&tree, &triangles, &at_edges, test);
        let leaks = hits.iter().filter(|hit| hit.is_none()).count();
        let (hits, _) = trace(&tree, &triangles, &at_faces, test);
        let to = |k: usize| {
            let pairs = hits.iter().zip(&exact).filter_map(|(hit, exact)| Some((hit.as_ref()?.t, exact[k]?)));
            // Where the piece touches another one the ray may start on that.
            let away = pairs.filter(|&(_, exact)| exact > 0.0);
            root_mean_square(away.map(|(t, exact)| f64::from(t) / exact - 1.0))
        };
        let traced = format!(
            "time of tracing {} rays from inside {} to edges and corners",
            at_edges.len(),
            match moved.inside.len() {
                1 => "a closed mesh".to_owned(),
                many => format!("{many} closed meshes"),
            }
        );
        for (error_name, error, unit, note) in [
            (
                "rays leaking out of closed meshes",
                Some(1e6 * leaks as f64 / at_edges.len().max(1) as f64),
                "in a million",
                format!("{traced}, {leaks} of which leak"),
            ),
            (
                "rms distance error against f64",
                to(0),
                "fraction of the distance",
                format!("{traced}; error of {} rays to faces", at_faces.len()),
            ),
            (
                "rms distance error against the mesh unmoved",
                to(1),
                "fraction of the distance",
                format!(
                    "{traced}; error of {} rays to faces: rounding of coordinates included",
                    at_faces.len()
                ),
            ),
        ] {
            let Some(error) = error else { continue };
            bench.add(Point {
                knob: format!("triangle test at {condition}"),
                setting: test.name().to_owned(),
                is_default: test == TriangleTest::default(),
                error_name: error_name.to_owned(),
                error,
                unit: unit.to_owned(),
                time_ms,
                note,
                ..Point::default()
            })?;
        }
    }
    Ok(())
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

fn root_mean_square(errors: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = errors.fold((0.0, 0_u64), |(sum, count), e| (sum + e * e, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}
