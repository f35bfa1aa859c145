//! What is rendered: triangles with materials, normals and textures.

use bvh_core::glam::Vec2;
use bvh_core::{Triangles, Vec3};

use crate::{Hit, Texture};

/// How a surface looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Linear colour (red, green, blue), each 0 to 1; times that of the texture, if there is one.
    pub color: [f32; 3],
    /// Opacity, 0 to 1; times that of the texture, if there is one. It counts only with a cutoff.
    pub opacity: f32,
    /// Index into [`Mesh::textures`].
    pub texture: Option<u32>,
    /// Where the opacity is below this there is no surface. `None`: there is everywhere.
    pub cutoff: Option<f32>,
    /// Whether it reflects like a mirror of its colour, rather than diffusely.
    pub mirror: bool,
}

impl Material {
    /// Diffuse and grey.
    pub const DEFAULT: Self =
        Self { color: [0.6; 3], opacity: 1.0, texture: None, cutoff: None, mirror: false };
}

/// Triangles and how they look.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    /// The triangles, numbered as the tree numbers its primitives.
    pub triangles: Triangles<'a>,
    /// A normal per vertex, of any length, for smooth shading; without, shading is flat.
    pub normals: Option<&'a [Vec3]>,
    /// Where in its texture each vertex lies; (0, 0) for vertices beyond the end.
    pub texcoords: &'a [Vec2],
    /// Textures, which materials refer to; white beyond the end.
    pub textures: &'a [Texture],
    /// Materials, which `material_of` refers to.
    pub materials: &'a [Material],
    /// For each triangle the number of its material in `materials`. Where either has no such entry
    /// it is [`Material::DEFAULT`].
    pub material_of: &'a [u32],
}

impl<'a> Mesh<'a> {
    /// Makes a mesh of the default material, flat.
    #[must_use]
    pub fn new(triangles: Triangles<'a>) -> Self {
        Self { triangles, normals: None, texcoords: &[], textures: &[], materials: &[], material_of: &[] }
    }

    #[inline]
    pub(crate) fn material(&self, primitive: u32) -> &'a Material {
        let material = self.material_of.get(primitive as usize).and_then(|&m| self.materials.get(m as usize));
        material.unwrap_or(&Material::DEFAULT)
    }

    /// The colour of the surface at a hit, texture and all.
    pub(crate) fn textured_color(&self, hit: &Hit) -> [f32; 3] {
        let material = self.material(hit.primitive);
        let texel = self.texel(material, hit).unwrap_or([1.0; 4]);
        [0, 1, 2].map(|k| material.color[k] * texel[k])
    }

    /// Whether there is a surface at a hit, rather than a hole.
    pub(crate) fn is_there(&self, hit: &Hit) -> bool {
        let material = self.material(hit.primitive);
        let Some(cutoff) = material.cutoff else { return true };
        let opacity = self.texel(material, hit).map_or(1.0, |[_, _, _, opacity]| opacity);
        material.opacity * opacity >= cutoff
    }

    fn texel(&self, material: &Material, hit: &Hit) -> Option<[f32; 4]> {
        let texture = self.textures.get(material.texture? as usize)?;
        let [a, b, c] = self.triangles.indices[hit.primitive as usize]
            .map(|v| self.texcoords.get(v as usize).copied().unwrap_or_default());
        Some(texture.sample(hit.interpolate([a, b, c])))
    }

    /// Interpolated normal at a hit: `None` if there is none, or it has no direction.
    #[inline(always)]
    pub(crate) fn normal(&self, hit: &Hit) -> Option<Vec3> {
        let normals = self.normals?;
        let [a, b, c] = self.triangles.indices[hit.primitive as usize];
        let [a, b, c] = [normals.get(a as usize)?, normals.get(b as usize)?, normals.get(c as usize)?];
        hit.interpolate([*a, *b, *c]).try_normalize()
    }
}
