//! Meshes that move, and rays, from integers and the four operations alone.

use std::collections::BTreeMap;

use fastrand::Rng;

use crate::adaptor::{Line, Mesh};
use crate::arithmetic::Point;

/// A point of the unit cube.
pub(crate) fn point(random: &mut Rng) -> Point {
    [random.f32(), random.f32(), random.f32()]
}

pub(crate) fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn scale(a: Point, s: f32) -> Point {
    a.map(|x| x * s)
}

/// Triangles of size 1 at random in a cube of side 10, each on its way in its own direction.
pub(crate) fn soup(n: usize, frame: usize, seed: u64) -> Mesh {
    let mut random = Rng::with_seed(seed);
    let mut positions = Vec::new();
    for _ in 0..n {
        let center = scale(point(&mut random), 10.0);
        let way = scale(add(point(&mut random), [-0.5; 3]), frame as f32);
        for _ in 0..3 {
            positions.push(add(add(center, way), point(&mut random)));
        }
    }
    Mesh { positions, triangles: (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }
}

/// A closed cube of `n` x `n` quads a side around `offset`, 2 x `half` wide; from frame 1 on its
/// corners are dented.
pub(crate) fn cube(n: u32, frame: usize, offset: Point, half: f32) -> Mesh {
    let mut numbers = BTreeMap::new();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (axis, side) in (0..6u32).map(|face| (face as usize / 2, face % 2 * n)) {
        let mut vertex = |u: u32, v: u32| {
            let mut at = [side; 3];
            (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (u, v);
            *numbers.entry(at).or_insert_with(|| {
                let place = at.map(|i| half * (2.0 * i as f32 / n as f32 - 1.0));
                let number = positions.len() as u32;
                let dent = Rng::with_seed(1000 * frame as u64 + u64::from(number)).f32();
                let shrink = if frame == 0 { 1.0 } else { 1.0 - 0.2 * dent };
                positions.push(add(offset, scale(place, shrink)));
                number
            })
        };
        for (u, v) in (0..n * n).map(|i| (i % n, i / n)) {
            let [a, b, c, d] = [vertex(u, v), vertex(u + 1, v), vertex(u, v + 1), vertex(u + 1, v + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    Mesh { positions, triangles }
}

/// A ray of one of several kinds: at the inside of a triangle, at an edge, at a corner, anywhere,
/// along an axis; some of them end near what they hit.
pub(crate) fn line(mesh: &Mesh, (low, high): (Point, Point), random: &mut Rng) -> Line {
    let inside = |random: &mut Rng| [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * random.f32());
    let triangle = random.usize(..mesh.triangles.len());
    let finite = mesh.is_finite(triangle);
    let [a, b, c] = if finite { mesh.corners(triangle) } else { [low, low, high] };
    let (u, v) = (random.f32(), random.f32());
    let target = match random.usize(..8) {
        0 => a,
        1 => [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * u),
        2 => inside(random),
        _ => {
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * u + (c[k] - a[k]) * v)
        }
    };
    let out = [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * (3.0 * random.f32() - 1.0));
    let mut origin = if random.usize(..3) == 0 { inside(random) } else { out };
    let mut direction = [0, 1, 2].map(|k| target[k] - origin[k]);
    match random.usize(..8) {
        0 => {
            // Along an axis, through the target.
            let k = random.usize(..3);
            origin = target;
            origin[k] = out[k];
            direction = [0.0, -0.0, 0.0];
            direction[k] = target[k] - out[k];
        }
        1 => direction[random.usize(..3)] = 0.0,
        2 => direction = scale(direction, 0.125 + 3.0 * random.f32()),
        _ => {}
    }
    let t_max = match random.usize(..4) {
        0 => 1.0,
        1 => 2.0 * random.f32(),
        _ => f32::INFINITY,
    };
    if direction == [0.0; 3] {
        direction = [0.0, 0.0, 1.0];
    }
    Line { origin, direction, t_max }
}

/// The box of all that is finite; a unit cube if nothing is.
pub(crate) fn extent(mesh: &Mesh) -> (Point, Point) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for i in (0..mesh.triangles.len()).filter(|&i| mesh.is_finite(i)) {
        for p in mesh.corners(i) {
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
    }
    if low[0] > high[0] { ([0.0; 3], [1.0; 3]) } else { (low, high) }
}
