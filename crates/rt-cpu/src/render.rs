//! Frames: tiles over threads, packets over tiles.

use std::cell::RefCell;

use bvh_core::{Bvh, Triangles, Vec3, pick};
use fearless_simd::{Simd, f32x4};
use rayon::prelude::*;

use crate::bundle::{Bundle, Hits, RAYS};
use crate::options::{Effects, Output, RenderOptions, RenderStats, Traversal, sum};
use crate::packet::{self, SIZE};
use crate::scene::{Query, Scene, Work, every, with_test};
use crate::shade::{PointLight, Shader};
use crate::simd::{at_level, load};
use crate::sort::Sorter;
use crate::surface::{Coordinates, Surfaces};
use crate::tile::{self, Scratch};
use crate::times::StageTimer;

use crate::wavefront::{Paths, Wavefront};
use crate::wide::WideTest;
use crate::{Bvh8, Camera, Hit, Image, Mesh, Pixel, alpha_cutouts, random};

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

/// Side of a tile in pixels: what one thread does at a time.
const TILE: usize = 64;

/// The pixels of a rectangle; rows below the image are empty.
pub(crate) type Rows<'a, P> = [&'a mut [P]; TILE];

/// What all tiles have in common.
pub(crate) struct Frame<'a> {
    pub(crate) scene: Scene<'a>,
    /// The mesh, if it has holes.
    pub(crate) alpha_cutouts: Option<&'a Mesh<'a>>,
    camera: &'a Camera,
    /// Position of the light, if it throws shadows.
    shadows: Option<Vec3>,
    options: &'a RenderOptions,
    /// Whether points and normals are needed even without shadows.
    shaded: bool,
}

impl<'a> Frame<'a> {
    fn new(
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
    size: (usize, usize),
    /// Column and row of each pixel in the tile.
    pub(crate) at: [[u8; 2]; RAYS],
    columns: [f32; RAYS],
    rows: [f32; RAYS],
    /// The ray of the pixel in each row, of `TILE` pixels, and column; without meaning outside the tile.
    ray: [u16; RAYS],
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
    nodes: [u32; RAYS],
    scratch: Scratch,
    /// What effects need; made when they first do.
    pub(crate) paths: Option<Box<Paths>>,
    pub(crate) timer: StageTimer,
}

impl Tile {
    fn new() -> Self {
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
            paths: None,
            timer: StageTimer::default(),
        }
    }
}

impl Tile {
    /// Makes it a tile of this size, without rays yet.
    fn resize(&mut self, width: usize, height: usize) {
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

thread_local! {
    /// One for each thread: too large to be set up for every tile.
    static THIS_TILE: RefCell<Box<Tile>> = RefCell::new(Box::new(Tile::new()));
}

/// What is made of the pixels of a traced tile.
pub(crate) trait PixelSink: Sync {
    type Pixel: Send;

    /// `corner` is the tile's upper left pixel.
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        corner: (u32, u32),
        rows: &mut Rows<'_, Self::Pixel>,
        stats: &mut RenderStats,
    );
}

impl PixelSink for Shader<'_> {
    type Pixel = [f32; 3];

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, [f32; 3]>,
        _: &mut RenderStats,
    ) {
        self.shade(simd, &tile.seen, &tile.hits, &tile.surfaces, &tile.lit, &mut tile.colors);
        let [r, g, b] = &tile.colors;
        for (i, &[x, y]) in tile.at[..tile.seen.count].iter().enumerate() {
            rows[y as usize][x as usize] = [r[i], g[i], b[i]];
        }
    }
}

/// Gives hits as they are.
struct Caster;

impl PixelSink for Caster {
    type Pixel = Pixel;

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, Pixel>,
        _: &mut RenderStats,
    ) {
        let Hits { t, u, v, primitive } = &tile.hits;
        // Numbers of primitives with the bit for light.
        let mut words = [0.0; RAYS];
        for (word, (&p, &lit)) in words.iter_mut().zip(primitive.iter().zip(&tile.lit)) {
            *word = Pixel::word(p, p != Hits::NONE && lit > 0.0);
        }
        for (row, rays) in rows.iter_mut().zip(tile.ray.chunks_exact(TILE)).take(tile.size.1) {
            if row.len() == TILE {
                // Rays of four neighbours are neighbours.
                let row: &mut [f32] = bytemuck::cast_slice_mut(row);
                for (four, rays) in row.as_chunks_mut().0.iter_mut().zip(rays.chunks_exact(4)) {
                    let first = rays[0] as usize;
                    let lanes = [
                        load::<S, f32x4<S>, RAYS>(simd, t, first),
                        load(simd, u, first),
                        load(simd, v, first),
                        load(simd, &words, first),
                    ];
                    simd.store_four_interleaved_f32x4(lanes, four);
                }
            } else {
                for (to, &ray) in row.iter_mut().zip(rays) {
                    let i = ray as usize;
                    *to = Pixel::packed([t[i], u[i], v[i]], words[i]);
                }
            }
        }
    }
}

/// Shows the number of nodes.
struct Heat {
    most: u32,
}

impl PixelSink for Heat {
    type Pixel = [f32; 3];

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        _: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, [f32; 3]>,
        _: &mut RenderStats,
    ) {
        for (i, &[x, y]) in tile.at[..tile.seen.count].iter().enumerate() {
            rows[y as usize][x as usize] = heat(tile.nodes[i] as f32 / self.most.max(1) as f32);
        }
    }
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

/// Traces the rays of a tile whose upper left pixel is `corner`, and their shadow rays.
#[inline(never)]
fn cast_tile<S: Simd, T: WideTest>(
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
    let any_hits = tile.hits.primitive[..count].iter().any(|&p| p != Hits::NONE);
    let Some(light) = shadows.filter(|_| any_hits) else { return };
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

/// Colour of a number from 0 to 1.
fn heat(x: f32) -> [f32; 3] {
    const RAMP: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.05, 0.05, 0.6], [0.8, 0.05, 0.05], [1.0, 0.8, 0.05], [1.0, 1.0, 1.0]];
    let at = x.clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let i = (at as usize).min(RAMP.len() - 2);
    let f = at - i as f32;
    std::array::from_fn(|c| RAMP[i][c] + (RAMP[i + 1][c] - RAMP[i][c]) * f)
}
