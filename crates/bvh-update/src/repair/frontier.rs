//! The walk that finds the frontier of a repair: breadth-first in blocks that fit a cache, in parts that threads share out.
//!
//! A block lists nodes on its way down, so that memory is asked for well before, and sums up their excess on its way back
//! up. Only nodes that are opened are looked at again; these are few.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use bvh_core::{Bvh, MAX_HEIGHT, Node, prefetch};
use rayon::prelude::*;

use super::RepairScratch;
use crate::quality::{NodeMeasure, TreeCost};

/// Inner nodes that one block lists; about half of them are processed in it.
const LISTED: usize = 1024;
/// Roots of one block below another.
const ROOTS: usize = 64;
/// Blocks nested in each other: 64 roots and 1024 listed nodes make three levels at least.
const NESTED: usize = MAX_HEIGHT as usize / 3 + 2;
/// Roots of a part.
const PER_PART: usize = 8;
/// Cache lines, of a pair of nodes each, to fetch for roots whose turn is next: subtrees lie in one piece, or nearly so.
const LINES: usize = 4;

/// Nodes of more than this part of the root's area are opened in any case. There are few, but a subtree as large as the
/// room that everything else is in would have to be kept beside all of it.
const LARGE: f32 = 0.005;

/// Memory of the walk.
#[derive(Default)]
pub(crate) struct FrontierScratch {
    top: Listing,
    parts: Vec<Part>,
    /// Nested blocks, of as many workers as there have been at a time.
    workers: Mutex<Vec<Vec<Listing>>>,
}

/// Finds the subtrees whose excess is at most `threshold`; gives the sum of references in them. Where there are more than
/// `most`, that is all that is known.
pub(crate) fn open(
    bvh: &Bvh,
    measure: impl NodeMeasure,
    scale: f64,
    threshold: f64,
    most: usize,
    scratch: &mut RepairScratch,
) -> f64 {
    let RepairScratch { walk: FrontierScratch { top, parts, workers }, frontier, pairs, opened, .. } =
        scratch;
    let workers = &*workers;
    frontier.clear();
    pairs.clear();
    *opened = TreeCost::default();
    if bvh.height() < 2 {
        return 0.0;
    }
    let large = LARGE * bvh.root().aabb().half_area();
    let found = Found::default();
    let walk = Walk { nodes: bvh.nodes(), measure, scale, threshold, large, most, found: &found };
    parts.resize_with(1 + LISTED.div_ceil(PER_PART), Part::default);
    parts.iter_mut().for_each(Part::clear);
    let (top_part, below) = parts.split_first_mut().expect("one for the top");
    top.roots(&[0], &[bvh.root().first() as u32]);
    walk.descend(top, top_part);
    let roots = top.done..top.listed;
    let Listing { slots, pairs: children, excess, .. } = top;
    let roots = slots[roots.clone()]
        .par_chunks(PER_PART)
        .zip(children[roots.clone()].par_chunks(PER_PART))
        .zip(excess[roots].par_chunks_mut(PER_PART));
    roots.zip(below).for_each(|(((slots, pairs), excess), part)| {
        let take = || workers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut blocks = take().pop().unwrap_or_default();
        blocks.resize_with(NESTED, Listing::default);
        walk.below(slots, pairs, excess, &mut blocks, part);
        take().push(blocks);
    });
    walk.ascend(top, top_part);
    for part in parts.iter() {
        *opened = opened.and(part.opened);
        if found.bad.load(Ordering::Relaxed) > 0 {
            frontier.extend_from_slice(&part.kept);
            pairs.extend_from_slice(&part.pairs);
        }
    }
    parts.iter().map(|part| part.references).sum()
}

/// A part of the walk, and what it has found.
#[derive(Default)]
struct Part {
    kept: Vec<u32>,
    pairs: Vec<u32>,
    /// Sum of references of nodes that are not opened.
    references: f64,
    /// Areas of those that are.
    opened: TreeCost,
    /// How many were opened for their excess.
    bad: usize,
    /// How many kept subtrees and how many bad nodes other parts know of.
    reported: [usize; 2],
}

impl Part {
    fn clear(&mut self) {
        self.kept.clear();
        self.pairs.clear();
        (self.references, self.opened) = (0.0, TreeCost::default());
        (self.bad, self.reported) = (0, [0; 2]);
    }
}

/// What all parts have found so far.
#[derive(Default)]
struct Found {
    /// How many subtrees are kept.
    kept: AtomicUsize,
    /// How many nodes were opened for their excess.
    bad: AtomicUsize,
}

/// A block: nodes with grandchildren, breadth-first as in `block.rs`; those from `done` on belong to further blocks.
struct Listing {
    slots: Box<[u32]>,
    /// The first child of each.
    pairs: Box<[u32]>,
    /// How many children of each are listed, and [`IS_LARGE`] if it is opened in any case.
    kinds: Box<[u8]>,
    /// Excess at and below each.
    excess: Box<[f64]>,
    listed: usize,
    done: usize,
}

const IS_LARGE: u8 = 4;

impl Default for Listing {
    fn default() -> Self {
        fn places<T: Copy>(nothing: T) -> Box<[T]> {
            vec![nothing; LISTED].into()
        }
        let [slots, pairs] = [places(0), places(0)];
        Self { slots, pairs, kinds: places(0), excess: places(0.0), listed: 0, done: 0 }
    }
}

impl Listing {
    fn roots(&mut self, slots: &[u32], pairs: &[u32]) {
        (self.listed, self.done) = (slots.len(), 0);
        self.slots[..slots.len()].copy_from_slice(slots);
        self.pairs[..pairs.len()].copy_from_slice(pairs);
    }
}

struct Walk<'a, M> {
    nodes: &'a [Node],
    measure: M,
    scale: f64,
    threshold: f64,
    large: f32,
    most: usize,
    /// The walk ends early where there is something bad and more than `most` subtrees are kept.
    found: &'a Found,
}

impl<M: NodeMeasure> Walk<'_, M> {
    /// Finds the excess at and below these nodes.
    fn below(
        &self,
        slots: &[u32],
        pairs: &[u32],
        excess: &mut [f64],
        blocks: &mut [Listing],
        part: &mut Part,
    ) {
        let [kept, bad] = [&self.found.kept, &self.found.bad].map(|found| found.load(Ordering::Relaxed));
        if kept > self.most && bad > 0 {
            return;
        }
        let (block, deeper) = blocks.split_first_mut().expect("as many as nest");
        block.roots(slots, pairs);
        self.descend(block, part);
        let Listing { slots, pairs, excess: of_all, listed, done, .. } = block;
        for start in (*done..*listed).step_by(ROOTS) {
            let end = (start + ROOTS).min(*listed);
            for i in end..(end + ROOTS).min(*listed) {
                prefetch(self.nodes, slots[i] as usize);
                (0..LINES).for_each(|line| prefetch(self.nodes, pairs[i] as usize + 2 * line));
            }
            self.below(&slots[start..end], &pairs[start..end], &mut of_all[start..end], deeper, part);
        }
        self.ascend(block, part);
        excess.copy_from_slice(&block.excess[..excess.len()]);
    }

    /// What a node exceeds its reference by.
    #[inline(always)]
    fn excess(&self, node: &Node) -> f64 {
        let excess = (self.measure)(self.nodes, node) - self.scale * f64::from(node.reference());
        if excess > 0.0 { excess } else { 0.0 }
    }

    /// Lists nodes until there is no more room, and judges those of their children that have no grandchildren.
    fn descend(&self, block: &mut Listing, part: &mut Part) {
        let Listing { slots, pairs, kinds, excess, listed, done } = block;
        while *done < *listed && *listed + 2 <= LISTED {
            let node = &self.nodes[slots[*done] as usize];
            let pair = pairs[*done];
            let children = &self.nodes[pair as usize..][..2];
            // What is opened is taken off again.
            part.references += f64::from(node.reference());
            let before = *listed;
            let mut sum = self.excess(node);
            for (slot, child) in (pair..).zip(children) {
                let height = child.height();
                let is_listed = height > 1;
                prefetch(self.nodes, if is_listed { child.first() } else { pair as usize });
                // Which nodes are listed cannot be predicted.
                (slots[*listed], pairs[*listed]) = (slot, child.first() as u32);
                *listed += usize::from(is_listed);
                if height == 1 {
                    part.references += f64::from(child.reference());
                    let excess = self.excess(child);
                    sum += excess;
                    if self.is_opened(child, excess) {
                        self.open(child, excess, [0.0; 2], part);
                    }
                }
            }
            kinds[*done] = (*listed - before) as u8 | if self.is_large(node) { IS_LARGE } else { 0 };
            excess[*done] = sum;
            *done += 1;
        }
        self.report(part);
    }

    /// Judges the nodes of a block, once the excess of those below it is known.
    fn ascend(&self, block: &mut Listing, part: &mut Part) {
        let Listing { slots, pairs, kinds, excess, listed, done } = block;
        let mut end = *listed;
        for i in (0..*done).rev() {
            let count = usize::from(kinds[i] & !IS_LARGE);
            end -= count;
            let l = if count > 0 { excess[end] } else { 0.0 };
            let r = if count > 1 { excess[end + 1] } else { 0.0 };
            let total = excess[i] + (l + r);
            excess[i] = total;
            if total > self.threshold || kinds[i] & IS_LARGE != 0 {
                let mut listed = excess[end..].iter();
                let pair = pairs[i] as usize;
                let below = [pair, pair + 1].map(|n| &self.nodes[n]).map(|child| match child.height() {
                    // Leaves have no excess.
                    0 => 0.0,
                    1 => self.excess(child),
                    _ => *listed.next().expect("as many as are listed"),
                });
                self.open(&self.nodes[slots[i] as usize], total, below, part);
            }
        }
        self.report(part);
    }

    /// Reports to other parts what this one has found.
    fn report(&self, part: &mut Part) {
        let now = [part.kept.len(), part.bad];
        self.found.kept.fetch_add(now[0] - part.reported[0], Ordering::Relaxed);
        self.found.bad.fetch_add(now[1] - part.reported[1], Ordering::Relaxed);
        part.reported = now;
    }

    /// Whether a node is opened, given the excess at and below it.
    fn is_opened(&self, node: &Node, excess: f64) -> bool {
        excess > self.threshold || self.is_large(node)
    }

    fn is_large(&self, node: &Node) -> bool {
        node.height() > 0 && node.aabb().half_area() > self.large
    }

    /// Opens a node, given the excess at and below it and its children.
    #[cold]
    fn open(&self, node: &Node, total: f64, below: [f64; 2], part: &mut Part) {
        part.bad += usize::from(total > self.threshold);
        part.references -= f64::from(node.reference());
        part.opened.add(node);
        let pair = node.first();
        part.pairs.push(pair as u32);
        for (child, below) in (pair..).zip(below) {
            if !self.is_opened(&self.nodes[child], below) {
                part.kept.push(child as u32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::super::divergence::divergence;
    use super::*;
    use crate::quality::{area, take_baseline};
    use crate::refit::{RefitScratch, pass};
    use crate::state::State;

    /// The recursion of `repair/mod.rs`.
    #[derive(Default)]
    struct Plain {
        kept: Vec<u32>,
        pairs: Vec<u32>,
        references: f64,
        opened: TreeCost,
        is_bad: bool,
    }

    impl Plain {
        /// Gives the excess at and below a node.
        fn frontier<M: NodeMeasure>(&mut self, walk: &Walk<'_, M>, node: &Node) -> f64 {
            if node.is_leaf() {
                return 0.0;
            }
            let pair = node.first();
            let below = [pair, pair + 1].map(|child| self.frontier(walk, &walk.nodes[child]));
            let total = walk.excess(node) + below[0] + below[1];
            self.is_bad |= total > walk.threshold;
            if walk.is_opened(node, total) {
                let kept =
                    (pair..).zip(below).filter(|&(child, below)| !walk.is_opened(&walk.nodes[child], below));
                self.kept.extend(kept.map(|(child, _)| child as u32));
                self.pairs.push(pair as u32);
                self.opened.add(node);
            } else {
                self.references += f64::from(node.reference());
            }
            total
        }
    }

    #[test]
    fn the_walk_opens_what_the_recursion_opens() {
        let at = |i: usize, k: usize| (i.wrapping_mul(k) % 99_991) as f32 * 1e-3;
        // The largest takes blocks below blocks.
        for (n, builder) in [(3, Builder::Sweep), (500, Builder::Lbvh), (400_000, Builder::Lbvh)] {
            let pose = |moved: f32| -> Vec<Aabb> {
                let corner = |i: usize| Vec3::new(at(i, 7919), at(i, 104_729), at(i, 1_299_709));
                let away = |i: usize| if i.is_multiple_of(50) { moved * at(i, 31) } else { 0.0 };
                (0..n).map(|i| corner(i) + away(i)).map(|corner| Aabb::new(corner, corner + 0.4)).collect()
            };
            let mut bvh = build(&pose(0.0), builder).expect("few enough");
            bvh.set_dynamic(|p| p % 7 != 0);
            take_baseline(&mut bvh, area);
            let tally = pass(&mut bvh, &pose(0.1), None, &mut RefitScratch::new());
            let scale = State::of(&bvh).baseline.scale_now(&bvh, tally.leaf_area);
            let [mut fewest, mut most] = [usize::MAX, 0];
            for threshold in [0.0, 0.1, 1.0, 30.0] {
                let cuts = [check(&bvh, area, scale, threshold), check(&bvh, divergence, scale, threshold)];
                fewest = cuts.into_iter().fold(fewest, usize::min);
                most = cuts.into_iter().fold(most, usize::max);
            }
            assert!(n < 1000 || fewest < n / 5 && most > n / 5, "{fewest} to {most} of {n}");
        }
    }

    #[test]
    fn a_walk_that_finds_too_much_ends_early() {
        let boxes = |moved: f32| -> Vec<Aabb> {
            let at = |i: usize| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32);
            let away = |i: usize| moved * (i.wrapping_mul(7919) % 997) as f32;
            (0..100_000).map(|i| at(i) + away(i)).map(|p| Aabb::new(p, p + 0.5)).collect()
        };
        let mut bvh = build(&boxes(0.0), Builder::Lbvh).expect("few enough");
        take_baseline(&mut bvh, area);
        pass(&mut bvh, &boxes(1.0), None, &mut RefitScratch::new());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let mut scratch = RepairScratch::default();
        let mut kept = |most| {
            pool.install(|| {
                open(&bvh, area, 1.0, 0.0, most, &mut scratch);
                scratch.frontier.len()
            })
        };
        let all = kept(usize::MAX);
        let some = kept(1000);
        assert!(all > 50_000 && (1001..all / 4).contains(&some), "{some} of {all}");
    }

    /// Gives how many subtrees are kept.
    fn check(bvh: &Bvh, measure: impl NodeMeasure, scale: f64, threshold: f64) -> usize {
        let (mut plain, found) = (Plain::default(), Found::default());
        let large = LARGE * bvh.root().aabb().half_area();
        let walk = Walk { nodes: bvh.nodes(), measure, scale, threshold, large, most: 0, found: &found };
        plain.frontier(&walk, bvh.root());
        let mut scratch = RepairScratch::default();
        let references = open(bvh, measure, scale, threshold, usize::MAX, &mut scratch);
        let is_close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs());
        assert!(is_close(references, plain.references), "{references} {}", plain.references);
        assert!(is_close(scratch.opened.all, plain.opened.all));
        if !plain.is_bad {
            assert!(scratch.frontier.is_empty() && scratch.pairs.is_empty());
            return 0;
        }
        let count = plain.kept.len();
        for (mut fast, mut plain) in [(scratch.frontier, plain.kept), (scratch.pairs, plain.pairs)] {
            fast.sort_unstable();
            plain.sort_unstable();
            assert_eq!(fast, plain, "{threshold}");
        }
        count
    }
}
