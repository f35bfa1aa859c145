//! Light and background.

use bvh_core::Vec3;
use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Mesh;
use crate::bundle::{Coordinates, Hits, RAYS};
use crate::cast::Tile;
use crate::simd::{Lanes, bits, dot, load, load3, max, normalize, store3};
use crate::surface::Surfaces;

/// A point that shines alike in all directions and to any distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Where it is.
    pub position: Vec3,
    /// Linear colour and strength: a white surface that faces the light gets this colour.
    pub color: [f32; 3],
}

/// Linear colours of the vertical gradient behind everything: straight up, and straight down.
pub(crate) const ZENITH: [f32; 3] = [0.32, 0.40, 0.52];
pub(crate) const NADIR: [f32; 3] = [0.78, 0.77, 0.74];

/// Light from everywhere, on a surface that lies on its side.
const AMBIENT: f32 = 0.12;

/// How a tile's pixels get their colours.
pub(crate) struct Shader<'a> {
    pub(crate) mesh: &'a Mesh<'a>,
    pub(crate) light: Option<&'a PointLight>,
    pub(crate) smooth: bool,
}

/// What shading needs to know of surfaces in lanes, beside where they are.
struct Lit<V> {
    normal: [V; 3],
    albedo: [V; 3],
    /// Light from everywhere.
    ambient: V,
}

/// What is known of a tile's surfaces before they are shaded.
#[derive(Zeroable)]
pub(crate) struct Looks {
    pub(crate) albedo: Coordinates,
    /// Unit normals on the viewer's side.
    pub(crate) normal: Coordinates,
    /// Part of the constant light from everywhere that arrives.
    pub(crate) open: [f32; RAYS],
}

impl Looks {
    #[inline(always)]
    fn surface<S: Simd>(&self, simd: S, at: usize) -> Lit<S::f32s> {
        let normal = load3(simd, &self.normal, at);
        let open = load::<S, S::f32s, RAYS>(simd, &self.open, at);
        Lit { normal, albedo: load3(simd, &self.albedo, at), ambient: ambient(normal) * open }
    }
}

impl Shader<'_> {
    /// Colours by Lambert's law, and a little light from everywhere, more from above. Without a
    /// light, shading is as if there were one at the eye. `looks` has the surfaces, if they are
    /// known already.
    #[inline(always)]
    pub(crate) fn shade<S: Simd>(&self, simd: S, tile: &mut Tile, looks: Option<&Looks>) {
        let Tile { seen, surfaces, lit, colors, .. } = tile;
        for at in (0..seen.rays.count).step_by(S::f32s::LEN) {
            let lanes = seen.hits.lanes(simd, at);
            let ray = load3::<S, S::f32s, RAYS>(simd, &seen.rays.direction, at);
            let mut color = Self::behind(simd, ray);
            if lanes != 0 {
                let surface = match looks {
                    Some(looks) => looks.surface(simd, at),
                    None => self.surface(simd, at, lanes, &seen.hits, surfaces),
                };
                let point = load3(simd, &surfaces.point, at);
                let front = self.lambert(simd, ray, point, load(simd, lit, at), &surface);
                let mask = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, lanes);
                for k in 0..3 {
                    color[k] = mask.select(front[k], color[k]);
                }
            }
            store3(color, colors, at);
        }
    }

    /// What is seen where nothing is hit.
    #[inline(always)]
    fn behind<S: Simd, V: Lanes<S>>(simd: S, ray: [V; 3]) -> [V; 3] {
        let (unit, valid) = normalize(simd, ray);
        let level = V::simd_from(simd, 0.0);
        let up = V::Mask::from_bitmask(simd, valid).select(unit[1], level) * 0.5 + 0.5;
        [
            up * (ZENITH[0] - NADIR[0]) + NADIR[0],
            up * (ZENITH[1] - NADIR[1]) + NADIR[1],
            up * (ZENITH[2] - NADIR[2]) + NADIR[2],
        ]
    }

    /// The surfaces that lanes hit, without textures.
    #[inline(always)]
    fn surface<S: Simd>(
        &self,
        simd: S,
        at: usize,
        lanes: u64,
        hits: &Hits,
        surfaces: &Surfaces,
    ) -> Lit<S::f32s> {
        let mut albedo = [[0.0; 16]; 3];
        for i in bits(lanes) {
            let color = self.mesh.material(hits.primitive[at + i]).color;
            for k in 0..3 {
                albedo[k][i] = color[k];
            }
        }
        let normal = self.normal(simd, at, lanes, hits, surfaces);
        Lit { normal, albedo: load3(simd, &albedo, 0), ambient: ambient(normal) }
    }

    /// Unit normals on the viewer's side.
    #[inline(always)]
    pub(crate) fn normal<S: Simd, V: Lanes<S>>(
        &self,
        simd: S,
        at: usize,
        lanes: u64,
        hits: &Hits,
        surfaces: &Surfaces,
    ) -> [V; 3] {
        let face = load3::<S, V, RAYS>(simd, &surfaces.face, at);
        let mut normal = face;
        if self.smooth {
            let mut smoothed = [[0.0; 16]; 3];
            for i in bits(lanes) {
                let n = hits.get(at + i).and_then(|hit| self.mesh.normal(&hit));
                for k in 0..3 {
                    smoothed[k][i] = n.map_or(surfaces.face[k][at + i], |n| n[k]);
                }
            }
            normal = load3::<S, V, 16>(simd, &smoothed, 0);
            let away = dot(normal, face).simd_lt(0.0);
            for n in &mut normal {
                *n = away.select(-*n, *n);
            }
        }
        normal
    }

    /// What is seen of diffuse surfaces in the light.
    #[inline(always)]
    fn lambert<S: Simd, V: Lanes<S>>(
        &self,
        simd: S,
        ray: [V; 3],
        point: [V; 3],
        lit: V,
        &Lit { normal, albedo, ambient }: &Lit<V>,
    ) -> [V; 3] {
        let (to_light, light) = match self.light {
            Some(&PointLight { position: p, color }) => {
                ([-point[0] + p.x, -point[1] + p.y, -point[2] + p.z], color)
            }
            None => ([-ray[0], -ray[1], -ray[2]], [1.0; 3]),
        };
        let (unit, valid) = normalize(simd, to_light);
        let zero = V::simd_from(simd, 0.0);
        let facing = V::Mask::from_bitmask(simd, valid).select(dot(unit, normal), zero);
        let direct = max(facing, zero) * lit;
        [
            albedo[0] * (ambient + direct * light[0]),
            albedo[1] * (ambient + direct * light[1]),
            albedo[2] * (ambient + direct * light[2]),
        ]
    }
}

/// Light from everywhere on surfaces with these normals.
#[inline(always)]
fn ambient<S: Simd, V: Lanes<S>>(normal: [V; 3]) -> V {
    normal[1] * (0.5 * AMBIENT) + AMBIENT
}
