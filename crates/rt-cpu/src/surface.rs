//! Where rays meet triangles: points, normals and shadow rays, for the pixels of a tile.

use bvh_core::{Triangles, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use bytemuck::Zeroable;

use crate::simd::{bits, cross, dot, load, load3, max, normalize, store_chosen};
use crate::wave::{Coordinates, RAYS, Wave};

/// Points seen and the planes they lie in; without meaning where nothing is hit.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(crate) struct Surfaces {
    /// The point, from the corners, which is more exact than along the ray.
    pub(crate) point: Coordinates,
    /// Unit normal of the triangle's plane, on the viewer's side.
    pub(crate) face: Coordinates,
    /// The greatest coordinate of the triangle's corners.
    pub(crate) max_coordinate: [f32; RAYS],
}

/// What is known of a tile's surfaces before they are shaded.
#[derive(Zeroable)]
pub(crate) struct Appearance {
    pub(crate) albedo: Coordinates,
    /// Unit normals on the viewer's side.
    pub(crate) normal: Coordinates,
    /// Part of the constant light from everywhere that arrives.
    pub(crate) open: [f32; RAYS],
}

impl Surfaces {
    /// Finds the surfaces that the rays of `seen` hit.
    #[inline(always)]
    pub(crate) fn find<S: Simd>(&mut self, simd: S, triangles: &Triangles<'_>, seen: &Wave) {
        let n = S::f32s::LEN;
        for at in (0..seen.count).step_by(n) {
            let lanes = seen.hit_lanes(simd, at);
            if lanes == 0 {
                continue;
            }
            let ([a, b, c], max_coordinate) = edges(simd, triangles, &seen.primitive[at..at + n], lanes);
            max_coordinate.store_slice(&mut self.max_coordinate[at..at + n]);
            let (mut normal, unit) = normalize(simd, cross(b, c));
            for i in bits(lanes & !unit) {
                // The product does not fit in single precision.
                let [b, c] = [b, c].map(|e| {
                    Vec3::new(e[0].as_slice()[i], e[1].as_slice()[i], e[2].as_slice()[i]).as_dvec3()
                });
                let exact = b.cross(c).normalize_or_zero().as_vec3();
                (normal[0][i], normal[1][i], normal[2][i]) = (exact.x, exact.y, exact.z);
            }
            let away = dot(normal, load3(simd, &seen.direction, at)).simd_gt(0.0);
            let u: S::f32s = load(simd, &seen.u, at);
            let v: S::f32s = load(simd, &seen.v, at);
            for k in 0..3 {
                away.select(-normal[k], normal[k]).store_slice(&mut self.face[k][at..at + n]);
                (a[k] + b[k] * u + c[k] * v).store_slice(&mut self.point[k][at..at + n]);
            }
        }
    }

    /// Fills `shadow`, which must be empty, with rays from its origin, a light, to those of the
    /// surfaces `seen` that face it, where they end at `t` = 1; surfaces that face away shadow
    /// themselves. `pixels` gets the pixel of each ray.
    ///
    /// The ends are moved off the surfaces by 32 roundings of the corners and distances that went
    /// into them: the idea of Wächter and Binder, *A Fast and Robust Method for Avoiding
    /// Self-Intersection*, 2019.
    #[inline(always)]
    pub(crate) fn shadow_rays<S: Simd>(
        &self,
        simd: S,
        seen: &Wave,
        shadow: &mut Wave,
        pixels: &mut [u16; RAYS],
    ) {
        let light = shadow.origin;
        for at in (0..seen.count).step_by(S::f32s::LEN) {
            let lanes = seen.hit_lanes(simd, at);
            if lanes == 0 {
                continue;
            }
            let point = load3::<S, S::f32s, RAYS>(simd, &self.point, at);
            let face = load3::<S, S::f32s, RAYS>(simd, &self.face, at);
            let to_light = [-point[0] + light.x, -point[1] + light.y, -point[2] + light.z];
            let size = max(
                load(simd, &self.max_coordinate, at),
                max(max(to_light[0].abs(), to_light[1].abs()), to_light[2].abs()),
            );
            let off = size * (1.0 / (1 << 19) as f32);
            let facing = dot(face, to_light).simd_gt(0.0).to_bitmask() & lanes;
            let next = shadow.count;
            for k in 0..3 {
                let to = (point[k] + face[k] * off) - light[k];
                store_chosen(simd, to, facing, &mut shadow.direction[k][next..]);
            }
            for (pixel, i) in pixels[next..].iter_mut().zip(bits(facing)) {
                *pixel = (at + i) as u16;
            }
            shadow.count += facing.count_ones() as usize;
        }
    }
}

/// Corner A of the triangles that lanes hit, the edges from there to B and C, and the greatest
/// coordinates of the corners.
///
/// Neighbours mostly hit the same triangle: each is read once for all lanes that hit it.
#[inline(always)]
fn edges<S: Simd>(
    simd: S,
    triangles: &Triangles<'_>,
    hit: &[u32],
    lanes: u64,
) -> ([[S::f32s; 3]; 3], S::f32s) {
    let zero = S::f32s::simd_from(simd, 0.0);
    let (mut edges, mut max_coordinate) = ([[zero; 3]; 3], zero);
    let primitives = S::u32s::from_slice(simd, hit);
    let mut left = lanes;
    while left != 0 {
        let primitive = hit[left.trailing_zeros() as usize % S::f32s::LEN];
        let same = primitives.simd_eq(primitive);
        left &= !same.to_bitmask();
        let [a, b, c] = triangles.corners(primitive as usize);
        let of_triangle = a.abs().max(b.abs()).max(c.abs()).max_element();
        max_coordinate = same.select(S::f32s::simd_from(simd, of_triangle), max_coordinate);
        for (edge, of_triangle) in edges.iter_mut().zip([a, b - a, c - a]) {
            for k in 0..3 {
                edge[k] = same.select(S::f32s::simd_from(simd, of_triangle[k]), edge[k]);
            }
        }
    }
    (edges, max_coordinate)
}
