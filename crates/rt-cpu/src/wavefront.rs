//! Light beyond the first hit: mirrors, ambient occlusion and diffuse bounces, a tile's rays at a
//! time.
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

use bvh_core::{Ray, Vec3, pick};
use bytemuck::{Zeroable, zeroed_box};
use fearless_simd::Simd;

use crate::Hit;
use crate::bvh8::{self, Bvh8};
use crate::cast::{Frame, Tile, light_arrives};
use crate::options::{AmbientOcclusion, DiffuseBounces, Effects};
use crate::random::{Stream, cosine_direction};
use crate::scene::{Scene, Work};
use crate::shade::Shader;
use crate::simd::vectorize;
use crate::times::Tally;
use crate::wave::{Coordinates, RAYS, at, set};
use crate::wide::WideTest;

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
}

/// What is known of the rays of a wave besides their directions and hits, which are in the
/// [`Tile`].
#[derive(Zeroable)]
pub(crate) struct Paths {
    origin: Coordinates,
    /// The ray of the first wave that each goes back to.
    whose: [u16; RAYS],
    /// What arrives at the eye of what a ray sees.
    weight: Coordinates,
    /// Diffuse bounces so far.
    bounces: [u32; RAYS],
    /// Mirrors since the last diffuse bounce.
    mirrors: [u8; RAYS],
    /// What is seen through each pixel.
    sum: Coordinates,
    streams: [Stream; RAYS],
}

impl Paths {
    /// Begins with one ray for each pixel of a tile.
    fn start(&mut self, tile: &Tile, seed: u64) {
        let (x, y) = tile.corner;
        for i in 0..tile.seen.count {
            self.whose[i] = i as u16;
            self.streams[i] = Stream::new(seed, x + tile.columns[i] as u32, y + tile.rows[i] as u32);
        }
        self.weight.as_flattened_mut().fill(1.0);
        self.sum.as_flattened_mut().fill(0.0);
        self.bounces.fill(0);
        self.mirrors.fill(0);
    }
}

thread_local! {
    /// Made when a thread first needs them, and kept.
    static THESE_PATHS: Cell<Option<Box<Paths>>> = const { Cell::new(None) };
}

impl Wavefront<'_> {
    /// Finds the colours of a tile's pixels.
    #[inline(always)]
    pub(crate) fn follow<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        tally: &mut Tally,
    ) {
        let mut paths = THESE_PATHS.take().unwrap_or_else(zeroed_box);
        paths.start(tile, frame.options.seed);
        tile.appearance.open.fill(if self.effects.diffuse_bounces.is_some() { 0.0 } else { 1.0 });
        for bounce in 0.. {
            self.shader.find_appearance(tile, tally);
            if let Some(occlusion) = self.effects.ambient_occlusion {
                tally.end(|t| &mut t.primary);
                self.look_around::<S, T>(simd, frame, tile, &paths, (occlusion, bounce), tally);
                tally.end(|t| &mut t.ambient_occlusion);
            }
            self.see(simd, tile, &mut paths);
            self.reflect(frame, tile, &mut paths, bounce, tally);
            let rays = tile.seen.count;
            if rays == 0 {
                break;
            }
            tally.end(|t| &mut t.primary);
            for i in 0..rays {
                let ray = Ray::new(at(&paths.origin, i), at(&tile.seen.direction, i));
                let hit = self.hit::<S, T, false>(simd, frame, &ray, f32::INFINITY, &mut tally.work);
                tile.seen.set_hit(i, hit);
            }
            tally.end_reflected(paths.mirrors[..rays].iter().filter(|&&m| m > 0).count(), rays);
            tile.seen.end();
            tile.surfaces.find(simd, frame.scene.triangles, &tile.seen);
            light_arrives::<S, T>(simd, frame, tile, tally);
        }
        tile.colors = paths.sum;
        THESE_PATHS.set(Some(paths));
    }

    fn is_mirror(&self, primitive: u32) -> bool {
        self.effects.mirror && self.shader.mesh.material(primitive).mirror
    }

    // A call on purpose: a walk is large, and inlined it leaves no registers to what is around it.
    #[inline(never)]
    fn hit<S: Simd, T: WideTest, const ANY: bool>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        ray: &Ray,
        t_max: f32,
        work: &mut Work,
    ) -> Option<Hit> {
        let Scene { bvh, triangles, .. } = frame.scene;
        let counts = |hit: &Hit| frame.alpha_cutouts.is_none_or(|mesh| mesh.is_there(hit));
        vectorize!(simd, {
            match self.wide {
                Some(wide) => bvh8::hit::<S, T, ANY>(simd, wide, ray, t_max, work, counts),
                None => pick::hit::<S, T, ANY>(simd, bvh, triangles, ray, t_max, work, counts),
            }
        })
    }

    /// Finds out how much of the sky is open above what a wave hit.
    #[inline(always)]
    fn look_around<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        paths: &Paths,
        (AmbientOcclusion { samples, distance }, bounce): (AmbientOcclusion, u32),
        tally: &mut Tally,
    ) {
        let first = u64::from(frame.options.sample) * u64::from(samples);
        for i in 0..tile.seen.count {
            if tile.seen.hit(i).is_none_or(|hit| self.is_mirror(hit.primitive)) {
                continue;
            }
            let from = off_surface(tile, i);
            let (face, normal) = (at(&tile.surfaces.face, i), at(&tile.appearance.normal, i));
            let stream = paths.streams[usize::from(paths.whose[i])].split(bounce);
            let mut hidden = 0;
            for n in 0..samples {
                let direction = cosine_direction(normal, stream.even(first + u64::from(n)));
                let ray = Ray::new(from, onto_side(direction, face));
                let hit = self.hit::<S, T, true>(simd, frame, &ray, distance, &mut tally.work);
                hidden += u32::from(hit.is_some());
            }
            tally.stats.rays_ambient_occlusion += u64::from(samples);
            tile.appearance.open[i] = 1.0 - hidden as f32 / samples.max(1) as f32;
        }
    }

    /// Adds what the rays of a wave see to their pixels.
    #[inline(always)]
    fn see<S: Simd>(&self, simd: S, tile: &mut Tile, paths: &mut Paths) {
        self.shader.shade(simd, tile);
        for i in 0..tile.seen.count {
            let color = match (tile.seen.hit(i), self.effects.diffuse_bounces) {
                (Some(hit), _) if self.is_mirror(hit.primitive) => continue,
                // From the eye and from mirrors the background is seen instead.
                (None, Some(DiffuseBounces { sky, .. })) if paths.bounces[i] > 0 && paths.mirrors[i] == 0 => {
                    sky.into()
                }
                _ => at(&tile.colors, i),
            };
            let pixel = usize::from(paths.whose[i]);
            let seen = at(&paths.sum, pixel) + at(&paths.weight, i) * color;
            set(&mut paths.sum, pixel, seen);
        }
    }

    /// Replaces the rays of a wave by those of the next.
    fn reflect(&self, frame: &Frame<'_>, tile: &mut Tile, paths: &mut Paths, bounce: u32, tally: &mut Tally) {
        let (mut next, sample, stats) = (0, frame.options.sample, &mut tally.stats);
        for i in 0..tile.seen.count {
            let Some(hit) = tile.seen.hit(i) else { continue };
            let (face, normal) = (at(&tile.surfaces.face, i), at(&tile.appearance.normal, i));
            let mut weight = at(&paths.weight, i) * at(&tile.appearance.albedo, i);
            let (mut mirrors, mut bounces) = (paths.mirrors[i], paths.bounces[i]);
            let specular = self.is_mirror(hit.primitive);
            let direction = if specular {
                mirrors += 1;
                let along = at(&tile.seen.direction, i);
                along - normal * (2.0 * along.dot(normal))
            } else {
                let Some(DiffuseBounces { most, .. }) = self.effects.diffuse_bounces else { continue };
                (mirrors, bounces) = (0, bounces + 1);
                if bounces > most {
                    continue;
                }
                let stream = paths.streams[usize::from(paths.whose[i])];
                let random = stream.split(sample);
                let first_number = bounce.wrapping_mul(NUMBERS);
                if bounces > SURE_BOUNCES {
                    let survival = weight.max_element().min(GREATEST_SURVIVAL);
                    if random.uniform(first_number) >= survival {
                        continue;
                    }
                    weight /= survival;
                }
                let point = if bounces == 1 {
                    // Over the samples the first directions of a pixel are spread evenly.
                    stream.even(u64::from(sample))
                } else {
                    [1, 2].map(|n| random.uniform(first_number.wrapping_add(n)))
                };
                cosine_direction(normal, point)
            };
            if mirrors > MIRRORS || weight == Vec3::ZERO {
                continue;
            }
            let from = off_surface(tile, i);
            set(&mut tile.seen.direction, next, onto_side(direction, face));
            set(&mut paths.origin, next, from);
            set(&mut paths.weight, next, weight);
            paths.whose[next] = paths.whose[i];
            (paths.mirrors[next], paths.bounces[next]) = (mirrors, bounces);
            next += 1;
            *(if specular { &mut stats.rays_mirror } else { &mut stats.rays_bounce }) += 1;
        }
        tile.seen.count = next;
    }
}

/// The point that a ray hit, moved off the surface by 32 roundings of the greatest coordinate of
/// the triangle, which is what goes into both the point and the next test.
fn off_surface(tile: &Tile, i: usize) -> Vec3 {
    let off = tile.surfaces.max_coordinate[i] * (1.0 / (1 << 19) as f32);
    at(&tile.surfaces.point, i) + at(&tile.surfaces.face, i) * off
}

/// Directions that interpolated normals send below the surface come out of it at the same angle.
fn onto_side(direction: Vec3, face: Vec3) -> Vec3 {
    let below = direction.dot(face).min(0.0);
    direction - face * (2.0 * below)
}
