//! Frames: tiles over threads, packets over tiles.

use std::ops::AddAssign;
use std::str::FromStr;

use bvh_core::{Bvh, Ray, Vec3};
use rayon::prelude::*;
use thiserror::Error;

use crate::packet::{self, Query, SIDE, SIZE};
use crate::shade::{Background, PointLight, Surface};
use crate::single::{self, Work, with_test};
use crate::triangle::{Double, Hit, MollerTrumbore, Test, TriangleTest, Watertight};
use crate::{Camera, Image, Mesh};

/// How rays are grouped to go through the tree. Images do not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Traversal {
    /// One by one.
    Single,
    /// In packets of 8 x 8 as Wald, Boulos and Shirley published them in 2007.
    #[default]
    Packet,
}

impl Traversal {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Single, Self::Packet];

    /// Name on a command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["single", "packet"][self as usize]
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
}

impl AddAssign for RenderStats {
    fn add_assign(&mut self, other: Self) {
        self.rays_primary += other.rays_primary;
        self.rays_shadow += other.rays_shadow;
        self.hits += other.hits;
        self.shadowed += other.shadowed;
        self.nodes_visited += other.nodes_visited;
        self.triangles_tested += other.triangles_tested;
    }
}

fn sum(mut a: RenderStats, b: RenderStats) -> RenderStats {
    a += b;
    a
}

/// Renders a frame into `image`, which is replaced if it is not of the camera's size.
///
/// `mesh.triangles` are the primitives of the tree, by its numbers. Runs in the current rayon pool, in tiles;
/// every pixel is the same for any number of threads and any [`Traversal`]. Allocates nothing for an image
/// of the right size.
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
    let frame = Frame { bvh, mesh, camera, light, options };
    let band = image.width().max(1) as usize * TILE;
    image
        .pixels_mut()
        .par_chunks_mut(band)
        .enumerate()
        .map(|(i, band)| {
            let mut rows = band.chunks_mut(camera.width() as usize);
            let rows = std::array::from_fn(|_| rows.next().unwrap_or_default());
            with_test!(options.triangle_test, T => tiles::<T>(&frame, rows, 0, (i * TILE) as u32))
        })
        .reduce(RenderStats::default, sum)
}

/// Side of a tile in pixels: what one thread does at a time.
const TILE: usize = 32;

/// The pixels of a rectangle; rows below the image are empty.
type Rows<'a> = [&'a mut [[f32; 3]]; TILE];

/// What all tiles have in common.
struct Frame<'a> {
    bvh: &'a Bvh,
    mesh: &'a Mesh<'a>,
    camera: &'a Camera,
    light: Option<&'a PointLight>,
    options: &'a RenderOptions,
}

/// Halves a band of rows until it is a tile. Slices on the stack give each tile its pixels without locks.
fn tiles<T: Test>(frame: &Frame<'_>, mut rows: Rows<'_>, x: u32, y: u32) -> RenderStats {
    let width = rows[0].len();
    if width <= TILE {
        return tile::<T>(frame, &mut rows, x, y);
    }
    let middle = width.div_ceil(2).next_multiple_of(TILE);
    let mut right: Rows<'_> = std::array::from_fn(|_| Default::default());
    let mut halves = right.iter_mut();
    let left = rows.map(|row| {
        let (left, right) = row.split_at_mut(middle.min(row.len()));
        if let Some(half) = halves.next() {
            *half = right;
        }
        left
    });
    let (a, b) =
        rayon::join(|| tiles::<T>(frame, left, x, y), || tiles::<T>(frame, right, x + middle as u32, y));
    sum(a, b)
}

fn tile<T: Test>(frame: &Frame<'_>, rows: &mut Rows<'_>, x: u32, y: u32) -> RenderStats {
    let (width, height) = (rows[0].len() as u32, rows.iter().filter(|r| !r.is_empty()).count() as u32);
    let mut stats = RenderStats::default();
    for by in (0..height).step_by(SIDE as usize) {
        for bx in (0..width).step_by(SIDE as usize) {
            let present = |i: usize| bx + i as u32 % SIDE < width && by + i as u32 / SIDE < height;
            let colors = block::<T>(frame, x + bx, y + by, present, &mut stats);
            for i in (0..SIZE).filter(|&i| present(i)) {
                rows[by as usize + i / SIDE as usize][bx as usize + i % SIDE as usize] = colors[i];
            }
        }
    }
    stats
}

/// The colours of 8 x 8 pixels.
fn block<T: Test>(
    frame: &Frame<'_>,
    x: u32,
    y: u32,
    present: impl Fn(usize) -> bool,
    stats: &mut RenderStats,
) -> [[f32; 3]; SIZE] {
    let mut work = [Work::default(); SIZE];
    let rays = std::array::from_fn(|i| frame.camera.ray(x + i as u32 % SIDE, y + i as u32 / SIDE));
    let t_max = std::array::from_fn(|i| if present(i) { f32::INFINITY } else { -1.0 });
    let hits = trace::<T>(frame, &rays, t_max, Query::Closest, &mut work);
    let surfaces: [Option<Surface>; SIZE] = std::array::from_fn(|i| {
        let hit = hits[i].as_ref()?;
        Some(Surface::new(frame.mesh, hit, rays[i].direction(), frame.options.smooth))
    });
    stats.rays_primary += (0..SIZE).filter(|&i| present(i)).count() as u64;
    stats.hits += hits.iter().flatten().count() as u64;

    let mut visible = [true; SIZE];
    if let Some(light) = frame.light.filter(|_| frame.options.shadows) {
        let ways = surfaces.map(|s| s.and_then(|s| s.way_from_light(light.position)));
        let rays = ways.map(|way| Ray::new(light.position, way.unwrap_or(Vec3::ZERO)));
        let t_max = ways.map(|way| if way.is_some() { 1.0 } else { -1.0 });
        let blocked = trace::<T>(frame, &rays, t_max, Query::Any, &mut work);
        visible = std::array::from_fn(|i| ways[i].is_some() && blocked[i].is_none());
        stats.rays_shadow += ways.iter().flatten().count() as u64;
        stats.shadowed += blocked.iter().flatten().count() as u64;
    }
    for w in &work {
        stats.nodes_visited += w.nodes;
        stats.triangles_tested += w.triangles;
    }

    std::array::from_fn(|i| match (frame.options.output, &surfaces[i]) {
        (Output::NodesVisited { most }, _) => heat(work[i].nodes as f32 / most.max(1) as f32),
        (Output::Shaded, Some(s)) => s.shade(frame.light, visible[i], -rays[i].direction()),
        (Output::Shaded, None) => frame.options.background.color(rays[i].direction()),
    })
}

/// Traces rays from one origin, in the way the options ask for.
fn trace<T: Test>(
    frame: &Frame<'_>,
    rays: &[Ray; SIZE],
    t_max: [f32; SIZE],
    query: Query,
    work: &mut [Work; SIZE],
) -> [Option<Hit>; SIZE] {
    let triangles = &frame.mesh.triangles;
    let one_by_one = matches!(frame.options.output, Output::NodesVisited { .. });
    if frame.options.traversal == Traversal::Packet && !one_by_one {
        return packet::trace::<T>(frame.bvh, triangles, rays, t_max, query, &mut work[0]);
    }
    std::array::from_fn(|i| match query {
        Query::Closest => single::closest::<T>(frame.bvh, triangles, &rays[i], t_max[i], &mut work[i]),
        Query::Any => single::any::<T>(frame.bvh, triangles, &rays[i], t_max[i], &mut work[i]),
    })
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
