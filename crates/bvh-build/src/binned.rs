//! Binned SAH (Wald 2007, "On fast construction of SAH-based bounding volume hierarchies"), serial and parallel.

use bvh_core::glam::Vec4;
use bvh_core::{Node, Primitives};
use rayon::prelude::*;

use crate::item::{Hull, Item, gather};
use crate::plot::{Plot, middle};

/// Most bins on an axis.
const MAX_BINS: usize = 256;

/// Subtrees of fewer primitives are built by one thread.
const GRAIN: usize = 4096;

pub(crate) fn build<P: Primitives + ?Sized>(primitives: &P, bins: u32, threads: usize, plot: Plot) -> Node {
    let (mut items, dropped) = gather(primitives, threads > 1);
    let mut spare = items.clone();
    let builder = Binned { bins: bins.clamp(2, MAX_BINS as u32) as usize, threads };
    match (items.len(), dropped.len()) {
        (_, 0) => builder.grow(&mut items, &mut spare, plot, &mut Bins::new()),
        (0, _) => plot.halve(&dropped),
        (n, _) => plot
            .fork(n, |l, r| (builder.grow(&mut items, &mut spare, l, &mut Bins::new()), r.halve(&dropped))),
    }
}

#[derive(Clone, Copy)]
struct Binned {
    bins: usize,
    threads: usize,
}

impl Binned {
    /// Builds the subtree over `items`; `spare` is as long, and both are left in disorder.
    fn grow(self, items: &mut [Item], spare: &mut [Item], plot: Plot, bins: &mut Bins) -> Node {
        let n = items.len();
        match items {
            [item] => return plot.leaf(item),
            [a, b] => return plot.fork(1, |l, r| (l.leaf(a), r.leaf(b))),
            _ => {}
        }
        let parallel = self.threads > 1 && n >= 2 * GRAIN;
        let (hull, centers) = if parallel { hulls_parallel(items) } else { hulls(items) };
        let mut split = None;
        if plot.any_split_fits() {
            let grid = Grid::new(&centers, self.bins.min(4 + n / 2));
            if parallel {
                let size = n.div_ceil(4 * self.threads).max(GRAIN);
                split = split_parallel(items, spare, size, &grid, hull.unit());
            } else {
                bins.fill(items, &grid);
                split = bins.best_split(&grid, hull.unit());
                if let Some(split) = &split {
                    let (left, right) = spare.split_at_mut(split.left);
                    partition(items, left, right, &grid, split);
                }
            }
        }
        let (from, to, left) = match split {
            Some(split) => (spare, items, split.left),
            None => {
                let left = middle(items, &centers);
                (items, spare, left)
            }
        };
        let (l, r) = from.split_at_mut(left);
        let (spare_l, spare_r) = to.split_at_mut(left);
        plot.fork(left, |plot_l, plot_r| {
            if parallel {
                rayon::join(
                    || self.grow(l, spare_l, plot_l, &mut Bins::new()),
                    || self.grow(r, spare_r, plot_r, &mut Bins::new()),
                )
            } else {
                (self.grow(l, spare_l, plot_l, bins), self.grow(r, spare_r, plot_r, bins))
            }
        })
    }
}

/// Hull of the boxes and hull of their centres.
fn hulls(items: &[Item]) -> (Hull, Hull) {
    items.iter().fold((Hull::EMPTY, Hull::EMPTY), |(hull, centers), item| {
        (hull.union(item.hull()), centers.with_point(item.center()))
    })
}

fn hulls_parallel(items: &[Item]) -> (Hull, Hull) {
    let union = |a: (Hull, Hull), b: (Hull, Hull)| (a.0.union(b.0), a.1.union(b.1));
    items.par_chunks(GRAIN).map(hulls).reduce(|| (Hull::EMPTY, Hull::EMPTY), union)
}

/// How centres map to bins.
struct Grid {
    min: Vec4,
    scale: Vec4,
    bins: usize,
    /// Whether the centres spread on an axis, and few enough binades for the arithmetic.
    usable: [bool; 3],
}

/// Added to a number in `0 .. 2^22` it leaves the integer part in the low bits of the sum.
const ROUNDER: f32 = (1 << 23) as f32;

impl Grid {
    fn new(centers: &Hull, bins: usize) -> Self {
        // A little less than `bins`, so that the greatest centre does not fall off the end.
        let scale = Vec4::splat(bins as f32 * (1.0 - 1e-6)) / (centers.max - centers.min);
        let usable = scale.truncate().to_array().map(|s| s.is_finite() && s > 0.0);
        Self { min: centers.min, scale, bins, usable }
    }

    /// Bin on each axis; 0 on unusable ones.
    #[inline]
    fn bins_of(&self, item: &Item) -> [usize; 3] {
        // Rounding to nearest after taking off a half is rounding down, but for the first half bin.
        let x = (item.center() - self.min) * self.scale + Vec4::splat(ROUNDER - 0.5);
        let [x, y, z, _] = x.max(Vec4::splat(ROUNDER)).to_array().map(|x| (x.to_bits() & 0xff) as usize);
        [x, y, z]
    }

    /// Whether the item is in a bin before `bin`, which is not 0.
    #[inline]
    fn is_before(&self, item: &Item, axis: usize, bin: usize) -> bool {
        let x = (item.center_on(axis) - self.min.to_array()[axis]) * self.scale.to_array()[axis];
        x + (ROUNDER - 0.5) < ROUNDER + bin as f32
    }
}

/// A place to split: on an axis, before a bin.
struct Split {
    axis: usize,
    bin: usize,
    /// Number of primitives before it.
    left: usize,
}

struct Bins {
    hulls: [Vec<Hull>; 3],
    counts: [Vec<u32>; 3],
    /// For each bin, the cost of all from there on.
    rest: Vec<f32>,
}

impl Bins {
    fn new() -> Self {
        Self {
            hulls: std::array::from_fn(|_| vec![Hull::EMPTY; MAX_BINS]),
            counts: std::array::from_fn(|_| vec![0; MAX_BINS]),
            rest: vec![0.0; MAX_BINS],
        }
    }

    fn fill(&mut self, items: &[Item], grid: &Grid) {
        for axis in 0..3 {
            self.hulls[axis][..grid.bins].fill(Hull::EMPTY);
            self.counts[axis][..grid.bins].fill(0);
        }
        for item in items {
            let hull = item.hull();
            for (axis, b) in grid.bins_of(item).into_iter().enumerate() {
                self.hulls[axis][b] = self.hulls[axis][b].union(hull);
                self.counts[axis][b] += 1;
            }
        }
    }

    fn merge(&mut self, other: &Self, grid: &Grid) {
        for axis in 0..3 {
            for b in 0..grid.bins {
                self.hulls[axis][b] = self.hulls[axis][b].union(other.hulls[axis][b]);
                self.counts[axis][b] += other.counts[axis][b];
            }
        }
    }

    fn count_before(&self, axis: usize, bin: usize) -> usize {
        self.counts[axis][..bin].iter().map(|&c| c as usize).sum()
    }

    /// The cheapest split; of equals the most even, then the first, x before y before z. None if no axis is
    /// usable.
    fn best_split(&mut self, grid: &Grid, unit: f32) -> Option<Split> {
        let (mut best, mut unevenness) = (f32::INFINITY, u32::MAX);
        let mut split = None;
        for axis in (0..3).filter(|&axis| grid.usable[axis]) {
            let (hulls, counts) = (&self.hulls[axis], &self.counts[axis]);
            let (mut hull, mut count) = (Hull::EMPTY, 0);
            for b in (1..grid.bins).rev() {
                hull = hull.union(hulls[b]);
                count += counts[b];
                self.rest[b] = hull.half_area(unit) * count as f32;
            }
            let n = count + counts[0];
            (hull, count) = (Hull::EMPTY, 0);
            for b in 1..grid.bins {
                hull = hull.union(hulls[b - 1]);
                count += counts[b - 1];
                let cost = hull.half_area(unit) * count as f32 + self.rest[b];
                if cost < best || cost == best && count.abs_diff(n - count) < unevenness {
                    (best, unevenness) = (cost, count.abs_diff(n - count));
                    split = Some(Split { axis, bin: b, left: count as usize });
                }
            }
        }
        split
    }
}

/// Copies the items before the split to `left`, the others to `right`, each in the order they had.
fn partition(items: &[Item], left: &mut [Item], right: &mut [Item], grid: &Grid, split: &Split) {
    let mut to = [left.iter_mut(), right.iter_mut()];
    for item in items {
        let side = usize::from(!grid.is_before(item, split.axis, split.bin));
        if let Some(place) = to[side].next() {
            *place = *item;
        }
    }
}

/// Bins, splits and partitions on all threads, `size` items a task.
fn split_parallel(items: &[Item], spare: &mut [Item], size: usize, grid: &Grid, unit: f32) -> Option<Split> {
    let parts: Vec<Bins> = items
        .par_chunks(size)
        .map(|chunk| {
            let mut bins = Bins::new();
            bins.fill(chunk, grid);
            bins
        })
        .collect();
    let mut all = Bins::new();
    parts.iter().for_each(|part| all.merge(part, grid));
    let split = all.best_split(grid, unit)?;
    let (mut left, mut right) = spare.split_at_mut(split.left);
    let mut jobs = Vec::with_capacity(parts.len());
    for (chunk, part) in items.chunks(size).zip(&parts) {
        let n = part.count_before(split.axis, split.bin);
        let (l, r);
        (l, left) = left.split_at_mut(n);
        (r, right) = right.split_at_mut(chunk.len() - n);
        jobs.push((chunk, l, r));
    }
    jobs.into_par_iter().for_each(|(chunk, l, r)| partition(chunk, l, r, grid, &split));
    Some(split)
}
