//! The kernels for any processor.

use std::ops::{Add, Mul, Range, Sub};

use bvh_core::glam::{Mat4, Vec4};
use bvh_core::rotation::NO_GAIN;

use super::Tally;
use super::block::{Block, Entry, Leaves, Lister};
pub(super) use super::kernels::{fit_leaves, refit_boxes};
use super::rotations::{self, Accepted, BestRotations, Boxes, define_rotate};
use super::shared::{PairAt, SharedNodes};

/// See [`Block::walk`].
#[inline(always)]
pub(super) fn walk(block: &mut Block, nodes: SharedNodes<'_>, roots: &[Entry], leaves: &mut Leaves) {
    block.walk(nodes, roots, leaves, |parents, count, lister| {
        for &parent in &parents[..count] {
            let links = lister.children(nodes, parent);
            lister.rotating(parent, links);
        }
    });
}

/// Lists the nodes of successive pairs.
#[inline(always)]
pub(super) fn sweep(nodes: SharedNodes<'_>, pairs: Range<usize>, lister: &mut Lister<'_>) {
    for pair in pairs {
        lister.children(nodes, Entry::new(0, 2 * pair as u32));
    }
}

/// Nodes that are judged at a time.
const WIDTH: usize = 4;

/// The boxes of the nodes on one side of all pairs.
#[inline(always)]
fn boxes(pairs: &[PairAt<'_>; WIDTH], side: usize) -> Boxes<Vec4> {
    let half = |i: usize| {
        let row = |j: usize| pairs[j].part(2 * side + i);
        let columns = Mat4::from_cols(row(0), row(1), row(2), row(3)).transpose();
        [columns.x_axis, columns.y_axis, columns.z_axis]
    };
    Boxes { min: half(0), max: half(1) }
}

/// The best rotation of each node, given the changes under all. A NaN is no gain.
#[inline(always)]
pub(super) fn best(changes: [Vec4; 6]) -> BestRotations<WIDTH> {
    let (mut least, mut rotations) = (Vec4::splat(NO_GAIN), Vec4::ZERO);
    for (i, change) in (0..).zip(changes) {
        let is_less = change.cmplt(least);
        least = Vec4::select(is_less, change, least);
        rotations = Vec4::select(is_less, Vec4::splat(f32::from_bits(i)), rotations);
    }
    let gains = least.cmplt(Vec4::splat(NO_GAIN)).bitmask();
    BestRotations { gains, changes: least.to_array(), rotations: bytemuck::cast(rotations) }
}

define_rotate! {
    zero: Vec4::ZERO, min: Vec4::min, max: Vec4::max, add: Vec4::add, sub: Vec4::sub, mul: Vec4::mul
}
