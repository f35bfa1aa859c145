//! Binned SAH (Wald 2007, "On fast construction of SAH-based bounding volume hierarchies"), serial and parallel.

use bvh_core::glam::{Mat4, Vec4};
use rayon::prelude::*;

use crate::four;
use crate::item::{Hull, Item};
use crate::plot::{Plot, middle};

/// Most bins on an axis.
const MAX_BINS: usize = 256;

/// Bins of the smallest nodes; one more for every eight primitives.
const FEWEST_BINS: usize = 4;

/// Subtrees of fewer primitives are built by one thread.
const GRAIN: usize = 1024;

/// Fewest items to bin or move in a task of their own.
const PART: usize = 4096;

/// Most items that are binned at once; more would not fit the counters.
const MAX_PART: usize = 1 << 23;

/// Builds the tree over `items`, which have boxes; gives its hull.
pub(crate) fn build(mut items: Vec<Item>, bins: u32, threads: usize, plot: Plot) -> Hull {
    let mut spare = if threads > 1 { items.par_iter().copied().collect() } else { items.clone() };
    let builder = Binned { bins: bins.clamp(2, MAX_BINS as u32) as usize, threads };
    builder.grow(&mut items, &mut spare, plot, &mut Bins::new())
}

#[derive(Clone, Copy)]
struct Binned {
    bins: usize,
    threads: usize,
}

impl Binned {
    /// Builds the subtree over `items` and gives its hull; `spare` is as long, and both are left in disorder.
    fn grow(self, items: &mut [Item], spare: &mut [Item], plot: Plot, bins: &mut Bins) -> Hull {
        let n = items.len();
        if let [item] = items {
            return plot.leaf(item);
        }
        if n <= four::MOST && plot.any_split_fits() {
            return four::grow(items, plot);
        }
        let in_parts = self.threads > 1 && n >= 2 * PART;
        let centers = if in_parts { centers_parallel(items) } else { centers(items) };
        let mut split = None;
        if plot.any_split_fits() {
            let grid = Grid::new(&centers, self.bins.min(FEWEST_BINS + n / 8));
            split = if in_parts || n > MAX_PART {
                self.split_in_parts(items, spare, &grid)
            } else {
                bins.fill(items, &grid);
                bins.best_split(&grid).map(|cut| {
                    let left = bins.count_before(cut);
                    let (l, r) = spare.split_at_mut(left);
                    partition(items, l, r, &grid, cut);
                    left
                })
            };
        }
        let (from, to, left) = match split {
            Some(left) => (spare, items, left),
            None => {
                let left = middle(items, &centers);
                (items, spare, left)
            }
        };
        let (l, r) = from.split_at_mut(left);
        let (spare_l, spare_r) = to.split_at_mut(left);
        plot.fork(left, |plot_l, plot_r| {
            if self.threads > 1 && n >= GRAIN {
                rayon::join(
                    || self.grow(l, spare_l, plot_l, bins),
                    || self.grow(r, spare_r, plot_r, &mut Bins::new()),
                )
            } else {
                (self.grow(l, spare_l, plot_l, bins), self.grow(r, spare_r, plot_r, bins))
            }
        })
    }

    /// Bins, splits and partitions part by part, on all threads if there are several. Gives the number of items on
    /// the left, now at the front of `spare`. The result does not depend on the parts.
    #[inline(never)] // Out of the way of the small nodes, of which there are many.
    fn split_in_parts(self, items: &[Item], spare: &mut [Item], grid: &Grid) -> Option<usize> {
        let size = items.len().div_ceil(4 * self.threads).clamp(PART, MAX_PART);
        let fill = |part: &[Item]| {
            let mut bins = Bins::new();
            bins.fill(part, grid);
            bins
        };
        let parts: Vec<Box<Bins>> = if self.threads > 1 {
            items.par_chunks(size).map(fill).collect()
        } else {
            items.chunks(size).map(fill).collect()
        };
        let cut = Bins::of_parts(&parts, grid).best_split(grid)?;
        let lefts: Vec<usize> = parts.iter().map(|part| part.count_before(cut)).collect();
        let left = lefts.iter().sum();
        let (mut l, mut r) = spare.split_at_mut(left);
        let mut jobs = Vec::with_capacity(parts.len());
        for (part, &left) in items.chunks(size).zip(&lefts) {
            let (to_l, to_r);
            (to_l, l) = l.split_at_mut(left);
            (to_r, r) = r.split_at_mut(part.len() - left);
            jobs.push((part, to_l, to_r));
        }
        let run = |(part, l, r): (&[Item], &mut [Item], &mut [Item])| partition(part, l, r, grid, cut);
        if self.threads > 1 {
            jobs.into_par_iter().for_each(run);
        } else {
            jobs.into_iter().for_each(run);
        }
        Some(left)
    }
}

/// Hull of the centres.
fn centers(items: &[Item]) -> Hull {
    items.iter().fold(Hull::EMPTY, |hull, item| hull.with_point(item.center()))
}

fn centers_parallel(items: &[Item]) -> Hull {
    items.par_chunks(PART).map(centers).reduce(|| Hull::EMPTY, Hull::union)
}

/// How centres map to bins.
struct Grid {
    min: Vec4,
    /// Bins a length; 0 on an axis on which centres are too close to be told apart, where all are in bin 0.
    scale: Vec4,
    bins: usize,
}

/// A number below 2^18 added to this has its integer part in bits 5 and up of the sum, which is the offset of a
/// bin in memory.
const ROUNDER: f32 = (1 << 18) as f32;

impl Grid {
    fn new(centers: &Hull, bins: usize) -> Self {
        // A little less than `bins`, so that the greatest centre does not fall off the end.
        let scale = Vec4::splat(bins as f32 - 0.0625) / (centers.max - centers.min);
        let usable = scale.cmplt(Vec4::INFINITY);
        Self { min: centers.min, scale: Vec4::select(usable, scale, Vec4::ZERO), bins }
    }

    /// Bin on each axis.
    #[inline]
    fn bins_of(&self, item: &Item) -> [usize; 3] {
        let x = (item.center() - self.min) * self.scale + Vec4::splat(ROUNDER);
        let [x, y, z, _] = x.to_array().map(|x| (x.to_bits() >> 5 & 0xff) as usize);
        [x, y, z]
    }

    /// Whether an item is on the left of a cut.
    #[inline]
    fn is_left(&self, cut: Cut) -> impl Fn(&Item) -> bool {
        let (min, scale) = (self.min.to_array()[cut.axis], self.scale.to_array()[cut.axis]);
        let end = ROUNDER + cut.bin as f32;
        move |item| (item.center_on(cut.axis) - min) * scale + ROUNDER < end
    }
}

/// A place to split: on an axis, before a bin other than the first.
#[derive(Clone, Copy)]
struct Cut {
    axis: usize,
    bin: usize,
}

/// Hull of the items in a bin, and their number in the fourth lane of `max`: there one vector operation of those
/// that the hull needs anyway keeps count. Exact up to 2^24.
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
    fn put(&mut self, item: Hull) {
        *self = Self { min: self.min.min(item.min), max: self.max.max(item.max) + Vec4::W };
    }

    #[inline]
    fn hull(&self) -> Hull {
        Hull { min: self.min, max: self.max }
    }

    #[inline]
    fn count(&self) -> f32 {
        self.max.w
    }
}

struct Bins {
    bins: [Axis; 3],
    /// For each bin, on the three axes, the cost of all from there on.
    rest: [Vec4; MAX_BINS],
}

/// The bins of an axis; a little longer than a power of two, lest those of all axes compete for the same cache lines.
#[derive(Clone, Copy)]
struct Axis {
    bins: [Bin; MAX_BINS],
    _gap: [Bin; 34],
}

impl Bins {
    // Not inlined, since a call that inlines it has all this on its stack.
    #[inline(never)]
    fn new() -> Box<Self> {
        let axis = Axis { bins: [Bin::EMPTY; MAX_BINS], _gap: [Bin::EMPTY; 34] };
        Box::new(Self { bins: [axis; 3], rest: [Vec4::ZERO; MAX_BINS] })
    }

    /// Bins at most [`MAX_PART`] items.
    fn fill(&mut self, items: &[Item], grid: &Grid) {
        for axis in &mut self.bins {
            axis.bins[..grid.bins].fill(Bin::EMPTY);
        }
        // Neighbours in memory tend to fall into the same bin, where each would wait for the one before.
        // Taking turns between two places far apart avoids that.
        let (near, far) = items.split_at(items.len() / 2);
        for (a, b) in near.iter().zip(far) {
            self.put(a, grid);
            self.put(b, grid);
        }
        if let Some(last) = far.get(near.len()) {
            self.put(last, grid);
        }
    }

    #[inline]
    fn put(&mut self, item: &Item, grid: &Grid) {
        for (axis, bin) in self.bins.iter_mut().zip(grid.bins_of(item)) {
            axis.bins[bin].put(item.hull());
        }
    }

    /// Sums up bins of parts. Counts are rounded once, so that it does not matter which parts.
    fn of_parts(parts: &[Box<Self>], grid: &Grid) -> Box<Self> {
        let mut all = Self::new();
        for (axis, Axis { bins, .. }) in all.bins.iter_mut().enumerate() {
            for (b, bin) in bins[..grid.bins].iter_mut().enumerate() {
                let parts = || parts.iter().map(|part| &part.bins[axis].bins[b]);
                let hull = parts().fold(Hull::EMPTY, |hull, part| hull.union(part.hull()));
                let count: usize = parts().map(|part| part.count() as usize).sum();
                *bin = Bin { min: hull.min, max: hull.max.with_w(count as f32) };
            }
        }
        all
    }

    fn count_before(&self, cut: Cut) -> usize {
        self.bins[cut.axis].bins[..cut.bin].iter().map(Bin::count).sum::<f32>() as usize
    }

    /// The cheapest split; of equals the first, x before y before z. None if no centres can be told apart, or
    /// if the hull of all has no area.
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
        let all = || bins[0].iter().fold(Hull::EMPTY, |all, bin| all.union(bin.hull()));
        let pointless = least[axis] == f32::INFINITY || least[axis] == 0.0 && all().half_area() == 0.0;
        (!pointless).then_some(Cut { axis, bin: place[axis] as usize })
    }
}

/// All bins on one side of a place, on each axis.
#[derive(Clone, Copy)]
struct Side {
    hulls: [Hull; 3],
    counts: Vec4,
}

impl Side {
    const EMPTY: Self = Self { hulls: [Hull::EMPTY; 3], counts: Vec4::ZERO };

    #[inline]
    fn with(&self, bins: [&Bin; 3]) -> Self {
        let [x, y, z] = bins;
        Self {
            hulls: [
                self.hulls[0].union(x.hull()),
                self.hulls[1].union(y.hull()),
                self.hulls[2].union(z.hull()),
            ],
            counts: self.counts + Vec4::new(x.count(), y.count(), z.count(), 0.0),
        }
    }

    /// For each axis, half area (as [`Hull::half_area`] has it) times number of items.
    #[inline]
    fn cost(&self) -> Vec4 {
        let [a, b, c] = self.hulls.map(|hull| hull.max - hull.min);
        let extents = Mat4::from_cols(a, b, c, Vec4::ZERO).transpose();
        let (x, y, z) = (extents.x_axis, extents.y_axis, extents.z_axis);
        ((x * y + y * z) + z * x) * self.counts
    }
}

/// Copies the items left of the cut to `left`, the others to `right`, each in the order they had.
fn partition(items: &[Item], left: &mut [Item], right: &mut [Item], grid: &Grid, cut: Cut) {
    let is_left = grid.is_left(cut);
    let mut to = [left.iter_mut(), right.iter_mut()];
    for item in items {
        let side = usize::from(!is_left(item));
        if let Some(place) = to[side].next() {
            *place = *item;
        }
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};

    use super::*;

    #[test]
    fn parts_do_not_change_a_split() {
        let n = 10 * PART as u32 + 17;
        let boxes: Vec<Aabb> = (0..n)
            .map(|i| Vec3::new((i % 97) as f32, (i % 89) as f32 * 1.5, (i / 97) as f32 * 0.3))
            .map(|p| Aabb::new(p, p + Vec3::new(1.0, 2.0, p.x)))
            .collect();
        let items = crate::item::gather(&boxes, false).boxed;
        let grid = Grid::new(&centers(&items), 32);
        let mut bins = Bins::new();
        bins.fill(&items, &grid);
        let cut = bins.best_split(&grid).expect("centres differ");
        let left = bins.count_before(cut);
        let mut whole = items.clone();
        let (l, r) = whole.split_at_mut(left);
        partition(&items, l, r, &grid, cut);
        assert!(whole[..left].iter().all(|item| grid.bins_of(item)[cut.axis] < cut.bin));
        assert!(whole[left..].iter().all(|item| grid.bins_of(item)[cut.axis] >= cut.bin));
        for threads in [1, 3] {
            let mut spare = items.clone();
            let binned = Binned { bins: 32, threads };
            assert_eq!(binned.split_in_parts(&items, &mut spare, &grid), Some(left));
            assert!(spare.iter().zip(&whole).all(|(a, b)| a.number() == b.number()));
        }
    }

    #[test]
    fn bins_keep_hulls_and_counts() {
        let boxes: Vec<Aabb> =
            (0..1000).map(|i| Vec3::new(i as f32, 0.0, -2.0)).map(|p| Aabb::new(p, p + 1.0)).collect();
        let items = crate::item::gather(&boxes, false).boxed;
        // Centres do not spread on the last two axes: all are in the first bin there.
        let grid = Grid::new(&centers(&items), 10);
        let mut bins = Bins::new();
        bins.fill(&items, &grid);
        let counts = bins.bins.map(|axis| axis.bins[..10].iter().map(Bin::count).collect::<Vec<_>>());
        assert_eq!(counts[0].iter().sum::<f32>(), 1000.0);
        assert!(counts[0].iter().all(|c| (90.0..=110.0).contains(c)), "{:?}", counts[0]);
        assert!(counts[1][0] == 1000.0 && counts[2][0] == 1000.0);
        let last = bins.bins[0].bins[9].hull().aabb();
        assert_eq!((last.max, last.min.y), (Vec3::new(1000.0, 1.0, -1.0), 0.0));
    }
}
