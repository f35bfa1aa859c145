//! Frames: tiles over threads.

use std::cell::RefCell;

use bvh_core::{Bvh, Triangles, Vec3};
use bytemuck::zeroed_box;
use fearless_simd::Simd;
use rayon::prelude::*;

use crate::cast::{Frame, TILE, Tile, cast_tile};
use crate::options::{Effects, Output, RenderOptions, Traversal};
use crate::scene::{Scene, with_test};
use crate::shade::{PointLight, Shader};
use crate::simd::{detected, dispatch};
use crate::sink::{Look, Rows, TilePixel};
use crate::times::{RenderStats, Tally};
use crate::wavefront::Wavefront;
use crate::wide::WideTest;
use crate::{Bvh8, Camera, Image, Mesh, Pixel};

/// Renders a frame into `image`, which is replaced if it is not of the camera's size.
///
/// `mesh.triangles` are the primitives of the tree, by its numbers. Runs in the current rayon pool,
/// in tiles; every pixel is the same for any number of threads, any [`Traversal`] and any
/// [`SimdLevel`](bvh_core::SimdLevel). A camera that is not finite sees the background; triangles
/// that are not finite are not there.
pub fn render(
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    render_with(bvh, None, mesh, camera, light, options, image)
}

/// Renders as [`render`] does, with a view of the same tree and triangles if there is one already.
/// Only ambient occlusion and diffuse bounces use the view.
///
/// For more than one image of a frame, samples to be averaged for instance: `render` would make a
/// view for each. With the view of another scene, rays that leave a surface see that scene; a
/// view of another number of triangles is ignored.
pub fn render_with(
    bvh: &Bvh,
    wide: Option<&Bvh8>,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    if (image.width(), image.height()) != (camera.width, camera.height) {
        *image = Image::new(camera.width, camera.height);
    }
    if let Output::NodesVisited { most } = options.output {
        let options = RenderOptions { traversal: Traversal::Single, ..*options };
        let frame = frame(bvh, &mesh.triangles, camera, light, &options);
        return run(&frame, &Look::Nodes { most }, image.pixels_mut());
    }
    let frame = frame(bvh, &mesh.triangles, camera, light, options);
    let effects = called_for(&options.effects, mesh);
    // With bounces no light is no light, not one at the eye.
    let light = light.or(effects.diffuse_bounces.map(|_| &DARKNESS));
    let smooth = options.smooth && mesh.normals.is_some();
    let Effects { textures, alpha, .. } = effects;
    let shader = Shader { mesh, light, smooth, textures };
    let mut own = Bvh8::default();
    let direct_only = Effects { textures, alpha, ..Effects::default() };
    let look = if effects == direct_only {
        Look::Direct(shader)
    } else {
        let mut wide = wide.filter(|wide| wide.triangles == mesh.triangles.indices.len());
        if wide.is_none() && options.traversal != Traversal::Single && calls_for_wide(&effects, camera, bvh) {
            own.update(bvh, &mesh.triangles);
            wide = Some(&own);
        }
        Look::Effects(Wavefront { shader, effects, wide })
    };
    let alpha_cutouts = effects.alpha.then_some(mesh);
    run(&Frame { alpha_cutouts, shaded: true, ..frame }, &look, image.pixels_mut())
}

/// A frame without holes that is not shaded.
fn frame<'a>(
    bvh: &'a Bvh,
    triangles: &'a Triangles<'a>,
    camera: &'a Camera,
    light: Option<&PointLight>,
    options: &'a RenderOptions,
) -> Frame<'a> {
    let shadows = light.filter(|_| options.shadows).map(|l| l.position);
    let scene = Scene { bvh, triangles };
    Frame { scene, alpha_cutouts: None, camera, shadows, options, shaded: false }
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

/// Whether making a view pays: whether at least one ray for six triangles will have little in
/// common with others.
fn calls_for_wide(effects: &Effects, camera: &Camera, bvh: &Bvh) -> bool {
    let of_hit = effects.ambient_occlusion.map_or(0, |a| u64::from(a.samples))
        + effects.diffuse_bounces.map_or(0, |d| u64::from(d.most));
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    pixels.saturating_mul(of_hit) > bvh.len() as u64 / 6
}

/// Casts the rays that [`render`] would cast without effects, and does not shade: `pixels` are rows
/// from the top.
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
    let size = u64::from(camera.width) * u64::from(camera.height);
    assert_eq!(pixels.len() as u64, size, "pixels of the camera");
    run(&frame(bvh, triangles, camera, light, options), &Look::Hits, pixels)
}

thread_local! {
    /// One for each thread: too large to be set up for every tile.
    static THIS_TILE: RefCell<Box<Tile>> = RefCell::new(zeroed_box());
}

/// Fills an image, by bands of tiles.
fn run<P: TilePixel>(frame: &Frame<'_>, look: &Look<'_>, pixels: &mut [P]) -> RenderStats {
    let width = (frame.camera.width as usize).max(1);
    let bands = pixels.par_chunks_mut(width.saturating_mul(TILE)).enumerate();
    let of_band = |(band, pixels): (usize, &mut [P])| -> RenderStats {
        let mut tiles: Vec<Rows<'_, P>> = Vec::new();
        tiles.resize_with(width.div_ceil(TILE), || std::array::from_fn(|_| Default::default()));
        for (y, row) in pixels.chunks_mut(width).enumerate() {
            for (tile, part) in tiles.iter_mut().zip(row.chunks_mut(TILE)) {
                tile[y] = part;
            }
        }
        let tiles = tiles.par_iter_mut().enumerate();
        let stats = tiles.map(|(i, rows)| {
            with_test!(frame.options.triangle_test, T => THIS_TILE.with_borrow_mut(|tile| {
                tile.corner = ((i * TILE) as u32, (band * TILE) as u32);
                dispatch!(detected(frame.options.simd), simd => fill_tile::<_, T, P>(simd, frame, look, tile, rows))
            }))
        });
        stats.sum()
    };
    bands.map(of_band).sum()
}

#[inline(always)]
fn fill_tile<S: Simd, T: WideTest, P: TilePixel>(
    simd: S,
    frame: &Frame<'_>,
    look: &Look<'_>,
    tile: &mut Tile,
    rows: &mut Rows<'_, P>,
) -> RenderStats {
    let mut tally = Tally::start(frame.options.timed);
    tile.resize(rows[0].len(), rows.iter().filter(|r| !r.is_empty()).count());
    cast_tile::<S, T>(simd, frame, tile, &mut tally);
    look.color::<S, T>(simd, frame, tile, &mut tally);
    P::write(simd, tile, rows);
    tally.end(|t| &mut t.primary);
    RenderStats { nodes_visited: tally.work.nodes, ..tally.stats }
}
