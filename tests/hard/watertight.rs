//! Closed meshes let no ray through: rays from inside, aimed at edges and vertices, near the origin
//! and far from it, through refitting and rotations.

use bvh_build::{Builder, build};
use bvh_core::glam::Vec3Swizzles;
use bvh_core::{Ray, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use pivot_tests::noise;
use rt_cpu::{
    Bvh8, Camera, DiffuseBounces, Effects, Image, Material, Mesh, PointLight, RenderOptions, TriangleTest,
    any_hit, closest_hit, render,
};

/// Rays a mesh, offset and strategy; `PIVOT_WATERTIGHT_RAYS` asks for more.
fn rays() -> usize {
    let rays = std::env::var("PIVOT_WATERTIGHT_RAYS")
        .map_or(5000, |n| n.parse().expect("PIVOT_WATERTIGHT_RAYS: a number"));
    assert!(rays > 0, "PIVOT_WATERTIGHT_RAYS is 0");
    rays
}

/// A dented ball of 2 x 24 x 24 triangles, closed.
fn ball(offset: Vec3, time: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    const N: u32 = 24;
    let vertex = |ring: u32, i: u32| {
        let (theta, phi) =
            (std::f32::consts::PI * ring as f32 / N as f32, std::f32::consts::TAU * i as f32 / N as f32);
        let direction = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        offset + direction * (10.0 + (3.0 * theta + time).sin() * (2.0 * phi).cos())
    };
    let mut positions = vec![vertex(0, 0), vertex(N, 0)];
    positions.extend((1..N).flat_map(|ring| (0..N).map(move |i| vertex(ring, i))));
    let at = |ring: u32, i: u32| match ring {
        0 => 0,
        N => 1,
        _ => 2 + (ring - 1) * N + i % N,
    };
    let mut triangles = Vec::new();
    for ring in 0..N {
        for i in 0..N {
            let [a, b, c, d] = [at(ring, i), at(ring, i + 1), at(ring + 1, i), at(ring + 1, i + 1)];
            if ring > 0 {
                triangles.push([a, b, c]);
            }
            if ring < N - 1 {
                triangles.push([b, d, c]);
            }
        }
    }
    (positions, triangles)
}

/// How many of the rays from the middle, aimed at edges and vertices, leave the ball: closest and
/// any hit, of the tree and of its eight-wide view.
fn leaks(offset: f32, strategy: Strategy, test: TriangleTest, rays: usize) -> usize {
    let offset = Vec3::new(offset, -0.7 * offset, 0.3 * offset);
    let (start, triangles) = ball(offset, 0.0);
    let first = Triangles { positions: &start, indices: &triangles };
    let mut bvh = build(&first, Builder::Sweep).expect("few enough");
    let (positions, _) = ball(offset, 1.0);
    let mesh = Triangles { positions: &positions, indices: &triangles };
    Updater::new(strategy).update(&mut bvh, &mesh).expect("same count");
    let mut wide = Bvh8::default();
    wide.update(&bvh, &mesh);
    let leaves = |i: &usize| {
        let random = noise(3, *i);
        let triangle = triangles[(random.x * triangles.len() as f32) as usize % triangles.len()];
        let [a, b] = [triangle[i % 3], triangle[(i + 1) % 3]].map(|v| positions[v as usize]);
        let target = if i.is_multiple_of(4) { a } else { a + (b - a) * random.y };
        let from = offset + (noise(4, *i) - 0.5) * 4.0;
        let (ray, t_max) = (Ray::new(from, target - from), f32::INFINITY);
        closest_hit(&bvh, &mesh, &ray, t_max, test).is_none()
            || wide.closest_hit(&ray, t_max, test).is_none()
            || !any_hit(&bvh, &mesh, &ray, t_max, test)
            || !wide.any_hit(&ray, t_max, test)
    };
    (0..rays).filter(leaves).count()
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    let mut count = 0;
    for strategy in Strategy::all() {
        let name = strategy.name();
        for offset in [0.0, 1e3, 1e6] {
            for test in [TriangleTest::Watertight, TriangleTest::Double] {
                let found = leaks(offset, strategy, test, rays());
                assert_eq!(found, 0, "{name} at offset {offset}, {}", test.name());
                count += rays();
            }
        }
    }
    println!("{count} rays, one by one");
}

/// Why the fast test is not the default. `cargo xtask reproduce accuracy` has the curve.
#[test]
fn the_fast_test_leaks_at_edges() {
    const RAYS: usize = 20_000;
    let found = leaks(0.0, Strategy::Refit, TriangleTest::MollerTrumbore, RAYS);
    println!("the fast test lets {found} of {RAYS} rays aimed at edges through");
    assert!(found > 0 && found < RAYS / 4, "{found}");
}

/// Light that bounces about in a closed mesh never comes to the sky, whatever made the tree, at
/// every SIMD level: the sky alone is blue.
#[test]
fn no_light_of_the_sky_enters_a_closed_mesh() {
    const WIDTH: u32 = 24;
    let materials = [Material { color: [0.9; 3], ..Material::DEFAULT }];
    let mut bounces = 0;
    for (turn, strategy) in Strategy::all().into_iter().enumerate() {
        let offset = [0.0, 1e3, 1e5][turn % 3] * Vec3::new(1.0, -0.7, 0.3);
        let [(before, triangles), (positions, _)] = [0.0, 1.0].map(|time| ball(offset, time));
        let first = Triangles { positions: &before, indices: &triangles };
        let mut bvh = build(&first, Builder::Binned).expect("few enough");
        let now = Triangles { positions: &positions, indices: &triangles };
        Updater::new(strategy).update(&mut bvh, &now).expect("same count");
        let mesh = Mesh { materials: &materials, material_of: &vec![0; triangles.len()], ..Mesh::new(now) };
        let light = PointLight { position: offset, color: [1.0, 1.0, 0.0] };
        let camera = Camera::look_at(offset + Vec3::X, offset + noise(7, turn), Vec3::Y, 1.5, WIDTH, WIDTH);
        for simd in SimdLevel::available() {
            let sky = DiffuseBounces { most: 6, sky: [0.0, 0.0, 1.0] };
            let effects = Effects { diffuse_bounces: Some(sky), ..Effects::default() };
            for triangle_test in [TriangleTest::Watertight, TriangleTest::Double] {
                let options = RenderOptions { simd, effects, triangle_test, ..RenderOptions::default() };
                let mut image = Image::new(0, 0);
                let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
                bounces += stats.rays_bounce;
                let blue = image.pixels().iter().filter(|[red, _, blue]| *red == 0.0 || *blue > 0.0).count();
                assert_eq!(blue, 0, "{} at {offset}, {simd:?}, {}", strategy.name(), triangle_test.name());
            }
        }
    }
    println!("{bounces} rays that bounced");
    assert!(bounces > 100_000);
}

/// Half the side of [`room`], and pixels from the middle of an image to its edge.
const HALF: i32 = 64;

/// A closed cube of 65 x 65 quads a side. Seen from its middle with a right angle of view in `2 *
/// HALF` pixels, one pixel in four looks at a vertex, the others at the middle of an edge, as
/// exactly as `f32` allows.
fn room(offset: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let inside = (0..HALF).map(|i| (2 * i - HALF) as f32 + 0.5);
    let places: Vec<f32> = [-HALF as f32].into_iter().chain(inside).chain([HALF as f32]).collect();
    let last = places.len() - 1;
    let mut numbers = std::collections::HashMap::new();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (axis, side) in (0..6).map(|face| (face / 2, face % 2 * last)) {
        let mut vertex = |u: usize, v: usize| {
            let mut at = [side; 3];
            (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (u, v);
            *numbers.entry(at).or_insert_with(|| {
                positions.push(offset + Vec3::from(at.map(|i| places[i])));
                positions.len() as u32 - 1
            })
        };
        for (u, v) in (0..last * last).map(|i| (i % last, i / last)) {
            let [a, b, c, d] = [vertex(u, v), vertex(u + 1, v), vertex(u, v + 1), vertex(u + 1, v + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    (positions, triangles)
}

#[test]
fn no_pixel_of_a_closed_mesh_is_empty_in_packets() {
    const WIDTH: u32 = 2 * HALF as u32;
    let pixel_count = (WIDTH * WIDTH) as usize;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let views = (rays() / (18 * pixel_count)).max(1);
    let mut pixels = vec![rt_cpu::Pixel::default(); pixel_count];
    let mut count = 0;
    for (case, offset) in [0.0, 1e3, 1e6].into_iter().enumerate() {
        let offset = Vec3::new(offset, -0.75 * offset, 0.5 * offset);
        let (positions, triangles) = room(offset);
        let mesh = Triangles { positions: &positions, indices: &triangles };
        let before: Vec<_> = positions.iter().map(|p| p + (p - offset).yzx() * 0.4).collect();
        let first = Triangles { positions: &before, indices: &triangles };
        let built = build(&first, Builder::Binned).expect("few enough");
        for name in ["refit", "refit+rotate"] {
            let mut bvh = built.clone();
            let strategy: Strategy = name.parse().expect("known");
            Updater::new(strategy).update(&mut bvh, &mesh).expect("same count");
            for view in case..case + views {
                // From the very middle first, then from near it.
                let eye = offset + (noise(5, view) - 0.5) * if view < 6 { 0.0 } else { 1e-3 };
                let (along, up) = (axes[view % 6], axes[(view + 1 + view / 6) % 6]);
                let camera = Camera::look_at(eye, eye + along, up, std::f32::consts::FRAC_PI_2, WIDTH, WIDTH);
                let traversals = rt_cpu::Traversal::ALL;
                for (simd, traversal) in
                    SimdLevel::available().flat_map(|level| traversals.map(|traversal| (level, traversal)))
                {
                    for triangle_test in [TriangleTest::Watertight, TriangleTest::Double] {
                        let options = RenderOptions { simd, traversal, triangle_test, ..Default::default() };
                        rt_cpu::cast(&bvh, &mesh, &camera, None, &options, &mut pixels);
                        let empty = pixels.iter().filter(|pixel| pixel.hit().is_none()).count();
                        let (traversal, test) = (traversal.name(), triangle_test.name());
                        assert_eq!(
                            empty, 0,
                            "{name} at {offset}, view {view}, {simd:?}, {traversal}, {test}"
                        );
                        count += pixel_count;
                    }
                }
            }
        }
    }
    println!("{count} rays of images");
}
