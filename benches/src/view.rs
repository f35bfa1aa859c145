//! Casting the rays of a picture, and comparing what contestants say of them.

use bvh_core::{Triangles, Vec3};
use rayon::prelude::*;
use rt_cpu::{Camera, Hit, Pixel};

use crate::{Contestant, Hits, RAYS, Rays};

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
    in_bands(&Tracing(contestant), view, pixels);
}

/// Does all that [`Contestant::cast`] does but for tracing: what rays find is `known`. The time that this takes is in
/// those of all contestants that leave rays to their users.
///
/// # Panics
/// If either number of pixels is not that of the view's camera.
pub fn set_up_rays(triangles: &Triangles<'_>, view: &View, known: &[Pixel], pixels: &mut [Pixel]) {
    assert_eq!(known.len(), pixels.len(), "as many pixels");
    in_bands(&Known { triangles: *triangles, pixels: known }, view, pixels);
}

/// Tells what rays find. They belong to the pixels at `places` of the band that starts with pixel `band`.
trait Teller: Sync {
    fn closest(&self, rays: &Rays, band: usize, places: &[u32], hits: &mut Hits);
    fn occluded(&self, rays: &Rays, band: usize, places: &[u32], blocked: &mut [bool; RAYS]);
    fn triangles(&self) -> Triangles<'_>;
}

/// By tracing them.
struct Tracing<'a, C: ?Sized>(&'a C);

impl<C: Contestant + ?Sized> Teller for Tracing<'_, C> {
    fn closest(&self, rays: &Rays, _band: usize, _places: &[u32], hits: &mut Hits) {
        self.0.closest(rays, hits);
    }

    fn occluded(&self, rays: &Rays, _band: usize, _places: &[u32], blocked: &mut [bool; RAYS]) {
        self.0.occluded(rays, blocked);
    }

    fn triangles(&self) -> Triangles<'_> {
        self.0.triangles()
    }
}

/// By heart.
struct Known<'a> {
    triangles: Triangles<'a>,
    pixels: &'a [Pixel],
}

impl Teller for Known<'_> {
    fn closest(&self, rays: &Rays, band: usize, places: &[u32], hits: &mut Hits) {
        // Rays that nobody looks at might not be made.
        std::hint::black_box(rays);
        for (i, &place) in places.iter().enumerate() {
            hits.set(i, self.pixels[band + place as usize].hit);
        }
    }

    fn occluded(&self, rays: &Rays, band: usize, places: &[u32], blocked: &mut [bool; RAYS]) {
        std::hint::black_box(rays);
        for (blocked, &place) in blocked.iter_mut().zip(places) {
            *blocked = !self.pixels[band + place as usize].lit;
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.triangles
    }
}

fn in_bands(teller: &impl Teller, view: &View, pixels: &mut [Pixel]) {
    let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
    assert_eq!(pixels.len(), width * height, "pixels of the camera");
    pixels.par_chunks_mut((width * TILE).max(1)).enumerate().for_each(|(row, band)| {
        let mut tile = Tile::new();
        for x in (0..width).step_by(TILE) {
            tile.cast(teller, view, band, x, row * TILE);
        }
    });
}

/// What a tile needs, kept from tile to tile.
struct Tile {
    rays: Rays,
    hits: Hits,
    blocked: [bool; RAYS],
    /// Place in the band of each primary ray's pixel, and of each shadow ray's.
    seen: [u32; RAYS],
    lit: [u32; RAYS],
}

impl Tile {
    fn new() -> Self {
        Self { rays: Rays::new(), hits: Hits::new(), blocked: [false; RAYS], seen: [0; RAYS], lit: [0; RAYS] }
    }

    /// The tile with its upper left corner at pixel `x`, `y`; the band starts in row `y`.
    fn cast(&mut self, teller: &impl Teller, view: &View, band: &mut [Pixel], x: usize, y: usize) {
        let width = view.camera.width() as usize;
        self.rays.clear();
        for i in 0..RAYS {
            let (dx, dy) = along_the_curve(i);
            let place = dy * width + x + dx;
            if x + dx < width && place < band.len() {
                self.seen[self.rays.len()] = place as u32;
                let direction = view.camera.direction((x + dx) as u32, (y + dy) as u32);
                self.rays.push(view.camera.eye(), direction, f32::INFINITY);
            }
        }
        let band_start = y * width;
        teller.closest(&self.rays, band_start, &self.seen[..self.rays.len()], &mut self.hits);
        for (i, &place) in self.seen[..self.rays.len()].iter().enumerate() {
            let hit = self.hits.get(i);
            band[place as usize] = Pixel { hit, lit: hit.is_some() && view.light.is_none() };
        }
        let Some(light) = view.light else { return };
        let primary = self.rays.len();
        let triangles = teller.triangles();
        let mut count = 0;
        for i in 0..primary {
            let way =
                self.hits.get(i).and_then(|hit| shadow_ray(&triangles, &hit, self.rays.direction(i), light));
            if let Some(way) = way {
                // In place of a primary ray that has been looked at already.
                self.lit[count] = self.seen[i];
                for axis in 0..3 {
                    self.rays.origin[axis][count] = light[axis];
                    self.rays.direction[axis][count] = way[axis];
                }
                self.rays.t_max[count] = 1.0;
                count += 1;
            }
        }
        self.rays.truncate(count);
        teller.occluded(&self.rays, band_start, &self.lit[..count], &mut self.blocked);
        for (&place, blocked) in self.lit[..count].iter().zip(self.blocked) {
            band[place as usize].lit = !blocked;
        }
    }
}

/// Pixel `i` of a tile in Morton order, so that 8 in a row are 4 x 2 pixels, 16 are 4 x 4 and 64 are 8 x 8.
fn along_the_curve(i: usize) -> (usize, usize) {
    let every_other = |i: usize| (i & 1) | (i >> 1 & 2) | (i >> 2 & 4) | (i >> 3 & 8);
    (every_other(i), every_other(i >> 1))
}

/// Direction from the light to just before a hit, which it reaches at `t` = 1; `None` if the surface faces away.
/// Off the surface by 32 roundings, as [`rt_cpu`] does it, so that all contestants cast the same rays.
fn shadow_ray(triangles: &Triangles<'_>, hit: &Hit, seen: Vec3, light: Vec3) -> Option<Vec3> {
    let [a, b, c] = triangles.corners(hit.primitive as usize);
    let (ab, ac) = (b - a, c - a);
    let face = ab.cross(ac).normalize_or_zero();
    let face = if face.dot(seen) > 0.0 { -face } else { face };
    let point = a + ab * hit.u + ac * hit.v;
    let to_light = light - point;
    let size = point.abs().max(to_light.abs()).max_element();
    (face.dot(to_light) > 0.0).then_some(point + face * (size / (1 << 19) as f32) - light)
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
    /// Pixels that say something else than the reference: hit or miss, or a `t` that differs by more than
    /// 0.1 %.
    pub different: u64,
    /// Pixels that are lit in one and in shadow in the other.
    pub shadows_different: u64,
}

impl Answers {
    /// Adds what was found in a view, compared pixel by pixel to a reference of the same view.
    pub fn add(&mut self, pixels: &[Pixel], reference: &[Pixel]) {
        for (pixel, expected) in pixels.iter().zip(reference) {
            self.rays += 1;
            self.lit += u64::from(pixel.lit);
            if let Some(hit) = pixel.hit {
                self.hits += 1;
                self.t_sum += f64::from(hit.t);
            }
            let same = match (pixel.hit, expected.hit) {
                (Some(a), Some(b)) => (a.t - b.t).abs() <= 1e-3 * b.t.abs(),
                (a, b) => a.is_some() == b.is_some(),
            };
            self.different += u64::from(!same);
            self.shadows_different += u64::from(pixel.lit != expected.lit);
        }
    }

    /// Whether the numbers of hits differ by no more than 0.01 % and those of lit pixels by no more than 0.1 % (and
    /// one, for small views), and the answers of no more than 0.1 % of all pixels: triangle tests that round in other ways may disagree at
    /// silhouettes, and along the edges of shadows.
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
    use super::*;

    #[test]
    fn the_curve_visits_every_pixel_in_square_blocks() {
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
        let hit = |t| Pixel { hit: Some(Hit { t, u: 0.0, v: 0.0, primitive: 0 }), lit: true };
        let miss = Pixel { hit: None, lit: false };
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
