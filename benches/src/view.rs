//! What every contestant does, casting the rays of a picture, and comparing what contestants say of
//! them.

use bvh_core::{Triangles, Vec3};
use bytemuck::Zeroable;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use rt_cpu::{Camera, Pixel};

use crate::{Failure, Hits, RAYS, Rays};

/// One library in one configuration, with the triangles it was made for.
///
/// Everything runs in the current rayon pool; Embree on as many threads as its device was made for.
pub trait Contestant: Send + Sync {
    /// Takes positions of the vertices, as many as it was made with.
    fn pose(&mut self, positions: &[Vec3]);

    /// Brings the tree up to date with the positions; the first time, builds it.
    ///
    /// # Errors
    /// If the library reports an error.
    fn update(&mut self) -> Result<(), Failure>;

    /// Whether updates learn from what is cast: it is to be shown every frame then, measured or
    /// not.
    fn learns(&self) -> bool {
        false
    }

    /// SAH cost of the tree as [`bvh_core::sah_cost`] defines it; `None` if the tree cannot be read
    /// or has other than two children a node.
    fn sah_cost(&self) -> Option<f64> {
        None
    }

    /// Finds the first triangle along each ray.
    fn closest(&self, rays: &Rays, hits: &mut Hits);

    /// Finds whether anything lies along each ray. Answers beyond the number of rays have no
    /// meaning.
    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]);

    /// The triangles as they are now.
    fn triangles(&self) -> Triangles<'_>;

    /// Whether [`closest`](Self::closest) gives normals of what it hits: shadow rays are made from
    /// these then, rather than from the triangles.
    fn gives_normals(&self) -> bool {
        false
    }

    /// Casts the primary and the shadow rays of every pixel of a view, in tiles over all threads.
    ///
    /// # Panics
    /// If the number of pixels is not that of the view's camera.
    fn cast(&self, view: &View, pixels: &mut [Pixel]) {
        cast(self, view, pixels);
    }
}

/// What is looked at, and where the light is.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Camera and size of the picture.
    pub camera: Camera,
    /// Position of a point light that throws shadows; without it no shadow rays are cast.
    pub light: Option<Vec3>,
}

/// Side of a tile in pixels.
const TILE: usize = 16;

/// Casts primary rays and, for what they hit and what faces the light, shadow rays from the light.
pub(crate) fn cast<C: Contestant + ?Sized>(contestant: &C, view: &View, pixels: &mut [Pixel]) {
    let source = Source::Traced(contestant);
    in_bands(&Picture { view, triangles: contestant.triangles(), source }, pixels);
}

/// Does all that [`Contestant::cast`] does but for tracing: what rays find is `known`. The time
/// that this takes is in those of all contestants that leave rays to their users.
///
/// # Panics
/// If either number of pixels is not that of the view's camera.
pub fn set_up_rays(triangles: &Triangles<'_>, view: &View, known: &[Pixel], pixels: &mut [Pixel]) {
    assert_eq!(known.len(), pixels.len(), "as many pixels");
    let source: Source<'_, dyn Contestant> = Source::Known(known);
    in_bands(&Picture { view, triangles: *triangles, source }, pixels);
}

/// Where what rays find comes from: a contestant traces them, or it is known for each pixel.
enum Source<'a, C: ?Sized> {
    Traced(&'a C),
    Known(&'a [Pixel]),
}

/// A view of some triangles.
struct Picture<'a, C: ?Sized> {
    view: &'a View,
    triangles: Triangles<'a>,
    source: Source<'a, C>,
}

fn in_bands<C: Contestant + ?Sized>(picture: &Picture<'_, C>, pixels: &mut [Pixel]) {
    let camera = &picture.view.camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    assert_eq!(pixels.len(), width * height, "pixels of the camera");
    let level = Level::new();
    pixels.par_chunks_mut((width * TILE).max(1)).enumerate().for_each(|(row, band)| {
        let mut tile = Tile::zeroed();
        for x in (0..width).step_by(TILE) {
            // Compiled for the best level of the machine, as a user with much to trace would
            // compile it: the plain loops over coordinates become SIMD there.
            dispatch!(level, simd => simd.vectorize(
                #[inline(always)]
                || tile.cast(picture, band, x, row * TILE),
            ));
        }
    });
}

/// What a tile needs, kept from tile to tile.
#[repr(C, align(64))]
#[derive(Zeroable)]
struct Tile {
    shadows: Shadows,
    rays: Rays,
    hits: Hits,
    blocked: [bool; RAYS],
    /// Place in the band of each primary ray's pixel, and of each shadow ray's.
    seen: [u32; RAYS],
    lit: [u32; RAYS],
}

impl Tile {
    /// The tile with its upper left corner at pixel `x`, `y`; the band starts in row `y`.
    #[inline(always)]
    fn cast<C>(&mut self, picture: &Picture<'_, C>, band: &mut [Pixel], x: usize, y: usize)
    where
        C: Contestant + ?Sized,
    {
        let Picture { view, triangles, source } = picture;
        let width = view.camera.width as usize;
        self.primary_rays(view, band.len(), x, y);
        let band_start = y * width;
        let primary = self.rays.len();
        match source {
            Source::Traced(contestant) => contestant.closest(&self.rays, &mut self.hits),
            Source::Known(pixels) => {
                // Rays that nobody looks at might not be made.
                std::hint::black_box(&self.rays);
                for (i, &place) in self.seen[..primary].iter().enumerate() {
                    self.hits.set(i, pixels[band_start + place as usize].hit());
                }
            }
        }
        let Hits { t, u, v, primitive, .. } = &self.hits;
        for (i, &place) in self.seen[..primary].iter().enumerate() {
            let is_lit = primitive[i] != Hits::NONE && view.light.is_none();
            band[place as usize] = Pixel::packed([t[i], u[i], v[i]], Pixel::word(primitive[i], is_lit));
        }
        let Some(light) = view.light else { return };
        if matches!(source, Source::Traced(contestant) if contestant.gives_normals()) {
            self.shadows.aim_by_normals(&self.hits, &self.rays, light);
        } else {
            self.shadows.aim(triangles, &self.hits, &self.rays.direction, primary, light);
        }
        let mut count = 0;
        for i in 0..primary {
            // In place of a primary ray that has been looked at already; counted where the surface
            // faces the light.
            self.lit[count] = self.seen[i];
            for axis in 0..3 {
                self.rays.direction[axis][count] = self.shadows.way[axis][i];
            }
            count += usize::from(self.shadows.faces[i]);
        }
        for axis in 0..3 {
            self.rays.origin[axis].fill(light[axis]);
        }
        self.rays.t_max.fill(1.0);
        self.rays.set_len(count);
        match source {
            Source::Traced(contestant) => contestant.occluded(&self.rays, &mut self.blocked),
            Source::Known(pixels) => {
                std::hint::black_box(&self.rays);
                for (blocked, &place) in self.blocked.iter_mut().zip(&self.lit[..count]) {
                    *blocked = !pixels[band_start + place as usize].is_lit();
                }
            }
        }
        for (&place, blocked) in self.lit[..count].iter().zip(self.blocked) {
            band[place as usize].set_lit(!blocked);
        }
    }

    /// The primary rays of the part of the tile at `x`, `y` that is within the picture.
    #[inline(always)]
    fn primary_rays(&mut self, view: &View, pixels: usize, x: usize, y: usize) {
        let width = view.camera.width as usize;
        let (columns, rows) = (&CURVE[0], &CURVE[1]);
        let mut count = RAYS;
        let (mut across, mut along) = ([0.0; RAYS], [0.0; RAYS]);
        if x + TILE <= width && width * TILE <= pixels {
            for i in 0..RAYS {
                self.seen[i] = u32::from(rows[i]) * width as u32 + (x as u32 + u32::from(columns[i]));
                across[i] = x as f32 + f32::from(columns[i]) + 0.5;
                along[i] = y as f32 + f32::from(rows[i]) + 0.5;
            }
        } else {
            count = 0;
            for (&dx, &dy) in columns.iter().zip(rows) {
                let place = dy as usize * width + x + dx as usize;
                if x + (dx as usize) < width && place < pixels {
                    self.seen[count] = place as u32;
                    across[count] = (x + dx as usize) as f32 + 0.5;
                    along[count] = (y + dy as usize) as f32 + 0.5;
                    count += 1;
                }
            }
        }
        let Camera { eye, corner, right, down, .. } = view.camera;
        for axis in 0..3 {
            for i in 0..RAYS {
                self.rays.direction[axis][i] = corner[axis] + right[axis] * across[i] + down[axis] * along[i];
            }
            self.rays.origin[axis].fill(eye[axis]);
        }
        self.rays.t_max.fill(f32::INFINITY);
        self.rays.set_len(count);
    }
}

/// Columns and rows of the pixels of a tile in Morton order, so that 8 in a row are 4 x 2 pixels,
/// 16 are 4 x 4 and 64 are 8 x 8.
static CURVE: [[u8; RAYS]; 2] = {
    let mut curve = [[0; RAYS]; 2];
    let mut i = 0;
    while i < RAYS {
        curve[0][i] = even_bits(i);
        curve[1][i] = even_bits(i >> 1);
        i += 1;
    }
    curve
};

/// The even bits of `i`, side by side.
const fn even_bits(i: usize) -> u8 {
    ((i & 1) | (i >> 1 & 2) | (i >> 2 & 4) | (i >> 3 & 8)) as u8
}

/// Shadow rays of one tile, coordinate by coordinate, so that the arithmetic is SIMD for those who
/// leave it to us too.
#[repr(C, align(64))]
#[derive(Zeroable)]
struct Shadows {
    /// A corner of what each ray hit, the two edges from there, and the greatest coordinate of the
    /// corners.
    corner: [[f32; RAYS]; 3],
    edges: [[[f32; RAYS]; 3]; 2],
    max_coordinate: [f32; RAYS],
    /// Way from the light to just before the hit, which it reaches at `t` = 1.
    way: [[f32; RAYS]; 3],
    /// Whether something is hit and faces the light.
    faces: [bool; RAYS],
}

impl Shadows {
    /// From the light to what `rays` hit, by what a library says of the surface: its normal, and
    /// the distance. The corners are not read, so the point stands for them in how far rays end off
    /// the surface: that costs these libraries less, and large triangles may shadow themselves.
    #[inline(always)]
    fn aim_by_normals(&mut self, hits: &Hits, rays: &Rays, light: Vec3) {
        let ([nx, ny, nz], [dx, dy, dz], [ox, oy, oz]) = (&hits.normal, &rays.direction, &rays.origin);
        for i in 0..RAYS {
            let is_hit = hits.primitive[i] != Hits::NONE;
            let t = if is_hit { hits.t[i] } else { 0.0 };
            let point = [ox[i] + dx[i] * t, oy[i] + dy[i] * t, oz[i] + dz[i] * t];
            let (normal, seen) = ([nx[i], ny[i], nz[i]], [dx[i], dy[i], dz[i]]);
            self.max_coordinate[i] = greatest(point);
            self.aim_at(i, is_hit, point, normal, seen, light);
        }
    }

    /// From the light to what the rays along `seen` hit, by the corners of the triangles.
    #[inline(always)]
    fn aim(
        &mut self,
        triangles: &Triangles<'_>,
        hits: &Hits,
        seen: &[[f32; RAYS]; 3],
        count: usize,
        light: Vec3,
    ) {
        if triangles.indices.is_empty() {
            self.faces.fill(false);
            return;
        }
        for i in 0..count {
            // Of what hits nothing any triangle will do.
            let primitive = hits.primitive[i];
            let [a, b, c] = triangles.corners(if primitive != Hits::NONE { primitive as usize } else { 0 });
            let (ab, ac) = (b - a, c - a);
            self.max_coordinate[i] = a.abs().max(b.abs()).max(c.abs()).max_element();
            for axis in 0..3 {
                self.corner[axis][i] = a[axis];
                self.edges[0][axis][i] = ab[axis];
                self.edges[1][axis][i] = ac[axis];
            }
        }
        for i in 0..RAYS {
            // Not by `map`, whose closures are not inlined here: the loop then took four times as
            // long.
            let [ab, ac] = &self.edges;
            let (ab, ac) = ([ab[0][i], ab[1][i], ab[2][i]], [ac[0][i], ac[1][i], ac[2][i]]);
            let (u, v) = (hits.u[i], hits.v[i]);
            let normal =
                [ab[1] * ac[2] - ac[1] * ab[2], ab[2] * ac[0] - ac[2] * ab[0], ab[0] * ac[1] - ac[0] * ab[1]];
            let point = [
                self.corner[0][i] + ab[0] * u + ac[0] * v,
                self.corner[1][i] + ab[1] * u + ac[1] * v,
                self.corner[2][i] + ab[2] * u + ac[2] * v,
            ];
            let seen = [seen[0][i], seen[1][i], seen[2][i]];
            self.aim_at(i, hits.primitive[i] != Hits::NONE, point, normal, seen, light);
        }
    }

    /// Ray `i`, from the light to a point. Off the surface by 32 roundings of `max_coordinate` and
    /// of the distance, as [`rt_cpu`] does it, so that contestants whose corners are read cast the
    /// same rays.
    #[inline(always)]
    fn aim_at(
        &mut self,
        i: usize,
        is_hit: bool,
        point: [f32; 3],
        [nx, ny, nz]: [f32; 3],
        seen: [f32; 3],
        light: Vec3,
    ) {
        // Towards the eye, and of length 1; infinite or NaN for a triangle without area.
        let scale = 1.0 / (nx * nx + ny * ny + nz * nz).sqrt();
        let scale = if nx * seen[0] + ny * seen[1] + nz * seen[2] > 0.0 { -scale } else { scale };
        let (nx, ny, nz) = (nx * scale, ny * scale, nz * scale);
        let to_light = [light.x - point[0], light.y - point[1], light.z - point[2]];
        let off = greater(self.max_coordinate[i], greatest(to_light)) / (1 << 19) as f32;
        self.faces[i] = is_hit & (nx * to_light[0] + ny * to_light[1] + nz * to_light[2] > 0.0);
        self.way[0][i] = point[0] + nx * off - light.x;
        self.way[1][i] = point[1] + ny * off - light.y;
        self.way[2][i] = point[2] + nz * off - light.z;
    }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The greatest coordinate, without its sign.
#[inline(always)]
fn greatest([x, y, z]: [f32; 3]) -> f32 {
    greater(greater(x.abs(), y.abs()), z.abs())
}

/// What the rays of one or more views found, for comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answers {
    /// Primary rays.
    pub rays: u64,
    /// Primary rays that hit something.
    pub hits: u64,
    /// Pixels that the light reaches.
    pub lit: u64,
    /// Sum of `t` over all hits.
    pub t_sum: f64,
    /// Pixels that say something else than the reference: hit or miss, or a `t` that differs by
    /// more than 0.1 %.
    pub different: u64,
    /// Pixels that are lit in one and in shadow in the other.
    pub shadows_different: u64,
}

impl Answers {
    /// Adds what was found in a view, compared pixel by pixel to a reference of the same view.
    pub fn add(&mut self, pixels: &[Pixel], reference: &[Pixel]) {
        for (pixel, expected) in pixels.iter().zip(reference) {
            self.rays += 1;
            self.lit += u64::from(pixel.is_lit());
            if let Some(hit) = pixel.hit() {
                self.hits += 1;
                self.t_sum += f64::from(hit.t);
            }
            let same = match (pixel.hit(), expected.hit()) {
                (Some(a), Some(b)) => (a.t - b.t).abs() <= 1e-3 * b.t.abs(),
                (a, b) => a.is_some() == b.is_some(),
            };
            self.different += u64::from(!same);
            self.shadows_different += u64::from(pixel.is_lit() != expected.is_lit());
        }
    }

    /// Returns whether the numbers of hits differ by no more than 0.01 % and those of lit pixels by
    /// no more than 0.1 % (and one, for small views), and the answers of no more than 0.1 % of all
    /// pixels: triangle tests that round in other ways may disagree at silhouettes, and along the
    /// edges of shadows.
    #[must_use]
    pub fn agrees_with(&self, reference: &Self) -> bool {
        let near = |a: u64, b: u64, part: u64| a.abs_diff(b) <= 1 + b / part;
        self.rays == reference.rays
            && near(self.hits, reference.hits, 10_000)
            && near(self.lit, reference.lit, 1_000)
            && self.different + self.shadows_different <= 1 + self.rays / 1_000
    }
}

#[cfg(test)]
mod tests {
    use rt_cpu::Hit;

    use super::*;

    #[test]
    fn the_curve_visits_every_pixel_in_square_blocks() {
        let along_the_curve = |i: usize| (usize::from(CURVE[0][i]), usize::from(CURVE[1][i]));
        let mut seen = [[false; TILE]; TILE];
        for i in 0..RAYS {
            let (x, y) = along_the_curve(i);
            assert!(!std::mem::replace(&mut seen[y][x], true));
            assert_eq!((x / 4 + y / 4 * 4 < 16, along_the_curve(i & !15).0 / 4), (true, x / 4));
        }
        let spans = |n: usize| {
            let last: Vec<_> = (0..n).map(along_the_curve).collect();
            (last.iter().map(|p| p.0).max(), last.iter().map(|p| p.1).max())
        };
        assert_eq!(spans(8), (Some(3), Some(1)));
        assert_eq!(spans(16), (Some(3), Some(3)));
        assert_eq!(spans(64), (Some(7), Some(7)));
    }

    #[test]
    fn answers_are_compared_pixel_by_pixel() {
        let hit = |t| Pixel::new(Some(Hit { t, u: 0.0, v: 0.0, primitive: 0 }), true);
        let miss = Pixel::default();
        let reference = [hit(1.0), hit(2.0), miss];
        let mut answers = Answers::default();
        answers.add(&[hit(1.0), hit(2.1), miss], &reference);
        assert_eq!((answers.rays, answers.hits, answers.lit, answers.different), (3, 2, 2, 1));
        assert!((answers.t_sum - 3.1).abs() < 1e-6);
        answers.add(&[miss, hit(2.0), hit(1.0)], &reference);
        assert_eq!((answers.different, answers.shadows_different), (3, 2));
        let many = Answers { rays: 100_000, hits: 50_000, ..Answers::default() };
        assert!(Answers { hits: 49_995, ..many }.agrees_with(&many));
        assert!(!Answers { hits: 49_993, ..many }.agrees_with(&many));
        assert!(!Answers { shadows_different: 102, ..many }.agrees_with(&many));
    }
}
