//! The rays of a tile of pixels: from the eye, and from the light to what these hit.

use bvh_core::triangle::Test;
use bvh_core::{Vec3, pick};
use bytemuck::Zeroable;
use fearless_simd::Simd;

use crate::options::{RenderOptions, Traversal};
use crate::packet;
use crate::scene::Scene;
use crate::simd::vectorize;
use crate::sort::Sorter;
use crate::surface::{Appearance, Surfaces};
use crate::tile::{self, Scratch};
use crate::times::Tally;
use crate::wave::{Coordinates, RAYS, Wave};
use crate::wide::WideTest;
use crate::{Camera, Hit, Mesh, random};

/// Side of a tile in pixels: what one thread does at a time.
pub(crate) const TILE: usize = 64;

/// What all tiles have in common.
#[derive(Clone, Copy)]
pub(crate) struct Frame<'a> {
    pub(crate) scene: Scene<'a>,
    /// The mesh, if it has holes.
    pub(crate) alpha_cutouts: Option<&'a Mesh<'a>>,
    pub(crate) camera: &'a Camera,
    /// Position of the light, if it throws shadows.
    pub(crate) shadows: Option<Vec3>,
    pub(crate) options: &'a RenderOptions,
    /// Whether points and normals are needed even without shadows.
    pub(crate) shaded: bool,
}

/// Column and row of a whole tile's pixel `i`: in quarters of 32 x 32, which share a cut of the
/// tree, in these in blocks of 8 x 8, one packet each, and in these in 4 x 4, so that groups of 16
/// rays are square, too.
pub(crate) fn place(i: usize) -> (usize, usize) {
    let (quarter, block, group, i) = (i / 1024, i / 64 % 16, i / 16 % 4, i % 16);
    let column = quarter % 2 * 32 + block % 4 * 8 + group % 2 * 4 + i % 4;
    let row = quarter / 2 * 32 + block / 4 * 8 + group / 2 * 4 + i / 4;
    (column, row)
}

/// Everything about the pixels of a tile, which are in the order of their [`place`]s.
#[derive(Zeroable)]
pub(crate) struct Tile {
    /// The upper left pixel.
    pub(crate) corner: (u32, u32),
    /// Pixels in a row and in a column of it.
    pub(crate) size: (usize, usize),
    /// Column and row of each pixel in the tile.
    pub(crate) columns: [f32; RAYS],
    pub(crate) rows: [f32; RAYS],
    /// The ray of the pixel in each row, of `TILE` pixels, and column; without meaning outside the
    /// tile.
    pub(crate) ray: [u16; RAYS],
    pub(crate) seen: Wave,
    pub(crate) surfaces: Surfaces,
    pub(crate) shadow: Wave,
    sorter: Sorter,
    /// The pixel of each shadow ray.
    pub(crate) whose: [u16; RAYS],
    /// 1 for pixels that light reaches, else 0.
    pub(crate) lit: [f32; RAYS],
    pub(crate) appearance: Appearance,
    pub(crate) colors: Coordinates,
    pub(crate) scratch: Scratch,
}

impl Tile {
    /// Makes it a tile of this size, without rays yet.
    pub(crate) fn resize(&mut self, width: usize, height: usize) {
        if self.size == (width, height) {
            return;
        }
        self.size = (width, height);
        let places = (0..RAYS).map(place);
        for (i, (x, y)) in places.filter(|&(x, y)| x < width && y < height).enumerate() {
            (self.columns[i], self.rows[i]) = (x as f32, y as f32);
            self.ray[y * TILE + x] = i as u16;
        }
    }
}

/// Traces the rays of a tile and their shadow rays.
#[inline(never)]
pub(crate) fn cast_tile<S: Simd, T: WideTest>(
    simd: S,
    frame: &Frame<'_>,
    tile: &mut Tile,
    tally: &mut Tally,
) {
    vectorize!(simd, {
        let Tile { corner, size, columns, rows, seen, surfaces, scratch, .. } = &mut *tile;
        seen.start(frame.camera.eye, f32::INFINITY);
        seen.count = size.0 * size.1;
        let inside = random::in_pixel(frame.options.sample);
        frame.camera.directions(simd, *corner, inside, (columns, rows), &mut seen.direction);
        trace_past_holes::<S, T, false>(simd, frame, seen, scratch, tally);
        let count = seen.count;
        tally.stats.rays_primary = count as u64;
        let hits = seen.primitive[..count].iter().filter(|&&p| p != Wave::NO_HIT);
        tally.stats.hits = hits.count() as u64;
        if tally.stats.hits > 0 && (frame.shadows.is_some() || frame.shaded) {
            surfaces.find(simd, frame.scene.triangles, seen);
        }
    });
    light_arrives::<S, T>(simd, frame, tile, tally);
}

/// Finds out at which of the surfaces of a tile light arrives.
#[inline(never)]
pub(crate) fn light_arrives<S: Simd, T: WideTest>(
    simd: S,
    frame: &Frame<'_>,
    tile: &mut Tile,
    tally: &mut Tally,
) {
    let Tile { surfaces, seen, shadow, sorter, whose, lit, scratch, .. } = tile;
    let count = seen.count;
    lit[..count].fill(if frame.shadows.is_some() { 0.0 } else { 1.0 });
    shadow.count = 0;
    let any_hits = || seen.primitive[..count].iter().any(|&p| p != Wave::NO_HIT);
    let Some(light) = frame.shadows.filter(|_| any_hits()) else { return };
    tally.end(|t| &mut t.primary);
    vectorize!(simd, {
        shadow.start(light, 1.0);
        surfaces.shadow_rays(simd, seen, shadow, whose);
        if frame.options.traversal == Traversal::Tile {
            sorter.sort_if_scattered(simd, shadow, whose);
        }
        trace_past_holes::<S, T, true>(simd, frame, shadow, scratch, tally);
        let blocked = &shadow.primitive[..shadow.count];
        tally.stats.rays_shadow += blocked.len() as u64;
        for (&blocked, &i) in blocked.iter().zip(&*whose) {
            let arrives = blocked == Wave::NO_HIT;
            lit[i as usize] = if arrives { 1.0 } else { 0.0 };
            tally.stats.shadowed += u64::from(!arrives);
        }
    });
    tally.end(|t| &mut t.shadow);
}

/// Traces a wave. Trees and packets know nothing of holes ([`Material::cutoff`](crate::Material)):
/// rays are first traced as if there were none, which gives the same result unless what they hit is
/// a hole.
#[inline(always)]
fn trace_past_holes<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    frame: &Frame<'_>,
    wave: &mut Wave,
    scratch: &mut Scratch,
    tally: &mut Tally,
) {
    let scene = frame.scene;
    trace::<S, T, ANY>(simd, scene, frame.options.traversal, wave, scratch, tally);
    if let Some(mesh) = frame.alpha_cutouts {
        tally.end(|t| if ANY { &mut t.shadow } else { &mut t.primary });
        see_through::<S, T, ANY>(simd, scene, mesh, wave, tally);
        tally.end(|t| &mut t.alpha);
    }
}

/// Replaces hits of holes by what is behind them, one ray at a time, and counts the rays traced
/// again: with `ANY`, all that hit a surface which has holes anywhere.
#[inline(never)]
pub(crate) fn see_through<S: Simd, T: Test, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    mesh: &Mesh<'_>,
    wave: &mut Wave,
    tally: &mut Tally,
) {
    vectorize!(simd, {
        for i in 0..wave.count {
            let stays = wave.hit(i).is_none_or(|hit| {
                // With `ANY` a hit comes without the place.
                if ANY { mesh.material(hit.primitive).cutoff.is_none() } else { mesh.is_there(&hit) }
            });
            if !stays {
                let (Scene { bvh, triangles, .. }, t_max) = (scene, wave.t_max);
                let (ray, counts) = (wave.ray(i), |hit: &Hit| mesh.is_there(hit));
                let hit = pick::hit::<S, T, ANY>(simd, bvh, triangles, &ray, t_max, &mut tally.work, counts);
                wave.set_hit(i, hit);
                tally.stats.rays_again += 1;
            }
        }
    });
}

/// Traces a wave as if there were no holes.
#[inline(always)]
pub(crate) fn trace<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    traversal: Traversal,
    wave: &mut Wave,
    scratch: &mut Scratch,
    tally: &mut Tally,
) {
    let work = &mut tally.work;
    match traversal {
        Traversal::Tile => {
            tile::trace::<S, T, ANY>(simd, scene, wave, scratch);
            work.nodes += std::mem::take(&mut scratch.nodes);
        }
        Traversal::Packet => packet::trace_all::<T, ANY>(scene, wave, work),
        Traversal::Single => {
            for i in 0..wave.count {
                let (before, ray) = (work.nodes, wave.ray(i));
                let Scene { bvh, triangles, .. } = scene;
                let hit = pick::hit::<S, T, ANY>(simd, bvh, triangles, &ray, wave.t_max, work, |_| true);
                wave.set_hit(i, hit);
                wave.nodes[i] = (work.nodes - before) as u32;
            }
        }
    }
    wave.end();
}
