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
mod node;
mod walk;

use bvh_core::{Bvh, SimdLevel, Triangles};
use fearless_simd::Level;

use crate::simd::detected;

use block::Block;
use collapse::{Plan, collapse};
use node::Node8;

pub(crate) use walk::hit;

/// A second view of a [`Bvh`] and its triangles, for rays that have little in common: about twice
/// as fast for these as the tree itself, once it is there.
///
/// It holds copies of the tree's boxes and of the triangles' corners, 60 to 110 bytes a triangle (300
/// in trees nearly as high as they may be), and knows nothing of later changes:
/// [`update`](Self::update) it after each. That pays from about one ray for every six triangles on.
/// [`render`](crate::render) does so by itself for ambient occlusion and diffuse bounces;
/// [`render_with`](crate::render_with) takes a view that is there.
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
}

impl Default for Bvh8 {
    /// A view of nothing.
    fn default() -> Self {
        Self::with_level(SimdLevel::best())
    }
}
