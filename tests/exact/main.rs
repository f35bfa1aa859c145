//! Trees, hits and queries against exact arithmetic. Nothing here but `adaptor` calls the crates.
//!
//! A hit that is lost, too many, or at another distance fails, unless `rounding` says that the
//! triangle test cannot know. Boxes, heights and box queries are exact, without exceptions.

mod adaptor;
mod arithmetic;
mod check;
mod hard_input;
mod rounding;
mod scenes;
mod seeded;

use adaptor::{Mesh, Real, Test, levels, strategies};
use arithmetic::Point;
use check::{Tally, check_boxes, check_nearest, check_pictures, check_rays, check_tree};
use fastrand::Rng;
use rayon::prelude::*;
use scenes::{add, cube, extent, line, point, scale, soup};

/// Some meshes, frame by frame.
fn scene(kind: usize, frame: usize, seed: u64) -> Mesh {
    let mut mesh = soup(60, frame, seed);
    match kind % 4 {
        0 => {}
        1 => {
            // Some triangles twice, some that are not finite in some frames.
            for i in 0..20 {
                mesh.triangles[40 + i] = mesh.triangles[2 * i];
            }
            for i in (0..60).filter(|i| (i + frame).is_multiple_of(7)) {
                mesh.positions[3 * i][i % 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i / 7 % 3];
            }
        }
        2 => return cube(3, frame, [0.0; 3], 5.0),
        _ => return cube(3, frame, [1000.5, -700.25, 300.0], 5.0),
    }
    mesh
}

const KINDS: usize = 4;

fn middle(low: Point, high: Point) -> Point {
    scale(add(low, high), 0.5)
}

/// Rays of all kinds, and such as start inside a closed mesh.
fn check_all_rays(real: &Real, mesh: &Mesh, kind: usize, rays: usize, seed: u64, tally: &mut Tally) {
    let mut random = Rng::with_seed(seed);
    let bounds = extent(mesh);
    let lines: Vec<_> = (0..rays).map(|_| line(mesh, bounds, &mut random)).collect();
    let checked = check_rays(real, mesh, &lines, false, tally);
    checked.unwrap_or_else(|e| panic!("scene {kind}: {e}"));
    if kind % 4 >= 2 {
        let mut from_inside = lines;
        for line in &mut from_inside {
            let target = add(line.origin, line.direction);
            let dent = add(scale(point(&mut random), 4.0), [-2.0; 3]);
            line.origin = add(middle(bounds.0, bounds.1), dent);
            line.direction = [0, 1, 2].map(|k| target[k] - line.origin[k]);
            line.t_max = f32::INFINITY;
        }
        let checked = check_rays(real, mesh, &from_inside, true, tally);
        checked.unwrap_or_else(|e| panic!("scene {kind}, from inside: {e}"));
    }
}

fn check_everything(real: &Real, mesh: &Mesh, kind: usize, rays: usize, seed: u64) -> Tally {
    let mut tally = Tally::default();
    check_all_rays(real, mesh, kind, rays, seed, &mut tally);
    let mut random = Rng::with_seed(seed);
    let (low, high) = extent(mesh);
    let mut queries = vec![(low, high)];
    for i in 0..rays.min(30) {
        let place = |random: &mut Rng| [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * random.f32());
        let corner = place(&mut random);
        queries.push((corner, add(corner, scale(point(&mut random), 0.3 * (high[0] - low[0])))));
        // Boxes that touch another in a plane.
        if let Some((_, touched)) = check::triangle_box(mesh, i % mesh.triangles.len()) {
            queries.push((touched, add(touched, [1.0; 3])));
        }
    }
    check_boxes(real, mesh, &queries).unwrap_or_else(|e| panic!("scene {kind}: {e}"));
    // Corners of boxes: some are inside of others.
    let points: Vec<_> = queries.iter().map(|query| query.0).collect();
    check_nearest(real, mesh, &points).unwrap_or_else(|e| panic!("scene {kind}: {e}"));
    tally
}

#[test]
fn every_query_after_every_strategy_at_every_level_is_exact() {
    let tasks: Vec<_> = strategies().into_iter().enumerate().collect();
    let tally = tasks.into_par_iter().map(|(number, name)| {
        let mut tally = Tally::default();
        for (turn, level) in levels().into_iter().enumerate() {
            for kind in 0..KINDS {
                let leaf_size = [1, 4][(number + turn + kind) % 2];
                let seed = 100 * number as u64 + kind as u64;
                let mut real = Real::new(&scene(kind, 0, seed), leaf_size, level);
                for frame in 0..4 {
                    let mesh = scene(kind, frame, seed);
                    if frame > 0 {
                        real.update(&mesh, &name);
                    }
                    check_tree(&real, &mesh)
                        .unwrap_or_else(|e| panic!("{name}, scene {kind}, frame {frame}: {e}"));
                }
                let mesh = scene(kind, 3, seed);
                tally = tally.plus(check_everything(&real, &mesh, kind, 40, seed));
                let (low, high) = extent(&mesh);
                let target = middle(low, high);
                let eye = add(target, scale([3.1, 5.2, 13.7], [1.0, 0.1][usize::from(kind == 2)]));
                let test = Test::ALL[(number + turn + kind) % 3];
                let light = add(target, scale([-4.3, 9.1, 7.7], [1.0, 0.1][usize::from(kind == 2)]));
                check_pictures(&real, &mesh, test, [eye, target, light], 12, &mut tally)
                    .unwrap_or_else(|e| panic!("{name}, scene {kind}: {e}"));
            }
        }
        tally
    });
    let tally = tally.reduce(Tally::default, Tally::plus);
    println!("{tally:?}");
    assert!(tally.shadows > 10_000, "{}", tally.shadows);
    assert!(tally.exact_tests > 1_000_000 && tally.answers > 100_000);
    // Rays at edges and corners are a quarter.
    let [fast, watertight, double] = tally.excused.map(|n| n as f64 / (tally.answers as f64 / 3.0));
    assert!(fast < 0.2 && watertight < 0.2 && double < 0.1, "{fast} {watertight} {double} are excused");
}

/// Makes two million exact tests of a ray and a triangle; `PIVOT_EXACT_TESTS` asks for more.
#[test]
fn rays_hit_what_they_hit_exactly() {
    let wanted: f64 =
        std::env::var("PIVOT_EXACT_TESTS").map_or(2e6, |n| n.parse().expect("PIVOT_EXACT_TESTS: a number"));
    assert!(wanted > 0.0, "PIVOT_EXACT_TESTS is {wanted}");
    let names = strategies();
    let level = levels().last().copied().expect("one at least");
    let start = std::time::Instant::now();
    let (mut tally, mut rounds) = (Tally::default(), 0);
    while (tally.exact_tests as f64) < wanted {
        let all = (rounds..rounds + 16).into_par_iter().map(|round: usize| {
            let (kind, seed) = (round % KINDS, 7 + round as u64);
            let mut real = Real::new(&scene(kind, 0, seed), [1, 4][round / 4 % 2], level);
            let mesh = scene(kind, 1, seed);
            real.update(&mesh, &names[round % names.len()]);
            check_tree(&real, &mesh).unwrap_or_else(|e| panic!("round {round}: {e}"));
            check_everything(&real, &mesh, kind, 1000, seed)
        });
        tally = tally.plus(all.reduce(Tally::default, Tally::plus));
        rounds += 16;
    }
    println!("{tally:?} in {rounds} rounds, {:.1} s", start.elapsed().as_secs_f64());
}
