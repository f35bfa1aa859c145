//! Surfaces, light and background.

use bvh_core::{Triangles, Vec3};

use crate::{Hit, Mesh};

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

impl Background {
    pub(crate) fn color(&self, direction: Vec3) -> [f32; 3] {
        let up = 0.5 + 0.5 * direction.normalize_or_zero().y;
        std::array::from_fn(|i| self.nadir[i] + (self.zenith[i] - self.nadir[i]) * up)
    }
}

/// The triangle at a hit: the point, from the corners, which is more exact than along the ray, and the unit
/// normal of its plane, towards where `direction` comes from.
fn facet(triangles: &Triangles<'_>, hit: &Hit, direction: Vec3) -> (Vec3, Vec3) {
    let [a, b, c] = triangles.corners(hit.primitive as usize);
    let (ab, ac) = (b - a, c - a);
    let face = ab.cross(ac).try_normalize().unwrap_or_else(|| {
        // The product does not fit in single precision.
        ab.as_dvec3().cross(ac.as_dvec3()).normalize_or_zero().as_vec3()
    });
    let face = if face.dot(direction) > 0.0 { -face } else { face };
    (a + ab * hit.u + ac * hit.v, face)
}

/// Direction of the shadow ray from a light to a hit, which ends at `t` = 1; `None` if the surface faces away and
/// so shadows itself.
///
/// The end is moved off the surface by 32 roundings of the coordinates and distances that went into it: the
/// idea of Wächter and Binder, *A Fast and Robust Method for Avoiding Self-Intersection*, 2019.
pub(crate) fn shadow_ray(triangles: &Triangles<'_>, hit: &Hit, seen: Vec3, light: Vec3) -> Option<Vec3> {
    let (point, face) = facet(triangles, hit, seen);
    let to_light = light - point;
    let size = point.abs().max(to_light.abs()).max_element();
    let end = point + face * (size * (1.0 / (1 << 19) as f32));
    (face.dot(to_light) > 0.0).then_some(end - light)
}

/// A point that is seen, with what shading needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    point: Vec3,
    /// Unit normal on the viewer's side.
    normal: Vec3,
    color: [f32; 3],
}

impl Surface {
    pub(crate) fn new(mesh: &Mesh<'_>, hit: &Hit, direction: Vec3, smooth: bool) -> Self {
        let (point, face) = facet(&mesh.triangles, hit, direction);
        let normal = mesh.normal(hit).filter(|_| smooth).unwrap_or(face);
        let normal = if normal.dot(face) < 0.0 { -normal } else { normal };
        Self { point, normal, color: mesh.color(hit.primitive) }
    }

    /// Lambert's law, and a little light from everywhere, more from above.
    ///
    /// Without a light, shading is as if there were one at the eye.
    pub(crate) fn shade(&self, light: Option<&PointLight>, visible: bool, to_eye: Vec3) -> [f32; 3] {
        const AMBIENT: f32 = 0.12;
        let ambient = AMBIENT * (1.0 + 0.5 * self.normal.y);
        let (to_light, color) = light.map_or((to_eye, [1.0; 3]), |l| (l.position - self.point, l.color));
        let facing = to_light.normalize_or_zero().dot(self.normal).max(0.0);
        let direct = if visible { facing } else { 0.0 };
        std::array::from_fn(|i| self.color[i] * (ambient + color[i] * direct))
    }
}
