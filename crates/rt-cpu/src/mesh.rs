//! What is rendered: triangles with colours and normals.

use bvh_core::{Triangles, Vec3};

/// Linear colour of triangles without another.
pub const DEFAULT_COLOR: [f32; 3] = [0.6, 0.6, 0.6];

/// Triangles and how they look.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    /// The triangles, numbered as the tree numbers its primitives.
    pub triangles: Triangles<'a>,
    /// A normal per vertex, of any length, for smooth shading; without, shading is flat.
    pub normals: Option<&'a [Vec3]>,
    /// Linear colours (red, green, blue), each 0 to 1, that `color_of` refers to.
    pub palette: &'a [[f32; 3]],
    /// For each triangle the number of its colour in `palette`. Where either has no such entry the colour is
    /// [`DEFAULT_COLOR`].
    pub color_of: &'a [u32],
}

impl<'a> Mesh<'a> {
    /// Triangles in the default colour, flat.
    #[must_use]
    pub fn new(triangles: Triangles<'a>) -> Self {
        Self { triangles, normals: None, palette: &[], color_of: &[] }
    }

    pub(crate) fn color(&self, primitive: u32) -> [f32; 3] {
        let color = self.color_of.get(primitive as usize).and_then(|&c| self.palette.get(c as usize));
        *color.unwrap_or(&DEFAULT_COLOR)
    }

    /// Interpolated normal at a hit: `None` if there is none, or it has no direction.
    pub(crate) fn normal(&self, hit: &crate::Hit) -> Option<Vec3> {
        let normals = self.normals?;
        let [a, b, c] = self.triangles.indices[hit.primitive as usize];
        let [a, b, c] = [normals.get(a as usize)?, normals.get(b as usize)?, normals.get(c as usize)?];
        (a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v).try_normalize()
    }
}
