//! The top of the tree, opened once for all packets of a tile.

use bvh_core::Node;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::beam::{Beam, Frame, Outline};
use crate::simd::{load, max};
use crate::single::Work;

/// Subtrees of a cut; a multiple of all vector lengths.
const CUT: usize = 48;

/// The top of the tree as a tile sees it: subtrees, nearest first.
#[repr(C, align(64))]
pub(super) struct Cut {
    x: [[f32; CUT]; 2],
    y: [[f32; CUT]; 2],
    z: [[f32; CUT]; 2],
    pub(super) near: [f32; CUT],
    pub(super) node: [u32; CUT],
    pub(super) count: usize,
}

/// A subtree of a cut.
#[derive(Clone, Copy)]
struct Piece {
    node: u32,
    near: f32,
    outline: Outline,
}

impl Cut {
    pub(super) fn new() -> Self {
        let none = [0.0; CUT];
        Self { x: [none; 2], y: [none; 2], z: [none; 2], near: none, node: [0; CUT], count: 0 }
    }

    /// Opens the tree's top: the largest inner node first, by half area.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(
        &mut self,
        simd: S,
        nodes: &[Node],
        frame: &Frame,
        beam: &Beam,
        t_max: f32,
        work: &mut Work,
    ) {
        let nothing = Outline { x: [0.0; 2], y: [0.0; 2], z: [0.0; 2] };
        let mut pieces = [Piece { node: 0, near: 0.0, outline: nothing }; CUT];
        // Half areas, 0 for leaves and where they are NaN; apart from the rest because all of them are read again and again.
        let mut sizes = [0.0; CUT];
        let (mut count, mut n) = (0, 0);
        loop {
            let aabb = nodes[n].aabb();
            let outline = frame.outline(&aabb, beam);
            let near = frame.enters(&outline);
            if beam.meets(&outline) && near <= t_max {
                pieces[count] = Piece { node: n as u32, near, outline };
                sizes[count] = if nodes[n].is_leaf() { 0.0 } else { f32::max(aabb.half_area(), 0.0) };
                count += 1;
            }
            if n & 1 == 0 && n != 0 {
                n += 1;
                continue;
            }
            let Some(largest) = largest(simd, &sizes).filter(|_| count < CUT) else { break };
            n = nodes[pieces[largest].node as usize].first();
            work.nodes += 1;
            count -= 1;
            (pieces[largest], sizes[largest]) = (pieces[count], sizes[count]);
            sizes[count] = 0.0;
        }
        let mut order = [0; CUT];
        for (i, (key, piece)) in order.iter_mut().zip(&pieces[..count]).enumerate() {
            // Bits of numbers that are not negative are in the order of the numbers.
            *key = u64::from(piece.near.to_bits()) << 32 | i as u64;
        }
        order[..count].sort_unstable();
        for (i, &key) in order[..count].iter().enumerate() {
            let Piece { node, near, outline } = pieces[key as u32 as usize];
            for side in 0..2 {
                self.x[side][i] = outline.x[side];
                self.y[side][i] = outline.y[side];
                self.z[side][i] = outline.z[side];
            }
            (self.near[i], self.node[i]) = (near, node);
        }
        self.count = count;
    }

    /// Bits of the subtrees that a beam meets.
    #[inline(always)]
    pub(super) fn met<S: Simd>(&self, simd: S, beam: &Beam) -> u64 {
        let mut met = 0;
        for at in (0..CUT).step_by(S::f32s::LEN) {
            let x = [load::<S, S::f32s, CUT>(simd, &self.x[0], at), load(simd, &self.x[1], at)];
            let y = [load(simd, &self.y[0], at), load(simd, &self.y[1], at)];
            let z = [load(simd, &self.z[0], at), load(simd, &self.z[1], at)];
            met |= beam.meets_lanes(simd, x, y, z) << at;
        }
        met & ((1 << self.count) - 1)
    }
}

/// The place of the greatest of numbers, unless all are 0.
#[inline(always)]
fn largest<S: Simd>(simd: S, sizes: &[f32; CUT]) -> Option<usize> {
    type V<S> = fearless_simd::f32x16<S>;
    let [a, b, c] = [load::<S, V<S>, CUT>(simd, sizes, 0), load(simd, sizes, 16), load(simd, sizes, 32)];
    let greatest = max(max(a, b), c).reduce_max();
    let [a, b, c] = [a.simd_eq(greatest), b.simd_eq(greatest), c.simd_eq(greatest)];
    let places = a.to_bitmask() | b.to_bitmask() << 16 | c.to_bitmask() << 32;
    (greatest > 0.0).then_some(places.trailing_zeros() as usize)
}
