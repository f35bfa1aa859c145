//! One node: 32 bytes, two to a cache line.

use glam::{Vec3, Vec4};

use crate::{Aabb, COST_INTERSECT, COST_TRAVERSE};

/// Largest number of primitives in one leaf.
pub const MAX_LEAF_SIZE: u32 = (1 << 24) - 1;

const LEAF: u32 = Node::LEAF;
const MOVES: u32 = Node::MOVES;
const INDEX: u32 = Node::INDEX;
const HEIGHT: u32 = Node::HEIGHT;

/// A node of a [`Bvh`](crate::Bvh), inner or leaf, with its box.
///
/// ```text
/// byte  0  min   3 x f32
///      12  link  bit 31     leaf
///                bit 30     a primitive below may move
///                bits 0-29  inner: number of the left child node (even; the right child follows it)
///                           leaf:  first slot in the tree's order of primitives
///      16  max   3 x f32
///      28  aux   bits 8-31  leaf: number of primitives
///                           inner: reference area, the upper bits of an f32
///                bits 0-7   height: 0 for a leaf, else 1 + the greater height of the children
/// ```
///
/// Everything a rotation must carry along with a node is in these 32 bytes, so swapping two slots of the
/// arena moves whole subtrees.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Node {
    min: Vec3,
    link: u32,
    max: Vec3,
    aux: u32,
}

const _: () = assert!(size_of::<Node>() == 32 && align_of::<Node>() == 32);

impl Node {
    /// The bit of the link word, for SIMD kernels, that [`is_leaf`](Self::is_leaf) tells.
    pub const LEAF: u32 = 1 << 31;

    /// The bit of the link word, for SIMD kernels, that [`moves`](Self::moves) tells.
    pub const MOVES: u32 = 1 << 30;

    /// The bits of the link word, for SIMD kernels, that [`first`](Self::first) tells.
    pub const INDEX: u32 = Self::MOVES - 1;

    /// The bits of the aux word, for SIMD kernels, that [`height`](Self::height) tells.
    pub const HEIGHT: u32 = 0xff;

    /// A leaf without primitives: the root of an empty tree, and what fills unused slots.
    pub const NOTHING: Self = Self { min: Vec3::INFINITY, link: LEAF, max: Vec3::NEG_INFINITY, aux: 0 };

    /// A leaf over the slots `first .. first + count` of the tree's order, counted as moving.
    ///
    /// # Panics
    /// In debug builds, if `first` exceeds 30 bits or `count` exceeds [`MAX_LEAF_SIZE`].
    #[must_use]
    #[inline]
    pub const fn leaf(aabb: Aabb, first: u32, count: u32) -> Self {
        debug_assert!(first <= INDEX && count <= MAX_LEAF_SIZE, "leaf out of range");
        Self { min: aabb.min, link: LEAF | MOVES | first & INDEX, max: aabb.max, aux: count << 8 }
    }

    /// An inner node over the child nodes `left` and `left + 1`, counted as moving, of height 1 until it is
    /// set.
    ///
    /// # Panics
    /// In debug builds, if `left` is odd or exceeds 30 bits.
    #[must_use]
    #[inline]
    pub fn inner(aabb: Aabb, left: u32) -> Self {
        debug_assert!(left <= INDEX && left.is_multiple_of(2), "child pair {left} out of range");
        Self { min: aabb.min, link: MOVES | left & INDEX, max: aabb.max, aux: 1 }
    }

    /// The node's box.
    #[must_use]
    #[inline]
    pub fn aabb(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }

    /// Whether this is a leaf that moves and holds one primitive, as most do.
    #[must_use]
    #[inline]
    pub fn is_single_and_moves(&self) -> bool {
        self.link & MOVES != 0 && self.aux == 1 << 8
    }

    /// Replaces the box.
    #[inline]
    pub fn set_aabb(&mut self, aabb: Aabb) {
        // Whole-node store: a store of part of a node, followed by a wider load, stalls the pipeline.
        *self = Self { min: aabb.min, link: self.link, max: aabb.max, aux: self.aux };
    }

    /// Whether this is a leaf.
    #[must_use]
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.link & LEAF != 0
    }

    /// Whether any primitive at or below this node may move (see [`Bvh::set_moving`](crate::Bvh::set_moving)).
    #[must_use]
    #[inline]
    pub fn moves(&self) -> bool {
        self.link & MOVES != 0
    }

    #[inline]
    pub(crate) fn set_moves(&mut self, moves: bool) {
        self.link = self.link & !MOVES | if moves { MOVES } else { 0 };
    }

    /// Inner: number of the left child node; the right one follows it. Leaf: first slot in the tree's order.
    #[must_use]
    #[inline]
    pub fn first(&self) -> usize {
        (self.link & INDEX) as usize
    }

    /// Number of primitives of a leaf; 0 for an inner node.
    #[must_use]
    #[inline]
    pub fn count(&self) -> usize {
        if self.is_leaf() { (self.aux >> 8) as usize } else { 0 }
    }

    /// The reference area of an inner node: what its half area was, in units that the update chooses, when the node
    /// was last built. 0 until it is set, and for a leaf. Rotations carry it along.
    #[must_use]
    #[inline]
    pub fn reference(&self) -> f32 {
        if self.is_leaf() { 0.0 } else { f32::from_bits(self.aux & !HEIGHT) }
    }

    /// Sets the reference area of an inner node, with 16 bits of precision, rounded down. Does nothing to a leaf.
    #[inline]
    pub fn set_reference(&mut self, area: f32) {
        if !self.is_leaf() {
            self.aux = area.to_bits() & !HEIGHT | self.aux & HEIGHT;
        }
    }

    /// What the node's half area counts in the SAH cost: see [`sah_cost`](crate::sah_cost).
    #[must_use]
    #[inline]
    pub fn weight(&self) -> f64 {
        if self.is_leaf() { COST_INTERSECT * self.count() as f64 } else { COST_TRAVERSE }
    }

    /// Number of edges on the longest way down to a leaf.
    #[must_use]
    #[inline]
    pub fn height(&self) -> u32 {
        self.aux & HEIGHT
    }

    /// A leaf's height is 0.
    #[inline]
    pub(crate) fn clear_leaf_height(&mut self) {
        if self.is_leaf() {
            self.aux &= !HEIGHT;
        }
    }

    #[inline]
    pub(crate) fn set_height_and_moves(&mut self, l: &Self, r: &Self) {
        let aabb = self.aabb();
        self.refit(l, r);
        self.set_aabb(aabb);
    }

    /// The parent of `l` and `r`, which are or will be the child nodes `left` and `left + 1`.
    ///
    /// # Panics
    /// As [`inner`](Self::inner).
    #[must_use]
    #[inline]
    pub fn parent(l: &Self, r: &Self, left: u32) -> Self {
        let mut node = Self::inner(Aabb::EMPTY, left);
        node.refit(l, r);
        node
    }

    /// Makes this inner node the parent of `l` and `r` as far as box, height and motion go.
    #[inline]
    pub fn refit(&mut self, l: &Self, r: &Self) {
        let height = 1 + l.height().max(r.height());
        let moves = (l.link | r.link) & MOVES;
        let link = self.link & !MOVES | moves;
        let aux = self.aux & !HEIGHT | height;
        // Boxes by the vector; what comes of the fourth lanes is replaced.
        let [[l_min, l_max], [r_min, r_max]]: [[Vec4; 2]; 2] = [bytemuck::cast(*l), bytemuck::cast(*r)];
        let (min, max) = (l_min.min(r_min), l_max.max(r_max));
        *self = Self::from_lanes(min, max, link, aux);
    }

    /// The first three lanes of the vectors, with the other two words in their fourth.
    #[inline]
    fn from_lanes(min: Vec4, max: Vec4, link: u32, aux: u32) -> Self {
        bytemuck::cast([min.with_w(f32::from_bits(link)), max.with_w(f32::from_bits(aux))])
    }
}
