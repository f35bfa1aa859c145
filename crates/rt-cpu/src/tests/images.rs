//! Whole frames: the same by every way of making them, with shadows where they belong.

use bvh_core::glam::Quat;

use super::*;

#[test]
fn images_are_the_same_for_all_threads_traversals_and_simd_levels() {
    let (soup, camera, light) = scene();
    let bvh = tree(&soup, 2);
    let mesh = Mesh { normals: Some(&soup.positions), ..Mesh::new(soup.triangles()) };
    for triangle_test in TriangleTest::ALL {
        let mut images = Vec::new();
        for way in ways() {
            for threads in [1, 2, 3, 8] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let options = RenderOptions { triangle_test, ..way };
                let mut image = Image::new(0, 0);
                let stats = pool.install(|| render(&bvh, &mesh, &camera, Some(&light), &options, &mut image));
                assert_eq!(stats.rays_primary, 133 * 71);
                assert!(stats.rays_shadow > 0 && stats.rays_shadow < stats.hits);
                images.push((pixel_bits(&image), stats.hits, stats.rays_shadow, stats.shadowed));
            }
        }
        assert!(images.iter().all(|i| *i == images[0]), "{triangle_test:?}");
    }
}

#[test]
fn a_lit_sphere_has_no_shadow_on_its_lit_side() {
    for (scale, offset) in [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 300.0)] {
        let sphere = icosphere(4).map(|p| p * scale + Vec3::splat(offset));
        let bvh = tree(&sphere, 1);
        let place = |x, y, z| Vec3::new(x, y, z) * scale + Vec3::splat(offset);
        let camera = Camera::look_at(place(0.0, 0.5, 3.0), place(0.0, 0.0, 0.0), Vec3::Y, 0.8, 200, 200);
        let light = PointLight { position: place(3.0, 2.0, 2.0), color: [1.0; 3] };
        let mut image = Image::new(0, 0);
        let options = RenderOptions::default();
        let mesh = Mesh::new(sphere.triangles());
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        assert!(stats.rays_shadow > 5000, "{stats:?}");
        assert_eq!(stats.shadowed, 0, "scale {scale}, offset {offset}");
    }
}

/// Points far from the corners have the rounding of the corners.
#[test]
fn a_large_plane_does_not_shadow_itself() {
    for (size, tilt) in [1e2_f32, 1e4, 1e6].into_iter().flat_map(|size| [(size, 0.1_f32), (size, 0.7)]) {
        let turn = Quat::from_rotation_x(tilt) * Quat::from_rotation_z(0.37 * tilt);
        let corner = |x: f32, z: f32| turn * Vec3::new(x * size, 0.0, z * size);
        let mut plane = Soup::default();
        plane.push([corner(-1.0, -1.13), corner(0.1, 1.2), corner(1.3, -0.9)]);
        let camera = Camera::look_at(turn * Vec3::new(0.3, 6.0, 8.0), Vec3::ZERO, Vec3::Y, 0.9, 96, 64);
        let light = PointLight { position: turn * Vec3::new(5.0, 20.0, 3.0), color: [1.0; 3] };
        let (mesh, mut image) = (Mesh::new(plane.triangles()), Image::new(0, 0));
        let options = RenderOptions::default();
        let stats = render(&tree(&plane, 1), &mesh, &camera, Some(&light), &options, &mut image);
        assert_eq!((stats.rays_shadow, stats.shadowed), (96 * 64, 0), "size {size}, tilt {tilt}");
    }
}

#[test]
#[should_panic = "pixels of the camera"]
fn rays_are_cast_for_all_pixels_of_the_camera() {
    let (soup, camera, _) = scene();
    let mut pixels = vec![crate::Pixel::default(); 133 * 71 - 1];
    crate::cast(&tree(&soup, 2), &soup.triangles(), &camera, None, &RenderOptions::default(), &mut pixels);
}

#[test]
fn shadows_fall_where_they_should() {
    let (soup, _, light) = scene();
    let bvh = tree(&soup, 1);
    let mesh = Mesh::new(soup.triangles());
    // From above, on the floor: the sphere's shadow lies on the far side from the light.
    let camera = Camera::look_at(Vec3::new(0.0, 12.0, 0.0), Vec3::ZERO, Vec3::NEG_Z, 0.6, 64, 64);
    let mut image = Image::new(0, 0);
    let mut shot = |shadows| {
        let options = RenderOptions { shadows, ..RenderOptions::default() };
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        let pixel = |p: Vec3| {
            // Height above the floor matters little: the floor is 13 below the eye.
            let at = |x: f32| (32.0 + x / 13.0 / 0.3f32.tan() * 32.0) as usize;
            image.pixels()[at(p.z) * 64 + at(p.x)]
        };
        let behind = Vec3::new(-1.0, -1.0, -0.7);
        (stats, pixel(behind)[0], pixel(-behind * 1.6)[0])
    };
    let (with, dark, lit) = shot(true);
    let (without, plain, _) = shot(false);
    assert!(dark < 0.4 * lit && plain > 0.8 * lit, "{dark} {plain} {lit}");
    assert!(with.rays_shadow > 0 && with.shadowed > 0);
    assert_eq!((without.rays_shadow, without.shadowed), (0, 0));
}

#[test]
fn heat_maps_show_where_the_work_is() {
    let (soup, camera, light) = scene();
    let bvh = tree(&soup, 1);
    let mut image = Image::new(0, 0);
    let output = Output::NodesVisited { most: 60 };
    let options = RenderOptions { output, ..RenderOptions::default() };
    let stats = render(&bvh, &Mesh::new(soup.triangles()), &camera, Some(&light), &options, &mut image);
    let (middle, corner) = (image.pixels()[35 * 133 + 50], image.pixels()[0]);
    assert!(middle != corner && stats.nodes_visited > 133 * 71);
    assert!(image.pixels().iter().flatten().all(|c| (0.0..=1.0).contains(c)));
}

#[test]
fn odd_meshes_and_sizes_render() {
    let soup = cube();
    let bvh = tree(&soup, 1);
    let mesh = Mesh {
        normals: Some(&soup.positions[..2]),
        materials: &[Material { color: [1.0, 0.0, 0.0], texture: Some(3), ..Material::DEFAULT }],
        material_of: &[0, 7],
        ..Mesh::new(soup.triangles())
    };
    for (w, h) in [(0, 0), (0, 5), (5, 0), (1, 1), (33, 1), (1, 65)] {
        let camera = Camera::look_at(Vec3::splat(3.0), Vec3::ZERO, Vec3::Y, 1.0, w, h);
        let mut image = Image::new(9, 9);
        let stats = render(&bvh, &mesh, &camera, None, &RenderOptions::default(), &mut image);
        assert_eq!((image.width(), image.height()), (w, h));
        assert_eq!(stats.rays_primary, u64::from(w) * u64::from(h));
    }
    let broken = Camera::look_at(Vec3::NAN, Vec3::ZERO, Vec3::Y, 1.0, 16, 16);
    let mut image = Image::new(0, 0);
    assert_eq!(render(&bvh, &mesh, &broken, None, &RenderOptions::default(), &mut image).hits, 0);
    assert!(image.pixels().iter().flatten().all(|c| c.is_finite()));
}
