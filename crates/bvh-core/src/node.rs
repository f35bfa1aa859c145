//! One node: 32 bytes, two to a cache line.

use glam::{Vec3, Vec4};

use crate::Aabb;

/// Largest number of primitives in one leaf.
pub const MAX_LEAF_SIZE: u32 = (1 << 24) - 1;

/// Cost of visiting an inner node.
pub const COST_TRAVERSE: f64 = 1.0;

/// Cost of testing one primitive.
pub const COST_INTERSECT: f64 = 1.0;

/// A node of a [`Bvh`](crate::Bvh), inner or leaf, with its box.
///
/// ```text
/// byte  0  min   3 x f32
///      12  link  bit 31     leaf
///                bit 30     dynamic: a primitive below may move
///                bits 0-29  inner: number of the left child node (even; the right child follows it)
///                           leaf:  first slot in the tree's order of primitives
///      16  max   3 x f32
///      28  aux   bits 8-31  leaf: number of primitives
///                           inner: reference area, the upper bits of an f32
///                bits 0-7   height: 0 for a leaf, else 1 + the greater height of the children
/// ```
///
/// A node holds all that a rotation must carry along with it. So swapping two slots of the arena
/// moves two whole subtrees.
///
/// ```
/// use bvh_core::{Aabb, Node, Vec3};
///
/// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
/// let leaf = Node::leaf(unit, 0, 2);
/// assert_eq!((leaf.is_leaf(), leaf.count(), leaf.sah_term()), (true, 2, 6.0));
/// let inner = Node::parent(&leaf, &Node::leaf(unit.grown(1.0), 2, 1), 2);
/// assert_eq!((inner.first(), inner.height(), inner.sah_term()), (2, 1, 27.0));
/// ```
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
    /// Bit of the link word, for SIMD kernels: [`is_leaf`](Self::is_leaf).
    pub const LEAF: u32 = 1 << 31;

    /// Bit of the link word, for SIMD kernels: [`is_dynamic`](Self::is_dynamic).
    pub const DYNAMIC: u32 = 1 << 30;

    /// Bits of the link word, for SIMD kernels: [`first`](Self::first).
    pub const INDEX: u32 = Self::DYNAMIC - 1;

    /// Bits of the aux word, for SIMD kernels: [`height`](Self::height).
    pub const HEIGHT: u32 = 0xff;

    /// A leaf without primitives: the root of an empty tree, and what fills unused slots.
    pub const NOTHING: Self = Self { min: Vec3::INFINITY, link: Self::LEAF, max: Vec3::NEG_INFINITY, aux: 0 };

    /// Makes a dynamic leaf over the slots `first .. first + count` of the tree's order.
    ///
    /// # Panics
    /// In debug builds, if `first` exceeds 30 bits or `count` exceeds [`MAX_LEAF_SIZE`].
    #[must_use]
    #[inline]
    pub const fn leaf(aabb: Aabb, first: u32, count: u32) -> Self {
        debug_assert!(first <= Self::INDEX && count <= MAX_LEAF_SIZE, "leaf out of range");
        let link = Self::LEAF | Self::DYNAMIC | first & Self::INDEX;
        Self { min: aabb.min, link, max: aabb.max, aux: count << 8 }
    }

    /// Makes a dynamic inner node over the child nodes `left` and `left + 1`, of height 1.
    ///
    /// # Panics
    /// In debug builds, if `left` is odd or exceeds 30 bits.
    #[must_use]
    #[inline]
    pub fn inner(aabb: Aabb, left: u32) -> Self {
        debug_assert!(left <= Self::INDEX && left.is_multiple_of(2), "child pair {left} out of range");
        Self { min: aabb.min, link: Self::DYNAMIC | left & Self::INDEX, max: aabb.max, aux: 1 }
    }

    /// Returns the node's box.
    #[must_use]
    #[inline]
    pub fn aabb(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }

    /// Replaces the box.
    #[inline]
    pub fn set_aabb(&mut self, aabb: Aabb) {
        // Whole-node store: a store of part of a node, followed by a wider load, stalls the
        // pipeline.
        *self = Self { min: aabb.min, link: self.link, max: aabb.max, aux: self.aux };
    }

    /// Returns whether this is a leaf.
    #[must_use]
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.link & Self::LEAF != 0
    }

    /// Returns whether any primitive at or below this node may move; see
    /// [`Bvh::set_dynamic`](crate::Bvh::set_dynamic).
    #[must_use]
    #[inline]
    pub fn is_dynamic(&self) -> bool {
        self.link & Self::DYNAMIC != 0
    }

    #[inline]
    pub(crate) fn set_dynamic(&mut self, dynamic: bool) {
        self.link = self.link & !Self::DYNAMIC | if dynamic { Self::DYNAMIC } else { 0 };
    }

    /// Returns, of an inner node, the number of the left child, which the right child follows; of a
    /// leaf, the first slot in the order of primitives.
    #[must_use]
    #[inline]
    pub fn first(&self) -> usize {
        (self.link & Self::INDEX) as usize
    }

    /// Returns the number of primitives of a leaf; 0 for an inner node.
    #[must_use]
    #[inline]
    pub fn count(&self) -> usize {
        if self.is_leaf() { (self.aux >> 8) as usize } else { 0 }
    }

    /// Returns the reference area of an inner node: its half area when the node was last built, in
    /// a unit that the update chooses. 0 until it is set, and for a leaf. Rotations carry it along.
    #[must_use]
    #[inline]
    pub fn reference(&self) -> f32 {
        if self.is_leaf() { 0.0 } else { f32::from_bits(self.aux & !Self::HEIGHT) }
    }

    /// Sets the reference area of an inner node, rounded down to 16 bits of precision; infinite for
    /// NaN, whose bits processors do not agree on. Does nothing to a leaf.
    #[inline]
    pub fn set_reference(&mut self, area: f32) {
        if !self.is_leaf() {
            self.aux = area.min(f32::INFINITY).to_bits() & !Self::HEIGHT | self.aux & Self::HEIGHT;
        }
    }

    /// Returns the factor of the node's half area in the SAH cost: [`COST_TRAVERSE`] for an inner
    /// node, [`COST_INTERSECT`] times the number of primitives for a leaf.
    #[must_use]
    #[inline]
    pub fn weight(&self) -> f64 {
        if self.is_leaf() { COST_INTERSECT * self.count() as f64 } else { COST_TRAVERSE }
    }

    /// Returns the node's term of the SAH cost before normalisation, [`weight`](Self::weight) times
    /// half area; see [`sah_cost`](crate::sah_cost).
    #[must_use]
    #[inline]
    pub fn sah_term(&self) -> f64 {
        self.aabb().half_area_f64() * self.weight()
    }

    /// Returns the node's part of [`Bvh::static_area`](crate::Bvh::static_area):
    /// [`sah_term`](Self::sah_term) of a static node, else 0.
    #[doc(hidden)]
    #[must_use]
    #[inline]
    pub fn static_term(&self) -> f64 {
        if self.is_dynamic() { 0.0 } else { self.sah_term() }
    }

    /// Returns the number of edges on the longest path down to a leaf.
    #[must_use]
    #[inline]
    pub fn height(&self) -> u32 {
        self.aux & Self::HEIGHT
    }

    /// A leaf's height is 0.
    #[inline]
    pub(crate) fn clear_leaf_height(&mut self) {
        if self.is_leaf() {
            self.aux &= !Self::HEIGHT;
        }
    }

    /// Sets height and dynamic bit from the children and keeps the box, unless there is nothing in
    /// it: what has no primitives is static, so no update would make that box tight.
    #[inline]
    pub(crate) fn refit_metadata(&mut self, l: &Self, r: &Self) {
        let aabb = self.aabb();
        self.refit(l, r);
        if !self.aabb().is_empty() {
            self.set_aabb(aabb);
        }
    }

    /// Makes the parent of `l` and `r`, which are or will be the child nodes `left` and `left + 1`.
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

    /// Sets box, height and dynamic bit of this inner node from its children.
    #[inline]
    pub fn refit(&mut self, l: &Self, r: &Self) {
        let height = 1 + l.height().max(r.height());
        let link = self.link & !Self::DYNAMIC | (l.link | r.link) & Self::DYNAMIC;
        let aux = self.aux & !Self::HEIGHT | height;
        // Vector operations; the fourth lanes are overwritten.
        let [[l_min, l_max], [r_min, r_max]]: [[Vec4; 2]; 2] = [bytemuck::cast(*l), bytemuck::cast(*r)];
        let (min, max) = (l_min.min(r_min), l_max.max(r_max));
        *self = bytemuck::cast([min.with_w(f32::from_bits(link)), max.with_w(f32::from_bits(aux))]);
    }
}
