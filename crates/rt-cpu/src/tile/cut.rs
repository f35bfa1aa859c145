//! The top of the tree, opened once for all packets of a tile.

use bvh_core::{Node, prefetch};
use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::frustum::{Frame, Frustum, Outline};
use crate::simd::{load, max};
use crate::wide::V;

/// Subtrees of a cut; a multiple of all vector lengths.
const CUT: usize = 48;

/// The top of the tree as a tile sees it: subtrees, nearest first.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(super) struct Cut {
    outlines: Outline<[f32; CUT]>,
    pub(super) near: [f32; CUT],
    pub(super) node: [u32; CUT],
    pub(super) count: usize,
}

impl Cut {
    /// Opens the tree's top: the largest inner nodes first, by half area. Gives their number.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(
        &mut self,
        simd: S,
        nodes: &[Node],
        frame: &Frame,
        frustum: &Frustum,
        t_max: f32,
    ) -> u64 {
        let mut opened = [0; CUT];
        let mut outlines = [frame.outline(&nodes[0].aabb(), frustum); CUT];
        // Half areas, 0 for leaves and where they are NaN.
        let mut sizes = [0.0; CUT];
        let (mut count, mut visited) = (1, 0);
        sizes[0] = size(&nodes[0]);
        'open: loop {
            // From the last on, so that what takes the place of a node is never one still to be
            // opened.
            let mut large = large(simd, &sizes);
            if large == 0 {
                break;
            }
            while large != 0 {
                if count == CUT {
                    break 'open;
                }
                let i = 63 - large.leading_zeros() as usize;
                large ^= 1 << i;
                let first = nodes[opened[i] as usize].first();
                let [l, r] = [nodes[first], nodes[first + 1]];
                visited += 1;
                count -= 1;
                (opened[i], sizes[i], outlines[i]) = (opened[count], sizes[count], outlines[count]);
                sizes[count] = 0.0;
                for (side, child) in [l, r].iter().enumerate() {
                    let outline = frame.outline(&child.aabb(), frustum);
                    if frustum.meets(&outline) && frame.enters(&outline) <= t_max {
                        opened[count] = (first + side) as u32;
                        (sizes[count], outlines[count]) = (size(child), outline);
                        if !child.is_leaf() {
                            prefetch(nodes, child.first());
                        }
                        count += 1;
                    }
                }
            }
        }
        let mut near = [f32::INFINITY; CUT];
        for (near, outline) in near[..count].iter_mut().zip(&outlines) {
            *near = frame.enters(outline);
        }
        for i in 0..count {
            let place = rank(simd, &near, i);
            for (to, from) in self.outlines.as_flattened_mut().iter_mut().zip(outlines[i].as_flattened()) {
                to[place] = *from;
            }
            (self.near[place], self.node[place]) = (near[i], opened[i]);
        }
        self.count = count;
        visited
    }

    /// Bits of the subtrees that a frustum meets.
    #[inline(always)]
    pub(super) fn met<S: Simd>(&self, simd: S, frustum: &Frustum) -> u64 {
        let mut met = 0;
        for at in (0..CUT).step_by(S::f32s::LEN) {
            let [x, y, z] = &self.outlines;
            let x = [load::<S, S::f32s, CUT>(simd, &x[0], at), load(simd, &x[1], at)];
            let y = [load(simd, &y[0], at), load(simd, &y[1], at)];
            let z = [load(simd, &z[0], at), load(simd, &z[1], at)];
            met |= frustum.meets_lanes(simd, [x, y, z]) << at;
        }
        met & ((1 << self.count) - 1)
    }
}

#[inline(always)]
fn size(node: &Node) -> f32 {
    if node.is_leaf() { 0.0 } else { f32::max(node.aabb().half_area(), 0.0) }
}

/// The places of all numbers from half the greatest on: opened together, they do not wait for each
/// other's memory.
#[inline(always)]
fn large<S: Simd>(simd: S, sizes: &[f32; CUT]) -> u64 {
    let [a, b, c] = [load::<S, V<S>, CUT>(simd, sizes, 0), load(simd, sizes, 16), load(simd, sizes, 32)];
    let greatest = max(max(a, b), c).reduce_max();
    if greatest <= 0.0 {
        return 0;
    }
    let half = greatest * 0.5;
    let [a, b, c] = [a.simd_ge(half), b.simd_ge(half), c.simd_ge(half)];
    a.to_bitmask() | b.to_bitmask() << 16 | c.to_bitmask() << 32
}

/// The place of number `i` when all are sorted, equals in their order.
#[inline(always)]
fn rank<S: Simd>(simd: S, numbers: &[f32; CUT], i: usize) -> usize {
    let (mut less, mut equal) = (0, 0);
    for at in (0..CUT).step_by(16) {
        let all: V<S> = load(simd, numbers, at);
        less |= all.simd_lt(numbers[i]).to_bitmask() << at;
        equal |= all.simd_eq(numbers[i]).to_bitmask() << at;
    }
    (less | equal & ((1 << i) - 1)).count_ones() as usize
}
