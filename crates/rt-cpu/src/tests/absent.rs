//! What a frame costs for which nothing calls for an effect, beside a renderer that has never heard
//! of any.

use std::hint::black_box;
use std::time::Instant;

use fearless_simd::{Level, Simd};

use super::*;
use crate::cast::Tile;
use crate::random;
use crate::shade::Shader;
use crate::simd::vectorize;
use crate::tile;
use crate::times::Tally;
use crate::wide::WideTest;

const TILE: usize = 32;

#[inline(never)]
fn see<S: Simd, T: WideTest>(
    simd: S,
    tile: &mut Tile,
    scene: Scene<'_>,
    camera: &Camera,
    corner: (u32, u32),
) -> bool {
    let Tile { size, columns, rows, seen, surfaces, scratch, .. } = tile;
    vectorize!(simd, {
        seen.start(camera.eye, f32::INFINITY);
        seen.count = size.0 * size.1;
        let places = (&*columns, &*rows);
        camera.directions(simd, corner, random::in_pixel(0), places, &mut seen.direction);
        tile::trace::<S, T, false>(simd, scene, seen, scratch);
        seen.end();
        let any = seen.primitive[..seen.count].iter().any(|&p| p != Wave::NO_HIT);
        if any {
            surfaces.find(simd, scene.triangles, seen);
        }
        any
    })
}

#[inline(never)]
fn shine<S: Simd, T: WideTest>(simd: S, tile: &mut Tile, scene: Scene<'_>, light: Vec3) {
    let Tile { seen, surfaces, shadow, whose, lit, scratch, .. } = tile;
    vectorize!(simd, {
        shadow.start(light, 1.0);
        surfaces.shadow_rays(simd, seen, shadow, whose);
        tile::trace::<S, T, true>(simd, scene, shadow, scratch);
        for (&blocked, &i) in shadow.primitive.iter().zip(&whose[..shadow.count]) {
            lit[i as usize] = if blocked == Wave::NO_HIT { 1.0 } else { 0.0 };
        }
    });
}

#[inline(never)]
fn by_hand<S: Simd, T: WideTest>(
    simd: S,
    tile: &mut Tile,
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: &PointLight,
    image: &mut Image,
) {
    let scene = Scene { bvh, triangles: &mesh.triangles };
    let shader = Shader { mesh, light: Some(light), smooth: true, textures: false };
    let (width, height) = (camera.width as usize, camera.height as usize);
    for y in (0..height).step_by(TILE) {
        for x in (0..width).step_by(TILE) {
            tile.resize(TILE.min(width - x), TILE.min(height - y));
            let any = see::<S, T>(simd, tile, scene, camera, (x as u32, y as u32));
            tile.lit[..tile.seen.count].fill(0.0);
            if any {
                shine::<S, T>(simd, tile, scene, light.position);
            }
            vectorize!(simd, {
                tile.appearance.open.fill(1.0);
                shader.find_appearance(tile, &mut Tally::default());
                shader.shade(simd, tile);
            });
            let [r, g, b] = &tile.colors;
            for i in 0..tile.seen.count {
                let pixel = (y + tile.rows[i] as usize) * width + x + tile.columns[i] as usize;
                image.pixels_mut()[pixel] = [r[i], g[i], b[i]];
            }
        }
    }
}

#[inline(never)]
fn by_render(
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: &PointLight,
    options: &RenderOptions,
    image: &mut Image,
) -> u64 {
    let stats = render(bvh, mesh, camera, Some(light), options, image);
    stats.rays_primary + stats.rays_shadow
}

/// All effects allowed, and none called for.
fn allowed() -> RenderOptions {
    let effects = Effects { textures: true, alpha: true, mirror: true, ..Effects::default() };
    RenderOptions { effects, ..RenderOptions::default() }
}

#[test]
fn a_frame_without_effects_is_that_of_a_renderer_without_any() {
    let (soup, camera, light) = scene();
    let bvh = tree(&soup, 2);
    let mesh = Mesh { normals: Some(&soup.positions), ..Mesh::new(soup.triangles()) };
    let mut tile: Box<Tile> = zeroed_box();
    for simd in SimdLevel::available() {
        for triangle_test in TriangleTest::ALL {
            let options = RenderOptions { triangle_test, simd, ..allowed() };
            let mut image = Image::new(0, 0);
            by_render(&bvh, &mesh, &camera, &light, &options, &mut image);
            let mut plain = Image::new(camera.width, camera.height);
            with_test!(triangle_test, T => dispatch!(detected(simd), simd => {
                by_hand::<_, T>(simd, &mut tile, &bvh, &mesh, &camera, &light, &mut plain);
            }));
            assert_eq!(pixel_bits(&image), pixel_bits(&plain));
        }
    }
}

/// Prints what both take for each ray, one after the other and again and again on one thread.
#[test]
#[ignore = "measures; docs/METHODOLOGY.md says how"]
fn measure_a_frame_without_effects() {
    const ROUNDS: usize = 15;
    let (_, _, light) = scene();
    let mut soup = icosphere(6);
    for t in [[[-4, -1, -4], [4, -1, -4], [4, -1, 4]], [[-4, -1, -4], [4, -1, 4], [-4, -1, 4]]] {
        soup.push(t.map(|c| Vec3::from(c.map(|x| x as f32))));
    }
    let camera = Camera::look_at(Vec3::new(1.0, 1.5, 4.0), Vec3::ZERO, Vec3::Y, 0.8, 256, 256);
    let bvh = tree(&soup, 1);
    let mesh = Mesh::new(soup.triangles());
    let (mut image, mut plain) = (Image::new(256, 256), Image::new(256, 256));
    let mut tile: Box<Tile> = zeroed_box();
    let options = allowed();
    let (mut times, mut times_by_hand) = (Vec::new(), Vec::new());
    let mut rays = 0;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| {
        for _ in 0..ROUNDS {
            let start = Instant::now();
            rays = by_render(&bvh, black_box(&mesh), &camera, &light, &options, &mut image);
            times.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            dispatch!(Level::new(), simd => {
                by_hand::<_, Watertight>(simd, &mut tile, &bvh, black_box(&mesh), &camera, &light, &mut plain);
            });
            times_by_hand.push(start.elapsed().as_secs_f64());
        }
    });
    assert_eq!(pixel_bits(&image), pixel_bits(&plain));
    let [render, hand] = [times, times_by_hand].map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[ROUNDS / 2] * 1e9 / rays as f64
    });
    println!("{rays} rays in each of {ROUNDS} frames, ns a ray: render {render:.2}, by hand {hand:.2}");
}
