//! Light and background.

use bvh_core::Vec3;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Mesh;
use crate::cast::Tile;
use crate::simd::{dot, load, load3, max, normalize, store3};
use crate::times::Tally;
use crate::wave::{RAYS, at, set};

/// A point that shines alike in all directions and to any distance from 1e-19 to 1e19; surfaces
/// nearer or farther get no light. Shadow rays come from the light and end above the surface, by
/// 2^-19 of the distance (of its coordinates, if these are larger): what is nearer to the surface
/// throws no shadow on it.
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
    pub(crate) textures: bool,
}

impl Shader<'_> {
    /// Finds normals and colours of what a tile's rays hit.
    #[inline(always)]
    pub(crate) fn find_appearance(&self, tile: &mut Tile, tally: &mut Tally) {
        let Tile { seen, surfaces, appearance, .. } = tile;
        let count = seen.count;
        for (normal, face) in appearance.normal.iter_mut().zip(&surfaces.face) {
            normal[..count].copy_from_slice(&face[..count]);
        }
        let hits = (0..count).filter_map(|i| Some((i, seen.hit(i)?)));
        if self.smooth {
            for (i, hit) in hits.clone() {
                if let Some(normal) = self.mesh.normal(&hit) {
                    let away = normal.dot(at(&surfaces.face, i)) < 0.0;
                    set(&mut appearance.normal, i, if away { -normal } else { normal });
                }
            }
        }
        tally.end(|t| &mut t.primary);
        for (i, hit) in hits {
            let material = self.mesh.material(hit.primitive);
            let color = if self.textures { self.mesh.textured_color(&hit) } else { material.color };
            set(&mut appearance.albedo, i, color.into());
            tally.stats.textured += u64::from(self.textures && material.texture.is_some());
        }
        tally.end(|t| if self.textures { &mut t.textures } else { &mut t.primary });
    }

    /// Colours by Lambert's law, and a little light from everywhere, more from above. Without a
    /// light, shading is as if there were one at the eye.
    #[inline(always)]
    pub(crate) fn shade<S: Simd>(&self, simd: S, tile: &mut Tile) {
        let Tile { seen, surfaces, appearance, lit, colors, .. } = tile;
        let zero = S::f32s::simd_from(simd, 0.0);
        for at in (0..seen.count).step_by(S::f32s::LEN) {
            let ray = load3::<S, S::f32s, RAYS>(simd, &seen.direction, at);
            let mut color = behind(simd, ray);
            let lanes = seen.hit_lanes(simd, at);
            if lanes != 0 {
                let point: [S::f32s; 3] = load3(simd, &surfaces.point, at);
                let (to_light, light) = match self.light {
                    Some(&PointLight { position: p, color }) => {
                        ([-point[0] + p.x, -point[1] + p.y, -point[2] + p.z], color)
                    }
                    None => ([-ray[0], -ray[1], -ray[2]], [1.0; 3]),
                };
                let (unit, valid) = normalize(simd, to_light);
                let normal = load3(simd, &appearance.normal, at);
                let facing = Mask::<S>::from_bitmask(simd, valid).select(dot(unit, normal), zero);
                let direct = max(facing, zero) * load::<S, S::f32s, RAYS>(simd, lit, at);
                let open: S::f32s = load(simd, &appearance.open, at);
                let ambient = (normal[1] * (0.5 * AMBIENT) + AMBIENT) * open;
                let albedo: [S::f32s; 3] = load3(simd, &appearance.albedo, at);
                let hit = Mask::<S>::from_bitmask(simd, lanes);
                for k in 0..3 {
                    color[k] = hit.select(albedo[k] * (ambient + direct * light[k]), color[k]);
                }
            }
            store3(color, colors, at);
        }
    }
}

type Mask<S> = <<S as Simd>::f32s as SimdBase<S>>::Mask;

/// What is seen where nothing is hit.
#[inline(always)]
fn behind<S: Simd>(simd: S, ray: [S::f32s; 3]) -> [S::f32s; 3] {
    let (unit, valid) = normalize(simd, ray);
    let level = S::f32s::simd_from(simd, 0.0);
    let up = Mask::<S>::from_bitmask(simd, valid).select(unit[1], level) * 0.5 + 0.5;
    [
        up * (ZENITH[0] - NADIR[0]) + NADIR[0],
        up * (ZENITH[1] - NADIR[1]) + NADIR[1],
        up * (ZENITH[2] - NADIR[2]) + NADIR[2],
    ]
}
