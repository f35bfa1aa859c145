//! How exact the triangle tests are.
//!
//! A closed wall stands all across the view, and its vertices lie on rays through the middle of
//! pixels: most rays of the picture meet an edge or a corner, as nearly as `f32` can tell, and
//! every ray must hit. Rays that do not hit have leaked. Distances are compared with where the ray
//! meets the plane of the triangle in `f64`. The same tests in whole frames of a scene show what
//! users see of that.

use std::hint::black_box;

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::glam::DVec3;
use bvh_core::pick::hit_by;
use bvh_core::triangle::{DET_RANGE, Found, Test, Watertight};
use bvh_core::{Bvh, Ray, Triangles, Vec3, Visits};
use rt_cpu::{Camera, Hit, Pixel, RenderOptions, Traversal, TriangleTest, cast};

use super::Point;
use super::bench::{Bench, Log, differing, in_a_million, in_turns};
use crate::interrupt;
use crate::stage::{fresh_tree, timed};

/// How far the wall is moved along each axis, where its edges are about 1 long.
const OFFSETS: [(&str, f64); 4] = [("the origin", 0.0), ("1e3", 1e3), ("1e5", 1e5), ("1e7", 1e7)];

/// One row of rays in this number is timed: short runs find a quiet moment.
const PART: usize = 7;

/// Pixels from a vertex to the next, and vertices beyond each side of the picture.
const SPACING: i64 = 4;
const MARGIN: i64 = 8;

/// The [`Watertight`] test with boxes that are not conservative.
struct Unwidened(Watertight);

impl Test for Unwidened {
    const WIDEN: f32 = 1.0;

    fn new(ray: &Ray) -> Self {
        Self(Watertight::new(ray))
    }

    #[inline(always)]
    fn test(&self, corners: &[Vec3; 3]) -> Option<Found> {
        self.0.test(corners)
    }
}

/// The [`Watertight`] test with a fused multiply-add wherever one fits.
struct Fused(Watertight);

impl Test for Fused {
    fn new(ray: &Ray) -> Self {
        Self(Watertight::new(ray))
    }

    #[inline(always)]
    fn test(&self, [a, b, c]: &[Vec3; 3]) -> Option<Found> {
        let ([kx, ky, kz], origin, shear) = (self.0.axes, self.0.origin, self.0.shear);
        let z = [a[kz] - origin.z, b[kz] - origin.z, c[kz] - origin.z];
        let along = |p: &Vec3, z: f32| {
            ((-shear.x).mul_add(z, p[kx] - origin.x), (-shear.y).mul_add(z, p[ky] - origin.y))
        };
        let ((xa, ya), (xb, yb), (xc, yc)) = (along(a, z[0]), along(b, z[1]), along(c, z[2]));
        let wa = xc.mul_add(yb, -(yc * xb));
        let wb = xa.mul_add(yc, -(ya * xc));
        let wc = xb.mul_add(ya, -(yb * xa));
        let (least, greatest) = (wa.min(wb).min(wc), wa.max(wb).max(wc));
        if least < 0.0 && greatest > 0.0 {
            return None;
        }
        let det = wa + wb + wc;
        let plain = det.abs() >= DET_RANGE.0 && det.abs() <= DET_RANGE.1;
        if !plain || least == 0.0 || greatest == 0.0 {
            return Watertight::exactly([xa, xb, xc], [ya, yb, yc], z, shear.z);
        }
        let z = [shear.z * z[0], shear.z * z[1], shear.z * z[2]];
        let inv_det = 1.0 / det;
        let (u, v) = (wb * inv_det, wc * inv_det);
        let t = (wa * inv_det).mul_add(z[0], u.mul_add(z[1], v * z[2]));
        (0.0..f32::INFINITY).contains(&t).then_some((t, u, v))
    }
}

/// The wall and the camera before it.
struct Wall {
    camera: Camera,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Wall {
    fn new(size: u32, offset: f64, seed: u64) -> Self {
        let mut random = fastrand::Rng::with_seed(seed);
        let eye = DVec3::splat(offset);
        let target = eye + DVec3::new(100.0, 40.0, -70.0);
        let camera = Camera::look_at(eye.as_vec3(), target.as_vec3(), Vec3::Y, 1.5, size, size);
        let [corner, right, down] = [camera.corner, camera.right, camera.down].map(Vec3::as_dvec3);
        let columns = i64::from(size) / SPACING + 2 * MARGIN;
        // Edges of about 1: so far away is a pixel 1 / SPACING wide.
        let far = 1.0 / (right.length() * SPACING as f64);
        let vertex = |row: i64, column: i64, jitter: f64| {
            let [x, y] = [column, row].map(|i| (SPACING * (i - MARGIN)) as f64 + 0.5);
            let bump = 1.0 + 0.2 * (0.02 * x).sin() * (0.03 * y).cos();
            (eye + (corner + x * right + y * down) * (far * bump + jitter)).as_vec3()
        };
        let cells = (0..columns).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let positions = cells.clone().map(|(row, column)| vertex(row, column, random.f64())).collect();
        let inner = cells.filter(|&(row, column)| row + 1 < columns && column + 1 < columns);
        let faces = inner.flat_map(|(row, column)| {
            let at = |r, c| ((row + r) * columns + column + c) as u32;
            [[at(0, 0), at(1, 0), at(0, 1)], [at(1, 0), at(1, 1), at(0, 1)]]
        });
        Self { camera, positions, triangles: faces.collect() }
    }

    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.triangles }
    }

    /// What the rays of all pixels hit in tiles, and the milliseconds that took.
    fn tiles(&self, tree: &Bvh, triangle_test: TriangleTest) -> (Vec<Option<Hit>>, f64) {
        let mut pixels = vec![Pixel::default(); (self.camera.width * self.camera.height) as usize];
        let options = RenderOptions { triangle_test, ..RenderOptions::default() };
        let (_, time_ms) = timed(|| cast(tree, &self.triangles(), &self.camera, None, &options, &mut pixels));
        (pixels.iter().map(Pixel::hit).collect(), time_ms)
    }

    /// The same one by one, on one thread, of one row in `every`.
    fn single<T: Test>(&self, tree: &Bvh, every: usize) -> (Vec<Option<Hit>>, f64) {
        let (triangles, width) = (self.triangles(), self.camera.width);
        let mut hits = Vec::with_capacity((width * self.camera.height) as usize);
        timed(|| {
            for y in (0..self.camera.height).step_by(every) {
                for x in 0..width {
                    let ray = black_box(self.camera.ray(x, y));
                    let mut visits = Visits::default();
                    hits.push(hit_by::<T, false>(tree, &triangles, &ray, f32::INFINITY, &mut visits));
                }
            }
            hits
        })
    }

    /// Root mean square of the relative errors of the distances.
    fn distance_error(&self, hits: &[Option<Hit>]) -> f64 {
        let width = self.camera.width;
        let square = |(hit, pixel): (&Option<Hit>, u32)| {
            let hit = hit.as_ref()?;
            let ray = self.camera.ray(pixel % width, pixel / width);
            let exact = meets_plane(&ray, &self.triangles().corners(hit.primitive as usize));
            Some((f64::from(hit.t) / exact - 1.0).powi(2)).filter(|square| square.is_finite())
        };
        let squares: Vec<f64> = hits.iter().zip(0..).filter_map(square).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// The distance along a ray to the plane of a triangle.
fn meets_plane(ray: &Ray, corners: &[Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| p.as_dvec3() - ray.origin().as_dvec3());
    let normal = (b - a).cross(c - a);
    normal.dot(a) / normal.dot(ray.direction().as_dvec3())
}

fn leaks(hits: &[Option<Hit>]) -> f64 {
    in_a_million(hits.iter().filter(|hit| hit.is_none()).count(), hits.len())
}

/// All triangle tests in tiles; conservative boxes and fused arithmetic with single rays.
pub(super) fn on_a_wall(log: &mut Log<'_>) -> Result<()> {
    for (condition, offset) in OFFSETS.into_iter().take_while(|_| !interrupt::requested()) {
        let wall = Wall::new(log.pick([160, 512, 1024]), offset, log.seed);
        let tree = build(&wall.triangles(), Builder::Sweep).context("no tree")?;
        triangle_tests(log, &wall, &tree, condition)?;
        arithmetic(log, &wall, &tree, condition)?;
    }
    Ok(())
}

const LEAKS: (&str, &str) = ("rays leaking through a wall", "in a million");

fn triangle_tests(log: &mut Log<'_>, wall: &Wall, tree: &Bvh, condition: &str) -> Result<()> {
    let all = TriangleTest::ALL;
    let times = in_turns(2 * log.rounds(), all.len(), |i| Ok(wall.tiles(tree, all[i]).1))?;
    for (test, time_ms) in all.into_iter().zip(times) {
        let (hits, _) = wall.tiles(tree, test);
        let knob = format!("triangle test on a wall at {condition}");
        let note = format!("time of {} primary rays in tiles", hits.len());
        let is_default = test == TriangleTest::default();
        let point = Point { note, ..Point::new(&knob, test.name(), is_default, time_ms) };
        log.add(point.with(LEAKS.0, leaks(&hits), LEAKS.1))?;
        log.add(point.with("rms distance error", wall.distance_error(&hits), "fraction"))?;
    }
    Ok(())
}

fn arithmetic(log: &mut Log<'_>, wall: &Wall, tree: &Bvh, condition: &str) -> Result<()> {
    let run = [Wall::single::<Watertight>, Wall::single::<Unwidened>, Wall::single::<Fused>];
    let times = in_turns(8 * log.rounds(), run.len(), |i| Ok(run[i](wall, tree, PART).1))?;
    let [plain, narrow, fused] = run.map(|run| run(wall, tree, 1).0);
    let bits = |hit: &Option<Hit>| hit.map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.primitive]);
    let differ = |hits: &[Option<Hit>]| {
        in_a_million(hits.iter().zip(&plain).filter(|(a, b)| bits(a) != bits(b)).count(), plain.len())
    };
    for (knob, setting, hits, time_ms) in [
        ("conservative boxes", "on", &plain, times[0]),
        ("conservative boxes", "off", &narrow, times[1]),
        ("fused multiply-add", "none", &plain, times[0]),
        ("fused multiply-add", "in the triangle test", &fused, times[2]),
    ] {
        let is_default = std::ptr::eq(hits, &raw const plain);
        let rows = wall.camera.height.div_ceil(PART as u32);
        let note = format!("time of {} single rays, one thread", rows * wall.camera.width);
        let of = format!("{knob} at {condition}");
        let point = Point { note, ..Point::new(&of, setting, is_default, time_ms) };
        log.add(point.with(LEAKS.0, leaks(hits), LEAKS.1))?;
        if knob == "fused multiply-add" {
            log.add(point.with("hits with other bits than without", differ(hits), "in a million"))?;
        }
    }
    Ok(())
}

/// Every test, in tiles, in packets and ray by ray: frames with shadows, against those of `f64`.
pub(super) fn in_frames(bench: &mut Bench<'_>) -> Result<()> {
    bench.pose_in_the_middle();
    let tree = fresh_tree(bench.stage)?;
    for (condition, traversal, rounds) in [
        ("tiles", Traversal::Tile, 6),
        ("packets", Traversal::Packet, 3),
        ("single rays", Traversal::Single, 2),
    ] {
        let with = |triangle_test| RenderOptions { triangle_test, traversal, ..bench.flat() };
        let all = TriangleTest::ALL;
        let times =
            in_turns(rounds * bench.log.rounds(), all.len(), |i| Ok(bench.trace(&tree, &with(all[i]))))?;
        let see = |test| bench.see(&tree, &bench.stage.triangles(), &with(test));
        let exact = see(TriangleTest::Double);
        let errors = all.map(|test| differing(&see(test), &exact));
        for ((test, time_ms), error) in all.into_iter().zip(times).zip(errors) {
            let knob = format!("triangle test at {condition}");
            let note = "time of a frame with primary and shadow rays, in the middle of the loop".to_owned();
            let is_default = test == TriangleTest::default();
            let point = Point { note, ..Point::new(&knob, test.name(), is_default, time_ms) };
            let name = "pixels seen or lit otherwise than with f64";
            bench.log.add(point.with(name, error, "in a million"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ray_hits_the_wall_and_most_hit_an_edge() {
        for offset in [0.0, 1e4] {
            let wall = Wall::new(64, offset, 1);
            let tree = build(&wall.triangles(), Builder::Sweep).unwrap();
            for test in [TriangleTest::Watertight, TriangleTest::Double] {
                assert_eq!(leaks(&wall.tiles(&tree, test).0), 0.0, "{test} at {offset}");
            }
            let hits = wall.single::<Watertight>(&tree, 1).0;
            assert!(hits == wall.tiles(&tree, TriangleTest::Watertight).0, "one by one as in tiles");
            let at_edge = |hit: &Hit| hit.weights().into_iter().any(|weight| weight < 1e-3);
            let count = hits.iter().flatten().filter(|hit| at_edge(hit)).count();
            assert!(offset > 0.0 || 2 * count > hits.len(), "{count} of {}", hits.len());
            assert!(wall.distance_error(&hits) < 1e-5 * (1.0 + offset));
        }
    }

    #[test]
    fn what_is_left_out_is_missed() {
        let wall = Wall::new(256, 0.0, 1);
        let tree = build(&wall.triangles(), Builder::Sweep).unwrap();
        assert!(leaks(&wall.tiles(&tree, TriangleTest::MollerTrumbore).0) > 0.0);
        assert!(leaks(&wall.single::<Unwidened>(&tree, 1).0) > 0.0);
        assert!(leaks(&wall.single::<Fused>(&tree, 1).0) > 0.0);
    }
}
