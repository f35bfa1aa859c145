//! Rays through a tree of eight children a node.

use arrayvec::ArrayVec;
use bvh_core::{MAX_HEIGHT, Ray, Visits};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use rayon::prelude::*;

use super::Bvh8;
use super::block::Each;
use super::node::{CHILDREN, LEAF, Node8, WIDTH};
use crate::scene::with_test;
use crate::simd::{dispatch, load, max, min, splat3};
use crate::wide::{WideTest, in_all_lanes};
use crate::{Hit, TriangleTest};

/// Most that is put off at a time: seven children a level of the binary tree, and of what large
/// leaves are cut into.
const STACK: usize = (WIDTH - 1) * (MAX_HEIGHT as usize + 32) + 1;

/// Rays that one thread traces at least.
const BATCH: usize = 256;

impl Bvh8 {
    /// Does what [`closest_hit`](crate::closest_hit) does on the tree that this is a view of.
    #[must_use]
    pub fn closest_hit(&self, ray: &Ray, t_max: f32, test: TriangleTest) -> Option<Hit> {
        self.hit::<false>(ray, t_max, test, &mut Visits::default())
    }

    /// Does what [`any_hit`](crate::any_hit) does on the tree that this is a view of.
    #[must_use]
    pub fn any_hit(&self, ray: &Ray, t_max: f32, test: TriangleTest) -> bool {
        self.hit::<true>(ray, t_max, test, &mut Visits::default()).is_some()
    }

    /// Does what [`closest_hit`](Self::closest_hit) does, or if `ANY` finds the first hit met, and
    /// adds what the ray visited to `visits`. Nodes are those of this view, which stand for several
    /// of the tree; triangles, which are tested by the block, are not counted.
    #[must_use]
    pub fn hit<const ANY: bool>(
        &self,
        ray: &Ray,
        t_max: f32,
        test: TriangleTest,
        visits: &mut Visits,
    ) -> Option<Hit> {
        visits.queries += 1;
        with_test!(test, T => dispatch!(self.level, simd => {
            hit::<_, T, ANY>(simd, self, ray, t_max, visits, |_| true)
        }))
    }

    /// Finds the [`closest_hit`](Self::closest_hit) of many rays in the current rayon pool:
    /// `hits[i]` is that of `rays[i]`, with `0 <= t <= t_max[i]`.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest_hits(&self, rays: &[Ray], t_max: &[f32], test: TriangleTest, hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), t_max.len(), "one t_max a ray");
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        let all = (rays.par_iter(), t_max.par_iter(), hits.par_iter_mut()).into_par_iter();
        all.with_min_len(BATCH).for_each(|(ray, &t_max, hit)| *hit = self.closest_hit(ray, t_max, test));
    }
}

/// A ray in eight lanes, for as many boxes.
struct Ray8<S: Simd> {
    origin: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    /// The rows of a node with the planes that the ray meets first; four rows from them are those
    /// that it meets last.
    first: [usize; 3],
}

impl<S: Simd> Ray8<S> {
    #[inline(always)]
    fn new(simd: S, ray: &Ray) -> Self {
        let (origin, inverse) = (ray.origin(), ray.inverse());
        let row = |axis: usize| axis + if inverse[axis].is_sign_negative() { 4 } else { 0 };
        Self { origin: splat3(simd, origin), inverse: splat3(simd, inverse), first: [row(0), row(1), row(2)] }
    }

    /// Tests eight boxes; see [`slab::enters`](bvh_core::slab::enters). Gives where the ray enters
    /// them, in the upper half of each key, and what is in them, in the lower, and the mask of
    /// those that it does enter.
    #[inline(always)]
    fn enter(&self, simd: S, node: &Node8, t_max: f32) -> ([u64; WIDTH], u64) {
        // Eight rows, so that there is nothing to check.
        let row = |i: usize| load::<S, f32x8<S>, WIDTH>(simd, &node.0[i & 7], 0);
        let mut near = f32x8::splat(simd, 0.0);
        let mut far = f32x8::splat(simd, f32::INFINITY);
        for k in 0..3 {
            near = max((row(self.first[k]) - self.origin[k]) * self.inverse[k], near);
            far = min((row(self.first[k] ^ 4) - self.origin[k]) * self.inverse[k], far);
        }
        // Widening the least gives the least of the widened: rounding is monotonic.
        let far = min(far * Ray::WIDEN, f32x8::splat(simd, t_max));
        let mask = near.simd_le(far).to_bitmask();
        let (low, high) = simd.interleave_f32x8(row(CHILDREN), near);
        let mut floats = [0.0; 2 * WIDTH];
        low.store_slice(&mut floats[..WIDTH]);
        high.store_slice(&mut floats[WIDTH..]);
        (bytemuck::cast(floats), mask)
    }
}

/// What a ray hits of that which `counts` is true for: the closest, unless `ANY` will do.
#[inline(always)]
pub(crate) fn hit<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    tree: &Bvh8,
    ray: &Ray,
    mut t_max: f32,
    work: &mut Visits,
    counts: impl Fn(&Hit) -> bool,
) -> Option<Hit> {
    let mut best = None::<Hit>;
    if !ray.is_valid() {
        return best;
    }
    let (test, ray8, rays) = (T::new(ray), Ray8::new(simd, ray), in_all_lanes::<S, Each<S>>(simd, ray));
    let mut stack = ArrayVec::<u64, STACK>::new();
    let mut next = 0;
    loop {
        if next & LEAF == 0 {
            let Some(node) = tree.nodes.get(next as usize) else { return best };
            work.nodes += 1;
            let (keys, mut mask) = ray8.enter(simd, node, t_max);
            if mask != 0 {
                // Bits of positive numbers are in their order: keys are in that of where the ray
                // enters.
                let mut nearest = keys[mask.trailing_zeros() as usize & (WIDTH - 1)];
                mask &= mask - 1;
                let before = stack.len();
                while mask != 0 {
                    let key = keys[mask.trailing_zeros() as usize & (WIDTH - 1)];
                    mask &= mask - 1;
                    stack.push(nearest.max(key));
                    nearest = nearest.min(key);
                    // The nearest of what is put off comes last.
                    let mut i = stack.len() - 1;
                    while i > before && stack[i - 1] < stack[i] {
                        stack.swap(i - 1, i);
                        i -= 1;
                    }
                }
                next = nearest as u32;
                continue;
            }
        } else {
            let Some(block) = tree.blocks.get((next & !LEAF) as usize) else { return best };
            let found = block.test::<S, T>(simd, &rays);
            best = block.closest(ray, &test, &found, t_max, best, &counts);
            if let Some(hit) = best {
                if ANY {
                    return best;
                }
                t_max = hit.t;
            }
        }
        loop {
            let Some(key) = stack.pop() else { return best };
            if f32::from_bits((key >> 32) as u32) <= t_max {
                next = key as u32;
                break;
            }
        }
    }
}
