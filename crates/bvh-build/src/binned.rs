//! Binned SAH (Wald 2007, "On fast construction of SAH-based bounding volume hierarchies"), serial
//! and parallel.

use bvh_core::glam::{Mat4, Vec4};
use rayon::prelude::*;

use crate::prim_ref::{Bounds, PrimRef};
use crate::small_trees;
use crate::subtree_slot::{SubtreeSlot, middle};

/// Most bins on an axis.
const MAX_BINS: usize = 256;

/// Bins of the smallest nodes; one more for every eight primitives.
// Half and double: docs/TUNING.md.
const FEWEST_BINS: usize = 4;

/// Subtrees of fewer primitives are built by one thread.
// Half and double: docs/TUNING.md.
const GRAIN: usize = 1024;

/// Most tasks a thread, for an even share of the work.
// Half and double: docs/TUNING.md.
const TASKS: usize = 16;

/// Fewest primitives to bin or move in a task of their own.
// Half and double: docs/TUNING.md.
const PART: usize = 4096;

/// Most primitives that are binned at once; more would not fit the counters.
const MAX_PART: usize = 1 << 23;

/// What the items that are binned stand for: a primitive each, or a cluster of them.
pub(crate) trait Leaves: Sync {
    /// Most primitives in one item.
    const MOST: usize;

    /// How many primitives are in all these items.
    fn slots(&self, prims: &[PrimRef]) -> usize;

    /// Builds the subtree over one item.
    fn subtree(&self, prim: &PrimRef, slot: SubtreeSlot);
}

/// Each item is one primitive.
pub(crate) struct OnePrimitive;

impl Leaves for OnePrimitive {
    const MOST: usize = 1;

    #[inline]
    fn slots(&self, prims: &[PrimRef]) -> usize {
        prims.len()
    }

    #[inline]
    fn subtree(&self, prim: &PrimRef, slot: SubtreeSlot) {
        slot.leaf(prim);
    }
}

/// Builds the tree over `prims`, which have boxes and are left in disorder; `spare` and `bins` are
/// memory to use.
pub(crate) fn build<L: Leaves>(
    prims: &mut [PrimRef],
    (spare, all_bins): (&mut Vec<PrimRef>, &mut Vec<Bins>),
    leaves: &L,
    bins: u32,
    threads: usize,
    slot: SubtreeSlot,
) {
    let n = prims.len();
    crate::lists::make_room(spare, n, PrimRef::NOTHING, threads);
    let tasks = if threads > 1 { (n / GRAIN).min(TASKS * threads) } else { 1 };
    all_bins.resize(tasks.max(bins_for(n)), Bins::EMPTY);
    let bins = bins.clamp(2, MAX_BINS as u32) as usize;
    let binned = Binned { leaves, bins, parallel: threads > 1 };
    binned.subtree(prims, spare, slot, all_bins);
}

/// How many [`Bins`] it takes to split `n` primitives: where they are binned in parts, one more for
/// the sum.
fn bins_for(n: usize) -> usize {
    if n > MAX_PART { 1 + n.div_ceil(MAX_PART) } else { 1 }
}

struct Binned<'a, L> {
    leaves: &'a L,
    bins: usize,
    parallel: bool,
}

impl<L: Leaves> Binned<'_, L> {
    /// Builds the subtree over `prims`, in parallel with as many tasks as there are `bins`. `spare`
    /// is as long as `prims`; both are left in disorder.
    fn subtree(&self, prims: &mut [PrimRef], spare: &mut [PrimRef], slot: SubtreeSlot, bins: &mut [Bins]) {
        let n = prims.len();
        if let [prim] = prims {
            return self.leaves.subtree(prim, slot);
        }
        let any_split_fits = slot.any_split_fits(L::MOST);
        if L::MOST == 1 && n <= small_trees::MOST && any_split_fits {
            return small_trees::build(prims, slot);
        }
        let in_parts = self.parallel && bins.len() > 1 && n >= 2 * PART;
        let centers = if in_parts { centers_parallel(prims) } else { centers(prims) };
        let mut split = None;
        if any_split_fits {
            let grid = Grid::new(&centers, self.bins.min(FEWEST_BINS + n / 8));
            split = if in_parts || n > MAX_PART {
                self.split_in_parts(prims, spare, &grid, bins)
            } else {
                bins[0].fill(prims, &grid);
                bins[0].best_split(&grid).map(|cut| {
                    let left = bins[0].count_before(cut);
                    let (l, r) = spare.split_at_mut(left);
                    partition(prims, l, r, &grid, cut);
                    left
                })
            };
        }
        let (from, to) = if split.is_some() { (spare, prims) } else { (prims, spare) };
        let left = split.unwrap_or_else(|| middle(from, &centers));
        let (l, r) = from.split_at_mut(left);
        let (spare_l, spare_r) = to.split_at_mut(left);
        slot.fork(self.leaves.slots(l), |slot_l, slot_r| {
            let (least_l, least_r) = (bins_for(left), bins_for(n - left));
            if self.parallel && bins.len() >= least_l + least_r {
                // Tasks on each side in proportion to its primitives.
                let tasks = (bins.len() * left / n).clamp(least_l, bins.len() - least_r);
                let (bins_l, bins_r) = bins.split_at_mut(tasks);
                rayon::join(
                    || self.subtree(l, spare_l, slot_l, bins_l),
                    || self.subtree(r, spare_r, slot_r, bins_r),
                )
            } else {
                (self.subtree(l, spare_l, slot_l, bins), self.subtree(r, spare_r, slot_r, bins))
            }
        });
    }

    /// Bins, splits and partitions part by part, on all threads if there are several. Gives the
    /// number of primitives on the left, now at the front of `spare`. The result does not depend on
    /// the parts.
    #[inline(never)] // Out of the way of the small nodes, of which there are many.
    fn split_in_parts(
        &self,
        prims: &[PrimRef],
        spare: &mut [PrimRef],
        grid: &Grid,
        bins: &mut [Bins],
    ) -> Option<usize> {
        let (all, parts) = bins.split_first_mut()?;
        let size = prims.len().div_ceil(parts.len()).clamp(PART, MAX_PART);
        let parts = &mut parts[..prims.len().div_ceil(size)];
        if self.parallel {
            prims.par_chunks(size).zip(&mut *parts).for_each(|(part, bins)| bins.fill(part, grid));
        } else {
            prims.chunks(size).zip(&mut *parts).for_each(|(part, bins)| bins.fill(part, grid));
        }
        all.add_up(parts, grid);
        let cut = all.best_split(grid)?;
        let left = count_before(parts, cut);
        let (l, r) = spare.split_at_mut(left);
        self.partition_in_parts(parts, size, prims, [l, r], grid, cut);
        Some(left)
    }

    /// Partitions primitives that have been binned in parts of `size`.
    fn partition_in_parts(
        &self,
        parts: &[Bins],
        size: usize,
        prims: &[PrimRef],
        [l, r]: [&mut [PrimRef]; 2],
        grid: &Grid,
        cut: Cut,
    ) {
        if parts.len() <= 1 || !self.parallel {
            return partition(prims, l, r, grid, cut);
        }
        let (parts_a, parts_b) = parts.split_at(parts.len() / 2);
        let (a, b) = prims.split_at(parts_a.len() * size);
        let left = count_before(parts_a, cut);
        let ((l_a, l_b), (r_a, r_b)) = (l.split_at_mut(left), r.split_at_mut(a.len() - left));
        rayon::join(
            || self.partition_in_parts(parts_a, size, a, [l_a, r_a], grid, cut),
            || self.partition_in_parts(parts_b, size, b, [l_b, r_b], grid, cut),
        );
    }
}

/// Number of primitives left of a cut in bins of parts.
fn count_before(parts: &[Bins], cut: Cut) -> usize {
    parts.iter().map(|part| part.count_before(cut)).sum()
}

/// Bounds of the centres.
fn centers(prims: &[PrimRef]) -> Bounds {
    prims.iter().fold(Bounds::EMPTY, |bounds, prim| bounds.with_point(prim.center()))
}

fn centers_parallel(prims: &[PrimRef]) -> Bounds {
    prims.par_chunks(PART).map(centers).reduce(|| Bounds::EMPTY, Bounds::union)
}

/// How centres map to bins.
struct Grid {
    min: Vec4,
    /// Bins a length; 0 on an axis where centres are too close to distinguish: all are in bin 0
    /// there.
    scale: Vec4,
    bins: usize,
}

/// A number below 2^18 added to this has its integer part in bits 5 and up of the sum, which is the
/// offset of a bin in memory.
const ROUNDER: f32 = (1 << 18) as f32;

impl Grid {
    fn new(centers: &Bounds, bins: usize) -> Self {
        // A little less than `bins`, so that the greatest centre does not fall off the end.
        let scale = Vec4::splat(bins as f32 - 0.0625) / (centers.max - centers.min);
        let usable = scale.cmplt(Vec4::INFINITY);
        Self { min: centers.min, scale: Vec4::select(usable, scale, Vec4::ZERO), bins }
    }

    /// Bin on each axis.
    #[inline]
    fn bins_of(&self, prim: &PrimRef) -> [usize; 3] {
        let x = (prim.center() - self.min) * self.scale + Vec4::splat(ROUNDER);
        let [x, y, z, _] = x.to_array().map(|x| (x.to_bits() >> 5 & 0xff) as usize);
        [x, y, z]
    }

    /// Whether a prim is on the left of a cut.
    #[inline]
    fn is_left(&self, cut: Cut) -> impl Fn(&PrimRef) -> bool {
        let (min, scale) = (self.min.to_array()[cut.axis], self.scale.to_array()[cut.axis]);
        let end = ROUNDER + cut.bin as f32;
        move |prim| (prim.center_on(cut.axis) - min) * scale + ROUNDER < end
    }
}

/// A place to split: on an axis, before a bin other than the first.
#[derive(Clone, Copy)]
struct Cut {
    axis: usize,
    bin: usize,
}

/// Bounds of the primitives in a bin, and their number in the fourth lane of `max`: there one
/// vector operation of those that the bounds needs anyway keeps count. Exact up to 2^24.
#[derive(Clone, Copy)]
struct Bin {
    min: Vec4,
    max: Vec4,
}

impl Bin {
    const EMPTY: Self = Self {
        min: Vec4::INFINITY,
        max: Vec4::new(f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, 0.0),
    };

    #[inline]
    fn put(&mut self, prim: Bounds) {
        *self = Self { min: self.min.min(prim.min), max: self.max.max(prim.max) + Vec4::W };
    }

    #[inline]
    fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max }
    }

    #[inline]
    fn count(&self) -> f32 {
        self.max.w
    }
}

#[derive(Clone)]
pub(crate) struct Bins {
    bins: [Axis; 3],
    /// For each bin, on the three axes, the cost of all from there on.
    rest: [Vec4; MAX_BINS],
}

/// The bins of an axis; a little longer than a power of two, so that the axes do not compete for
/// the same cache lines.
#[derive(Clone, Copy)]
struct Axis {
    bins: [Bin; MAX_BINS],
    _gap: [Bin; 34],
}

impl Bins {
    const EMPTY: Self = {
        let axis = Axis { bins: [Bin::EMPTY; MAX_BINS], _gap: [Bin::EMPTY; 34] };
        Self { bins: [axis; 3], rest: [Vec4::ZERO; MAX_BINS] }
    };

    /// Bins at most [`MAX_PART`] primitives.
    fn fill(&mut self, prims: &[PrimRef], grid: &Grid) {
        for axis in &mut self.bins {
            axis.bins[..grid.bins].fill(Bin::EMPTY);
        }
        // Neighbours in memory tend to fall into the same bin, where each would wait for the one
        // before. Taking turns between two places far apart avoids that.
        let (near, far) = prims.split_at(prims.len() / 2);
        for (a, b) in near.iter().zip(far) {
            self.put(a, grid);
            self.put(b, grid);
        }
        if let Some(last) = far.get(near.len()) {
            self.put(last, grid);
        }
    }

    #[inline]
    fn put(&mut self, prim: &PrimRef, grid: &Grid) {
        for (axis, bin) in self.bins.iter_mut().zip(grid.bins_of(prim)) {
            axis.bins[bin].put(prim.bounds());
        }
    }

    /// Becomes the sum of the bins of parts. Counts are rounded once, so that it does not matter
    /// which parts.
    fn add_up(&mut self, parts: &[Self], grid: &Grid) {
        for (axis, Axis { bins, .. }) in self.bins.iter_mut().enumerate() {
            for (b, bin) in bins[..grid.bins].iter_mut().enumerate() {
                let parts = || parts.iter().map(|part| &part.bins[axis].bins[b]);
                let bounds = parts().fold(Bounds::EMPTY, |bounds, part| bounds.union(part.bounds()));
                let count: usize = parts().map(|part| part.count() as usize).sum();
                *bin = Bin { min: bounds.min, max: bounds.max.with_w(count as f32) };
            }
        }
    }

    fn count_before(&self, cut: Cut) -> usize {
        self.bins[cut.axis].bins[..cut.bin].iter().map(Bin::count).sum::<f32>() as usize
    }

    /// The cheapest split; the first of equals, x before y before z. None if all centres are equal,
    /// or if the bounds of all primitives have no area.
    fn best_split(&mut self, grid: &Grid) -> Option<Cut> {
        let bins = self.bins.each_ref().map(|axis| &axis.bins[..grid.bins]);
        let rest = &mut self.rest[..grid.bins];
        let mut side = Side::EMPTY;
        for b in (1..grid.bins).rev() {
            side = side.with(bins.map(|axis| &axis[b]));
            rest[b] = side.cost();
        }
        side = Side::EMPTY;
        let mut least = Vec4::INFINITY;
        let mut place = Vec4::ZERO;
        for b in 1..grid.bins {
            side = side.with(bins.map(|axis| &axis[b - 1]));
            let cost = side.cost() + rest[b];
            let better = cost.cmplt(least);
            least = Vec4::select(better, cost, least);
            place = Vec4::select(better, Vec4::splat(b as f32), place);
        }
        let least = Vec4::select(grid.scale.cmpgt(Vec4::ZERO), least, Vec4::INFINITY).to_array();
        let place = place.to_array();
        let mut axis = 0;
        for other in 1..3 {
            if least[other] < least[axis] {
                axis = other;
            }
        }
        let all = || bins[0].iter().fold(Bounds::EMPTY, |all, bin| all.union(bin.bounds()));
        let pointless = least[axis] == f32::INFINITY || least[axis] == 0.0 && all().half_area() == 0.0;
        (!pointless).then_some(Cut { axis, bin: place[axis] as usize })
    }
}

/// All bins on one side of a place, on each axis.
#[derive(Clone, Copy)]
struct Side {
    boxes: [Bounds; 3],
    counts: Vec4,
}

impl Side {
    const EMPTY: Self = Self { boxes: [Bounds::EMPTY; 3], counts: Vec4::ZERO };

    #[inline]
    fn with(&self, bins: [&Bin; 3]) -> Self {
        let [x, y, z] = bins;
        Self {
            boxes: [
                self.boxes[0].union(x.bounds()),
                self.boxes[1].union(y.bounds()),
                self.boxes[2].union(z.bounds()),
            ],
            counts: self.counts + Vec4::new(x.count(), y.count(), z.count(), 0.0),
        }
    }

    /// For each axis, half area (as [`Bounds::half_area`] has it) times number of primitives.
    #[inline]
    fn cost(&self) -> Vec4 {
        let [a, b, c] = self.boxes.map(|bounds| bounds.max - bounds.min);
        let extents = Mat4::from_cols(a, b, c, Vec4::ZERO).transpose();
        let (x, y, z) = (extents.x_axis, extents.y_axis, extents.z_axis);
        ((x * y + y * z) + z * x) * self.counts
    }
}

/// Copies the primitives left of the cut to `left`, the others to `right`, each in the order they
/// had.
fn partition(prims: &[PrimRef], left: &mut [PrimRef], right: &mut [PrimRef], grid: &Grid, cut: Cut) {
    let is_left = grid.is_left(cut);
    let mut to = [left.iter_mut(), right.iter_mut()];
    for prim in prims {
        let side = usize::from(!is_left(prim));
        if let Some(place) = to[side].next() {
            *place = *prim;
        }
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::prim_ref::gather;

    fn gathered(boxes: &[Aabb]) -> Vec<PrimRef> {
        let mut prims = Vec::new();
        gather(boxes, boxes.len(), &mut prims, &mut Vec::new(), 1);
        prims
    }

    #[test]
    fn parts_do_not_change_a_split() {
        let n = 10 * PART as u32 + 17;
        let boxes: Vec<Aabb> = (0..n)
            .map(|i| Vec3::new((i % 97) as f32, (i % 89) as f32 * 1.5, (i / 97) as f32 * 0.3))
            .map(|p| Aabb::new(p, p + Vec3::new(1.0, 2.0, p.x)))
            .collect();
        let prims = gathered(&boxes);
        let grid = Grid::new(&centers(&prims), 32);
        let mut bins = Bins::EMPTY;
        bins.fill(&prims, &grid);
        let cut = bins.best_split(&grid).expect("centres differ");
        let left = bins.count_before(cut);
        let mut whole = prims.clone();
        let (l, r) = whole.split_at_mut(left);
        partition(&prims, l, r, &grid, cut);
        assert!(whole[..left].iter().all(|prim| grid.bins_of(prim)[cut.axis] < cut.bin));
        assert!(whole[left..].iter().all(|prim| grid.bins_of(prim)[cut.axis] >= cut.bin));
        for (parallel, parts) in [(false, 1), (true, 3), (true, 8)] {
            let mut spare = prims.clone();
            let mut bins = vec![Bins::EMPTY; 1 + parts];
            let binned = Binned { leaves: &OnePrimitive, bins: 32, parallel };
            assert_eq!(binned.split_in_parts(&prims, &mut spare, &grid, &mut bins), Some(left));
            assert!(spare.iter().zip(&whole).all(|(a, b)| a.number() == b.number()));
        }
    }

    #[test]
    fn bins_keep_hulls_and_counts() {
        let boxes: Vec<Aabb> =
            (0..1000).map(|i| Vec3::new(i as f32, 0.0, -2.0)).map(|p| Aabb::new(p, p + 1.0)).collect();
        let prims = gathered(&boxes);
        // Centres do not spread on the last two axes: all are in the first bin there.
        let grid = Grid::new(&centers(&prims), 10);
        let mut bins = Bins::EMPTY;
        bins.fill(&prims, &grid);
        let counts = bins.bins.map(|axis| axis.bins[..10].iter().map(Bin::count).collect::<Vec<_>>());
        assert_eq!(counts[0].iter().sum::<f32>(), 1000.0);
        assert!(counts[0].iter().all(|c| (90.0..=110.0).contains(c)), "{:?}", counts[0]);
        assert!(counts[1][0] == 1000.0 && counts[2][0] == 1000.0);
        let last = bins.bins[0].bins[9].bounds().aabb();
        assert_eq!((last.max, last.min.y), (Vec3::new(1000.0, 1.0, -1.0), 0.0));
    }
}
