//! Linear BVH: splits along the Morton curve through the centres of the boxes (Lauterbach, Garland,
//! Sengupta, Luebke, Manocha 2009, "Fast BVH construction on GPUs").
//!
//! A node holds all primitives whose codes agree in some leading bits and its children differ in
//! the next one that is not the same for all. Where codes are equal, the bits of the primitives'
//! numbers follow: halves of the order in which they were given. No path is longer than a key has
//! bits of either, at most 63 + 29.

use bvh_core::glam::Vec4;
use bvh_core::{MAX_HEIGHT, Node, prefetch};
use rayon::prelude::*;

use crate::lists::bytes_of;
use crate::prim_ref::{Bounds, PrimRef};
use crate::radix::{Counts, Key, sort};
use crate::subtree_slot::SubtreeSlot;

/// Subtrees of fewer primitives are built by one thread.
// Half and double: docs/TUNING.md.
const GRAIN: usize = 4096;

/// How many primitives ahead boxes are fetched.
pub(crate) const AHEAD: usize = 32;

/// Memory for codes and their order.
#[derive(Default)]
pub(crate) struct Codes {
    short: Vec<u64>,
    short_spare: Vec<u64>,
    long: Vec<u128>,
    long_spare: Vec<u128>,
    counts: Vec<Counts>,
}

/// The primitives' places along the curve.
pub(crate) enum Sorted<'a> {
    Short(&'a [u64]),
    Long(&'a [u128]),
}

/// Evaluates `$body` with the keys of a [`Sorted`].
macro_rules! with_keys {
    ($sorted:expr, $keys:ident => $body:expr) => {
        match $sorted {
            $crate::morton::Sorted::Short($keys) => $body,
            $crate::morton::Sorted::Long($keys) => $body,
        }
    };
}
pub(crate) use with_keys;

impl Codes {
    pub(crate) fn memory_usage(&self) -> usize {
        let Self { short, short_spare, long, long_spare, counts } = self;
        let short = bytes_of(short) + bytes_of(short_spare);
        short + bytes_of(long) + bytes_of(long_spare) + bytes_of(counts)
    }

    /// Sorts primitives along the curve; `centers` are the bounds of their centres.
    ///
    /// Codes have 39 bits, what fits into 64 beside the number of one in 16 million. They have 63
    /// if there are more primitives, or if more than half of them would share their code with the
    /// one before.
    pub(crate) fn sort(&mut self, prims: &[PrimRef], centers: &Bounds, threads: usize) -> Sorted<'_> {
        let Self { short, short_spare, long, long_spare, counts } = self;
        if prims.len() <= 1 << u64::LOW {
            encode(prims, centers, short, threads);
            sort(short, short_spare, counts, threads);
            if equal(short, threads) <= prims.len() / 2 {
                return Sorted::Short(short);
            }
        }
        encode(prims, centers, long, threads);
        sort(long, long_spare, counts, threads);
        Sorted::Long(long)
    }
}

/// Fewest parts for a task: all where there is one thread, which takes microseconds to wake. The
/// parts themselves never depend on threads.
pub(crate) fn least_parts(threads: usize) -> usize {
    if threads > 1 { 1 } else { usize::MAX }
}

/// How many sorted keys share their code with the one before, but for the first of each part.
fn equal(keys: &[u64], threads: usize) -> usize {
    let equal = |keys: &[u64]| keys.windows(2).filter(|key| (key[0] ^ key[1]) >> u64::LOW == 0).count();
    keys.par_chunks(GRAIN).with_min_len(least_parts(threads)).map(equal).sum()
}

/// The cells of the curve: cubes, so that equal distances count alike on all axes.
#[derive(Clone, Copy)]
struct Grid {
    min: Vec4,
    scale: Vec4,
    last: Vec4,
}

impl Grid {
    fn new(centers: &Bounds, bits: u32) -> Self {
        let extent = (centers.max - centers.min).truncate().max_element();
        let cells = (1u32 << bits) as f32;
        let scale = cells / extent;
        let scale = Vec4::splat(if scale < f32::INFINITY { scale } else { 0.0 });
        Self { min: centers.min, scale, last: Vec4::splat(cells - 1.0) }
    }

    /// The keys of primitives, the first of which has the place `first`.
    // Not inlined into what shares it out, where the compiler keeps less of it in registers.
    #[inline(never)]
    fn encode<K: Key>(self, prims: &[PrimRef], first: usize, keys: &mut [K]) {
        for ((prim, key), number) in prims.iter().zip(keys).zip(first as u32..) {
            let cell = floor(((prim.center() - self.min) * self.scale).min(self.last));
            *key = K::new(interleave::<K>(cell), number);
        }
    }
}

/// The keys of all primitives: codes, and below them the places in `prims`.
fn encode<K: Key>(prims: &[PrimRef], centers: &Bounds, keys: &mut Vec<K>, threads: usize) {
    crate::lists::make_room(keys, prims.len(), K::MAX, threads);
    let grid = Grid::new(centers, K::AXIS);
    let parts = prims.par_chunks(GRAIN).zip(keys.par_chunks_mut(GRAIN)).enumerate();
    let parts = parts.with_min_len(least_parts(threads));
    parts.for_each(|(i, (prims, keys))| grid.encode(prims, i * GRAIN, keys));
}

/// The integers below numbers from 0 to 2^22, in the lowest bits of each lane.
#[inline]
fn floor(v: Vec4) -> [u32; 4] {
    // At 2^23 the lowest bit of a number counts ones. A conversion to integers would go lane by
    // lane.
    let unit = Vec4::splat((1 << 23) as f32);
    let rounded = v + unit;
    let above = (rounded - unit).cmpgt(v);
    (rounded - Vec4::select(above, Vec4::ONE, Vec4::ZERO)).to_array().map(f32::to_bits)
}

/// Bit `i` of a number in bit `3 i`, for numbers of 7 bits.
const SPREAD: [u32; 128] = {
    let mut spread = [0; 128];
    let mut i = 1;
    while i < 128 {
        spread[i] = spread[i / 2] << 3 | i as u32 & 1;
        i += 1;
    }
    spread
};

/// The lowest bits of three coordinates, those of the first in front.
#[inline]
fn interleave<K: Key>([x, y, z, _]: [u32; 4]) -> u64 {
    let spread = |v: u32, bit: u32| SPREAD[(v >> bit & 127) as usize];
    let seven = |bit| u64::from(spread(x, bit) << 2 | spread(y, bit) << 1 | spread(z, bit)) << (3 * bit);
    (0..K::AXIS).step_by(7).fold(0, |code, bit| code | seven(bit))
}

/// Builds the subtree over the primitives with these keys, which are neighbours along the curve.
pub(crate) fn build<K: Key>(keys: &[K], prims: &[PrimRef], parallel: bool, slot: SubtreeSlot) {
    if !parallel || keys.len() < GRAIN {
        return emit(keys, prims, slot);
    }
    let (l, r) = split(keys);
    slot.fork(l.len(), |slot_l, slot_r| {
        rayon::join(|| build(l, prims, parallel, slot_l), || build(r, prims, parallel, slot_r))
    });
}

/// The two halves of a node of at least two primitives.
pub(crate) fn split<K: Key>(keys: &[K]) -> (&[K], &[K]) {
    let bit = (keys[0] ^ keys[keys.len() - 1]).highest();
    keys.split_at(keys.partition_point(|key| key.bits_from(bit) & 1 == 0))
}

/// Builds the subtree over neighbours along the curve in one pass from the last to the first.
///
/// Two neighbouring subtrees become one as soon as the keys on either side of both differ in a
/// higher bit than those between them. Nodes come about children first, the right ones before the
/// left ones, and are written from the end: that is depth first, parents first and left before
/// right, when read from the start.
fn emit<K: Key>(keys: &[K], prims: &[PrimRef], slot: SubtreeSlot) {
    let SubtreeSlot { root, below, first_node, order, first_slot, .. } = slot;
    // Subtrees to the right that are yet to become part of another, the next one last, and how the
    // keys differ between each and what is left of it. Differences decrease, so there are no more
    // than bits in a key.
    let mut pending = [(Node::NOTHING, K::MAX); MAX_HEIGHT as usize];
    let mut count = 0;
    let mut next = below.len();
    let mut node = Node::NOTHING;
    for s in (0..keys.len()).rev() {
        prefetch(prims, keys[s.saturating_sub(AHEAD)].number() as usize);
        let prim = &prims[keys[s].number() as usize];
        order[s] = prim.number();
        node = Node::leaf(prim.bounds().aabb(), first_slot + s as u32, 1);
        let difference = if s > 0 { keys[s - 1] ^ keys[s] } else { K::MAX };
        while count > 0 && pending[count - 1].1 < difference {
            count -= 1;
            next -= 2;
            below[next] = node;
            below[next + 1] = pending[count].0;
            node = Node::parent(&node, &pending[count].0, first_node + next as u32);
        }
        pending[count] = (node, difference);
        count += 1;
    }
    *root = node;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether codes are short or long follows from it, and so does the tree.
    #[test]
    fn how_many_codes_are_equal_does_not_depend_on_threads() {
        let keys: Vec<u64> = (0..3 * GRAIN as u32).map(|i| Key::new(7, i)).collect();
        assert_eq!([1, 2, 8].map(|threads| equal(&keys, threads)), [3 * (GRAIN - 1); 3]);
    }
}
