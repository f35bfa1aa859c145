//! A few triangles, and one ray against all of them.

use bvh_core::triangle::{Test, in_box};
use bvh_core::{Primitives, Ray, Triangles, Vec3};
use bytemuck::{Pod, Zeroable};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::Hit;
use crate::simd::bits;
use crate::wide::{self, Found, Rays, WideTest};

/// Triangles of a block: as many as AVX2 and AVX-512 have use for, and no more than NEON has.
/// x86-64 processors without AVX2 take eight as well, and 1.2 to 1.38 times as long as with four
/// (`docs/BENCHMARKS.md`, incoherent rays).
pub(super) const SIZE: usize = if cfg!(target_arch = "x86_64") { 8 } else { 4 };

// One number for each triangle of a block.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) use fearless_simd::{f32x4 as Each, u32x4 as EachPrimitive};
#[cfg(target_arch = "x86_64")]
pub(crate) use fearless_simd::{f32x8 as Each, u32x8 as EachPrimitive};

/// In place of a triangle's number: there is none in that lane.
const NONE: u32 = u32::MAX;

/// Triangles, corner by corner and axis by axis.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Block {
    corners: [[[f32; SIZE]; 3]; 3],
    /// Numbers of the primitives, or [`NONE`].
    primitive: [u32; SIZE],
}

impl Block {
    pub(super) const EMPTY: Self = Self { corners: [[[0.0; SIZE]; 3]; 3], primitive: [NONE; SIZE] };

    /// A block of those of the primitives that can be hit: that are there and finite.
    pub(super) fn new(triangles: &Triangles<'_>, primitives: &[u32]) -> Self {
        let (mut block, mut count) = (Self::EMPTY, 0);
        for &primitive in primitives.iter().take(SIZE).filter(|&&p| (p as usize) < triangles.len()) {
            let corners = triangles.corners(primitive as usize);
            for (to, from) in block.corners.iter_mut().zip(&corners) {
                for axis in 0..3 {
                    to[axis][count] = from[axis];
                }
            }
            if corners.iter().all(|c| c.is_finite()) {
                block.primitive[count] = primitive;
                count += 1;
            }
        }
        block
    }

    pub(super) fn is_empty(&self) -> bool {
        self.primitive[0] == NONE
    }

    /// Tests a ray, in all lanes, against the triangles.
    #[inline(always)]
    pub(super) fn test<S: Simd, T: WideTest>(&self, simd: S, rays: &Rays<Each<S>>) -> Found<Each<S>> {
        let present = EachPrimitive::from_slice(simd, &self.primitive).simd_ne(NONE).to_bitmask();
        let [a, b, c] = &self.corners;
        // `closest` branches on a miss anyway: to do so here as well took 4 to 5 % more
        // (docs/BENCHMARKS.md, incoherent rays).
        let corners = wide::corners::<S, T, _, _>(simd, &rays.octant, [a, b, c]);
        T::wide(simd, rays, &corners, present, false)
    }

    #[inline(always)]
    fn corners(&self, i: usize) -> [Vec3; 3] {
        let at = |corner: &[[f32; SIZE]; 3]| Vec3::new(corner[0][i], corner[1][i], corner[2][i]);
        [at(&self.corners[0]), at(&self.corners[1]), at(&self.corners[2])]
    }

    /// The closest of what a triangle test found, or finds where it was unsure, that comes before
    /// `best` and not after `t_max`, and that `counts` is true for; else `best`.
    #[inline(always)]
    pub(super) fn closest<S: Simd>(
        &self,
        ray: &Ray,
        test: &impl Test,
        found: &Found<Each<S>>,
        mut t_max: f32,
        mut best: Option<Hit>,
        counts: &impl Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        if found.lanes | found.unsure == 0 {
            return best;
        }
        let near = found.lanes & found.t.simd_le(t_max).to_bitmask();
        for i in bits(near | found.unsure) {
            let corners = self.corners(i);
            let at = if near >> i & 1 == 1 {
                Some((found.t.as_slice()[i], found.u.as_slice()[i], found.v.as_slice()[i]))
            } else {
                test.test(&corners)
            };
            let hit = at.and_then(|at| in_box(ray, at, &corners, self.primitive[i], t_max, Ray::WIDEN));
            if let Some(hit) = hit.filter(|h| best.is_none_or(|b| h.is_before(b.t, b.primitive)) && counts(h))
            {
                (best, t_max) = (Some(hit), hit.t);
            }
        }
        best
    }
}
