//! `bart-museum`: a sculpture of triangles that each travel between unrelated places in five
//! shapes, in a still room.
//!
//! In the museum of the Benchmark for Animated Ray Tracing (Lext, Assarsson, Möller 2001) every
//! animated triangle has five keys of its own. At the first two its neighbours are anybody; in the
//! last three they are those next to it in the order of the triangles.

use std::f32::consts::{PI, TAU};

use anim::{KeyFrames, Model, Motion};
use glam::{Vec3, vec3};

use crate::rigid::{rotated, rotation};
use crate::shape::{Assembly, Mesh, around, turned};
use crate::{Effects, Make, Scene, SceneError, SceneInfo, SceneOptions, Simulated};

/// Animated triangles of level 8 of the benchmark: 4 to the power of 8.
const TRIANGLES: usize = 65_536;
const SHAPES: usize = 5;
/// One second from shape to shape.
const SECONDS_PER_SHAPE: f64 = 1.0;
const FRAMES: usize = 200;
/// Height of the pedestal's top, on which the first shape lies.
const PEDESTAL: f32 = 1.45;
/// Middle of the other shapes.
const CENTER: Vec3 = vec3(0.0, 2.6, 0.0);
/// The hall: a prism over a regular polygon.
const RADIUS: f32 = 5.5;
const HEIGHT: f32 = 5.0;
const SIDES: usize = 24;

pub(crate) const INFO: SceneInfo = SceneInfo {
    name: "bart-museum",
    about: "a sculpture whose triangles travel between unrelated places in five shapes, in a museum",
    triangles: TRIANGLES + ROOM_TRIANGLES,
    frames: FRAMES,
    effects: Effects::of_scene(Simulated::empty(), Motion::KEY_FRAMES),
    key_bytes: SHAPES * 3 * TRIANGLES * size_of::<Vec3>(),
    make: &[
        ("", Make::Whole(|options| scene(options, 0))),
        (":0", Make::Whole(|options| scene(options, 0))),
        (":1", Make::Whole(|options| scene(options, 1))),
        (":2", Make::Whole(|options| scene(options, 2))),
        (":3", Make::Whole(|options| scene(options, 3))),
        (":4", Make::Whole(|options| scene(options, 4))),
    ],
};

/// Steps about the axes of pillars and pedestal, and of posts.
const STEPS: usize = 33;
const POST_STEPS: usize = 12;
/// Posts about the pedestal, and their profile.
const POSTS: usize = 16;
const POST: [(f32, f32); 8] =
    [(0.0, 0.8), (0.05, 0.76), (0.03, 0.7), (0.03, 0.3), (0.05, 0.2), (0.03, 0.1), (0.08, 0.0), (0.0, 0.0)];
/// About as many as the original has, 10,284: walls and flats, pillars, pedestal, posts, paintings.
const ROOM_TRIANGLES: usize = 4 * SIDES + 8 * 28 * STEPS + 12 * STEPS + POSTS * 12 * POST_STEPS + 6 * 12;

/// A triangle's corners.
type Corners = [Vec3; 3];

/// The museum, started from one of its shapes.
fn scene(options: &SceneOptions<'_>, start: usize) -> Result<Scene, SceneError> {
    let mut random = fastrand::Rng::with_seed(options.seed);
    // `less` is the number of levels of the benchmark that the sculpture is below the full one: as
    // many, up to four, as leave at least the wanted part of the triangles. One level less has a
    // quarter of the triangles, and edges of loose triangles twice as long.
    let detail = options.detail.unwrap_or(1.0);
    let less = (1..=4).take_while(|&less| 0.25_f32.powi(less) >= detail).count() as u32;
    let (count, scale) = (TRIANGLES >> (2 * less), (1 << less) as f32);
    let mut shapes: [Vec<Corners>; SHAPES] = [
        heap(count, scale, &mut random),
        flame(count, scale, &mut random),
        cube(less),
        ball(less),
        knot(less),
    ];
    for shape in &mut shapes[..2] {
        // As `Rng::shuffle`, whose numbers depend on the width of `usize`.
        (1..shape.len()).for_each(|i| shape.swap(i, random.u64(..=i as u64) as usize));
    }
    shapes.rotate_left(start);

    let mut assembly = Assembly::default();
    let bronze = assembly.material([0.75, 0.45, 0.2]);
    let mut sculpture = Mesh::default();
    sculpture.add(&shapes[0]);
    assembly.part("sculpture", &sculpture, Motion::KEY_FRAMES, bronze);
    furnish(&mut assembly);
    let Assembly { topology, positions: rest } = assembly;
    let more = shapes[1..].iter().map(|shape| [&shape.concat()[..], &rest[3 * count..]].concat()).collect();
    let model = Model { topology, rest, ..Model::default() };
    let animation = KeyFrames::new(model, more, SECONDS_PER_SHAPE)?;
    let seen = (vec3(0.5, 2.5, 4.9), vec3(0.0, 2.15, 0.0));
    Ok(Scene::new(&INFO, Box::new(animation), seen, 55_f32.to_radians(), vec3(-1.6, 4.7, 2.8)))
}

/// Crumbs in a heap on the pedestal.
fn heap(count: usize, scale: f32, random: &mut fastrand::Rng) -> Vec<Corners> {
    let mut crumb = || {
        let direction = around(TAU * random.f32());
        let out = 0.46 * random.f32().sqrt();
        let top = 0.14 * (1.0 - out / 0.46) + 0.02;
        let at = (out * direction).with_y(PEDESTAL + top * random.f32());
        let mut corner =
            || at + 0.012 * scale * vec3(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5);
        [corner(), corner(), corner()]
    };
    (0..count).map(|_| crumb()).collect()
}

/// Slivers along three twisted tongues that rise from the pedestal.
fn flame(count: usize, scale: f32, random: &mut fastrand::Rng) -> Vec<Corners> {
    let mut sliver = || {
        let h = random.f32();
        let tongue = (random.f32() * 3.0).floor();
        let (sin, cos) = libm::sincosf(TAU * (tongue / 3.0 + 0.7 * h));
        let (off_sin, off_cos) = libm::sincosf(TAU * random.f32());
        let (axis, width) = (0.42 * libm::sinf(PI * h * 0.9), 0.3 * (1.0 - h) * (0.4 + 1.6 * h).min(1.0));
        let at = vec3(axis * cos + width * off_cos, PEDESTAL + 0.1 + 2.4 * h, axis * sin + width * off_sin);
        let along = vec3(-sin, 2.0, cos).normalize() * 0.045 * scale;
        let across = vec3(-off_sin, 0.0, off_cos) * 0.008;
        [at - across, at + across, at + along]
    };
    (0..count).map(|_| sliver()).collect()
}

fn ball(less: u32) -> Vec<Corners> {
    round(less).into_iter().map(|t| t.map(|p| CENTER + 0.8 * p.normalize())).collect()
}

fn cube(less: u32) -> Vec<Corners> {
    round(less).into_iter().map(|t| t.map(|p| CENTER + 0.6 * p / p.abs().max_element())).collect()
}

/// A double pyramid over an octagon, its 16 triangles split into four six times at full detail.
fn round(less: u32) -> Vec<Corners> {
    let rim = |k: usize| around(TAU * k as f32 / 8.0);
    let pair = |k| [[rim(k), Vec3::Y, rim(k + 1)], [rim(k), rim(k + 1), Vec3::NEG_Y]];
    let mut all: Vec<Corners> = (0..8).flat_map(pair).collect();
    for _ in less..6 {
        all = all.into_iter().flat_map(split).collect();
    }
    all
}

fn split([a, b, c]: Corners) -> [Corners; 4] {
    let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// A trefoil knot, 512 steps along and 64 around at full detail.
fn knot(less: u32) -> Vec<Corners> {
    let [along, around] = [512, TRIANGLES / 2 / 512].map(|steps| steps >> less);
    let curve = |u: f32| {
        let ((s1, c1), (s2, c2)) = (libm::sincosf(TAU * u), libm::sincosf(2.0 * TAU * u));
        CENTER + 0.3 * vec3(s1 + 2.0 * s2, c1 - 2.0 * c2, -libm::sinf(3.0 * TAU * u))
    };
    let point = |i: usize, j: usize| {
        let u = i as f32 / along as f32;
        let tangent = (curve(u + 1e-3) - curve(u - 1e-3)).normalize();
        let side = tangent.cross(Vec3::Z).normalize();
        let (sin, cos) = libm::sincosf(TAU * j as f32 / around as f32);
        curve(u) + 0.2 * (cos * side + sin * side.cross(tangent))
    };
    let quad = |(i, j)| {
        let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1)];
        [[a, c, b], [b, c, d]]
    };
    (0..along).flat_map(|i| (0..around).map(move |j| (i, j))).flat_map(quad).collect()
}

fn furnish(assembly: &mut Assembly) {
    let [wall, floor, stone, frame] =
        [[0.72, 0.7, 0.62], [0.45, 0.33, 0.24], [0.8, 0.8, 0.82], [0.2, 0.3, 0.5]]
            .map(|color| assembly.material(color));
    let on_wall = |k: usize| RADIUS * around(TAU * k as f32 / SIDES as f32);
    let (mut walls, mut flats) = (Mesh::default(), Mesh::default());
    for k in 0..SIDES {
        let [a, b] = [on_wall(k), on_wall(k + 1)];
        let up = HEIGHT * Vec3::Y;
        walls.add(&[[a, b, b + up], [a, b + up, a + up]]);
        flats.add(&[[Vec3::ZERO, b, a], [up, a + up, b + up]]);
    }
    assembly.part("walls", &walls, Motion::empty(), wall);
    assembly.part("floor and ceiling", &flats, Motion::empty(), floor);

    let [top, foot] = [PEDESTAL, 0.15];
    let profile =
        [(0.0, top), (0.6, top), (0.6, 1.3), (0.45, 1.2), (0.5, foot), (0.75, foot), (0.75, 0.0), (0.0, 0.0)];
    assembly.part("pedestal", &turned(&profile, STEPS), Motion::empty(), stone);
    // A capital, and a shaft that swells a little.
    let shaft = (0..12).map(|i| {
        let up = 1.0 - i as f32 / 11.0;
        (0.25 - 0.03 * up * up, (HEIGHT - 0.3) * up)
    });
    let capital = [(0.0, HEIGHT), (0.3, HEIGHT)].into_iter();
    let pillar: Vec<_> = capital.chain(shaft).chain([(0.28, 0.0), (0.0, 0.0)]).collect();
    let pillar = turned(&pillar, STEPS);
    for k in 0..8 {
        let place = 0.86 * RADIUS * around(TAU * (k as f32 + 0.5) / 8.0);
        assembly.part("pillar", &pillar.clone().moved(|p| p + place), Motion::empty(), stone);
    }
    let post = turned(&POST, POST_STEPS);
    for k in 0..POSTS {
        let place = 1.9 * around(TAU * k as f32 / POSTS as f32);
        assembly.part("post", &post.clone().moved(|p| p + place), Motion::empty(), frame);
    }
    for k in 0..6 {
        let turn = rotation(Vec3::Y, TAU * k as f32 / 6.0);
        let painting =
            cuboid(vec3(0.05, 0.6, 0.9)).moved(|p| rotated(turn, p + vec3(0.97 * RADIUS, 2.4, 0.0)));
        assembly.part("painting", &painting, Motion::empty(), frame);
    }
}

/// A box about the origin with the given half edges.
fn cuboid(half: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let corner = |u: f32, v: f32| {
                let mut corner = [sign, u * sign, v];
                corner.rotate_right(axis);
                Vec3::from(corner) * half
            };
            let [a, b, c, d] = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            mesh.add(&[[a, b, c], [a, c, d]]);
        }
    }
    mesh
}
