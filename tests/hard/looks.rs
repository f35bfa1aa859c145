//! Whole images, with every effect, of what is not finite: vertices, normals, texture coordinates,
//! cameras, lights.

use std::collections::HashSet;
use std::sync::Arc;

use bvh_build::{Builder, build};
use bvh_core::{SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use pivot_tests::{Motion, Soup, noise, pool};
use rt_cpu::{
    AmbientOcclusion, Camera, DiffuseBounces, Effects, Filter, Image, Material, Mesh, PointLight,
    RenderOptions, Texture, Traversal, TriangleTest, Vec2, Wrap, render,
};

const SIDE: u32 = 20;

/// Everything at once, then the two that exclude one another, once with enough rays to get a view
/// of the tree.
fn effects() -> [Effects; 3] {
    let all = Effects { textures: true, alpha: true, mirror: true, ..Effects::default() };
    let occlusion = |samples| Some(AmbientOcclusion { samples, distance: f32::INFINITY });
    let diffuse_bounces = Some(DiffuseBounces { most: 3, sky: [0.3, 0.4, 0.5] });
    [
        Effects { ambient_occlusion: occlusion(0), ..all },
        Effects { ambient_occlusion: occlusion(4), ..all },
        Effects { diffuse_bounces, ..all },
    ]
}

fn view(eye: Vec3) -> Camera {
    Camera::look_at(eye, Vec3::splat(5.0), Vec3::Y, 0.9, SIDE, SIDE)
}

const LIGHT: PointLight = PointLight { position: Vec3::new(20.0, 30.0, 25.0), color: [1.0; 3] };

fn materials() -> [Material; 4] {
    let solid = Material { color: [0.9, 0.5, 0.2], ..Material::DEFAULT };
    [
        solid,
        Material { texture: Some(0), ..solid },
        Material { texture: Some(0), cutoff: Some(0.5), ..solid },
        Material { color: [0.9; 3], mirror: true, ..solid },
    ]
}

fn checks() -> Texture {
    let texels = Arc::new([[255, 80, 0, 255], [0, 200, 30, 0], [10, 20, 250, 90], [250, 250, 250, 200]]);
    Texture {
        texels,
        width: 2,
        height: 2,
        wrap: [Wrap::Repeat, Wrap::MirroredRepeat],
        filter: Filter::Linear,
    }
}

/// The image by every traversal, at every SIMD level, on one thread and on two, which must be one
/// and the same, and finite.
fn image(
    bvh: &bvh_core::Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    test: TriangleTest,
    effects: Effects,
) -> Vec<u32> {
    let mut first: Option<Vec<u32>> = None;
    for (level, traversal) in SimdLevel::available().flat_map(|level| Traversal::ALL.map(|way| (level, way)))
    {
        let threads = 1 + traversal as usize % 2;
        let options = RenderOptions {
            effects,
            traversal,
            simd: level,
            triangle_test: test,
            seed: 3,
            ..Default::default()
        };
        let mut image = Image::new(0, 0);
        pool(threads).install(|| render(bvh, mesh, camera, light, &options, &mut image));
        let colors = || image.pixels().iter().flatten();
        assert!(colors().all(|c| c.is_finite()), "{level:?}, {}, {effects:?}", traversal.name());
        let bits = colors().map(|c| c.to_bits()).collect();
        let first = first.get_or_insert_with(|| Vec::clone(&bits));
        assert!(*first == bits, "{level:?}, {}, {effects:?}", traversal.name());
    }
    first.expect("at least one level")
}

/// Triangles that are not finite are not there, whatever the effect: the image is that of the mesh
/// in which they are points. Normals and texture coordinates that are not finite change the colours
/// of their own triangles at most.
#[test]
fn effects_on_what_is_not_finite() {
    let soup = Soup::new(300, 8);
    let material_of: Vec<u32> = (0..300).map(|i| i % 4).collect();
    let (bad, broken) = ([f32::NAN, f32::INFINITY, f32::NEG_INFINITY], |vertex: usize| vertex / 3 % 7 == 2);
    let normals: Vec<Vec3> =
        (0..900).map(|i| if broken(i) { Vec3::splat(bad[i % 3]) } else { noise(4, i) - 0.5 }).collect();
    let place = |i: usize| Vec2::new(noise(5, i).x, if broken(i) { bad[i % 3] } else { noise(5, i).y });
    let texcoords: Vec<Vec2> = (0..900).map(place).collect();
    let (textures, materials) = ([checks()], materials());
    for (turn, strategy) in Strategy::all().into_iter().enumerate() {
        let start = soup.pose(Motion::PartlyNonFinite, turn);
        let positions = soup.pose(Motion::PartlyNonFinite, turn + 1);
        let triangles = Triangles { positions: &positions, indices: &soup.triangles };
        let first = Triangles { positions: &start, ..triangles };
        let mut bvh = build(&first, Builder::Binned).expect("few enough");
        Updater::new(strategy).update(&mut bvh, &triangles).expect("same count");

        let mut pointed = positions.clone();
        for corners in pointed.chunks_mut(3).filter(|corners| corners.iter().any(|p| !p.is_finite())) {
            corners.fill(Vec3::splat(5.0));
        }
        assert!(pointed != positions, "some are not finite in every frame");
        let without = Triangles { positions: &pointed, ..triangles };
        let fresh = build(&without, Builder::Sweep).expect("few enough");

        let mesh = |triangles| Mesh {
            triangles,
            normals: Some(&normals),
            texcoords: &texcoords,
            textures: &textures,
            materials: &materials,
            material_of: &material_of,
        };
        let camera = view(noise(6, turn) * 10.0 + Vec3::Z * 9.0);
        let (test, effects) = (TriangleTest::ALL[turn % 3], effects()[turn % 4 % 3]);
        let seen = image(&bvh, &mesh(triangles), &camera, Some(&LIGHT), test, effects);
        let colors: HashSet<u32> = seen.iter().copied().collect();
        assert!(colors.len() > 100, "{}: {} colours", strategy.name(), colors.len());
        let expected = image(&fresh, &mesh(without), &camera, Some(&LIGHT), test, effects);
        assert!(seen == expected, "{}, {}, {effects:?}", strategy.name(), test.name());
    }
}

/// A mesh of which nothing is finite is nowhere.
#[test]
fn an_image_of_nothing_finite_is_empty() {
    let soup = Soup::new(50, 8);
    let positions = vec![Vec3::NAN; 150];
    let triangles = Triangles { positions: &positions, indices: &soup.triangles };
    let bvh = build(&triangles, Builder::Sweep).expect("few enough");
    let none = Triangles { indices: &[], ..triangles };
    let empty = build(&none, Builder::Sweep).expect("few enough");
    for effects in effects() {
        let [seen, nothing] = [(&bvh, triangles), (&empty, none)].map(|(bvh, triangles)| {
            let (mesh, test) = (Mesh::new(triangles), TriangleTest::Watertight);
            image(bvh, &mesh, &view(Vec3::ZERO), Some(&LIGHT), test, effects)
        });
        assert!(seen == nothing);
    }
}

/// Whatever a camera or a light is made of, every way to the image gives the same, finite one, and
/// from a camera that is not finite nothing is seen.
#[test]
fn cameras_and_lights_of_any_kind() {
    let soup = Soup::new(200, 9);
    let positions = soup.pose(Motion::Smooth, 0);
    let triangles = Triangles { positions: &positions, indices: &soup.triangles };
    let bvh = build(&triangles, Builder::Sweep).expect("few enough");
    let mesh = Mesh::new(triangles);
    let (eye, target, up, pi) = (Vec3::new(5.0, 6.0, 19.0), Vec3::splat(5.0), Vec3::Y, std::f32::consts::PI);
    let tiny = f32::from_bits(1);
    let defined = [
        (eye, target, up, 0.0),
        (eye, target, up, tiny),
        (eye, target, up, -0.9),
        (eye, target, up, pi),
        (eye, target, up, 100.0),
        (eye, eye, up, 0.9),
        (target, target, Vec3::ZERO, 0.9),
        (eye, target, target - eye, 0.9),
        (eye, target, up * tiny, 0.9),
        (eye, target, up * f32::MAX, 0.9),
        (eye, eye + Vec3::splat(tiny), up, 0.9),
        (eye * 1e18, target, up, 0.9),
        (Vec3::splat(f32::MAX), -Vec3::splat(f32::MAX), up, 0.9),
        (Vec3::splat(1e38), target, up, 0.9),
    ];
    let not_finite = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().flat_map(|bad| {
        let bad_vector = Vec3::new(5.0, bad, 5.0);
        [(bad_vector, target, up, 0.9), (eye, target, up, bad)]
    });
    let odd_up = [f32::NAN, f32::INFINITY].map(|bad| (eye, bad * Vec3::X, up * bad, 0.9));
    let cameras = defined.into_iter().map(|c| (c, true)).chain(not_finite.map(|c| (c, false)));
    for ((eye, target, up, fov_y), defined) in cameras.chain(odd_up.map(|c| (c, true))) {
        let camera = Camera::look_at(eye, target, up, fov_y, SIDE, SIDE);
        for effects in effects() {
            image(&bvh, &mesh, &camera, Some(&LIGHT), TriangleTest::Watertight, effects);
        }
        let mut image = Image::new(0, 0);
        let stats = render(&bvh, &mesh, &camera, None, &RenderOptions::default(), &mut image);
        assert!(defined || stats.hits == 0, "{camera:?}");
    }
    let seen = |light: Option<PointLight>| {
        image(&bvh, &mesh, &view(eye), light.as_ref(), TriangleTest::Watertight, effects()[1])
    };
    let dark = seen(Some(PointLight { color: [0.0; 3], ..LIGHT }));
    assert!(dark != seen(Some(LIGHT)) && dark != seen(None));
    for position in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(Vec3::splat) {
        assert!(seen(Some(PointLight { position, ..LIGHT })) == dark, "no light comes from {position}");
    }
    for position in [Vec3::splat(f32::MAX), Vec3::splat(tiny), positions[3], eye] {
        seen(Some(PointLight { position, ..LIGHT }));
    }
}
