//! Picking: what one ray hits. Every triangle test, without a renderer.

use std::hint::black_box;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x4, f32x8, mask32x8};
use glam::Vec3;

use crate::slab;
use crate::triangle::{Test, intersect};
use crate::{
    Bvh, Hit, MAX_HEIGHT, MAX_PRIMITIVES, Node, Ray, TriangleTest, Triangles, Visits, prefetch, with_test,
};

/// Finds the first triangle along a ray with `0 <= t <= t_max`; of equally near ones that with the
/// lowest number.
///
/// `triangles` are the primitives of the tree, by its numbers. If they are fewer than the tree has,
/// the rest is never hit. `t_max` may be infinite; if it is negative or NaN there is no hit, nor
/// for a ray that is not valid ([`Ray::is_valid`]). The tree must be up to date with `triangles`:
/// what has left the boxes since may be missed. O(log n) for scattered triangles.
///
/// ```
/// use bvh_core::{Aabb, Bvh, Node, Ray, TriangleTest, Triangles, Vec3, closest_hit};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
/// let leaf = Node::leaf(Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)), 0, 1);
/// let bvh = Bvh::new(&[leaf, Node::NOTHING], vec![0])?;
/// let ray = Ray::new(Vec3::new(0.25, 0.5, 3.0), -Vec3::Z);
/// let hit = closest_hit(&bvh, &triangles, &ray, f32::INFINITY, TriangleTest::default());
/// assert_eq!(hit.map(|h| (h.t, h.weights())), Some((3.0, [0.25, 0.25, 0.5])));
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
#[must_use]
pub fn closest_hit(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
) -> Option<Hit> {
    closest_hit_counted(bvh, triangles, ray, t_max, test, &mut Visits::default())
}

/// Returns whether any triangle lies along a ray with `0 <= t <= t_max`; otherwise as
/// [`closest_hit`].
///
/// ```
/// use bvh_core::{Aabb, Bvh, Node, Ray, TriangleTest, Triangles, Vec3, any_hit};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
/// let leaf = Node::leaf(Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)), 0, 1);
/// let bvh = Bvh::new(&[leaf, Node::NOTHING], vec![0])?;
/// let to_light = Ray::new(Vec3::new(0.25, 0.5, 3.0), Vec3::new(0.0, 0.0, -9.0));
/// assert!(any_hit(&bvh, &triangles, &to_light, 1.0, TriangleTest::default()));
/// assert!(!any_hit(&bvh, &triangles, &to_light, 0.3, TriangleTest::default()));
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
#[must_use]
pub fn any_hit(bvh: &Bvh, triangles: &Triangles<'_>, ray: &Ray, t_max: f32, test: TriangleTest) -> bool {
    any_hit_counted(bvh, triangles, ray, t_max, test, &mut Visits::default())
}

/// Finds the closest hit that `counts` is true for, as [`closest_hit`] does, and adds what the ray
/// visited to `visits`.
///
/// Leave out objects that are hidden or locked, holes in textures, or all hits up to one that is
/// known: [`Hit::is_before`] orders hits. `counts` is asked about hits that come before the best so
/// far, in no particular order.
///
/// ```
/// use bvh_core::{Aabb, Bvh, Hit, Node, Ray, TriangleTest, Triangles, Vec3, Visits, closest_hit_where};
///
/// let positions = [0.0, 1.0, 2.0].map(|z| [Vec3::Z * z, Vec3::X + Vec3::Z * z, Vec3::Y + Vec3::Z * z]);
/// let indices = [[0, 1, 2], [3, 4, 5], [6, 7, 8]];
/// let triangles = Triangles { positions: positions.as_flattened(), indices: &indices };
/// let leaf = Node::leaf(Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 2.0)), 0, 3);
/// let bvh = Bvh::new(&[leaf, Node::NOTHING], vec![0, 1, 2])?;
/// let (ray, test) = (Ray::new(Vec3::new(0.2, 0.2, 5.0), -Vec3::Z), TriangleTest::default());
/// let (mut visits, mut through, mut last) = (Visits::default(), Vec::new(), None::<Hit>);
/// let is_behind = |hit: &Hit, last: Option<Hit>| last.is_none_or(|l| l.is_before(hit.t, hit.primitive));
/// while let Some(hit) =
///     closest_hit_where(&bvh, &triangles, &ray, 9.0, test, &mut visits, |hit| is_behind(hit, last))
/// {
///     through.push((hit.t, hit.primitive));
///     last = Some(hit);
/// }
/// assert_eq!(through, [(3.0, 2), (4.0, 1), (5.0, 0)]);
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
#[must_use]
pub fn closest_hit_where(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
    visits: &mut Visits,
    counts: impl Fn(&Hit) -> bool,
) -> Option<Hit> {
    with_test!(test, T => dispatch!(Level::new(), simd =>
        hit::<_, T, false>(simd, bvh, triangles, ray, t_max, visits, &counts)))
}

/// Does what [`closest_hit`] does and adds what the ray visited to `visits`.
///
/// ```
/// use bvh_core::{Aabb, Bvh, Node, Ray, TriangleTest, Triangles, Vec3, Visits, closest_hit_counted};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
/// let leaf = Node::leaf(Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)), 0, 1);
/// let bvh = Bvh::new(&[leaf, Node::NOTHING], vec![0])?;
/// let (ray, test) = (Ray::new(Vec3::new(0.25, 0.5, 3.0), -Vec3::Z), TriangleTest::default());
/// let mut visits = Visits::default();
/// assert!(closest_hit_counted(&bvh, &triangles, &ray, f32::INFINITY, test, &mut visits).is_some());
/// assert_eq!((visits.queries, visits.nodes, visits.primitives), (1, 0, 1));
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
#[must_use]
pub fn closest_hit_counted(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
    visits: &mut Visits,
) -> Option<Hit> {
    with_test!(test, T => hit_by::<T, false>(bvh, triangles, ray, t_max, visits))
}

/// Does what [`any_hit`] does and adds what the ray visited to `visits`.
#[must_use]
pub fn any_hit_counted(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
    visits: &mut Visits,
) -> bool {
    with_test!(test, T => hit_by::<T, true>(bvh, triangles, ray, t_max, visits).is_some())
}

/// Finds the first hit met if `ANY`, else the closest, by a triangle test that may be the caller's
/// own, and adds what the ray visited to `visits`.
#[must_use]
pub fn hit_by<T: Test, const ANY: bool>(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    visits: &mut Visits,
) -> Option<Hit> {
    dispatch!(Level::new(), simd => hit::<_, T, ANY>(simd, bvh, triangles, ray, t_max, visits, |_| true))
}

/// Does what [`closest_hit`] does by testing every triangle that a tree may hold,
/// [`MAX_PRIMITIVES`] at most: the oracle for everything else. O(n).
#[must_use]
pub fn closest_hit_brute(
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
) -> Option<Hit> {
    let n = if ray.is_valid() { triangles.indices.len().min(MAX_PRIMITIVES) as u32 } else { 0 };
    with_test!(test, T => {
        let test = T::new(ray);
        let hits = (0..n).filter_map(|p| intersect(ray, &test, &triangles.corners(p as usize), p, t_max));
        hits.reduce(|best, hit| if hit.is_before(best.t, best.primitive) { hit } else { best })
    })
}

/// Finds a hit that `counts` is true for: the first one met if `ANY`, else the closest.
#[inline(always)]
pub fn hit<S: Simd, T: Test, const ANY: bool>(
    simd: S,
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    mut t_max: f32,
    visits: &mut Visits,
    counts: impl Fn(&Hit) -> bool,
) -> Option<Hit> {
    visits.queries += 1;
    let (nodes, order, indices) = (bvh.nodes(), bvh.order(), triangles.indices);
    if !ray.is_valid() || slab::enters(ray, &bvh.root().aabb(), t_max, Ray::WIDEN).is_none() {
        return None;
    }
    let (test, pair_ray) = (T::new(ray), PairRay::new(simd, ray));
    let mut best = None::<Hit>;
    // Where slots are primitives there is no need to wait for which they are.
    let in_order = bvh.is_in_order();
    // What is wanted next below a child, as bytes, and the size of one.
    let pairs: (&[u8], usize) = (bytemuck::cast_slice(nodes), size_of::<Node>());
    let leaves: (&[u8], usize) = if in_order {
        (bytemuck::cast_slice(indices), size_of::<[u32; 3]>())
    } else {
        (bytemuck::cast_slice(order), size_of::<u32>())
    };
    // Where the ray enters in the upper half, the number of the node in the lower.
    let mut stack = [0u64; MAX_HEIGHT as usize + 1];
    let mut top = 0;
    let mut node = bvh.root();
    loop {
        if let Some(children) = bvh.children(node) {
            visits.nodes += 1;
            let pair = node.first();
            for child in children {
                let (memory, size) = if child.is_leaf() { leaves } else { pairs };
                prefetch(memory, child.first() * size);
            }
            let [(l, in_l), (r, in_r)] = pair_ray.enter(simd, bytemuck::cast_ref(children), t_max, T::WIDEN);
            // Branches on purpose: what is guessed right is fetched before the boxes are tested,
            // and that saves more than wrong guesses cost. The compiler would sooner compute which
            // child comes next; `black_box` keeps it from that.
            if in_l && in_r {
                let (far, n) = if r < l {
                    black_box(());
                    node = &children[1];
                    (l, 0)
                } else {
                    node = &children[0];
                    (r, 1)
                };
                stack[top] = u64::from(far.to_bits()) << 32 | (pair + n) as u64;
                top += 1;
                continue;
            }
            if in_l {
                node = &children[0];
                continue;
            }
            if in_r {
                node = &children[1];
                continue;
            }
        }
        for slot in node.first()..node.first() + node.count() {
            let p = if in_order { slot } else { order.get(slot).map_or(usize::MAX, |&p| p as usize) };
            if p < indices.len() {
                visits.primitives += 1;
                let is_wanted = |h: &Hit| best.is_none_or(|b| h.is_before(b.t, b.primitive)) && counts(h);
                let hit = intersect(ray, &test, &triangles.corners(p), p as u32, t_max);
                if let Some(hit) = hit.filter(is_wanted) {
                    best = Some(hit);
                    if ANY {
                        return best;
                    }
                    t_max = hit.t;
                }
            }
        }
        loop {
            if top == 0 {
                return best;
            }
            top -= 1;
            let key = stack[top];
            if f32::from_bits((key >> 32) as u32) <= t_max {
                node = &nodes[key as u32 as usize];
                break;
            }
        }
    }
}

/// A ray in both halves of a vector, for a pair of nodes.
///
/// In memory a node is `min`, a word, `max`, a word. In the lanes of these words the origins are
/// infinite, so that whatever they hold, entry comes out as NaN or minus infinity, and exit as NaN
/// or infinity: neither counts.
struct PairRay<S: Simd> {
    first_origin: f32x8<S>,
    last_origin: f32x8<S>,
    inverse: f32x8<S>,
    negative: mask32x8<S>,
}

impl<S: Simd> PairRay<S> {
    #[inline(always)]
    fn new(simd: S, ray: &Ray) -> Self {
        let inverse = twice(simd, ray.inverse(), 1.0);
        Self {
            first_origin: twice(simd, ray.origin(), f32::INFINITY),
            last_origin: twice(simd, ray.origin(), f32::NEG_INFINITY),
            inverse,
            negative: inverse.is_sign_negative(),
        }
    }

    /// Where the ray enters each of two boxes, and whether it does before `t_max`; see
    /// [`slab::enters`].
    #[inline(always)]
    fn enter(&self, simd: S, pair: &[[f32; 4]; 4], t_max: f32, widen: f32) -> [(f32, bool); 2] {
        let (lower, upper) = (both(simd, &pair[0], &pair[2]), both(simd, &pair[1], &pair[3]));
        let first = self.negative.select(upper, lower);
        let last = self.negative.select(lower, upper);
        let near = (first - self.first_origin) * self.inverse;
        let far = (last - self.last_origin) * self.inverse * widen;
        let near = max(near, f32x8::splat(simd, 0.0));
        let far = min(far, f32x8::splat(simd, t_max));
        let near = max(near, simd.slide_within_blocks_f32x8::<2>(near, near));
        let near = max(near, simd.slide_within_blocks_f32x8::<1>(near, near));
        let far = min(far, simd.slide_within_blocks_f32x8::<2>(far, far));
        let far = min(far, simd.slide_within_blocks_f32x8::<1>(far, far));
        let enters = near.simd_le(far).to_bitmask();
        let near = near.as_slice();
        [(near[0], enters & 1 != 0), (near[4], enters & 16 != 0)]
    }
}

/// Returns the greater; `b` if `a` is NaN.
#[inline(always)]
pub fn max<S: Simd, V: SimdFloat<S, Element = f32>>(a: V, b: V) -> V {
    // The x86 instruction gives its second operand if either is NaN; that is one instruction in
    // place of three.
    if cfg!(target_arch = "x86_64") { a.max(b) } else { a.max_precise(b) }
}

/// Returns the lesser; `b` if `a` is NaN.
#[inline(always)]
pub fn min<S: Simd, V: SimdFloat<S, Element = f32>>(a: V, b: V) -> V {
    if cfg!(target_arch = "x86_64") { a.min(b) } else { a.min_precise(b) }
}

#[inline(always)]
fn both<S: Simd>(simd: S, l: &[f32; 4], r: &[f32; 4]) -> f32x8<S> {
    simd.combine_f32x4(f32x4::from_slice(simd, l), f32x4::from_slice(simd, r))
}

#[inline(always)]
fn twice<S: Simd>(simd: S, a: Vec3, w: f32) -> f32x8<S> {
    let a = [a.x, a.y, a.z, w];
    both(simd, &a, &a)
}
