//! A tree of eight children a node with its triangles in blocks of four: what rays without anything in common want.
//!
//! ```text
//! for each node of eight, from the root on:
//!   begin with the two children of the binary node
//!   while there are fewer than eight: replace the one with the largest box, of those above more than four
//!     triangles, by its two children
//!   those above four triangles or fewer become blocks, the others nodes
//! ```
//!
//! Collapsing a binary tree so is from Wald, Benthin and Boulos, *Getting Rid of Packets*, 2008; going through eight boxes
//! and four triangles at a time from Woop, Feng, Wald and Benthin, *Embree Ray Tracing Kernels*, 2013.

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

/// A second view of a [`Bvh`] and its triangles for rays that have little in common: several times as fast for these as the
/// tree itself, once it is there.
///
/// It holds copies of the tree's boxes and of the triangles' corners, about 90 bytes a triangle, and knows nothing
/// of later changes: [`update`](Self::update) it after each, which costs about as much as a refit, if so many rays follow
/// that it pays: as a rule of thumb, one for every ten triangles.
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

/// Part of a binary tree, or of one of its leaves.
#[derive(Clone, Copy, Debug)]
enum Part {
    Node(Node),
    Slots { aabb: Aabb, first: usize, count: usize },
}

impl Part {
    fn aabb(&self) -> Aabb {
        match self {
            Self::Node(node) => node.aabb(),
            Self::Slots { aabb, .. } => *aabb,
        }
    }

    /// The slots of the primitives in it, if they fit into a block.
    fn few(&self, bvh: &Bvh) -> Option<ArrayVec<usize, { block::SIZE }>> {
        fn add(bvh: &Bvh, node: &Node, slots: &mut ArrayVec<usize, { block::SIZE }>) -> Option<()> {
            match bvh.children(node) {
                Some([l, r]) => add(bvh, l, slots).and_then(|()| add(bvh, r, slots)),
                None => (node.first()..node.first() + node.count()).try_for_each(|s| slots.try_push(s).ok()),
            }
        }
        let mut slots = ArrayVec::new();
        match *self {
            // A tree of height h has more than h leaves.
            Self::Node(ref node) if node.height() as usize >= block::SIZE => None,
            Self::Node(ref node) => add(bvh, node, &mut slots).map(|()| slots),
            Self::Slots { first, count, .. } => {
                (first..first + count).try_for_each(|s| slots.try_push(s).ok()).map(|()| slots)
            }
        }
    }

    /// Two halves of what is more than a block.
    fn halves(&self, bvh: &Bvh, triangles: &Triangles<'_>) -> [Self; 2] {
        let (first, count) = match *self {
            Self::Node(ref node) => match bvh.children(node) {
                Some(children) => return children.map(Self::Node),
                None => (node.first(), node.count()),
            },
            Self::Slots { first, count, .. } => (first, count),
        };
        let left = (count / 2).next_multiple_of(block::SIZE).min(count);
        [(first, left), (first + left, count - left)].map(|(first, count)| {
            let aabb_of = |&p: &u32| {
                if (p as usize) < triangles.len() { triangles.aabb(p as usize) } else { Aabb::EMPTY }
            };
            let boxes = bvh.order()[first..first + count].iter().map(aabb_of);
            Self::Slots { aabb: boxes.fold(Aabb::EMPTY, Aabb::union), first, count }
        })
    }
}

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
        self.todo.clear();
        self.nodes.push(Node8::empty());
        self.todo.push((Part::Node(*bvh.root()), 0));
        while let Some((part, place)) = self.todo.pop() {
            self.fill(bvh, triangles, part, place as usize);
        }
    }

    /// Makes the node `place` out of part of a binary tree.
    fn fill(&mut self, bvh: &Bvh, triangles: &Triangles<'_>, part: Part, place: usize) {
        let mut blocks = ArrayVec::<(Part, ArrayVec<usize, { block::SIZE }>), WIDTH>::new();
        let mut open = ArrayVec::<(f32, Part), WIDTH>::new();
        let mut next = Some(part);
        while let Some(part) = next {
            let halves = match part.few(bvh) {
                // The whole tree in one block.
                Some(few) => {
                    blocks.push((part, few));
                    break;
                }
                None => part.halves(bvh, triangles),
            };
            for half in halves {
                match half.few(bvh) {
                    Some(few) => blocks.push((half, few)),
                    None => open.push((half.aabb().half_area(), half)),
                }
            }
            let full = blocks.len() + open.len() == WIDTH;
            let largest = (0..open.len()).max_by(|&a, &b| open[a].0.total_cmp(&open[b].0));
            next = largest.filter(|_| !full).map(|i| open.swap_remove(i).1);
        }
        let mut node = Node8::empty();
        let mut i = 0;
        for (_, part) in open {
            let child = self.nodes.len() as u32;
            self.nodes.push(Node8::empty());
            self.todo.push((part, child));
            node.set(i, &part.aabb(), child);
            i += 1;
        }
        for (part, slots) in blocks {
            let mut block = Block::default();
            let mut count = 0;
            for slot in slots {
                let p = bvh.order()[slot];
                if (p as usize) < triangles.len() && block.set(count, p, &triangles.corners(p as usize)) {
                    count += 1;
                }
            }
            if count > 0 {
                let child = LEAF | (self.blocks.len() as u32) << 2 | (count as u32 - 1);
                self.blocks.push(block);
                node.set(i, &part.aabb(), child);
                i += 1;
            }
        }
        self.nodes[place] = node;
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
