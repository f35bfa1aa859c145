//! Full sweep SAH, the exact greedy build: O(n log n) by lists that are sorted once and stay so.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use rayon::prelude::*;

use crate::prim_ref::{Bounds, PrimRef};
use crate::subtree_slot::SubtreeSlot;

/// Subtrees of fewer primitives are built by one thread.
// Half and double: docs/TUNING.md.
const GRAIN: usize = 4096;

/// Builds the tree over `prims`, which have boxes and numbers below `count`.
pub(crate) fn build(prims: &[PrimRef], count: usize, parallel: bool, slot: SubtreeSlot) {
    let sweep = Sweep { parallel, is_left: (0..count).map(|_| AtomicBool::new(false)).collect() };
    sweep.build(prims, slot);
}

struct Sweep {
    parallel: bool,
    /// For each primitive, on which side of its present subtree's split it is. Atomic only because
    /// subtrees, whose primitives are disjoint, share it.
    is_left: Vec<AtomicBool>,
}

/// The primitives of a subtree: sorted on each axis, and room for as many.
struct Lists<'a> {
    sorted: [&'a mut [PrimRef]; 3],
    spare: &'a mut [PrimRef],
    costs: &'a mut [f32],
}

impl<'a> Lists<'a> {
    fn split_at(self, n: usize) -> (Self, Self) {
        let [x, y, z] = self.sorted.map(|list| list.split_at_mut(n));
        let (spare, costs) = (self.spare.split_at_mut(n), self.costs.split_at_mut(n));
        (
            Self { sorted: [x.0, y.0, z.0], spare: spare.0, costs: costs.0 },
            Self { sorted: [x.1, y.1, z.1], spare: spare.1, costs: costs.1 },
        )
    }
}

impl Sweep {
    fn build(&self, prims: &[PrimRef], slot: SubtreeSlot) {
        let mut sorted = [0, 1, 2].map(|axis| self.sort(prims, axis));
        let mut spare = prims.to_vec();
        let mut costs = vec![0.0; spare.len()];
        let sorted = sorted.each_mut().map(Vec::as_mut_slice);
        self.subtree(Lists { sorted, spare: &mut spare, costs: &mut costs }, slot);
    }

    /// The primitives by their centres on an axis; ties by number.
    fn sort(&self, prims: &[PrimRef], axis: usize) -> Vec<PrimRef> {
        let key = |(place, prim): (usize, &PrimRef)| {
            let bits = prim.center_on(axis).to_bits();
            // The order of these bits as integers is that of the numbers.
            let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
            u64::from(ordered) << 32 | place as u64
        };
        let mut keys: Vec<u64> = prims.iter().enumerate().map(key).collect();
        if self.parallel {
            keys.par_sort_unstable();
        } else {
            keys.sort_unstable();
        }
        keys.into_iter().map(|key| prims[key as u32 as usize]).collect()
    }

    fn subtree(&self, mut lists: Lists, slot: SubtreeSlot) {
        let n = lists.costs.len();
        if n == 1 {
            return slot.leaf(&lists.sorted[0][0]);
        }
        let split = if slot.any_split_fits(1) { best_split(&mut lists) } else { None };
        let (axis, left) = split.unwrap_or_else(|| (widest(&lists), n / 2));
        if n > 2 {
            self.partition(&mut lists, axis, left);
        }
        let (l, r) = lists.split_at(left);
        slot.fork(left, |slot_l, slot_r| {
            if self.parallel && n > GRAIN {
                rayon::join(|| self.subtree(l, slot_l), || self.subtree(r, slot_r))
            } else {
                (self.subtree(l, slot_l), self.subtree(r, slot_r))
            }
        });
    }

    /// Brings the first `left` primitives of one axis' list to the front of the others', keeping
    /// their order.
    fn partition(&self, lists: &mut Lists, axis: usize, left: usize) {
        for (i, prim) in lists.sorted[axis].iter().enumerate() {
            self.is_left[prim.number() as usize].store(i < left, Relaxed);
        }
        for other in (0..3).filter(|&other| other != axis) {
            let list = &mut *lists.sorted[other];
            let (mut l, mut r) = (0, 0);
            for i in 0..list.len() {
                let prim = list[i];
                let is_left = self.is_left[prim.number() as usize].load(Relaxed);
                list[l] = prim;
                lists.spare[r] = prim;
                l += usize::from(is_left);
                r += usize::from(!is_left);
            }
            list[l..].copy_from_slice(&lists.spare[..r]);
        }
    }
}

/// The cheapest split, as an axis and how many of its list are left of it; of equals the most even,
/// then the first, x before y before z. None if no centres differ.
fn best_split(lists: &mut Lists) -> Option<(usize, usize)> {
    let n = lists.costs.len();
    let (mut best, mut unevenness, mut split) = (f32::INFINITY, n, None);
    for (axis, list) in lists.sorted.iter().enumerate() {
        if spread(list, axis) <= 0.0 {
            continue;
        }
        let mut bounds = Bounds::EMPTY;
        for i in (1..n).rev() {
            bounds = bounds.union(list[i].bounds());
            lists.costs[i] = bounds.half_area() * (n - i) as f32;
        }
        bounds = Bounds::EMPTY;
        for i in 1..n {
            bounds = bounds.union(list[i - 1].bounds());
            let cost = bounds.half_area() * i as f32 + lists.costs[i];
            if cost < best || cost == best && i.abs_diff(n - i) < unevenness {
                (best, unevenness) = (cost, i.abs_diff(n - i));
                split = Some((axis, i));
            }
        }
    }
    split
}

/// How far the centres spread on an axis.
fn spread(list: &[PrimRef], axis: usize) -> f32 {
    match list {
        [first, .., last] => last.center_on(axis) - first.center_on(axis),
        _ => 0.0,
    }
}

/// The axis on which the centres spread most.
fn widest(lists: &Lists) -> usize {
    let spread = |axis: usize| spread(lists.sorted[axis], axis);
    (1..3).fold(0, |widest, axis| if spread(axis) > spread(widest) { axis } else { widest })
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};
    use proptest::prelude::*;

    use crate::{Builder, build};

    /// Cost of splitting before each prim, tried one by one in double precision.
    fn cheapest_by_force(boxes: &[Aabb]) -> f64 {
        let cost = |part: &[Aabb]| {
            part.iter().copied().fold(Aabb::EMPTY, Aabb::union).half_area_f64() * part.len() as f64
        };
        let mut least = f64::INFINITY;
        for axis in 0..3 {
            let mut sorted = boxes.to_vec();
            sorted.sort_by(|a, b| a.center()[axis].total_cmp(&b.center()[axis]));
            for i in 1..boxes.len() {
                least = least.min(cost(&sorted[..i]) + cost(&sorted[i..]));
            }
        }
        least
    }

    proptest! {
        #[test]
        fn the_first_split_is_the_cheapest(
            corners in prop::collection::vec(prop::array::uniform6(0f32..1.0), 2..60),
        ) {
            let boxes: Vec<_> = corners
                .iter()
                .map(|c| Aabb::around(&[Vec3::new(c[0], c[1], c[2]), Vec3::new(c[3], c[4], c[5])]))
                .collect();
            let bvh = build(&boxes, Builder::Sweep).expect("few");
            let [l, r] = bvh.children(bvh.root()).expect("two primitives or more");
            let mut count = [0usize; 2];
            for (side, child) in [l, r].into_iter().enumerate() {
                let mut todo = vec![*child];
                while let Some(node) = todo.pop() {
                    count[side] += node.count();
                    todo.extend(bvh.children(&node).into_iter().flatten());
                }
            }
            let cost = l.aabb().half_area_f64() * count[0] as f64 + r.aabb().half_area_f64() * count[1] as f64;
            prop_assert!(cost <= cheapest_by_force(&boxes) * (1.0 + 1e-5));
        }
    }
}
