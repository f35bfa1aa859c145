//! Light beyond the first hit: mirrors, ambient occlusion and diffuse bounces, a tile's rays at a time.
//!
//! ```text
//! the first wave: a tile's rays from the eye, traced, with their shadow rays
//! for each wave:
//!   albedos (textures), normals, ambient occlusion
//!   each ray's weight times what it sees goes to its pixel
//!   each hit that reflects adds a ray to the next wave: specular or diffuse, with a new weight
//!   trace these one by one, then their shadow rays together, as rays from the light
//! ```
//!
//! A wave of fewer rays overwrites the one before: a ray's successor never lies behind it.

use std::cell::Cell;

use bvh_core::{Ray, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Hit;
use crate::bundle::{Bundle, Hits, RAYS};
use crate::bvh8::{self, Bvh8};
use crate::cast::{Frame, Tile, light_arrives};
use crate::options::{AmbientOcclusion, DiffuseBounces, Effects, RenderStats};
use crate::packet::SIZE;
use crate::random::{Stream, cosine_direction};
use crate::scene::Work;
use crate::shade::{Shader, ambient};
use crate::simd::{load, load3};
use crate::sink::{PixelSink, Rows};
use crate::surface::Coordinates;
use crate::wide::WideTest;
use bvh_core::pick;

/// Mirrors in a row that are followed.
const MIRRORS: u8 = 4;

/// Bounces after which paths go on at random, and the greatest probability with which they do.
const SURE_BOUNCES: u32 = 3;
const GREATEST_SURVIVAL: f32 = 0.95;

/// Random numbers set aside for each wave.
const NUMBERS: u32 = 8;

/// Shading with the effects that [`Shader`] does not know.
pub(crate) struct Wavefront<'a> {
    pub(crate) shader: Shader<'a>,
    pub(crate) effects: Effects,
    /// A view of the tree, if enough rays are expected to pay for making it.
    pub(crate) wide: Option<&'a Bvh8>,
    pub(crate) seed: u64,
    pub(crate) sample: u32,
}

/// What is known of the rays of a wave besides their directions and hits, which are in the [`Tile`].
struct Paths {
    origin: Coordinates,
    /// The ray of the first wave that each goes back to.
    whose: [u16; RAYS],
    /// What arrives at the eye of what a ray sees.
    weight: Coordinates,
    /// Diffuse bounces so far.
    bounces: [u32; RAYS],
    /// Mirrors so far, and whether the last surface was one, or the ray comes from the eye.
    mirrors: [u8; RAYS],
    specular: [bool; RAYS],
    albedo: Coordinates,
    normal: Coordinates,
    /// Part of the sky that is not hidden.
    open: [f32; RAYS],
    /// What is seen through each pixel.
    sum: Coordinates,
    streams: [Stream; RAYS],
}

impl Paths {
    fn new() -> Self {
        let zero = [[0.0; RAYS]; 3];
        Self {
            origin: zero,
            whose: [0; RAYS],
            weight: zero,
            bounces: [0; RAYS],
            mirrors: [0; RAYS],
            specular: [true; RAYS],
            albedo: zero,
            normal: zero,
            open: [1.0; RAYS],
            sum: zero,
            streams: [Stream::new(0, 0, 0); RAYS],
        }
    }

    /// Begins with one ray for each pixel of a tile, whose upper left corner is at `x`, `y`.
    fn start(&mut self, tile: &Tile, seed: u64, (x, y): (u32, u32)) {
        for i in 0..tile.seen.count {
            let [column, row] = tile.at[i].map(u32::from);
            self.whose[i] = i as u16;
            self.streams[i] = Stream::new(seed, x + column, y + row);
        }
        for k in 0..3 {
            self.weight[k].fill(1.0);
            self.sum[k].fill(0.0);
        }
        self.bounces.fill(0);
        self.mirrors.fill(0);
        self.specular.fill(true);
    }

    fn ray(&self, i: usize, directions: &Bundle) -> Ray {
        Ray::new(at(&self.origin, i), at(&directions.direction, i))
    }
}

thread_local! {
    /// Made when a thread first needs them, and kept.
    static THESE_PATHS: Cell<Option<Box<Paths>>> = const { Cell::new(None) };
}

fn at(a: &Coordinates, i: usize) -> Vec3 {
    Vec3::new(a[0][i], a[1][i], a[2][i])
}

fn set(a: &mut Coordinates, i: usize, v: Vec3) {
    for k in 0..3 {
        a[k][i] = v[k];
    }
}

impl PixelSink for Wavefront<'_> {
    type Pixel = [f32; 3];

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        corner: (u32, u32),
        rows: &mut Rows<'_, [f32; 3]>,
        stats: &mut RenderStats,
    ) {
        let count = tile.seen.count;
        let mut work = Work::default();
        let mut paths = THESE_PATHS.take().unwrap_or_else(|| Box::new(Paths::new()));
        paths.start(tile, self.seed, corner);
        let mut wave = 0;
        loop {
            self.surfaces(simd, tile, &mut paths, stats);
            if let Some(occlusion) = self.effects.ambient_occlusion {
                tile.timer.end(|t| &mut t.primary);
                self.look_around::<S, T>(simd, frame, tile, &mut paths, occlusion, wave, &mut work, stats);
                tile.timer.end(|t| &mut t.ambient_occlusion);
            }
            self.see(simd, tile, &mut paths);
            self.reflect(tile, &mut paths, wave, stats);
            if tile.seen.count == 0 {
                break;
            }
            wave += 1;
            let rays = tile.seen.count;
            tile.timer.end(|t| &mut t.primary);
            for i in 0..rays {
                let ray = paths.ray(i, &tile.seen);
                let hit = self.closest::<S, T>(simd, frame, &ray, &mut work);
                tile.hits.set(i, hit);
            }
            tile.timer.end_reflected(paths.specular[..rays].iter().filter(|&&s| s).count(), rays);
            // Vectors may reach beyond the last ray.
            tile.hits.primitive[rays..rays.next_multiple_of(SIZE)].fill(Hits::NONE);
            tile.surfaces.find(simd, frame.scene.triangles, &tile.seen, &tile.hits);
            light_arrives::<S, T>(simd, frame, tile, stats);
        }
        for (i, &[x, y]) in tile.at[..count].iter().enumerate() {
            rows[y as usize][x as usize] = [paths.sum[0][i], paths.sum[1][i], paths.sum[2][i]];
        }
        THESE_PATHS.set(Some(paths));
        stats.count(&work);
    }
}

impl Wavefront<'_> {
    fn is_mirror(&self, primitive: u32) -> bool {
        self.effects.mirror && self.shader.mesh.material(primitive).mirror
    }

    // Both are calls on purpose: a walk is large, and inlined it leaves no registers to what is around it.
    #[inline(never)]
    fn closest<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        ray: &Ray,
        work: &mut Work,
    ) -> Option<Hit> {
        simd.vectorize(
            #[inline(always)]
            || match self.wide {
                Some(wide) => bvh8::closest::<S, T>(
                    simd,
                    wide,
                    ray,
                    f32::INFINITY,
                    work,
                    #[inline(always)]
                    |hit| frame.is_there(hit),
                ),
                None => pick::closest::<S, T>(
                    simd,
                    frame.scene.bvh,
                    frame.scene.triangles,
                    ray,
                    f32::INFINITY,
                    work,
                    #[inline(always)]
                    |hit| frame.is_there(hit),
                ),
            },
        )
    }

    #[inline(never)]
    fn any<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        ray: &Ray,
        t_max: f32,
        work: &mut Work,
    ) -> Option<Hit> {
        simd.vectorize(
            #[inline(always)]
            || match self.wide {
                Some(wide) => bvh8::any::<S, T>(
                    simd,
                    wide,
                    ray,
                    t_max,
                    work,
                    #[inline(always)]
                    |hit| frame.is_there(hit),
                ),
                None => pick::any::<S, T>(
                    simd,
                    frame.scene.bvh,
                    frame.scene.triangles,
                    ray,
                    t_max,
                    work,
                    #[inline(always)]
                    |hit| frame.is_there(hit),
                ),
            },
        )
    }

    /// Colours and normals of what a wave hit.
    #[inline(always)]
    fn surfaces<S: Simd>(&self, simd: S, tile: &mut Tile, paths: &mut Paths, stats: &mut RenderStats) {
        let (mesh, textures) = (self.shader.mesh, self.effects.textures);
        let smooth = self.shader.is_smooth();
        for first in (0..tile.seen.count).step_by(S::f32s::LEN) {
            let lanes = tile.hits.lanes(first, S::f32s::LEN);
            if lanes == 0 {
                continue;
            }
            let normal: [S::f32s; 3] =
                self.shader.normal(simd, first, lanes, &tile.hits, &tile.surfaces, smooth);
            for (k, normal) in normal.iter().enumerate() {
                normal.store_slice(&mut paths.normal[k][first..first + S::f32s::LEN]);
            }
        }
        tile.timer.end(|t| &mut t.primary);
        for i in 0..tile.seen.count {
            let Some(hit) = tile.hits.get(i) else { continue };
            let color = if textures { mesh.textured_color(&hit) } else { mesh.color(hit.primitive) };
            set(&mut paths.albedo, i, color.into());
            stats.textured += u64::from(textures && mesh.material(hit.primitive).texture.is_some());
        }
        tile.timer.end(|t| if textures { &mut t.textures } else { &mut t.primary });
    }

    /// Finds out how much of the sky is open above what a wave hit.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
    fn look_around<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &Tile,
        paths: &mut Paths,
        occlusion: AmbientOcclusion,
        wave: u32,
        work: &mut Work,
        stats: &mut RenderStats,
    ) {
        let AmbientOcclusion { samples, distance } = occlusion;
        let first = u64::from(self.sample) * u64::from(samples);
        for i in 0..tile.seen.count {
            let Some(hit) = tile.hits.get(i).filter(|h| !self.is_mirror(h.primitive)) else { continue };
            let from = self.off_surface(tile, i, hit.primitive);
            let (face, normal) = (at(&tile.surfaces.face, i), at(&paths.normal, i));
            let stream = paths.streams[usize::from(paths.whose[i])].split(wave);
            let mut hidden = 0;
            for n in 0..samples {
                let direction = cosine_direction(normal, stream.even(first + u64::from(n)));
                let ray = Ray::new(from, onto_side(direction, face));
                let hit = self.any::<S, T>(simd, frame, &ray, distance, work);
                hidden += u32::from(hit.is_some());
            }
            stats.rays_ambient_occlusion += u64::from(samples);
            paths.open[i] = 1.0 - hidden as f32 / samples.max(1) as f32;
        }
    }

    /// Adds what the rays of a wave see to their pixels.
    #[inline(always)]
    fn see<S: Simd>(&self, simd: S, tile: &mut Tile, paths: &mut Paths) {
        let n = S::f32s::LEN;
        for first in (0..tile.seen.count).step_by(n) {
            let lanes = tile.hits.lanes(first, n);
            let ray: [S::f32s; 3] = load3(simd, &tile.seen.direction, first);
            let mut color = self.shader.behind(simd, ray);
            if lanes != 0 {
                let normal = load3(simd, &paths.normal, first);
                let albedo = load3(simd, &paths.albedo, first);
                let around = if self.effects.diffuse_bounces.is_some() {
                    S::f32s::simd_from(simd, 0.0)
                } else if self.effects.ambient_occlusion.is_some() {
                    ambient(normal) * load::<S, S::f32s, RAYS>(simd, &paths.open, first)
                } else {
                    ambient(normal)
                };
                let (surfaces, lit) = (&tile.surfaces, &tile.lit);
                let front = self.shader.lambert(simd, first, ray, surfaces, lit, normal, albedo, around);
                let mask = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, lanes);
                for k in 0..3 {
                    color[k] = mask.select(front[k], color[k]);
                }
            }
            for (k, color) in color.iter().enumerate() {
                color.store_slice(&mut tile.colors[k][first..first + n]);
            }
        }
        for i in 0..tile.seen.count {
            let color = match (tile.hits.get(i), self.effects.diffuse_bounces) {
                (Some(hit), _) if self.is_mirror(hit.primitive) => continue,
                (None, Some(DiffuseBounces { sky, .. })) if !paths.specular[i] => sky,
                _ => [0, 1, 2].map(|k| tile.colors[k][i]),
            };
            let pixel = usize::from(paths.whose[i]);
            for (k, color) in color.iter().enumerate() {
                paths.sum[k][pixel] += paths.weight[k][i] * color;
            }
        }
    }

    /// Replaces the rays of a wave by those of the next.
    fn reflect(&self, tile: &mut Tile, paths: &mut Paths, wave: u32, stats: &mut RenderStats) {
        let mut next = 0;
        for i in 0..tile.seen.count {
            let Some(hit) = tile.hits.get(i) else { continue };
            let (face, normal) = (at(&tile.surfaces.face, i), at(&paths.normal, i));
            let mut weight = at(&paths.weight, i) * at(&paths.albedo, i);
            let (mut mirrors, mut bounces) = (paths.mirrors[i], paths.bounces[i]);
            let specular = self.is_mirror(hit.primitive);
            let direction = if specular {
                mirrors += 1;
                let along = at(&tile.seen.direction, i);
                along - normal * (2.0 * along.dot(normal))
            } else {
                let Some(DiffuseBounces { most, .. }) = self.effects.diffuse_bounces else { continue };
                bounces += 1;
                if bounces > most {
                    continue;
                }
                let stream = paths.streams[usize::from(paths.whose[i])];
                let random = stream.split(self.sample);
                let first_number = wave.wrapping_mul(NUMBERS);
                if bounces > SURE_BOUNCES {
                    let survival = weight.max_element().min(GREATEST_SURVIVAL);
                    if random.uniform(first_number) >= survival {
                        continue;
                    }
                    weight /= survival;
                }
                let point = if bounces == 1 {
                    // Over the samples the first directions of a pixel are spread evenly.
                    stream.even(u64::from(self.sample))
                } else {
                    [1, 2].map(|n| random.uniform(first_number.wrapping_add(n)))
                };
                cosine_direction(normal, point)
            };
            if mirrors > MIRRORS || weight == Vec3::ZERO {
                continue;
            }
            let from = self.off_surface(tile, i, hit.primitive);
            set(&mut tile.seen.direction, next, onto_side(direction, face));
            set(&mut paths.origin, next, from);
            set(&mut paths.weight, next, weight);
            paths.whose[next] = paths.whose[i];
            (paths.mirrors[next], paths.bounces[next]) = (mirrors, bounces);
            paths.specular[next] = specular;
            next += 1;
            *(if specular { &mut stats.rays_mirror } else { &mut stats.rays_bounce }) += 1;
        }
        tile.seen.count = next;
    }

    /// The point that a ray hit, moved off the surface by 32 roundings of the greatest coordinate of the triangle, which
    /// is what goes into both the point and the next test; as [`Surfaces`](crate::surface::Surfaces) does for shadow rays.
    fn off_surface(&self, tile: &Tile, i: usize, primitive: u32) -> Vec3 {
        let [a, b, c] = self.shader.mesh.triangles.corners(primitive as usize).map(Vec3::abs);
        let off = a.max(b).max(c).max_element() * (1.0 / (1 << 19) as f32);
        at(&tile.surfaces.point, i) + at(&tile.surfaces.face, i) * off
    }
}

/// Directions that interpolated normals send below the surface come out of it at the same angle.
fn onto_side(direction: Vec3, face: Vec3) -> Vec3 {
    let below = direction.dot(face).min(0.0);
    direction - face * (2.0 * below)
}
