//! Frames: tiles over threads.

use std::cell::RefCell;

use bvh_core::{Bvh, Triangles, Vec3};
use fearless_simd::Simd;
use rayon::prelude::*;

use crate::cast::{Frame, TILE, Tile, cast_tile};
use crate::options::{Effects, Output, RenderOptions, RenderStats, Traversal, sum};
use crate::scene::{Scene, with_test};
use crate::shade::{PointLight, Shader};
use crate::simd::at_level;
use crate::sink::{Caster, Heat, PixelSink, Rows};
use crate::times::StageTimer;
use crate::wavefront::Wavefront;
use crate::wide::WideTest;
use crate::{Bvh8, Camera, Image, Mesh, Pixel};

/// Renders a frame into `image`, which is replaced if it is not of the camera's size.
///
/// `mesh.triangles` are the primitives of the tree, by its numbers. Runs in the current rayon pool, in tiles;
/// every pixel is the same for any number of threads, any [`Traversal`] and any [`SimdLevel`](bvh_core::SimdLevel).
/// A camera that is not finite sees the background; triangles that are not finite are not there.
pub fn render(
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    draw(bvh, None, mesh, camera, light, options, image)
}

/// [`render`], with a view of the same tree and the same triangles that is there already. Ambient occlusion and diffuse
/// bounces go through it; without them nobody looks at it.
///
/// For more than one image of a frame, samples to be averaged for instance: `render` would make a view for each. A view
/// of something else shows that, where rays have come back from a surface; one of another number of triangles is not
/// looked at.
pub fn render_with(
    bvh: &Bvh,
    wide: &Bvh8,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    draw(bvh, Some(wide), mesh, camera, light, options, image)
}

fn draw(
    bvh: &Bvh,
    wide: Option<&Bvh8>,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    if (image.width(), image.height()) != (camera.width(), camera.height()) {
        *image = Image::new(camera.width(), camera.height());
    }
    let scene = Scene::new(bvh, &mesh.triangles);
    match options.output {
        Output::Shaded => {
            let RenderOptions { smooth, background, seed, sample, .. } = *options;
            let effects = called_for(&options.effects, mesh);
            // With bounces no light is no light, not one at the eye.
            let dark = effects.diffuse_bounces.map(|_| &DARKNESS);
            let shader = Shader { mesh, light: light.or(dark), smooth, background };
            let alpha_cutouts = Some(mesh).filter(|_| effects.alpha);
            let frame = Frame { alpha_cutouts, ..Frame::new(scene, camera, light, options, true) };
            let direct_only = Effects { alpha: effects.alpha, ..Effects::default() };
            if effects == direct_only {
                return run(&frame, image.pixels_mut(), &shader);
            }
            let mut own = Bvh8::new();
            let wide = wide.filter(|wide| wide.triangles == mesh.triangles.indices.len());
            let wide = wide.or_else(|| {
                let may = options.traversal != Traversal::Single;
                (may && calls_for_wide(&effects, camera, bvh)).then(|| {
                    own.update(bvh, &mesh.triangles);
                    &own
                })
            });
            run(&frame, image.pixels_mut(), &Wavefront { shader, effects, wide, seed, sample })
        }
        Output::NodesVisited { most } => {
            let options = RenderOptions { traversal: Traversal::Single, ..*options };
            run(&Frame::new(scene, camera, light, &options, false), image.pixels_mut(), &Heat { most })
        }
    }
}

const DARKNESS: PointLight = PointLight { position: Vec3::ZERO, color: [0.0; 3] };

/// The effects that something in the mesh calls for.
fn called_for(effects: &Effects, mesh: &Mesh<'_>) -> Effects {
    let any = |has: fn(&crate::Material) -> bool| mesh.materials.iter().any(has);
    Effects {
        textures: effects.textures && any(|m| m.texture.is_some()),
        alpha: effects.alpha && any(|m| m.cutoff.is_some()),
        mirror: effects.mirror && any(|m| m.mirror),
        ambient_occlusion: effects.ambient_occlusion.filter(|_| effects.diffuse_bounces.is_none()),
        diffuse_bounces: effects.diffuse_bounces,
    }
}

/// Whether making a view pays: whether at least one ray for six triangles will have little in common with others.
fn calls_for_wide(effects: &Effects, camera: &Camera, bvh: &Bvh) -> bool {
    let of_hit = effects.ambient_occlusion.map_or(0, |a| u64::from(a.samples))
        + effects.diffuse_bounces.map_or(0, |d| u64::from(d.most));
    let pixels = u64::from(camera.width()) * u64::from(camera.height());
    pixels.saturating_mul(of_hit) > bvh.len() as u64 / 6
}

/// Casts the rays that [`render`] would cast without effects, and does not shade: `pixels` are rows from the top.
///
/// # Panics
/// If the number of pixels is not that of the camera.
pub fn cast(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    pixels: &mut [Pixel],
) -> RenderStats {
    assert_eq!(pixels.len(), camera.width() as usize * camera.height() as usize, "pixels of the camera");
    let scene = Scene::new(bvh, triangles);
    run(&Frame::new(scene, camera, light, options, false), pixels, &Caster)
}

thread_local! {
    /// One for each thread: too large to be set up for every tile.
    static THIS_TILE: RefCell<Box<Tile>> = RefCell::new(Box::new(Tile::new()));
}

/// Fills an image.
fn run<F: PixelSink>(frame: &Frame<'_>, pixels: &mut [F::Pixel], finish: &F) -> RenderStats {
    let width = frame.camera.width() as usize;
    pixels
        .par_chunks_mut(width.max(1) * TILE)
        .enumerate()
        .map(|(i, band)| {
            let mut rows = band.chunks_mut(width);
            let rows = std::array::from_fn(|_| rows.next().unwrap_or_default());
            let y = (i * TILE) as u32;
            with_test!(frame.options.triangle_test, T => tiles::<T, F>(frame, rows, 0, y, finish))
        })
        .reduce(RenderStats::default, sum)
}

/// Halves a band of rows until it is a tile. Slices on the stack give each tile its pixels without locks.
fn tiles<T: WideTest, F: PixelSink>(
    frame: &Frame<'_>,
    mut rows: Rows<'_, F::Pixel>,
    x: u32,
    y: u32,
    finish: &F,
) -> RenderStats {
    let width = rows[0].len();
    if width <= TILE {
        return THIS_TILE.with_borrow_mut(|tile| {
            at_level!(frame.options.simd, simd => {
                fill_tile::<_, T, F>(simd, frame, tile, &mut rows, x, y, finish)
            })
        });
    }
    let middle = width.div_ceil(2).next_multiple_of(TILE);
    let mut right: Rows<'_, F::Pixel> = std::array::from_fn(|_| Default::default());
    let mut halves = right.iter_mut();
    let left = rows.map(|row| {
        let (left, right) = row.split_at_mut(middle.min(row.len()));
        if let Some(half) = halves.next() {
            *half = right;
        }
        left
    });
    let (a, b) = rayon::join(
        || tiles::<T, F>(frame, left, x, y, finish),
        || tiles::<T, F>(frame, right, x + middle as u32, y, finish),
    );
    sum(a, b)
}

#[inline(always)]
fn fill_tile<S: Simd, T: WideTest, F: PixelSink>(
    simd: S,
    frame: &Frame<'_>,
    tile: &mut Tile,
    rows: &mut Rows<'_, F::Pixel>,
    x: u32,
    y: u32,
    finish: &F,
) -> RenderStats {
    tile.timer = StageTimer::start(frame.options.timed);
    tile.resize(rows[0].len(), rows.iter().filter(|r| !r.is_empty()).count());
    let mut stats = cast_tile::<S, T>(simd, frame, tile, (x, y));
    finish.finish::<S, T>(simd, frame, tile, (x, y), rows, &mut stats);
    tile.timer.end(|t| &mut t.primary);
    stats.times = tile.timer.times();
    stats
}
