//! Frames: tiles over threads, packets over tiles.

use std::ops::AddAssign;
use std::str::FromStr;

use bvh_core::{Bvh, Ray, SimdLevel, Triangles, Vec3};
use rayon::prelude::*;
use thiserror::Error;

use crate::packet::{self, Query, SIZE};
use crate::shade::{Background, PointLight, Surface, shadow_ray};
use crate::simd::at_level;
use crate::single::{self, Work, with_test};
use crate::tile::{self, Bundle, Hits, RAYS, Scene, Scratch};
use crate::triangle::{Double, Hit, MollerTrumbore, TriangleTest, Watertight};
use crate::wide::WideTest;
use crate::{Camera, Image, Mesh};

/// How rays are grouped to go through the tree. Images do not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Traversal {
    /// One by one.
    Single,
    /// In packets of 8 x 8 as Wald, Boulos and Shirley published them in 2007.
    Packet,
    /// In packets of 8 x 8 of a tile that share the way through the tree's top, and in smaller groups where
    /// rays drift apart; with SIMD.
    #[default]
    Tile,
}

impl Traversal {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Single, Self::Packet, Self::Tile];

    /// Name on a command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["single", "packet", "tile"][self as usize]
    }
}

/// A name that stands for nothing.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("unknown {what} '{found}'; expected one of {expected}")]
pub struct UnknownName {
    what: &'static str,
    found: String,
    expected: String,
}

fn by_name<T: Copy>(
    what: &'static str,
    all: &[T],
    name: fn(T) -> &'static str,
    found: &str,
) -> Result<T, UnknownName> {
    all.iter().copied().find(|&t| name(t) == found).ok_or_else(|| {
        let expected = all.iter().map(|&t| name(t)).collect::<Vec<_>>().join(", ");
        UnknownName { what, found: found.to_owned(), expected }
    })
}

impl FromStr for Traversal {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        by_name("traversal", &Self::ALL, Self::name, s)
    }
}

impl FromStr for TriangleTest {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        by_name("triangle test", &Self::ALL, Self::name, s)
    }
}

/// What an image shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Output {
    /// The scene.
    #[default]
    Shaded,
    /// Inner nodes visited by the rays of each pixel, shadow rays included, traced one by one: from black
    /// over blue, red and yellow to white at `most` or more.
    NodesVisited {
        /// The number of nodes that is shown white.
        most: u32,
    },
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// How rays are grouped.
    pub traversal: Traversal,
    /// How rays are tested against triangles.
    pub triangle_test: TriangleTest,
    /// Instruction set for [`Traversal::Tile`]; the best of the machine if that has less.
    pub simd: SimdLevel,
    /// Whether the light throws shadows; without, no shadow ray is cast.
    pub shadows: bool,
    /// Whether normals are interpolated where the mesh has them.
    pub smooth: bool,
    /// What is seen where nothing is hit.
    pub background: Background,
    /// What the image shows.
    pub output: Output,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            traversal: Traversal::default(),
            triangle_test: TriangleTest::default(),
            simd: SimdLevel::best(),
            shadows: true,
            smooth: true,
            background: Background::default(),
            output: Output::default(),
        }
    }
}

/// What rendering a frame took. Only `rays_primary`, `rays_shadow`, `hits` and `shadowed` are the same for
/// every [`Traversal`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderStats {
    /// Rays from the eye: one a pixel.
    pub rays_primary: u64,
    /// Rays from the light: one for each hit that faces it.
    pub rays_shadow: u64,
    /// Rays from the eye that hit something.
    pub hits: u64,
    /// Shadow rays that did not arrive.
    pub shadowed: u64,
    /// Inner nodes opened, once for each ray or packet.
    pub nodes_visited: u64,
    /// Triangles tested, once for each ray or packet.
    pub triangles_tested: u64,
    /// Times that [`Traversal::Tile`] went on with a small group because few rays of a packet were left: high
    /// where rays have little in common.
    pub regrouped: u64,
}

impl AddAssign for RenderStats {
    fn add_assign(&mut self, other: Self) {
        self.rays_primary += other.rays_primary;
        self.rays_shadow += other.rays_shadow;
        self.hits += other.hits;
        self.shadowed += other.shadowed;
        self.nodes_visited += other.nodes_visited;
        self.triangles_tested += other.triangles_tested;
        self.regrouped += other.regrouped;
    }
}

fn sum(mut a: RenderStats, b: RenderStats) -> RenderStats {
    a += b;
    a
}

/// Renders a frame into `image`, which is replaced if it is not of the camera's size.
///
/// `mesh.triangles` are the primitives of the tree, by its numbers. Runs in the current rayon pool, in tiles;
/// every pixel is the same for any number of threads, any [`Traversal`] and any [`SimdLevel`].
pub fn render(
    bvh: &Bvh,
    mesh: &Mesh<'_>,
    camera: &Camera,
    light: Option<&PointLight>,
    options: &RenderOptions,
    image: &mut Image,
) -> RenderStats {
    if (image.width(), image.height()) != (camera.width(), camera.height()) {
        *image = Image::new(camera.width(), camera.height());
    }
    let shadows = light.filter(|_| options.shadows).map(|l| l.position);
    let traversal = match options.output {
        Output::Shaded => options.traversal,
        Output::NodesVisited { .. } => Traversal::Single,
    };
    let options = &RenderOptions { traversal, ..*options };
    let frame = Frame { scene: Scene { bvh, triangles: &mesh.triangles }, camera, shadows, options };
    let shade = |ray: Vec3, pixel: &Pixel, nodes: u32| match options.output {
        Output::NodesVisited { most } => heat(nodes as f32 / most.max(1) as f32),
        Output::Shaded => match &pixel.hit {
            Some(hit) => {
                let surface = Surface::new(mesh, hit, ray, options.smooth);
                surface.shade(light, pixel.lit, -ray)
            }
            None => options.background.color(ray),
        },
    };
    frame.run(image.pixels_mut(), &shade)
}

/// What is seen through a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// What the ray through its centre hits.
    pub hit: Option<Hit>,
    /// Whether light arrives there: false where nothing is hit, in shadow, and on surfaces that face away.
    /// True for every hit if there is no light or shadows are off.
    pub lit: bool,
}

/// Casts the rays that [`render`] would cast, without shading: `pixels` are rows from the top.
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
    let shadows = light.filter(|_| options.shadows).map(|l| l.position);
    let frame = Frame { scene: Scene { bvh, triangles }, camera, shadows, options };
    frame.run(pixels, &|_, pixel, _| *pixel)
}

/// Side of a tile in pixels: what one thread does at a time.
const TILE: usize = 32;

/// The pixels of a rectangle; rows below the image are empty.
type Rows<'a, P> = [&'a mut [P]; TILE];

/// What all tiles have in common.
struct Frame<'a> {
    scene: Scene<'a>,
    camera: &'a Camera,
    /// Position of the light, if it throws shadows.
    shadows: Option<Vec3>,
    options: &'a RenderOptions,
}

impl Frame<'_> {
    /// Fills the image with what `finish` makes of each pixel's ray, hit and number of nodes visited.
    fn run<P: Send>(
        &self,
        pixels: &mut [P],
        finish: &(impl Fn(Vec3, &Pixel, u32) -> P + Sync),
    ) -> RenderStats {
        let width = self.camera.width() as usize;
        pixels
            .par_chunks_mut(width.max(1) * TILE)
            .enumerate()
            .map(|(i, band)| {
                let mut rows = band.chunks_mut(width);
                let rows = std::array::from_fn(|_| rows.next().unwrap_or_default());
                let y = (i * TILE) as u32;
                with_test!(self.options.triangle_test, T => self.tiles::<T, P>(rows, 0, y, finish))
            })
            .reduce(RenderStats::default, sum)
    }

    /// Halves a band of rows until it is a tile. Slices on the stack give each tile its pixels without locks.
    fn tiles<T: WideTest, P: Send>(
        &self,
        mut rows: Rows<'_, P>,
        x: u32,
        y: u32,
        finish: &(impl Fn(Vec3, &Pixel, u32) -> P + Sync),
    ) -> RenderStats {
        let width = rows[0].len();
        if width <= TILE {
            return self.tile::<T, P>(&mut rows, x, y, finish);
        }
        let middle = width.div_ceil(2).next_multiple_of(TILE);
        let mut right: Rows<'_, P> = std::array::from_fn(|_| Default::default());
        let mut halves = right.iter_mut();
        let left = rows.map(|row| {
            let (left, right) = row.split_at_mut(middle.min(row.len()));
            if let Some(half) = halves.next() {
                *half = right;
            }
            left
        });
        let (a, b) = rayon::join(
            || self.tiles::<T, P>(left, x, y, finish),
            || self.tiles::<T, P>(right, x + middle as u32, y, finish),
        );
        sum(a, b)
    }

    fn tile<T: WideTest, P>(
        &self,
        rows: &mut Rows<'_, P>,
        x: u32,
        y: u32,
        finish: &impl Fn(Vec3, &Pixel, u32) -> P,
    ) -> RenderStats {
        let (width, height) = (rows[0].len() as u32, rows.iter().filter(|r| !r.is_empty()).count() as u32);
        let mut tracer = Tracer::new();
        // Pixels in blocks of 8 x 8, so that packets are square.
        let mut at = [(0, 0); RAYS];
        let mut count = 0;
        for i in 0..RAYS as u32 {
            let (block, i) = (i / 64, i % 64);
            let (px, py) = (block % 4 * 8 + i % 8, block / 4 * 8 + i / 8);
            if px < width && py < height {
                at[count] = (px, py);
                count += 1;
            }
        }
        let eye = self.camera.eye();
        tracer.start(eye, f32::INFINITY);
        for &(px, py) in &at[..count] {
            tracer.push(self.camera.direction(x + px, y + py));
        }
        tracer.trace::<T>(self.scene, self.options, Query::Closest);
        let mut stats = RenderStats { rays_primary: count as u64, ..RenderStats::default() };

        let mut pixels = [Pixel::default(); RAYS];
        let mut seen = [Vec3::ZERO; RAYS];
        let mut nodes = tracer.nodes;
        for (i, pixel) in pixels[..count].iter_mut().enumerate() {
            pixel.hit = tracer.hit(i);
            pixel.lit = pixel.hit.is_some() && self.shadows.is_none();
            seen[i] = tracer.direction(i);
            stats.hits += u64::from(pixel.hit.is_some());
        }
        if let Some(light) = self.shadows {
            let mut whose = [0; RAYS];
            tracer.start(light, 1.0);
            for (i, pixel) in pixels[..count].iter().enumerate() {
                let way = pixel.hit.and_then(|hit| shadow_ray(self.scene.triangles, &hit, seen[i], light));
                if let Some(way) = way {
                    whose[tracer.count()] = i;
                    tracer.push(way);
                }
            }
            stats.rays_shadow += tracer.count() as u64;
            tracer.trace::<T>(self.scene, self.options, Query::Any);
            for (j, &i) in whose[..tracer.count()].iter().enumerate() {
                pixels[i].lit = tracer.hit(j).is_none();
                stats.shadowed += u64::from(!pixels[i].lit);
                nodes[i] += tracer.nodes[j];
            }
        }
        for (i, &(px, py)) in at[..count].iter().enumerate() {
            rows[py as usize][px as usize] = finish(seen[i], &pixels[i], nodes[i]);
        }
        stats.nodes_visited = tracer.work.nodes;
        stats.triangles_tested = tracer.work.triangles;
        stats.regrouped = tracer.work.regrouped;
        stats
    }
}

/// Traces the rays of a tile in the way that the options ask for.
pub(crate) struct Tracer {
    rays: Bundle,
    hits: Hits,
    /// Inner nodes visited by each ray; for [`Traversal::Single`] only.
    nodes: [u32; RAYS],
    scratch: Scratch,
    work: Work,
}

impl Tracer {
    pub(crate) fn new() -> Self {
        Self {
            rays: Bundle { direction: [[0.0; RAYS]; 3], origin: Vec3::ZERO, count: 0, t_max: 0.0 },
            hits: Hits { t: [0.0; RAYS], u: [0.0; RAYS], v: [0.0; RAYS], primitive: [Hits::NONE; RAYS] },
            nodes: [0; RAYS],
            scratch: Scratch::new(),
            work: Work::default(),
        }
    }

    /// Begins a bundle of rays from `origin`.
    pub(crate) fn start(&mut self, origin: Vec3, t_max: f32) {
        (self.rays.origin, self.rays.t_max, self.rays.count) = (origin, t_max, 0);
    }

    pub(crate) fn push(&mut self, direction: Vec3) {
        for k in 0..3 {
            self.rays.direction[k][self.rays.count] = direction[k];
        }
        self.rays.count += 1;
    }

    fn count(&self) -> usize {
        self.rays.count
    }

    fn direction(&self, i: usize) -> Vec3 {
        Vec3::from([0, 1, 2].map(|k| self.rays.direction[k][i]))
    }

    pub(crate) fn hit(&self, i: usize) -> Option<Hit> {
        let hits = &self.hits;
        let primitive = hits.primitive[i];
        (primitive != Hits::NONE).then(|| Hit { t: hits.t[i], u: hits.u[i], v: hits.v[i], primitive })
    }

    pub(crate) fn trace<T: WideTest>(&mut self, scene: Scene<'_>, options: &RenderOptions, query: Query) {
        let Self { rays, hits, nodes: _, scratch, work } = self;
        match options.traversal {
            Traversal::Tile => {
                at_level!(options.simd, simd => {
                    tile::trace::<_, T>(simd, scene, query, rays, hits, scratch, work);
                });
            }
            Traversal::Packet => {
                for at in (0..self.rays.count).step_by(SIZE) {
                    let n = SIZE.min(self.rays.count - at);
                    let ray = |i| Ray::new(self.rays.origin, self.direction(at + std::cmp::min(i, n - 1)));
                    let rays = std::array::from_fn(ray);
                    let t_max = std::array::from_fn(|i| if i < n { self.rays.t_max } else { -1.0 });
                    let found =
                        packet::trace::<T>(scene.bvh, scene.triangles, &rays, t_max, query, &mut self.work);
                    for (i, hit) in found[..n].iter().enumerate() {
                        self.set(at + i, *hit);
                    }
                }
            }
            Traversal::Single => {
                for i in 0..self.rays.count {
                    let ray = Ray::new(self.rays.origin, self.direction(i));
                    let (bvh, triangles, t_max) = (scene.bvh, scene.triangles, self.rays.t_max);
                    let before = self.work.nodes;
                    let hit = match query {
                        Query::Closest => single::closest::<T>(bvh, triangles, &ray, t_max, &mut self.work),
                        Query::Any => single::any::<T>(bvh, triangles, &ray, t_max, &mut self.work),
                    };
                    self.nodes[i] = (self.work.nodes - before) as u32;
                    self.set(i, hit);
                }
            }
        }
    }

    fn set(&mut self, i: usize, hit: Option<Hit>) {
        self.hits.primitive[i] = hit.map_or(Hits::NONE, |h| h.primitive);
        if let Some(h) = hit {
            (self.hits.t[i], self.hits.u[i], self.hits.v[i]) = (h.t, h.u, h.v);
        }
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
