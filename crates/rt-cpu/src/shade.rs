//! Light and background.

use bvh_core::Vec3;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Mesh;
use crate::bundle::{Bundle, Hits, RAYS};
use crate::simd::{Lanes, bits, load, load3, max};
use crate::surface::{Coordinates, Surfaces, dot, normalize};

/// A point that shines alike in all directions and to any distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Where it is.
    pub position: Vec3,
    /// Linear colour and strength: a white surface that faces the light gets this colour.
    pub color: [f32; 3],
}

/// A vertical gradient behind everything, in linear colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Straight up.
    pub zenith: [f32; 3],
    /// Straight down.
    pub nadir: [f32; 3],
}

impl Default for Background {
    fn default() -> Self {
        Self { zenith: [0.32, 0.40, 0.52], nadir: [0.78, 0.77, 0.74] }
    }
}

/// Light from everywhere, on a surface that lies on its side.
const AMBIENT: f32 = 0.12;

/// How a tile's pixels get their colours.
pub(crate) struct Shader<'a> {
    pub(crate) mesh: &'a Mesh<'a>,
    pub(crate) light: Option<&'a PointLight>,
    pub(crate) smooth: bool,
    pub(crate) background: Background,
}

impl Shader<'_> {
    /// Colours by Lambert's law, and a little light from everywhere, more from above. Without a light, shading is as if
    /// there were one at the eye.
    #[inline(always)]
    pub(crate) fn shade<S: Simd>(
        &self,
        simd: S,
        seen: &Bundle,
        hits: &Hits,
        surfaces: &Surfaces,
        lit: &[f32; RAYS],
        colors: &mut Coordinates,
    ) {
        let smooth = self.is_smooth();
        for at in (0..seen.count).step_by(S::f32s::LEN) {
            let lanes = hits.lanes(at, S::f32s::LEN);
            let ray = load3::<S, S::f32s, RAYS>(simd, &seen.direction, at);
            let mut color = self.behind(simd, ray);
            if lanes != 0 {
                let front = self.front(simd, at, lanes, ray, hits, surfaces, lit, smooth);
                let mask = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, lanes);
                for k in 0..3 {
                    color[k] = mask.select(front[k], color[k]);
                }
            }
            for k in 0..3 {
                color[k].store_slice(&mut colors[k][at..at + S::f32s::LEN]);
            }
        }
    }

    /// Whether normals are interpolated.
    pub(crate) fn is_smooth(&self) -> bool {
        self.smooth && self.mesh.normals.is_some()
    }

    /// What is seen where nothing is hit.
    #[inline(always)]
    pub(crate) fn behind<S: Simd, V: Lanes<S>>(&self, simd: S, ray: [V; 3]) -> [V; 3] {
        let Background { zenith, nadir } = self.background;
        let (unit, valid) = normalize(simd, ray);
        let level = V::simd_from(simd, 0.0);
        let up = V::Mask::from_bitmask(simd, valid).select(unit[1], level) * 0.5 + 0.5;
        [
            up * (zenith[0] - nadir[0]) + nadir[0],
            up * (zenith[1] - nadir[1]) + nadir[1],
            up * (zenith[2] - nadir[2]) + nadir[2],
        ]
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
    fn front<S: Simd, V: Lanes<S>>(
        &self,
        simd: S,
        at: usize,
        lanes: u64,
        ray: [V; 3],
        hits: &Hits,
        surfaces: &Surfaces,
        lit: &[f32; RAYS],
        smooth: bool,
    ) -> [V; 3] {
        let mut albedo = [[0.0; 16]; 3];
        for i in bits(lanes) {
            let color = self.mesh.color(hits.primitive[at + i]);
            for k in 0..3 {
                albedo[k][i] = color[k];
            }
        }
        let normal = self.normal(simd, at, lanes, hits, surfaces, smooth);
        let albedo = load3::<S, V, 16>(simd, &albedo, 0);
        self.lambert(simd, at, ray, surfaces, lit, normal, albedo, ambient(normal))
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
        smooth: bool,
    ) -> [V; 3] {
        let face = load3::<S, V, RAYS>(simd, &surfaces.face, at);
        let mut normal = face;
        if smooth {
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

    /// What is seen of diffuse surfaces in the light and in `ambient` light.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
    pub(crate) fn lambert<S: Simd, V: Lanes<S>>(
        &self,
        simd: S,
        at: usize,
        ray: [V; 3],
        surfaces: &Surfaces,
        lit: &[f32; RAYS],
        normal: [V; 3],
        albedo: [V; 3],
        ambient: V,
    ) -> [V; 3] {
        let point = load3::<S, V, RAYS>(simd, &surfaces.point, at);
        let (to_light, light) = match self.light {
            Some(&PointLight { position: p, color }) => {
                ([-point[0] + p.x, -point[1] + p.y, -point[2] + p.z], color)
            }
            None => ([-ray[0], -ray[1], -ray[2]], [1.0; 3]),
        };
        let (unit, valid) = normalize(simd, to_light);
        let zero = V::simd_from(simd, 0.0);
        let facing = V::Mask::from_bitmask(simd, valid).select(dot(unit, normal), zero);
        let direct = max(facing, zero) * load::<S, V, RAYS>(simd, lit, at);
        [
            albedo[0] * (ambient + direct * light[0]),
            albedo[1] * (ambient + direct * light[1]),
            albedo[2] * (ambient + direct * light[2]),
        ]
    }
}

/// Light from everywhere on surfaces with these normals.
#[inline(always)]
pub(crate) fn ambient<S: Simd, V: Lanes<S>>(normal: [V; 3]) -> V {
    normal[1] * (0.5 * AMBIENT) + AMBIENT
}
