//! Rays that have little in common.

use std::f32::consts::TAU;

use bvh_core::Triangles;
use rt_cpu::{Camera, Pixel, uniform};

use crate::{RAYS, Rays};

/// Makes a diffuse bounce: from every hit of a picture a ray into the half space of the viewer, as
/// likely as the cosine of its angle to the triangle's normal is large. The same seed gives the
/// same rays.
///
/// They start off the surface by 32 roundings of the triangle's coordinates, as reflected rays of
/// [`rt_cpu`] do, and have unit length. Rays of neighbouring pixels are neighbours.
#[must_use]
pub fn bounces(camera: &Camera, triangles: &Triangles<'_>, pixels: &[Pixel], seed: u64) -> Vec<Rays> {
    let mut all = vec![Rays::default()];
    for (i, pixel) in pixels.iter().enumerate() {
        let Some(hit) = pixel.hit() else { continue };
        let [a, b, c] = triangles.corners(hit.primitive as usize);
        let (ab, ac) = (b - a, c - a);
        let Some(face) = ab.cross(ac).try_normalize() else { continue };
        let width = camera.width as usize;
        let seen = camera.ray((i % width) as u32, (i / width) as u32).direction();
        let normal = if face.dot(seen) > 0.0 { -face } else { face };
        let point = a + ab * hit.u + ac * hit.v;
        let size = a.abs().max(b.abs()).max(c.abs()).max_element();
        let [x, y] = [0, 1].map(|k| uniform(0, seed ^ (i as u64) << 1 ^ k));
        let (right, up) = normal.any_orthonormal_pair();
        let (sin, cos) = (TAU * x).sin_cos();
        let way = (right * cos + up * sin) * y.sqrt() + normal * (1.0 - y).sqrt();
        if all.last().is_none_or(|rays| rays.len() == RAYS) {
            all.push(Rays::default());
        }
        if let Some(rays) = all.last_mut() {
            rays.push(point + normal * (size / (1 << 19) as f32), way, f32::INFINITY);
        }
    }
    all
}
