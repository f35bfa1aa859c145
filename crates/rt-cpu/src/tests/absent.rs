//! What a frame costs for which nothing calls for an effect, beside a renderer that has never heard of any.

use std::hint::black_box;
use std::time::Instant;

use fearless_simd::Simd;

use super::*;
use crate::cast::place;
use crate::random;
use crate::shade::{Background, Shader};
use crate::surface::{Coordinates, Surfaces};
use crate::tile;
use crate::wide::WideTest;

const TILE: usize = 32;

/// Everything about a tile for primary rays, shadow rays and Lambert's law.
struct Plain {
    size: (usize, usize),
    at: [[u8; 2]; RAYS],
    columns: [f32; RAYS],
    rows: [f32; RAYS],
    seen: Bundle,
    hits: Hits,
    surfaces: Surfaces,
    shadow: Bundle,
    blocked: Hits,
    whose: [u16; RAYS],
    lit: [f32; RAYS],
    colors: Coordinates,
    scratch: Scratch,
}

impl Plain {
    fn new() -> Self {
        Self {
            size: (0, 0),
            at: [[0; 2]; RAYS],
            columns: [0.0; RAYS],
            rows: [0.0; RAYS],
            seen: Bundle::new(),
            hits: Hits::new(),
            surfaces: Surfaces::new(),
            shadow: Bundle::new(),
            blocked: Hits::new(),
            whose: [0; RAYS],
            lit: [0.0; RAYS],
            colors: [[0.0; RAYS]; 3],
            scratch: Scratch::new(),
        }
    }

    /// Places of the pixels.
    fn resize(&mut self, size: (usize, usize)) {
        if self.size == size {
            return;
        }
        self.size = size;
        let places = (0..RAYS).map(place);
        for (i, (x, y)) in places.filter(|&(x, y)| x < size.0 && y < size.1).enumerate() {
            self.at[i] = [x as u8, y as u8];
            (self.columns[i], self.rows[i]) = (x as f32, y as f32);
        }
    }

    #[inline(never)]
    fn see<S: Simd, T: WideTest>(
        &mut self,
        simd: S,
        scene: Scene<'_>,
        camera: &Camera,
        corner: (u32, u32),
    ) -> bool {
        let Self { seen, hits, .. } = self;
        simd.vectorize(
            #[inline(always)]
            || {
                seen.start(camera.eye(), f32::INFINITY);
                seen.count = self.size.0 * self.size.1;
                let places = (&self.columns, &self.rows);
                camera.directions(simd, corner, random::in_pixel(0), places, &mut seen.direction);
                let (scratch, work) = (&mut self.scratch, &mut Work::default());
                tile::trace::<S, T>(simd, scene, Query::Closest, seen, hits, scratch, work);
                hits.primitive[seen.count..seen.count.next_multiple_of(SIZE)].fill(Hits::NONE);
                let any = hits.primitive[..seen.count].iter().any(|&p| p != Hits::NONE);
                if any {
                    self.surfaces.find(simd, scene.triangles, seen, hits);
                }
                any
            },
        )
    }

    #[inline(never)]
    fn light<S: Simd, T: WideTest>(&mut self, simd: S, scene: Scene<'_>, light: Vec3) {
        let Self { shadow, blocked, whose, .. } = self;
        simd.vectorize(
            #[inline(always)]
            || {
                shadow.start(light, 1.0);
                self.surfaces.shadow_rays(simd, &self.hits, self.seen.count, shadow, whose);
                let (scratch, work) = (&mut self.scratch, &mut Work::default());
                tile::trace::<S, T>(simd, scene, Query::Any, shadow, blocked, scratch, work);
                for (&blocked, &i) in blocked.primitive.iter().zip(&whose[..shadow.count]) {
                    self.lit[i as usize] = if blocked == Hits::NONE { 1.0 } else { 0.0 };
                }
            },
        );
    }
}

#[inline(never)]
fn by_hand<S: Simd, T: WideTest>(
    simd: S,
    tile: &mut Plain,
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: &PointLight,
    image: &mut Image,
) {
    let scene = Scene::new(bvh, &mesh.triangles);
    let shader = Shader { mesh, light: Some(light), smooth: true, background: Background::default() };
    let (width, height) = (camera.width() as usize, camera.height() as usize);
    for y in (0..height).step_by(TILE) {
        for x in (0..width).step_by(TILE) {
            tile.resize((TILE.min(width - x), TILE.min(height - y)));
            let any = tile.see::<S, T>(simd, scene, camera, (x as u32, y as u32));
            tile.lit[..tile.seen.count].fill(0.0);
            if any {
                tile.light::<S, T>(simd, scene, light.position);
            }
            simd.vectorize(
                #[inline(always)]
                || {
                    let Plain { seen, hits, surfaces, lit, colors, .. } = &mut *tile;
                    shader.shade(simd, seen, hits, surfaces, lit, colors);
                },
            );
            let [r, g, b] = &tile.colors;
            for (i, &[column, row]) in tile.at[..tile.seen.count].iter().enumerate() {
                let pixel = (y + row as usize) * width + x + column as usize;
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
    let mut tile = Box::new(Plain::new());
    for simd in SimdLevel::available() {
        for triangle_test in TriangleTest::ALL {
            let options = RenderOptions { triangle_test, simd, ..allowed() };
            let mut image = Image::new(0, 0);
            by_render(&bvh, &mesh, &camera, &light, &options, &mut image);
            let mut plain = Image::new(camera.width(), camera.height());
            with_test!(triangle_test, T => at_level!(simd, simd => {
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
    let mut tile = Box::new(Plain::new());
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
            at_level!(best, simd => {
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
