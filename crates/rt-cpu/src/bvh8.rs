//! A tree of eight children a node with its triangles in blocks of four: what rays without anything in common want.
//!
//! ```text
//! cost of a subtree as one child:   its area, if it fits into a block
//!                                   else its area + its cost as eight children
//! cost as i > 1 children:           the least of cost(left as k) + cost(right as i - k) for all k,
//!                                   and of cost as i - 1 children
//! ```
//!
//! Collapsing a binary tree is from Wald, Benthin and Boulos, *Getting Rid of Packets*, 2008, in the cheapest way from
//! Ylitie, Karras and Laine, *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs*, 2017; going
//! through eight boxes and four triangles at a time is from Wald, Woop, Benthin, Johnson and Ernst, *Embree: A Kernel
//! Framework for Efficient CPU Ray Tracing*, 2014.

mod block;
mod walk;

use arrayvec::ArrayVec;
use bvh_core::{Aabb, Bvh, Node, Primitives, Ray, Triangles};
use rayon::prelude::*;

use crate::simd::at_level;
use crate::single::{Work, with_test};
use crate::triangle::{Double, Hit, MollerTrumbore, TriangleTest, Watertight};
use block::Block;

pub(crate) use block::BlockTest;
pub(crate) use walk::{any_where, closest_where};

/// Children of a node.
const WIDTH: usize = 8;

/// A second view of a [`Bvh`] and its triangles, for rays that have little in common: about three times as fast for
/// these as the tree itself, once it is there.
///
/// It holds copies of the tree's boxes and of the triangles' corners, about 80 bytes a triangle, and knows nothing of
/// later changes: [`update`](Self::update) it after each. That pays from about one ray for every ten triangles on.
/// [`render`](crate::render) does so by itself for ambient occlusion and diffuse bounces.
///
/// ```
/// use rt_cpu::{Bvh, Bvh8, Ray, TriangleTest, Triangles, Vec3};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
/// # let node = bvh_core::Node::leaf(bvh_core::Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)), 0, 1);
/// # let bvh = Bvh::new(&[node, bvh_core::Node::NOTHING], vec![0]).unwrap();
/// let mut wide = Bvh8::new();
/// wide.update(&bvh, &triangles);
/// let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
/// let hit = wide.closest_hit(&ray, f32::INFINITY, TriangleTest::Watertight);
/// assert_eq!(hit.map(|h| h.t), Some(1.0));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Bvh8 {
    nodes: Vec<Node8>,
    blocks: Vec<Block>,
    plans: Vec<Plan>,
    todo: Vec<(Part, u32)>,
}

/// Eight boxes, plane by plane, and where their contents are.
///
/// ```text
/// row 0-2  min x, y, z
///     3-5  max x, y, z; boxes of absent children are empty
///     6    u32: bit 31 clear: number of the child node
///               bit 31 set:   bits 2-30 number of the block, bits 0-1 triangles in it less one
///     7    unused, so that a node is four cache lines
/// ```
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
struct Node8([[f32; WIDTH]; 8]);

/// Row of what is in the boxes.
const CHILDREN: usize = 6;
const LEAF: u32 = 1 << 31;

impl Node8 {
    fn empty() -> Self {
        let mut rows = [[0.0; WIDTH]; 8];
        rows[..3].fill([f32::INFINITY; WIDTH]);
        rows[3..6].fill([f32::NEG_INFINITY; WIDTH]);
        Self(rows)
    }

    #[inline]
    fn set(&mut self, i: usize, aabb: &Aabb, child: u32) {
        for axis in 0..3 {
            self.0[axis][i] = aabb.min[axis];
            self.0[axis + 3][i] = aabb.max[axis];
        }
        self.0[CHILDREN][i] = f32::from_bits(child);
    }
}

/// What a node of eight is made of.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// The binary node of this number.
    Node(u32),
    /// First slot and number of slots of part of a leaf that is too large for a block.
    Slots(u32, u32),
}

/// Costs of a subtree as one child, two children and so on up to eight of a node of eight, in units of half area.
type Costs = [f32; WIDTH];

/// How to make the subtree below a pair of siblings into children of a node of eight.
#[derive(Clone, Copy, Debug, Default)]
struct Plan {
    /// Primitives in it; [`MANY`] for that many or more.
    count: u32,
    /// Given room for `i + 1` children, how many of them the left sibling gets; 0 where a node of its own is best.
    left: [u8; WIDTH],
    /// The same for the node of its own, which has room for eight.
    own_left: u8,
}

/// More primitives than a block holds.
const MANY: u32 = block::SIZE as u32 + 1;

impl Bvh8 {
    /// A view of nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes it a view of `bvh` with `triangles` as its primitives, by its numbers; triangles that the tree has and
    /// `triangles` has not are never hit.
    ///
    /// O(n). Uses the memory of the view before, and allocates only if that is not enough.
    pub fn update(&mut self, bvh: &Bvh, triangles: &Triangles<'_>) {
        self.nodes.clear();
        self.blocks.clear();
        self.plans.clear();
        self.plans.resize(bvh.nodes().len() / 2, Plan::default());
        self.plan(bvh, bvh.root());
        self.nodes.push(Node8::empty());
        self.todo.push((Part::Node(0), 0));
        while let Some((part, place)) = self.todo.pop() {
            self.fill(bvh, triangles, part, place as usize);
        }
    }

    /// Finds the cheapest way to make a subtree into up to eight children, from the bottom up, and its number of
    /// primitives.
    fn plan(&mut self, bvh: &Bvh, node: &Node) -> (Costs, u32) {
        let area = node.aabb().half_area();
        let Some([l, r]) = bvh.children(node) else {
            return ([area; WIDTH], (node.count() as u32).min(MANY));
        };
        let ((l, l_count), (r, r_count)) = (self.plan(bvh, l), self.plan(bvh, r));
        let plan = &mut self.plans[node.first() / 2];
        plan.count = (l_count + r_count).min(MANY);
        if plan.count < MANY {
            return ([area; WIDTH], plan.count);
        }
        let mut costs = [f32::INFINITY; WIDTH];
        for i in 1..WIDTH {
            for left in 0..i {
                let cost = l[left] + r[i - 1 - left];
                if cost < costs[i] {
                    (costs[i], plan.left[i]) = (cost, left as u8 + 1);
                }
            }
        }
        // All eight children are those of a node of its own, at the price of that node.
        plan.own_left = plan.left[WIDTH - 1].max(1);
        costs[0] = costs[WIDTH - 1] + area;
        for i in 1..WIDTH {
            if costs[i - 1] <= costs[i] {
                (costs[i], plan.left[i]) = (costs[i - 1], plan.left[i - 1]);
            }
        }
        (costs, plan.count)
    }

    /// Makes the node `place`.
    fn fill(&mut self, bvh: &Bvh, triangles: &Triangles<'_>, part: Part, place: usize) {
        let mut parts = ArrayVec::<(Aabb, Part), WIDTH>::new();
        match part {
            Part::Node(n) => {
                let node = &bvh.nodes()[n as usize];
                match bvh.children(node) {
                    Some([l, r]) if self.count(node) == MANY => {
                        let first = node.first() as u32;
                        let left = usize::from(self.plans[node.first() / 2].own_left);
                        self.collect(bvh, (l, first), left, &mut parts);
                        self.collect(bvh, (r, first + 1), WIDTH - left, &mut parts);
                    }
                    _ => self.collect(bvh, (node, n), 1, &mut parts),
                }
            }
            Part::Slots(first, count) => {
                let each = count.div_ceil(WIDTH as u32).next_multiple_of(block::SIZE as u32);
                let end = first + count;
                for first in (first..end).step_by(each as usize) {
                    let count = each.min(end - first);
                    let order = &bvh.order()[first as usize..(first + count) as usize];
                    let boxes = order.iter().filter(|&&p| (p as usize) < triangles.len());
                    let aabb = boxes.fold(Aabb::EMPTY, |b, &p| b.union(triangles.aabb(p as usize)));
                    parts.push((aabb, Part::Slots(first, count)));
                }
            }
        }
        let mut node = Node8::empty();
        let mut i = 0;
        for (aabb, part) in parts {
            let child = match part {
                Part::Node(n) if self.count(&bvh.nodes()[n as usize]) < MANY => {
                    self.block(triangles, |add| few(bvh, &bvh.nodes()[n as usize], add))
                }
                Part::Slots(first, count) if count < MANY => self.block(triangles, |add| {
                    bvh.order()[first as usize..(first + count) as usize].iter().copied().for_each(add);
                }),
                part => {
                    let child = self.nodes.len() as u32;
                    self.nodes.push(Node8::empty());
                    self.todo.push((part, child));
                    Some(child)
                }
            };
            if let Some(child) = child {
                node.set(i, &aabb, child);
                i += 1;
            }
        }
        self.nodes[place] = node;
    }

    /// Primitives below a node, or [`MANY`].
    fn count(&self, node: &Node) -> u32 {
        if node.is_leaf() { (node.count() as u32).min(MANY) } else { self.plans[node.first() / 2].count }
    }

    /// The children, `room` at most, that a subtree is made into; `n` is its number.
    fn collect(
        &self,
        bvh: &Bvh,
        (node, n): (&Node, u32),
        room: usize,
        parts: &mut ArrayVec<(Aabb, Part), WIDTH>,
    ) {
        match bvh.children(node) {
            None if self.count(node) == MANY => {
                parts.push((node.aabb(), Part::Slots(node.first() as u32, node.count() as u32)));
            }
            Some([l, r]) if self.plans[node.first() / 2].left[room - 1] > 0 => {
                let first = node.first() as u32;
                let left = usize::from(self.plans[node.first() / 2].left[room - 1]);
                self.collect(bvh, (l, first), left, parts);
                self.collect(bvh, (r, first + 1), room - left, parts);
            }
            _ => parts.push((node.aabb(), Part::Node(n))),
        }
    }

    /// Adds a block of the primitives that `each` gives to its argument; `None` if none of them can be hit.
    fn block(&mut self, triangles: &Triangles<'_>, each: impl FnOnce(&mut dyn FnMut(u32))) -> Option<u32> {
        let mut block = Block::default();
        let mut count = 0;
        each(&mut |p| {
            if (p as usize) < triangles.len() && block.set(count, p, &triangles.corners(p as usize)) {
                count += 1;
            }
        });
        let number = self.blocks.len() as u32;
        (count > 0).then(|| {
            self.blocks.push(block);
            LEAF | number << 2 | (count as u32 - 1)
        })
    }
}

/// Gives the primitives below a node of few to `add`.
fn few(bvh: &Bvh, node: &Node, add: &mut dyn FnMut(u32)) {
    match bvh.children(node) {
        Some([l, r]) => {
            few(bvh, l, add);
            few(bvh, r, add);
        }
        None => bvh.primitives(node).iter().for_each(|&p| add(p)),
    }
}

/// Rays that one thread traces at a time.
const BATCH: usize = 256;

impl Bvh8 {
    /// As [`closest_hit`](crate::closest_hit) on the tree that this is a view of.
    #[must_use]
    pub fn closest_hit(&self, ray: &Ray, t_max: f32, test: TriangleTest) -> Option<Hit> {
        with_test!(test, T => at_level!(best, simd => {
            closest_where::<_, T>(simd, self, ray, t_max, &mut Work::default(), #[inline(always)] |_| true)
        }))
    }

    /// As [`any_hit`](crate::any_hit) on the tree that this is a view of.
    #[must_use]
    pub fn any_hit(&self, ray: &Ray, t_max: f32, test: TriangleTest) -> bool {
        with_test!(test, T => at_level!(best, simd => {
            any_where::<_, T>(simd, self, ray, t_max, &mut Work::default(), #[inline(always)] |_| true).is_some()
        }))
    }

    /// [`closest_hit`](Self::closest_hit) of many rays, in the current rayon pool: `hits[i]` is that of `rays[i]`, with
    /// `0 <= t <= t_max[i]`.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest_hits(&self, rays: &[Ray], t_max: &[f32], test: TriangleTest, hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), t_max.len(), "one t_max a ray");
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        let chunks = (rays.par_chunks(BATCH), t_max.par_chunks(BATCH), hits.par_chunks_mut(BATCH));
        chunks.into_par_iter().for_each(|(rays, t_max, hits)| {
            with_test!(test, T => at_level!(best, simd => {
                for ((ray, &t_max), hit) in rays.iter().zip(t_max).zip(hits) {
                    *hit = closest_where::<_, T>(
                        simd, self, ray, t_max, &mut Work::default(), #[inline(always)] |_| true,
                    );
                }
            }));
        });
    }
}
