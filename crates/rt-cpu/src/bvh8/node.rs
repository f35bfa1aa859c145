//! A node of eight children, plane by plane.

use bvh_core::Aabb;
use bytemuck::{Pod, Zeroable};

/// Children of a node.
pub(super) const WIDTH: usize = 8;

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
pub(crate) struct Node8(pub(super) [[f32; WIDTH]; 8]);

/// Row of what is in the boxes.
pub(super) const CHILDREN: usize = 3;
pub(super) const LEAF: u32 = 1 << 31;

impl Node8 {
    pub(super) const EMPTY: Self = {
        let (min, max, none) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH], [0.0; WIDTH]);
        Self([min, min, min, none, max, max, max, none])
    };

    #[inline]
    pub(super) fn set(&mut self, i: usize, aabb: &Aabb, child: u32) {
        for axis in 0..3 {
            self.0[axis][i] = aabb.min[axis];
            self.0[axis + 4][i] = aabb.max[axis];
        }
        self.0[CHILDREN][i] = f32::from_bits(child);
    }
}
