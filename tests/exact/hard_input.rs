//! Hard input against exact arithmetic: coordinates of the earth's size, triangles of a nanometre
//! in a scene of a kilometre, and motion that jumps, stops, runs backwards and scales to nothing.

use fastrand::Rng;

use crate::adaptor::{Mesh, Real, levels, strategies};
use crate::arithmetic::Point;
use crate::check::{Tally, check_boxes, check_rays, check_tree, triangle_box};
use crate::scenes::{add, cube, extent, line, point, scale, soup};

/// Plays meshes with every strategy: trees in every frame, rays and boxes in the frames asked for.
fn play(frames: &[Mesh], rays_in: impl Fn(usize) -> bool) {
    let level = levels().last().copied().expect("one at least");
    for (number, name) in strategies().into_iter().enumerate() {
        let mut real = Real::new(&frames[0], [1, 4][number % 2], level);
        for (frame, mesh) in frames.iter().enumerate().skip(1) {
            real.update(mesh, &name);
            let checked = check_tree(&real, mesh).and_then(|()| {
                if rays_in(frame) { look(&real, mesh, 12, (frame + number) as u64) } else { Ok(()) }
            });
            checked.unwrap_or_else(|e| panic!("{name}, frame {frame}: {e}"));
        }
    }
}

fn look(real: &Real, mesh: &Mesh, rays: usize, seed: u64) -> Result<(), String> {
    let (bounds, mut random) = (extent(mesh), Rng::with_seed(seed));
    let lines: Vec<_> = (0..rays).map(|_| line(mesh, bounds, &mut random)).collect();
    check_rays(real, mesh, &lines, false, &mut Tally::default())?;
    let queries: Vec<_> = (0..rays).filter_map(|i| triangle_box(mesh, i % mesh.triangles.len())).collect();
    check_boxes(real, mesh, &queries)
}

/// In metres: at this distance from the middle of the earth single precision knows half a metre.
const EARTH: f32 = 6_371_000.0;

#[test]
fn earth_size_coordinates_with_details_of_a_metre() {
    for offset in [[EARTH, 0.0, 0.0], [-EARTH, EARTH, 0.5 * EARTH]] {
        let frame = |frame: usize| {
            let mut mesh = soup(60, frame, 3);
            mesh.positions.iter_mut().for_each(|p| *p = add(*p, offset));
            mesh
        };
        let frames: Vec<_> = (0..4).map(frame).collect();
        let corners = |i: usize| frames[1].corners(i);
        let flat = (0..60).filter(|&i| (0..3).any(|k| corners(i).iter().all(|p| p[k] == corners(i)[0][k])));
        assert!(flat.count() > 5, "rounding makes triangles flat, which is the point");
        play(&frames, |frame| frame == 3);
        play(&[cube(3, 0, offset, 50.0), cube(3, 1, offset, 50.0)], |_| true);
    }
}

/// Coordinates in double precision, less an origin nearby, have their details in single precision.
#[test]
fn earth_size_coordinates_less_a_local_origin_keep_micrometres() {
    let origin = [f64::from(EARTH), -4_000_000.125, 1_234_567.875];
    let local = soup(60, 1, 3);
    let world: Vec<[f64; 3]> =
        local.positions.iter().map(|p| [0, 1, 2].map(|k| origin[k] + f64::from(p[k]))).collect();
    let back: Vec<Point> = world.iter().map(|p| [0, 1, 2].map(|k| (p[k] - origin[k]) as f32)).collect();
    let most = |a: &[Point], b: &[Point]| {
        let apart = a.iter().zip(b).flat_map(|(a, b)| [0, 1, 2].map(|k| (a[k] - b[k]).abs()));
        apart.fold(0.0, f32::max)
    };
    assert!(most(&back, &local.positions) < 1e-6, "{}", most(&back, &local.positions));
    let direct: Vec<Point> = world.iter().map(|p| p.map(|x| x as f32)).collect();
    let shifted: Vec<Point> = direct.iter().map(|p| [0, 1, 2].map(|k| p[k] - origin[k] as f32)).collect();
    assert!(most(&shifted, &local.positions) > 0.1, "without it they are gone");
    let mesh = Mesh { positions: back, triangles: local.triangles };
    play(&[mesh.clone(), mesh], |_| true);
}

/// A soup of ten nanometres at the origin and one of a kilometre around it, in one tree.
#[test]
fn nanometre_triangles_in_a_kilometre_scene() {
    let frame = |frame: usize| {
        let mut mesh = soup(40, frame, 5);
        let large = soup(40, frame, 6);
        mesh.positions.iter_mut().for_each(|p| *p = scale(*p, 1e-9));
        mesh.positions.extend(large.positions.iter().map(|p| scale(add(*p, [-5.0; 3]), 100.0)));
        mesh.triangles.extend(large.triangles.iter().map(|t| t.map(|v| v + 120)));
        mesh
    };
    let frames: Vec<_> = (0..4).map(frame).collect();
    play(&frames, |frame| frame == 3);
    // Rays aimed at the small ones, from among them and from half a kilometre away.
    let level = levels().last().copied().expect("one at least");
    let mut real = Real::new(&frames[0], 1, level);
    real.update(&frames[3], "refit+rotate");
    let small = Mesh { triangles: frames[3].triangles[..40].to_vec(), ..frames[3].clone() };
    let mut random = Rng::with_seed(8);
    let lines: Vec<_> = (0..200)
        .map(|i| {
            let mut line = line(&small, extent(&small), &mut random);
            if i % 2 == 0 {
                let target = add(line.origin, line.direction);
                line.origin = scale(add(point(&mut random), [-0.5; 3]), 1000.0);
                line.direction = [0, 1, 2].map(|k| target[k] - line.origin[k]);
            }
            line
        })
        .collect();
    check_rays(&real, &frames[3], &lines, false, &mut Tally::default()).unwrap_or_else(|e| panic!("{e}"));
}

/// The frames of a soup in this order.
fn in_order(order: &[usize]) -> Vec<Mesh> {
    order.iter().map(|&frame| soup(80, frame, 9)).collect()
}

#[test]
fn animations_that_jump() {
    play(&in_order(&[0, 40, 1, 90, 2, 2, 300, 0]), |frame| frame % 3 == 1);
}

#[test]
fn animations_that_stop_and_go_on() {
    play(&in_order(&[0, 1, 2, 2, 2, 2, 2, 2, 3, 4, 4, 4, 9]), |frame| frame % 5 == 0);
}

#[test]
fn animations_that_run_backwards() {
    play(&in_order(&[0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]), |frame| frame % 5 == 0);
}

#[test]
fn animations_that_scale_to_zero_and_back() {
    let scales = [1.0, 0.1, 1e-4, 1e-20, 0.0, 0.0, -0.0, 1e-20, 1e-3, 1.0, -1.0, 1.0];
    let frame = |factor: f32| {
        let mut mesh = soup(80, 1, 9);
        mesh.positions.iter_mut().for_each(|p| *p = scale(*p, factor));
        mesh
    };
    let frames: Vec<_> = scales.into_iter().map(frame).collect();
    play(&frames, |frame| [1, 2, 8, 9, 10, 11].contains(&frame));
    // What has become a point cannot be hit, and comes back with every triangle.
    let level = levels().last().copied().expect("one at least");
    let mut real = Real::new(&frames[4], 1, level);
    real.update(&frames[0], "auto");
    look(&real, &frames[0], 100, 1).unwrap_or_else(|e| panic!("built over a point: {e}"));
}
