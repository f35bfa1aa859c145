//! Effects against closed forms and brute force, and what they cost where nothing calls for them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bvh_core::glam::Vec2;

use super::*;
use crate::cast::see_through;
use crate::shade::{NADIR, ZENITH};
use crate::{
    AmbientOcclusion, Bvh8, DiffuseBounces, Effects, Filter, Material, RenderStats, StageTimes, Texture,
    Wrap, render_with,
};

const OCCLUSION: AmbientOcclusion = AmbientOcclusion { samples: 16, distance: f32::INFINITY };

fn everything(most: u32) -> Effects {
    Effects {
        textures: true,
        alpha: true,
        mirror: true,
        ambient_occlusion: Some(OCCLUSION),
        diffuse_bounces: (most > 0).then_some(DiffuseBounces { most, sky: [0.3, 0.4, 0.5] }),
    }
}

fn with(effects: Effects) -> RenderOptions {
    RenderOptions { effects, ..RenderOptions::default() }
}

fn shot(
    soup: &Soup,
    materials: &[Material],
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
) -> (Image, RenderStats) {
    let (bvh, mut image) = (tree(soup, 2), Image::new(0, 0));
    let material_of = vec![0; soup.indices.len()];
    let mesh = Mesh { materials, material_of: &material_of, ..Mesh::new(soup.triangles()) };
    let stats = render(&bvh, &mesh, camera, light, options, &mut image);
    (image, stats)
}

/// Pixel by pixel mean of the first `samples` samples.
fn mean(
    soup: &Soup,
    material: Material,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    samples: u32,
) -> Image {
    let mut sum = Image::new(camera.width, camera.height);
    for sample in 0..samples {
        sum.add(&shot(soup, &[material], camera, light, &RenderOptions { sample, ..*options }).0);
    }
    sum.scale(1.0 / samples as f32);
    sum
}

fn average(image: &Image) -> [f32; 3] {
    let n = image.pixels().len() as f64;
    [0, 1, 2].map(|k| (image.pixels().iter().map(|p| f64::from(p[k])).sum::<f64>() / n) as f32)
}

fn floor(side: f32) -> Soup {
    let mut soup = Soup::default();
    let corner = |x: f32, z: f32| Vec3::new(side * x, 0.0, side * z);
    soup.push([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]);
    soup.push([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    soup
}

#[test]
fn effects_that_nothing_calls_for_cost_nothing_and_change_nothing() {
    let (soup, camera, light) = scene();
    let materials = [Material { color: [0.3, 0.6, 0.9], ..Material::DEFAULT }];
    let (plain, stats) = shot(&soup, &materials, &camera, Some(&light), &RenderOptions::default());
    let all = Effects { ambient_occlusion: None, ..everything(0) };
    let (same, same_stats) = shot(&soup, &materials, &camera, Some(&light), &with(all));
    assert_eq!(pixel_bits(&plain), pixel_bits(&same));
    assert_eq!(stats, same_stats);
    let of_effects =
        |s: &RenderStats| [s.rays_mirror, s.rays_ambient_occlusion, s.rays_bounce, s.rays_again, s.textured];
    assert_eq!(of_effects(&stats), [0; 5]);
    assert!(stats.rays_shadow > 0);

    let mirror = [Material { mirror: true, ..materials[0] }];
    let alpha_cutouts = [Material { opacity: 0.0, cutoff: Some(0.5), ..materials[0] }];
    let textured = [Material { texture: Some(0), ..materials[0] }];
    let count = |materials: &[Material], effects| {
        of_effects(&shot(&soup, materials, &camera, Some(&light), &with(effects)).1)
    };
    let occlusion = Effects { ambient_occlusion: Some(OCCLUSION), ..Effects::default() };
    let bounces = Effects { diffuse_bounces: everything(1).diffuse_bounces, ..Effects::default() };
    assert_eq!(count(&mirror, Effects::default()), [0; 5]);
    assert_eq!(count(&alpha_cutouts, Effects::default()), [0; 5]);
    assert_eq!(count(&textured, Effects::default()), [0; 5]);
    assert_eq!(count(&textured, all), [0, 0, 0, 0, stats.hits]);
    let [reflected, others @ ..] = count(&mirror, all);
    assert!(reflected > 0 && others == [0; 4]);
    assert_eq!(count(&materials, occlusion), [0, 16 * stats.hits, 0, 0, 0]);
    assert_eq!(count(&materials, bounces), [0, 0, stats.hits, 0, 0]);
    assert_eq!(count(&alpha_cutouts, all), [0, 0, 0, stats.hits, 0], "all of it is a hole");
}

/// A scene that calls for everything: a textured floor with holes, a mirror in front of it, a ball.
struct Varied {
    soup: Soup,
    texcoords: Vec<Vec2>,
    material_of: Vec<u32>,
    textures: [Texture; 1],
    camera: Camera,
    light: PointLight,
}

impl Varied {
    fn new() -> Self {
        let (mut soup, camera, light) = scene();
        let n = soup.indices.len();
        let mut material_of = vec![0; n];
        material_of[n - 2..].fill(1);
        soup.push([Vec3::new(-3.0, -1.0, -1.5), Vec3::new(3.0, -1.0, -2.0), Vec3::new(0.0, 3.0, -2.0)]);
        material_of.push(2);
        let texcoords = soup.positions.iter().map(|p| Vec2::new(p.x, p.z)).collect();
        Self { soup, texcoords, material_of, textures: [checks()], camera, light }
    }

    /// Smooth.
    fn mesh(&self) -> Mesh<'_> {
        Mesh {
            normals: Some(&self.soup.positions),
            texcoords: &self.texcoords,
            textures: &self.textures,
            materials: &VARIED,
            material_of: &self.material_of,
            ..Mesh::new(self.soup.triangles())
        }
    }
}

const TEXELS: [[u8; 4]; 4] = [[255, 80, 0, 255], [0, 200, 30, 0], [10, 20, 250, 90], [250, 250, 250, 200]];

fn checks() -> Texture {
    let wrap = [Wrap::Repeat, Wrap::MirroredRepeat];
    Texture { texels: Arc::new(TEXELS), width: 2, height: 2, wrap, filter: Filter::Linear }
}

const VARIED: [Material; 3] = [
    Material { color: [0.9, 0.5, 0.2], ..Material::DEFAULT },
    Material { texture: Some(0), cutoff: Some(0.5), ..Material::DEFAULT },
    Material { color: [0.9; 3], mirror: true, ..Material::DEFAULT },
];

/// Ambient occlusion of no rays changes nothing, but takes the way of waves.
#[test]
fn a_wave_is_shaded_as_direct_light_is() {
    let varied = Varied::new();
    let (bvh, mesh) = (tree(&varied.soup, 2), varied.mesh());
    let (camera, light) = (varied.camera, varied.light);
    let textured = |ambient_occlusion| {
        let effects = Effects { textures: true, alpha: true, ambient_occlusion, ..Effects::default() };
        let mut image = Image::new(0, 0);
        let stats = render(&bvh, &mesh, &camera, Some(&light), &with(effects), &mut image);
        assert!(stats.textured > 0);
        (pixel_bits(&image), stats.textured)
    };
    let no_rays = AmbientOcclusion { samples: 0, ..OCCLUSION };
    assert_eq!(textured(None), textured(Some(no_rays)), "direct light, and a wave of it");
}

#[test]
fn effects_are_the_same_for_all_threads_traversals_and_simd_levels() {
    let varied = Varied::new();
    let (bvh, mesh) = (tree(&varied.soup, 2), varied.mesh());
    let (camera, light) = (varied.camera, varied.light);
    for (effects, sample) in [(everything(0), 0), (everything(5), 3)] {
        let mut images = Vec::new();
        for way in ways() {
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let options = RenderOptions { effects, seed: 7, sample, ..way };
                let mut image = Image::new(0, 0);
                let stats = pool.install(|| render(&bvh, &mesh, &camera, Some(&light), &options, &mut image));
                let rays = [stats.rays_mirror, stats.rays_ambient_occlusion, stats.rays_bounce];
                assert!(stats.rays_mirror > 0 && stats.rays_again > 0);
                images.push((pixel_bits(&image), rays, stats.rays_shadow));
            }
        }
        assert!(images.iter().all(|i| *i == images[0]));
        let other = RenderOptions { effects, seed: 8, sample, ..RenderOptions::default() };
        let mut image = Image::new(0, 0);
        render(&bvh, &mesh, &camera, Some(&light), &other, &mut image);
        assert_ne!(pixel_bits(&image), images[0].0, "another seed");
        let same = RenderOptions { seed: 7, ..other };
        let drawn = |triangles: &Triangles<'_>| {
            let mut wide = Bvh8::default();
            wide.update(&bvh, triangles);
            let mut image = Image::new(0, 0);
            render_with(&bvh, Some(&wide), &mesh, &camera, Some(&light), &same, &mut image);
            pixel_bits(&image)
        };
        let Triangles { positions, indices } = mesh.triangles;
        assert!(drawn(&mesh.triangles) == images[0].0, "a view that was there");
        let moved: Vec<Vec3> = positions.iter().map(|p| *p * 0.5).collect();
        assert!(drawn(&Triangles { positions: &moved, indices }) != images[0].0, "a view of something else");
        let more = [indices, indices].concat();
        assert!(drawn(&Triangles { positions, indices: &more }) == images[0].0, "a view of more triangles");
    }
}

/// Asked for, the time of a frame is parted among the stages that it has; the picture is the same.
#[test]
fn times_belong_to_stages_that_ran() {
    let varied = Varied::new();
    let (bvh, mesh) = (tree(&varied.soup, 2), Mesh { normals: None, ..varied.mesh() });
    let (camera, light) = (varied.camera, varied.light);
    let drawn = |effects, timed| {
        let mut image = Image::new(0, 0);
        let options = RenderOptions { timed, ..with(effects) };
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        (stats, pixel_bits(&image))
    };
    for effects in [Effects::default(), everything(0), everything(2)] {
        let (untimed, expected) = drawn(effects, false);
        let (timed, pixels) = drawn(effects, true);
        assert_eq!(untimed.times, StageTimes::default());
        assert_eq!(RenderStats { times: StageTimes::default(), ..timed }, untimed);
        assert!(pixels == expected);
        let stages = |times: StageTimes| {
            let StageTimes { primary, shadow, alpha, textures, mirror, ambient_occlusion, diffuse_bounces } =
                times;
            [
                ("primary", timed.rays_primary, primary),
                ("shadow", timed.rays_shadow, shadow),
                ("alpha", timed.rays_again, alpha),
                ("textures", timed.textured, textures),
                ("mirror", timed.rays_mirror, mirror),
                ("ambient occlusion", timed.rays_ambient_occlusion, ambient_occlusion),
                ("diffuse bounces", timed.rays_bounce, diffuse_bounces),
            ]
        };
        // A coarse clock may see no time in a single picture.
        let (start, mut times) = (Instant::now(), timed.times);
        let is_unseen = |(_, work, time): (&str, u64, Duration)| work > 0 && time == Duration::ZERO;
        while stages(times).into_iter().any(is_unseen) && start.elapsed() < Duration::from_secs(10) {
            times += drawn(effects, true).0.times;
        }
        for (stage, work, time) in stages(times) {
            assert_eq!(work > 0, time > Duration::ZERO, "{stage}");
        }
        assert_eq!(timed.textured > 0, effects.textures);
    }
}

/// Over open ground nothing is hidden, in a closed box everything.
#[test]
fn ambient_occlusion_of_a_plane_and_of_a_closed_box() {
    let white = [Material { color: [1.0; 3], ..Material::DEFAULT }];
    let dark = PointLight { position: Vec3::new(0.0, 9.0, 0.0), color: [0.0; 3] };
    let above = Camera::look_at(Vec3::new(0.1, 3.0, 0.2), Vec3::ZERO, Vec3::Z, 0.5, 40, 40);
    let occlusion = |distance| {
        let effects = Effects {
            ambient_occlusion: Some(AmbientOcclusion { samples: 8, distance }),
            ..Effects::default()
        };
        with(effects)
    };
    for scale in [1e-3, 1.0, 1e4] {
        let plane = floor(50.0).map(|p| p * scale);
        let camera = Camera::look_at(above.eye * scale, Vec3::ZERO, Vec3::Z, 0.5, 40, 40);
        let plain = shot(&plane, &white, &camera, Some(&dark), &RenderOptions::default()).0;
        let open = shot(&plane, &white, &camera, Some(&dark), &occlusion(f32::INFINITY)).0;
        assert_eq!(pixel_bits(&plain), pixel_bits(&open), "scale {scale}");
    }
    let inside = Camera::look_at(Vec3::new(0.2, 0.1, 0.3), Vec3::new(1.0, 0.5, -0.4), Vec3::Y, 1.5, 40, 40);
    let (hidden, stats) = shot(&cube(), &white, &inside, Some(&dark), &occlusion(f32::INFINITY));
    assert_eq!((stats.hits, average(&hidden)), (1600, [0.0; 3]));
    // Nothing is as near as that, but for the other walls as seen from edges.
    let near = average(&shot(&cube(), &white, &inside, Some(&dark), &occlusion(1e-3)).0)[0];
    let plain = average(&shot(&cube(), &white, &inside, Some(&dark), &RenderOptions::default()).0)[0];
    assert!(near > 0.98 * plain, "{near} {plain}");
}

/// A wall at right angles to the ground hides half of the sky right at the corner, and at a
/// distance d from it (1 - sqrt(1 / (1 + (h / d)^2))) / 2 if it is of height h and endless: the
/// view factor of an edge.
#[test]
fn ambient_occlusion_beside_a_wall() {
    let (height, far) = (1.0, 40.0);
    let mut soup = floor(20.0);
    let corner = |y: f32, z: f32| Vec3::new(0.0, y, z);
    soup.push([corner(0.0, -far), corner(0.0, far), corner(height, far)]);
    soup.push([corner(0.0, -far), corner(height, far), corner(height, -far)]);
    let white = Material { color: [1.0; 3], ..Material::DEFAULT };
    let dark = PointLight { position: Vec3::new(9.0, 9.0, 0.0), color: [0.0; 3] };
    for distance in [0.1, 0.5, 2.0] {
        let at = Vec3::new(distance, 0.0, 0.0);
        let camera = Camera::look_at(at + Vec3::Y * 0.05, at, Vec3::Z, 1e-3, 8, 8);
        let effects = Effects { ambient_occlusion: Some(OCCLUSION), ..Effects::default() };
        let seen = average(&mean(&soup, white, &camera, Some(&dark), &with(effects), 16))[0];
        let plain = average(&mean(&soup, white, &camera, Some(&dark), &RenderOptions::default(), 1))[0];
        let hidden = (1.0 - (1.0 / (1.0 + (height / distance).powi(2))).sqrt()) / 2.0;
        assert!((seen / plain - (1.0 - hidden)).abs() < 0.01, "{distance}: {} {hidden}", seen / plain);
    }
}

/// Nothing of a convex body under a constant sky sees anything but the sky: it has the sky's colour
/// times its own.
#[test]
fn a_convex_body_in_a_furnace() {
    let sky = [0.3, 0.4, 0.5];
    let color = [0.8, 0.5, 0.25];
    let material = [Material { color, ..Material::DEFAULT }];
    let camera = Camera::look_at(Vec3::new(2.0, 1.5, 3.0), Vec3::ZERO, Vec3::Y, 0.3, 32, 32);
    for (scale, most) in [(1e-6, 1), (1.0, 20), (1e6, 5)] {
        let ball = icosphere(3).map(|p| p * scale);
        let camera = Camera::look_at(camera.eye * scale, Vec3::ZERO, Vec3::Y, 0.3, 32, 32);
        let options =
            with(Effects { diffuse_bounces: Some(DiffuseBounces { most, sky }), ..Effects::default() });
        let (image, stats) = shot(&ball, &material, &camera, None, &options);
        assert_eq!((stats.hits, stats.rays_bounce), (1024, 1024));
        for pixel in image.pixels() {
            assert_eq!(*pixel, [0, 1, 2].map(|k| color[k] * sky[k]), "scale {scale}");
        }
    }
}

/// A light in the middle of a closed sphere gives its whole inside the same light c. With a diffuse
/// colour r it looks r c (1 + r + r^2 + ...).
#[test]
fn light_in_a_closed_sphere() {
    let ball = icosphere(4);
    let camera = Camera::look_at(Vec3::new(0.2, 0.1, 0.0), Vec3::X, Vec3::Y, 1.5, 24, 24);
    let light = PointLight { position: Vec3::ZERO, color: [1.0, 0.5, 0.0] };
    let (r, sky) = (0.6, [9.0; 3]);
    let material = Material { color: [r; 3], ..Material::DEFAULT };
    let bright = |most, samples| {
        let effects = Effects { diffuse_bounces: Some(DiffuseBounces { most, sky }), ..Effects::default() };
        average(&mean(&ball, material, &camera, Some(&light), &with(effects), samples))
    };
    for most in [0, 1, 3] {
        let sum: f32 = (0..=most).map(|n| r.powi(n as i32 + 1)).sum();
        let [red, green, blue] = bright(most, 1);
        assert!((red - sum).abs() < 0.01 * sum && (green - 0.5 * sum).abs() < 0.01 * sum, "{red} {sum}");
        assert_eq!(blue, 0.0, "the sky is shut out");
    }
    // Roulette goes on for ever, and is right on average.
    let [red, ..] = bright(u32::MAX, 16);
    assert!((red - r / (1.0 - r)).abs() < 0.015 * r / (1.0 - r), "{red}");
}

/// From any point of a sphere's inside, a part of the sphere is seen with a weight that is its part
/// of the area. If the part f is open to a sky L and the rest has the colour r, that looks B = r
/// ((1 - f) B + f L).
#[test]
fn an_integrating_sphere() {
    let mut ball = icosphere(4);
    let all = ball.indices.len() as f32;
    ball.indices.retain(|t| ball.positions[t[0] as usize].y < 0.7);
    let open = 1.0 - ball.indices.len() as f32 / all;
    assert!((0.1..0.2).contains(&open));
    let (r, sky) = (0.8, 2.0);
    let material = Material { color: [r; 3], ..Material::DEFAULT };
    let camera = Camera::look_at(Vec3::ZERO, Vec3::new(1.0, -0.5, 0.3), Vec3::Y, 1.0, 32, 32);
    let effects = Effects {
        diffuse_bounces: Some(DiffuseBounces { most: u32::MAX, sky: [sky; 3] }),
        ..Effects::default()
    };
    let [found, ..] = average(&mean(&ball, material, &camera, None, &with(effects), 32));
    // Areas of the triangles vary a little; those that are missing are counted exactly.
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| ball.positions[v as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    let open = 1.0 - ball.indices.iter().map(area).sum::<f32>() / icosphere_area();
    let expected = r * open * sky / (1.0 - r * (1.0 - open));
    assert!((found - expected).abs() < 0.015 * expected, "{found}, {expected}");
}

fn icosphere_area() -> f32 {
    let ball = icosphere(4);
    ball.indices
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| ball.positions[v as usize]);
            (b - a).cross(c - a).length() / 2.0
        })
        .sum()
}

/// In a mirror on the ground the world stands on its head.
#[test]
fn a_mirror_shows_what_is_above_it() {
    let mut soup = floor(100.0);
    let ball = icosphere(2);
    for t in &ball.indices {
        soup.push(t.map(|v| ball.positions[v as usize] + Vec3::new(0.5, 3.0, 0.0)));
    }
    let bvh = tree(&soup, 2);
    let mut material_of = vec![1; soup.indices.len()];
    material_of[..2].fill(0);
    let tint = [0.5, 0.25, 1.0];
    let materials = [
        Material { color: tint, mirror: true, ..Material::DEFAULT },
        Material { color: [1.0; 3], ..Material::DEFAULT },
    ];
    let mesh = Mesh { materials: &materials, material_of: &material_of, ..Mesh::new(soup.triangles()) };
    let options =
        RenderOptions { effects: Effects { mirror: true, ..Effects::default() }, ..RenderOptions::default() };
    let light = PointLight { position: Vec3::new(4.0, 9.0, 3.0), color: [1.0; 3] };
    let see = |eye: Vec3, target: Vec3| {
        let camera = Camera::look_at(eye, target, Vec3::Z, 0.6, 65, 65);
        let mut image = Image::new(0, 0);
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        (image, stats)
    };
    // The eye, the place on the mirror that it looks at, and the ball's middle, which is what it
    // sees there.
    let (eye, target, ball) =
        (Vec3::new(0.5, 3.0, -6.0), Vec3::new(0.5, 0.0, -3.0), Vec3::new(0.5, 3.0, 0.0));
    let (mirrored, stats) = see(eye, target);
    assert_eq!((stats.rays_mirror, stats.hits), (65 * 65, 65 * 65));
    let (direct, _) = see(target + 0.01 * (ball - target), ball);
    let (m, d) = (mirrored.pixels()[32 * 65 + 32], direct.pixels()[32 * 65 + 32]);
    for k in 0..3 {
        assert!(d[k] > 0.0 && (m[k] - tint[k] * d[k]).abs() < 1e-3, "{m:?} {d:?}");
    }
    // And everywhere: the sky is seen where brute force finds nothing along the reflection.
    let camera = Camera::look_at(eye, target, Vec3::Z, 0.6, 65, 65);
    let above = Triangles { indices: &soup.indices[2..], ..soup.triangles() };
    let (mut on_ball, mut wrong) = (0, 0);
    for (i, pixel) in mirrored.pixels().iter().enumerate() {
        let ray = camera.ray(i as u32 % 65, i as u32 / 65);
        let at = ray.origin() - ray.direction() * (ray.origin().y / ray.direction().y);
        let reflected = Ray::new(at, ray.direction() * Vec3::new(1.0, -1.0, 1.0));
        let ball = closest_hit_brute(&above, &reflected, f32::INFINITY, TriangleTest::Watertight).is_some();
        let up = reflected.direction().normalize().y * 0.5 + 0.5;
        let sky =
            (0..3).all(|k| (pixel[k] - tint[k] * (NADIR[k] + up * (ZENITH[k] - NADIR[k]))).abs() < 1e-4);
        on_ball += usize::from(ball);
        wrong += usize::from(sky == ball);
    }
    // Rays that touch the ball's outline may go either way.
    assert!(on_ball > 100 && wrong <= 2, "{on_ball} {wrong}");
}

#[test]
fn mirrors_that_face_each_other_end_somewhere() {
    let mirror = [Material { color: [1.0; 3], mirror: true, ..Material::DEFAULT }];
    let inside = Camera::look_at(Vec3::new(0.2, 0.1, 0.3), Vec3::X, Vec3::Y, 1.0, 20, 20);
    let effects = Effects { mirror: true, ..Effects::default() };
    let (image, stats) = shot(&cube(), &mirror, &inside, None, &with(effects));
    assert_eq!(stats.rays_mirror, 4 * 400);
    assert_eq!(average(&image), [0.0; 3]);
}

/// Four mirrors in a row end a path, four with bounces between them do not.
#[test]
fn mirrors_are_counted_from_the_last_bounce_on() {
    let (soup, white) = (cube(), Material { color: [1.0; 3], ..Material::DEFAULT });
    let materials = [white, Material { mirror: true, ..white }];
    let material_of: Vec<u32> = (0..12).map(|triangle| u32::from(triangle < 6)).collect();
    let mesh = Mesh { materials: &materials, material_of: &material_of, ..Mesh::new(soup.triangles()) };
    let inside = Camera::look_at(Vec3::new(0.2, 0.1, 0.3), Vec3::X, Vec3::Y, 1.0, 20, 20);
    let bounces = DiffuseBounces { most: 64, sky: [0.0; 3] };
    let effects = Effects { mirror: true, diffuse_bounces: Some(bounces), ..Effects::default() };
    let stats = render(&tree(&soup, 2), &mesh, &inside, None, &with(effects), &mut Image::new(0, 0));
    assert!(stats.rays_mirror > 8 * 400, "{}", stats.rays_mirror);
}

/// Holes against brute force with the same rule, for all traversals, triangle tests and both kinds
/// of query.
#[test]
fn rays_pass_holes_as_the_rule_says() {
    let soup = random_soup(300, 1.5);
    let texcoords: Vec<Vec2> = soup.positions.iter().map(|p| Vec2::new(p.x * 3.0, p.y * 2.0 + p.z)).collect();
    let material_of: Vec<u32> = (0..300).map(|i| i % 3).collect();
    let solid = Material::DEFAULT;
    let materials = [solid, VARIED[1], Material { opacity: 0.3, cutoff: Some(0.4), ..solid }];
    let triangles = soup.triangles();
    let mesh = Mesh {
        texcoords: &texcoords,
        textures: &[checks()],
        materials: &materials,
        material_of: &material_of,
        ..Mesh::new(triangles)
    };
    let bvh = tree(&soup, 3);
    let scene = Scene { bvh: &bvh, triangles: &triangles };
    let targets = grid(Vec3::ZERO, Vec3::X, Vec3::Y);
    let (origin, t_max) = (Vec3::new(0.3, 0.2, 2.0), f32::INFINITY);
    let (mut wave, mut scratch): (Box<Wave>, Box<Scratch>) = (zeroed_box(), zeroed_box());
    for test in TriangleTest::ALL {
        // The nearest of all hits that are there, one triangle at a time.
        let truth: Vec<Option<Hit>> = targets
            .iter()
            .map(|&target| {
                let ray = Ray::new(origin, target - origin);
                let mut best = None::<Hit>;
                for p in 0..300 {
                    let one = Triangles { positions: &soup.positions, indices: &soup.indices[p..=p] };
                    let hit = closest_hit_brute(&one, &ray, t_max, test)
                        .map(|h| Hit { primitive: p as u32, ..h })
                        .filter(|h| mesh.is_there(h));
                    if let Some(hit) = hit
                        && best.is_none_or(|b| hit.is_before(b.t, b.primitive))
                    {
                        best = Some(hit);
                    }
                }
                best
            })
            .collect();
        for options in ways() {
            for any in [false, true] {
                aim(&mut wave, origin, t_max, &targets);
                let (way, tally) = (options.traversal, &mut Tally::default());
                with_test!(test, T => dispatch!(detected(options.simd), simd => {
                    if any {
                        trace::<_, T, true>(simd, scene, way, &mut wave, &mut scratch, tally);
                        see_through::<_, T, true>(simd, scene, &mesh, &mut wave, tally);
                    } else {
                        trace::<_, T, false>(simd, scene, way, &mut wave, &mut scratch, tally);
                        see_through::<_, T, false>(simd, scene, &mesh, &mut wave, tally);
                    }
                }));
                assert!(tally.stats.rays_again > 100);
                for (i, truth) in truth.iter().enumerate() {
                    if any {
                        assert_eq!(wave.hit(i).is_some(), truth.is_some());
                    } else {
                        assert_eq!(bits(wave.hit(i)), bits(*truth));
                    }
                }
            }
        }
        let (solid, alpha_cutouts) =
            truth.iter().flatten().partition::<Vec<&Hit>, _>(|h| h.primitive % 3 == 0);
        assert!(solid.len() > 100 && alpha_cutouts.len() > 100, "{} {}", solid.len(), alpha_cutouts.len());
        assert!(alpha_cutouts.iter().all(|h| h.primitive % 3 == 1));
    }
}

/// Where a point of the texture is seen, and that it is upright.
#[test]
fn textures_are_seen_where_texture_coordinates_say() {
    // A square from (-1, -1) to (1, 1) that faces the viewer; v counts downwards.
    let mut soup = Soup::default();
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    soup.push([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]);
    soup.push([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    let texcoords: Vec<Vec2> =
        soup.positions.iter().map(|p| Vec2::new(p.x * 0.5 + 0.5, 0.5 - p.y * 0.5)).collect();
    let texture = Texture { wrap: [Wrap::ClampToEdge; 2], filter: Filter::Nearest, ..checks() };
    let material = Material { color: [1.0; 3], texture: Some(0), ..Material::DEFAULT };
    let mesh = Mesh {
        texcoords: &texcoords,
        textures: std::slice::from_ref(&texture),
        materials: &[material],
        material_of: &[0, 0],
        ..Mesh::new(soup.triangles())
    };
    let camera = Camera::look_at(Vec3::Z * 3.0, Vec3::ZERO, Vec3::Y, 0.5, 2, 2);
    let options = with(Effects { textures: true, ..Effects::default() });
    let mut image = Image::new(0, 0);
    let (bvh, mut seen) = (tree(&soup, 1), Vec::new());
    render(&bvh, &mesh, &camera, None, &options, &mut image);
    for (pixel, texel) in image.pixels().iter().zip(TEXELS) {
        // The light is at the eye and the surface faces it, nearly.
        let factor = |k: usize| pixel[k];
        let brightest = (0..3).max_by_key(|&k| texel[k]).unwrap_or(0);
        seen.push((0..3).max_by(|&a, &b| factor(a).total_cmp(&factor(b))).unwrap_or(3) == brightest);
    }
    // The last texel is grey.
    assert_eq!(seen[..3], [true; 3]);
    let [r, g, b] = image.pixels()[3];
    assert!(r == g && g == b && r > 0.8);
}
