//! The rays of a tile of pixels: from the eye, and from the light to what these hit.

use bvh_core::{Vec3, pick};
use fearless_simd::Simd;

use crate::bundle::{Bundle, Hits, RAYS};
use crate::options::{RenderOptions, RenderStats, Traversal};
use crate::packet::{self, SIZE};
use crate::scene::{Query, Scene, Work, every};
use crate::shade::PointLight;
use crate::sort::Sorter;
use crate::surface::{Coordinates, Surfaces};
use crate::tile::{self, Scratch};
use crate::times::StageTimer;
use crate::wide::WideTest;
use crate::{Camera, Hit, Mesh, alpha_cutouts, random};

/// Side of a tile in pixels: what one thread does at a time.
pub(crate) const TILE: usize = 64;

/// What all tiles have in common.
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

impl<'a> Frame<'a> {
    pub(crate) fn new(
        scene: Scene<'a>,
        camera: &'a Camera,
        light: Option<&PointLight>,
        options: &'a RenderOptions,
        shaded: bool,
    ) -> Self {
        let shadows = light.filter(|_| options.shadows).map(|l| l.position);
        Self { scene, alpha_cutouts: None, camera, shadows, options, shaded }
    }

    /// Whether a hit is of a surface rather than of a hole in it.
    #[inline(always)]
    pub(crate) fn is_there(&self, hit: &Hit) -> bool {
        self.alpha_cutouts.is_none_or(|mesh| mesh.is_there(hit))
    }
}

/// Column and row of a whole tile's pixel `i`: in quarters of 32 x 32, which share a cut of the tree, in these in
/// blocks of 8 x 8, one packet each, and in these in 4 x 4, so that groups of 16 rays are square, too.
pub(crate) fn place(i: usize) -> (usize, usize) {
    let (quarter, block, group, i) = (i / 1024, i / 64 % 16, i / 16 % 4, i % 16);
    let column = quarter % 2 * 32 + block % 4 * 8 + group % 2 * 4 + i % 4;
    let row = quarter / 2 * 32 + block / 4 * 8 + group / 2 * 4 + i / 4;
    (column, row)
}

/// Everything about the pixels of a tile, which are in the order of their [`place`]s.
pub(crate) struct Tile {
    /// Pixels in a row and in a column of it.
    pub(crate) size: (usize, usize),
    /// Column and row of each pixel in the tile.
    pub(crate) at: [[u8; 2]; RAYS],
    columns: [f32; RAYS],
    rows: [f32; RAYS],
    /// The ray of the pixel in each row, of `TILE` pixels, and column; without meaning outside the tile.
    pub(crate) ray: [u16; RAYS],
    pub(crate) seen: Bundle,
    pub(crate) hits: Hits,
    pub(crate) surfaces: Surfaces,
    shadow: Bundle,
    sorter: Sorter,
    blocked: Hits,
    /// The pixel of each shadow ray.
    whose: [u16; RAYS],
    /// 1 for pixels that light reaches, else 0.
    pub(crate) lit: [f32; RAYS],
    pub(crate) colors: Coordinates,
    /// Inner nodes visited; for [`Traversal::Single`] only.
    pub(crate) nodes: [u32; RAYS],
    scratch: Scratch,
    pub(crate) timer: StageTimer,
}

impl Tile {
    pub(crate) fn new() -> Self {
        Self {
            size: (0, 0),
            at: [[0; 2]; RAYS],
            columns: [0.0; RAYS],
            rows: [0.0; RAYS],
            ray: [0; RAYS],
            seen: Bundle::new(),
            hits: Hits::new(),
            surfaces: Surfaces::new(),
            shadow: Bundle::new(),
            sorter: Sorter::new(),
            blocked: Hits::new(),
            whose: [0; RAYS],
            lit: [0.0; RAYS],
            colors: [[0.0; RAYS]; 3],
            nodes: [0; RAYS],
            scratch: Scratch::new(),
            timer: StageTimer::default(),
        }
    }

    /// Makes it a tile of this size, without rays yet.
    pub(crate) fn resize(&mut self, width: usize, height: usize) {
        if self.size == (width, height) {
            return;
        }
        self.size = (width, height);
        let mut count = 0;
        for i in 0..RAYS {
            let (x, y) = place(i);
            if x < width && y < height {
                self.at[count] = [x as u8, y as u8];
                (self.columns[count], self.rows[count]) = (x as f32, y as f32);
                self.ray[y * TILE + x] = count as u16;
                count += 1;
            }
        }
    }
}

/// Traces the rays of a tile whose upper left pixel is `corner`, and their shadow rays.
#[inline(never)]
pub(crate) fn cast_tile<S: Simd, T: WideTest>(
    simd: S,
    frame: &Frame<'_>,
    tile: &mut Tile,
    corner: (u32, u32),
) -> RenderStats {
    let Frame { scene, alpha_cutouts, camera, shadows, options, shaded } = *frame;
    let mut work = Work::default();
    let mut stats = RenderStats::default();
    simd.vectorize(
        #[inline(always)]
        || {
            tile.seen.start(camera.eye(), f32::INFINITY);
            tile.seen.count = tile.size.0 * tile.size.1;
            let inside = random::in_pixel(options.sample);
            camera.directions(simd, corner, inside, (&tile.columns, &tile.rows), &mut tile.seen.direction);
            let Tile { seen, hits, scratch, nodes, timer, .. } = &mut *tile;
            let (traversal, query) = (options.traversal, Query::Closest);
            trace::<S, T>(simd, scene, traversal, query, seen, hits, scratch, nodes, &mut work);
            if let Some(mesh) = alpha_cutouts {
                timer.end(|t| &mut t.primary);
                stats.rays_again +=
                    alpha_cutouts::see_through::<S, T>(simd, scene, mesh, query, seen, hits, &mut work);
                timer.end(|t| &mut t.alpha);
            }
            let count = seen.count;
            stats.rays_primary = count as u64;
            stats.hits = (0..count).step_by(64).map(|at| u64::from(hits.lanes(at, 64).count_ones())).sum();
            if stats.hits > 0 && (shaded || shadows.is_some()) {
                tile.surfaces.find(simd, scene.triangles, &tile.seen, &tile.hits);
            }
        },
    );
    stats.count(&work);
    light_arrives::<S, T>(simd, frame, tile, &mut stats);
    stats
}

/// Finds out at which of the surfaces of a tile light arrives.
#[inline(never)]
pub(crate) fn light_arrives<S: Simd, T: WideTest>(
    simd: S,
    frame: &Frame<'_>,
    tile: &mut Tile,
    stats: &mut RenderStats,
) {
    let Frame { scene, alpha_cutouts, shadows, options, .. } = *frame;
    let count = tile.seen.count;
    tile.lit[..count].fill(if shadows.is_some() { 0.0 } else { 1.0 });
    let any_hits = || tile.hits.primitive[..count].iter().any(|&p| p != Hits::NONE);
    let Some(light) = shadows.filter(|_| any_hits()) else { return };
    let mut work = Work::default();
    tile.timer.end(|t| &mut t.primary);
    simd.vectorize(
        #[inline(always)]
        || {
            let Tile {
                surfaces,
                hits,
                shadow,
                sorter,
                blocked,
                whose,
                lit,
                nodes: visited,
                scratch,
                timer,
                ..
            } = &mut *tile;
            shadow.start(light, 1.0);
            surfaces.shadow_rays(simd, hits, count, shadow, whose);
            if options.traversal == Traversal::Tile {
                sorter.sort_if_scattered(simd, shadow, whose);
            }
            let mut nodes = [0; RAYS];
            let (traversal, query) = (options.traversal, Query::Any);
            trace::<S, T>(simd, scene, traversal, query, shadow, blocked, scratch, &mut nodes, &mut work);
            if let Some(mesh) = alpha_cutouts {
                timer.end(|t| &mut t.shadow);
                stats.rays_again +=
                    alpha_cutouts::see_through::<S, T>(simd, scene, mesh, query, shadow, blocked, &mut work);
                timer.end(|t| &mut t.alpha);
            }
            stats.rays_shadow += shadow.count as u64;
            for (j, &i) in whose[..shadow.count].iter().enumerate() {
                let arrives = blocked.primitive[j] == Hits::NONE;
                lit[i as usize] = if arrives { 1.0 } else { 0.0 };
                visited[i as usize] += nodes[j];
                stats.shadowed += u64::from(!arrives);
            }
        },
    );
    tile.timer.end(|t| &mut t.shadow);
    stats.count(&work);
}

/// Traces the rays of a tile; `nodes` gets the number of inner nodes that each visits if they go one by one.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "parts of a tile, borrowed one by one")]
pub(crate) fn trace<S: Simd, T: WideTest>(
    simd: S,
    scene: Scene<'_>,
    traversal: Traversal,
    query: Query,
    rays: &mut Bundle,
    hits: &mut Hits,
    scratch: &mut Scratch,
    nodes: &mut [u32; RAYS],
    work: &mut Work,
) {
    match traversal {
        Traversal::Tile => tile::trace::<S, T>(simd, scene, query, rays, hits, scratch, work),
        Traversal::Packet => packets::<T>(scene, query, rays, hits, work),
        Traversal::Single => one_by_one::<S, T>(simd, scene, query, rays, hits, nodes, work),
    }
    // Vectors may reach beyond the last ray.
    hits.primitive[rays.count..rays.count.next_multiple_of(SIZE)].fill(Hits::NONE);
}

fn packets<T: WideTest>(scene: Scene<'_>, query: Query, rays: &Bundle, hits: &mut Hits, work: &mut Work) {
    for at in (0..rays.count).step_by(SIZE) {
        let n = SIZE.min(rays.count - at);
        let packet = std::array::from_fn(|i| rays.ray(at + i.min(n - 1)));
        let t_max = std::array::from_fn(|i| if i < n { rays.t_max } else { -1.0 });
        let found = packet::trace::<T>(scene.bvh, scene.triangles, &packet, t_max, query, work);
        for (i, hit) in found[..n].iter().enumerate() {
            hits.set(at + i, *hit);
        }
    }
}

#[inline(always)]
fn one_by_one<S: Simd, T: WideTest>(
    simd: S,
    scene: Scene<'_>,
    query: Query,
    rays: &Bundle,
    hits: &mut Hits,
    nodes: &mut [u32; RAYS],
    work: &mut Work,
) {
    for (i, nodes) in nodes[..rays.count].iter_mut().enumerate() {
        let before = work.nodes;
        let ray = rays.ray(i);
        let hit = match query {
            Query::Closest => {
                pick::closest::<S, T>(simd, scene.bvh, scene.triangles, &ray, rays.t_max, work, every)
            }
            Query::Any => pick::any::<S, T>(simd, scene.bvh, scene.triangles, &ray, rays.t_max, work, every),
        };
        hits.set(i, hit);
        *nodes = (work.nodes - before) as u32;
    }
}
