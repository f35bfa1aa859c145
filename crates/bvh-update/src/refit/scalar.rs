//! The kernels for any processor.

use std::ops::{Add, Mul, Range, Sub};

use bvh_core::glam::{Mat4, Vec4};

use super::Tally;
use super::block::{Block, Entry, Leaves, Lister};
pub(super) use super::kernels::{fit_leaves, refit_boxes};
use super::rotations::{self, Accepted, Boxes, define_rotate};
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

/// Which nodes have a change below zero. A NaN is no gain.
#[inline(always)]
fn gains(changes: [Vec4; 6]) -> u32 {
    let [a, b, c, d, e, f] = changes.map(|change| change.cmplt(Vec4::ZERO));
    (a | b | c | d | e | f).bitmask()
}

define_rotate! {
    zero: Vec4::ZERO, min: Vec4::min, max: Vec4::max, add: Vec4::add, sub: Vec4::sub, mul: Vec4::mul
}
