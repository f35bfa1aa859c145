//! Where rays meet triangles: points, normals and shadow rays, for the pixels of a tile.

use bvh_core::{Triangles, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::bundle::{Bundle, Hits, RAYS};
use crate::simd::{Lanes, load3, max};

/// Coordinates of a tile's pixels, an array for each axis.
pub(crate) type Coordinates = [[f32; RAYS]; 3];

/// Points seen and the planes they lie in; without meaning where nothing is hit.
#[repr(C, align(64))]
pub(crate) struct Surfaces {
    /// The point, from the corners, which is more exact than along the ray.
    pub(crate) point: Coordinates,
    /// Unit normal of the triangle's plane, on the viewer's side.
    pub(crate) face: Coordinates,
}

impl Surfaces {
    pub(crate) fn new() -> Self {
        Self { point: [[0.0; RAYS]; 3], face: [[0.0; RAYS]; 3] }
    }

    /// Finds the surfaces that the rays of `seen` hit.
    #[inline(always)]
    pub(crate) fn find<S: Simd>(&mut self, simd: S, triangles: &Triangles<'_>, seen: &Bundle, hits: &Hits) {
        for at in (0..seen.count).step_by(S::f32s::LEN) {
            // Corner A, and from there to B and C.
            let (mut a, mut ab, mut ac) = ([[0.0; 16]; 3], [[0.0; 16]; 3], [[0.0; 16]; 3]);
            let lanes = hits.lanes(at, S::f32s::LEN);
            if lanes == 0 {
                continue;
            }
            for i in crate::simd::bits(lanes) {
                let [p, q, r] = triangles.corners(hits.primitive[at + i] as usize);
                let (q, r) = (q - p, r - p);
                for k in 0..3 {
                    (a[k][i], ab[k][i], ac[k][i]) = (p[k], q[k], r[k]);
                }
            }
            let a = load3::<S, S::f32s, 16>(simd, &a, 0);
            let b = load3::<S, S::f32s, 16>(simd, &ab, 0);
            let c = load3::<S, S::f32s, 16>(simd, &ac, 0);
            let n = [b[1] * c[2] - c[1] * b[2], b[2] * c[0] - c[2] * b[0], b[0] * c[1] - c[0] * b[1]];
            let (mut n, unit) = normalize(simd, n);
            for i in crate::simd::bits(lanes & !unit) {
                // The product does not fit in single precision.
                let [b, c] = [&ab, &ac].map(|e| Vec3::new(e[0][i], e[1][i], e[2][i]).as_dvec3());
                let exact = b.cross(c).normalize_or_zero().as_vec3();
                (n[0][i], n[1][i], n[2][i]) = (exact.x, exact.y, exact.z);
            }
            let away = dot(n, load3(simd, &seen.direction, at)).simd_gt(0.0);
            let u: S::f32s = crate::simd::load(simd, &hits.u, at);
            let v: S::f32s = crate::simd::load(simd, &hits.v, at);
            for k in 0..3 {
                away.select(-n[k], n[k]).store_slice(&mut self.face[k][at..at + S::f32s::LEN]);
                (a[k] + b[k] * u + c[k] * v).store_slice(&mut self.point[k][at..at + S::f32s::LEN]);
            }
        }
    }

    /// Adds to `rays` those from their origin, a light, to the surfaces that face it, where they end at `t` = 1;
    /// surfaces that face away shadow themselves. `whose` gets the pixel of each ray.
    ///
    /// The ends are moved off the surfaces by 32 roundings of the coordinates and distances that went into them:
    /// the idea of Wächter and Binder, *A Fast and Robust Method for Avoiding Self-Intersection*, 2019.
    #[inline(always)]
    pub(crate) fn shadow_rays<S: Simd>(
        &self,
        simd: S,
        hits: &Hits,
        count: usize,
        rays: &mut Bundle,
        whose: &mut [u16; RAYS],
    ) {
        let light = rays.origin;
        let mut way = [[0.0; 16]; 3];
        for at in (0..count).step_by(S::f32s::LEN) {
            let lanes = hits.lanes(at, S::f32s::LEN);
            if lanes == 0 {
                continue;
            }
            let point = load3::<S, S::f32s, RAYS>(simd, &self.point, at);
            let face = load3::<S, S::f32s, RAYS>(simd, &self.face, at);
            let to_light = [-point[0] + light.x, -point[1] + light.y, -point[2] + light.z];
            let size = max(
                max(max(size(point[0]), size(point[1])), size(point[2])),
                max(max(size(to_light[0]), size(to_light[1])), size(to_light[2])),
            );
            let off = size * (1.0 / (1 << 19) as f32);
            let facing = dot(face, to_light).simd_gt(0.0).to_bitmask() & lanes;
            for k in 0..3 {
                let to = (point[k] + face[k] * off) - light[k];
                to.store_slice(&mut way[k][..S::f32s::LEN]);
            }
            for i in crate::simd::bits(facing) {
                whose[rays.count] = (at + i) as u16;
                rays.push(Vec3::new(way[0][i], way[1][i], way[2][i]));
            }
        }
    }
}

#[inline(always)]
fn size<S: Simd, V: Lanes<S>>(a: V) -> V {
    max(a, -a)
}

#[inline(always)]
pub(crate) fn dot<S: Simd, V: Lanes<S>>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Unit vectors, and the lanes where there are such: without overflow or underflow.
#[inline(always)]
pub(crate) fn normalize<S: Simd, V: Lanes<S>>(simd: S, a: [V; 3]) -> ([V; 3], u64) {
    let square = dot(a, a);
    let unit = square.simd_gt(f32::MIN_POSITIVE) & square.simd_lt(f32::INFINITY);
    let inverse = V::simd_from(simd, 1.0) / square.sqrt();
    ([a[0] * inverse, a[1] * inverse, a[2] * inverse], unit.to_bitmask())
}
