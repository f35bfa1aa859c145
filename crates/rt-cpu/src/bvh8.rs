//! A tree of eight children a node with its triangles in small blocks: what rays without anything
//! in common want.
//!
//! ```text
//! cost of a subtree as one child:   its area, if it fits into a block
//!                                   else its area + its cost as eight children
//! cost as i > 1 children:           the least of cost(left as k) + cost(right as i - k) for all k,
//!                                   and of cost as i - 1 children
//! ```
//!
//! Collapsing a binary tree is from Wald, Benthin and Boulos, *Getting Rid of Packets*, 2008, in
//! the cheapest way from Ylitie, Karras and Laine, *Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs*, 2017; going through eight boxes and several triangles at a time
//! is from Wald, Woop, Benthin, Johnson and Ernst, *Embree: A Kernel Framework for Efficient CPU
//! Ray Tracing*, 2014.

mod block;
mod collapse;
mod walk;

use bvh_core::{Aabb, Bvh, Ray, SimdLevel, Triangles, Visits};
use bytemuck::{Pod, Zeroable};
use fearless_simd::Level;
use rayon::prelude::*;

use crate::scene::with_test;
use crate::simd::{detected, dispatch};
use crate::{Hit, TriangleTest};

use block::Block;
use collapse::{Plan, collapse};

pub(crate) use walk::hit;

/// Children of a node.
const WIDTH: usize = 8;

/// A second view of a [`Bvh`] and its triangles, for rays that have little in common: about twice
/// as fast for these as the tree itself, once it is there.
///
/// It holds copies of the tree's boxes and of the triangles' corners, 60 to 110 bytes a triangle
/// (in trees nearly as high as they may be 300), and knows nothing of later changes: [`update`](Self::update) it after each. That pays from about
/// one ray for every six triangles on. [`render`](crate::render) does so by itself for ambient
/// occlusion and diffuse bounces; [`render_with`](crate::render_with) takes a view that is there.
///
/// ```
/// use rt_cpu::{Bvh, Bvh8, Ray, TriangleTest, Triangles, Vec3};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
/// # let node = bvh_core::Node::leaf(bvh_core::Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)), 0, 1);
/// # let bvh = Bvh::new(&[node, bvh_core::Node::NOTHING], vec![0]).unwrap();
/// let mut wide = Bvh8::default();
/// wide.update(&bvh, &triangles);
/// let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
/// let hit = wide.closest_hit(&ray, f32::INFINITY, TriangleTest::Watertight);
/// assert_eq!(hit.map(|h| h.t), Some(1.0));
/// ```
#[derive(Debug)]
pub struct Bvh8 {
    level: Level,
    pub(crate) nodes: Vec<Node8>,
    pub(crate) blocks: Vec<Block>,
    plans: Vec<Plan>,
    /// How many there are that a hit can be of.
    pub(crate) triangles: usize,
}

/// Eight boxes, plane by plane, and where their contents are.
///
/// ```text
/// row 0-2  min x, y, z
///     3    u32: bit 31 clear: number of the child node
///               bit 31 set:   bits 0-30 number of the block
///     4-6  max x, y, z; boxes of absent children are empty
///     7    unused, so that a node is four cache lines
/// ```
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Node8([[f32; WIDTH]; 8]);

/// Row of what is in the boxes.
const CHILDREN: usize = 3;
const LEAF: u32 = 1 << 31;

/// Rays that one thread traces at least.
const BATCH: usize = 256;

impl Node8 {
    const EMPTY: Self = {
        let (min, max, none) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH], [0.0; WIDTH]);
        Self([min, min, min, none, max, max, max, none])
    };

    #[inline]
    fn set(&mut self, i: usize, aabb: &Aabb, child: u32) {
        for axis in 0..3 {
            self.0[axis][i] = aabb.min[axis];
            self.0[axis + 4][i] = aabb.max[axis];
        }
        self.0[CHILDREN][i] = f32::from_bits(child);
    }
}

impl Bvh8 {
    /// Makes a view of nothing, whose rays use the instructions of `level`, or the best that the
    /// machine has if that is less. Every level finds the same hits.
    #[must_use]
    pub fn with_level(level: SimdLevel) -> Self {
        let (nodes, blocks, plans) = Default::default();
        Self { level: detected(level), nodes, blocks, plans, triangles: 0 }
    }

    /// Makes it a view of `bvh` with `triangles` as its primitives, by its numbers; triangles that
    /// the tree has and `triangles` has not are never hit.
    ///
    /// O(n), in the current rayon pool; the view is the same for any number of threads. Uses the
    /// memory of the view before, and allocates only if that is not enough.
    pub fn update(&mut self, bvh: &Bvh, triangles: &Triangles<'_>) {
        self.triangles = triangles.indices.len();
        collapse(bvh, triangles, &mut self.plans, &mut self.nodes, &mut self.blocks);
    }

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

    /// Does what [`closest_hit`](Self::closest_hit) does and adds what the ray visited to `visits`.
    /// Nodes are those of this view, which stand for several of the tree; primitives stay as they
    /// are, since triangles are tested by the block.
    #[must_use]
    pub fn closest_hit_counted(
        &self,
        ray: &Ray,
        t_max: f32,
        test: TriangleTest,
        visits: &mut Visits,
    ) -> Option<Hit> {
        self.hit::<false>(ray, t_max, test, visits)
    }

    /// Does what [`any_hit`](Self::any_hit) does and adds what the ray visited to `visits`, as
    /// [`closest_hit_counted`](Self::closest_hit_counted) does.
    #[must_use]
    pub fn any_hit_counted(&self, ray: &Ray, t_max: f32, test: TriangleTest, visits: &mut Visits) -> bool {
        self.hit::<true>(ray, t_max, test, visits).is_some()
    }

    fn hit<const ANY: bool>(
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

impl Default for Bvh8 {
    /// A view of nothing.
    fn default() -> Self {
        Self::with_level(SimdLevel::best())
    }
}
