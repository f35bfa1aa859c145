//! The walk that finds the frontier of a repair: over the top of the tree, and in parallel over the
//! subtrees below it; breadth-first down, so that nodes can be fetched ahead, and back up.

use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_core::{Bvh, Node, prefetch};
use rayon::prelude::*;

use crate::refit::SMALL;

/// Parts, which threads share, are the highest subtrees of at most this height: two to the power of
/// h - 14 of them in a balanced tree of height h. A small tree is one part. The height is fixed, so
/// sums do not depend on the number of threads.
// 10 to 18: docs/TUNING.md.
const PART_HEIGHT: u32 = 14;

/// Nodes of more than this part of the root's area are opened in any case. There are few, but a
/// subtree as large as the room that everything else is in would have to be kept beside all of it.
// Half and double: docs/TUNING.md.
const LARGE: f32 = 0.005;

/// Subtrees to keep, and the nodes above them.
#[derive(Default)]
pub(super) struct Frontier {
    /// Slots of the subtrees' roots; empty where no node was opened for its excess.
    pub(super) kept: Vec<u32>,
    /// The left child of each node above.
    pub(super) pairs: Vec<u32>,
    /// Sums of [`Node::sah_term`] and [`Node::static_term`] over the nodes above.
    pub(super) cost: f64,
    pub(super) static_cost: f64,
    /// Sum of the references of the dynamic nodes below.
    pub(super) references: f64,
}

impl Frontier {
    fn clear(&mut self) {
        self.kept.clear();
        self.pairs.clear();
        (self.cost, self.static_cost, self.references) = Default::default();
    }

    fn add(&mut self, other: &Self) {
        self.kept.extend_from_slice(&other.kept);
        self.pairs.extend_from_slice(&other.pairs);
        self.cost += other.cost;
        self.static_cost += other.static_cost;
        self.references += other.references;
    }
}

/// An inner node that a part of the walk has listed.
#[derive(Clone, Copy)]
struct Listed {
    /// With [`Self::IS_LARGE`].
    slot: u32,
    /// Index of the parent among the part's high nodes; 0 for its root.
    parent: u32,
    /// Excess of the node; once added up, of all nodes at and below it.
    excess: f64,
}

impl Listed {
    /// Bit of a slot whose node is opened for its size.
    const IS_LARGE: u32 = 1 << 31;

    fn slot(&self) -> usize {
        (self.slot & !Self::IS_LARGE) as usize
    }
}

/// Pushes a node, then takes it back if it does not belong: a branch would be guessed wrong for
/// half of the nodes.
fn push_if(belongs: bool, list: &mut Vec<Listed>, listed: Listed) {
    list.push(listed);
    list.truncate(list.len() - usize::from(!belongs));
}

/// A subtree that one task walks, listed down to some height.
#[derive(Default)]
pub(super) struct Part {
    /// Its root, then walked nodes above that height, parents before children.
    high: Vec<Listed>,
    /// Walked nodes of at most that height whose parents are high. In the top of the tree they are
    /// the roots of parts; in a part the height is 1, and leaves are all that is below them.
    low: Vec<Listed>,
    /// What was found below the root; in the top, in the end, in all of the tree.
    pub(super) found: Frontier,
}

impl Part {
    /// Adds the excess below each node to its own. Gives that of the part.
    fn add_up(&mut self) -> f64 {
        let Self { high, low, .. } = self;
        for listed in &*low {
            high[listed.parent as usize].excess += listed.excess;
        }
        for i in (1..high.len()).rev() {
            let Listed { parent, excess, .. } = high[i];
            high[parent as usize].excess += excess;
        }
        high[0].excess
    }
}

/// Memory of the walk: the top of the tree, and the parts below it.
#[derive(Default)]
pub(super) struct FrontierScratch {
    pub(super) top: Part,
    parts: Vec<Part>,
}

/// Finds the subtrees whose excess is at most `threshold`; none if that of the whole tree is. Where
/// there are more than `most`, not all are found. O(n) for the n nodes above dynamic primitives and
/// the large static ones.
pub(super) fn find(bvh: &Bvh, scale: f64, threshold: f64, most: usize, scratch: &mut FrontierScratch) {
    let FrontierScratch { top, parts } = scratch;
    let (nodes, root) = (bvh.nodes(), bvh.root());
    let walk = Walk { nodes, scale, threshold, large_area: LARGE * root.aabb().half_area() };
    if !walk.is_walked(root) {
        top.found.clear();
        return;
    }
    let low_height = if nodes.len() <= SMALL { 1 } else { PART_HEIGHT };
    walk.list(0, low_height, top);
    if low_height > 1 {
        walk.find_in_parts(top, parts, most);
    }
    if top.add_up() > threshold {
        walk.open_or_keep(top);
        top.found.references += f64::from(root.reference());
        walk.open(root, &mut top.found);
    } else {
        // Size alone is no reason for a repair.
        top.found.clear();
    }
}

struct Walk<'a> {
    nodes: &'a [Node],
    scale: f64,
    threshold: f64,
    large_area: f32,
}

impl Walk<'_> {
    /// Walks the parts below the top, and adds to it what they find.
    fn find_in_parts(&self, top: &mut Part, parts: &mut Vec<Part>, most: usize) {
        parts.resize_with(top.low.len().max(parts.len()), Part::default);
        let kept = AtomicUsize::new(0);
        top.low.par_iter_mut().zip(&mut *parts).for_each(|(root, part)| {
            if kept.load(Ordering::Relaxed) > most {
                // What is found no longer matters, but that there is too much.
                part.found.clear();
                root.excess = f64::INFINITY;
                return;
            }
            self.list(root.slot(), 1, part);
            root.excess = part.add_up();
            self.open_or_keep(part);
            if root.excess > self.threshold {
                kept.fetch_add(part.found.kept.len(), Ordering::Relaxed);
            }
        });
        parts[..top.low.len()].iter().for_each(|part| top.found.add(&part.found));
    }

    /// Lists the nodes of a part: those above `low_height`, and those that they end at.
    ///
    /// No branch depends on what a node is: half of them would be guessed wrong.
    fn list(&self, root: usize, low_height: u32, part: &mut Part) {
        let Part { high, low, found } = part;
        found.clear();
        high.clear();
        low.clear();
        high.push(self.listed(root, 0));
        let mut parent = 0;
        while let Some(above) = high.get(parent) {
            let first = self.nodes[above.slot()].first();
            for slot in [first, first + 1] {
                let node = &self.nodes[slot];
                let (is_walked, is_high) = (self.is_walked(node), node.height() > low_height);
                prefetch(self.nodes, if is_high { node.first() } else { slot });
                // The sum over all walked nodes: `open` subtracts its node's, so no closed node is
                // read twice. An infinite reference above the frontier makes the sum NaN; then the
                // next update measures the baseline again.
                found.references += if is_walked { f64::from(node.reference()) } else { 0.0 };
                let listed = self.listed(slot, parent);
                push_if(is_walked & is_high, high, listed);
                push_if(is_walked & !is_high, low, listed);
            }
            parent += 1;
        }
    }

    /// Opens the nodes below a part's root, or keeps them where their parents are opened.
    fn open_or_keep(&self, Part { high, low, found }: &mut Part) {
        if !self.is_opened(&high[0]) {
            return;
        }
        for listed in high[1..].iter().chain(&*low) {
            if self.is_opened(listed) {
                self.open(&self.nodes[listed.slot()], found);
            } else if self.is_opened(&high[listed.parent as usize]) {
                found.kept.push(listed.slot() as u32);
            }
        }
    }

    /// Opens a node and keeps the children that are not walked: leaves and small static subtrees.
    fn open(&self, node: &Node, found: &mut Frontier) {
        let pair = node.first()..node.first() + 2;
        found.pairs.push(pair.start as u32);
        found.cost += node.sah_term();
        found.static_cost += node.static_term();
        found.references -= f64::from(node.reference());
        found.kept.extend(pair.filter(|&n| !self.is_walked(&self.nodes[n])).map(|n| n as u32));
    }

    fn is_opened(&self, listed: &Listed) -> bool {
        listed.excess > self.threshold || listed.slot & Listed::IS_LARGE != 0
    }

    /// The entry of a node below the high one at `parent`; without meaning for one that is not
    /// walked.
    fn listed(&self, slot: usize, parent: usize) -> Listed {
        let node = &self.nodes[slot];
        let is_large = if node.aabb().half_area() > self.large_area { Listed::IS_LARGE } else { 0 };
        Listed { slot: slot as u32 | is_large, parent: parent as u32, excess: self.own_excess(node) }
    }

    /// Whether there may be something at or below a node. What stands still has not grown; it is
    /// opened only where it is large.
    fn is_walked(&self, node: &Node) -> bool {
        !node.is_leaf() & (node.is_dynamic() | (node.aabb().half_area() > self.large_area))
    }

    /// By how much the area of an inner node exceeds its reference.
    fn own_excess(&self, node: &Node) -> f64 {
        let excess = f64::from(node.aabb().half_area()) - self.scale * f64::from(node.reference());
        if node.is_dynamic() & (excess > 0.0) { excess } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::quality::take_baseline;
    use crate::refit::{PassOptions, parts, pass};
    use crate::state::State;

    /// A number from 0 to 1 that depends on `seed` and `i` only.
    fn noise(seed: u64, i: usize) -> f32 {
        fastrand::Rng::with_seed(seed.rotate_left(32) ^ i as u64).f32()
    }

    /// The excess at and below a node, by definition. O(n).
    fn excess(bvh: &Bvh, node: &Node, scale: f64) -> f64 {
        let Some(pair) = bvh.children(node) else { return 0.0 };
        let own = f64::from(node.aabb().half_area()) - scale * f64::from(node.reference());
        let own = if node.is_dynamic() { own.max(0.0) } else { 0.0 };
        own + pair.iter().map(|child| excess(bvh, child, scale)).sum::<f64>()
    }

    #[test]
    fn the_frontier_is_where_excess_ends() {
        let at = |i: usize, k: u64| noise(k, i) * 100.0;
        let some: fn(usize, usize) -> bool = |p, _| p % 7 != 0;
        let inputs = [
            (20_000, Builder::Lbvh, some),
            (20_000, Builder::Sweep, |p, n| p < n / 2),
            (20_000, Builder::Sweep, |_, _| false),
            (500, Builder::Lbvh, some),
            (3, Builder::Sweep, some),
        ];
        // Lists of one tree must not be found in the next.
        let mut scratch = FrontierScratch::default();
        for (n, builder, moves) in inputs {
            let pose = |moved: f32| -> Vec<Aabb> {
                let corner = |i: usize| Vec3::new(at(i, 0), at(i, 1), at(i, 2));
                let away = |i: usize| if i.is_multiple_of(50) { moved * at(i, 3) } else { 0.0 };
                (0..n).map(|i| corner(i) + away(i)).map(|corner| Aabb::new(corner, corner + 0.4)).collect()
            };
            let mut bvh = build(&pose(0.0), builder).expect("few enough");
            bvh.set_dynamic(|p| moves(p, n));
            take_baseline(&mut bvh);
            let tally = pass(&mut bvh, &pose(0.1), None, &PassOptions::default());
            let root_area = bvh.root().aabb().half_area_f64();
            let state = State::of_mut(parts(&mut bvh).state);
            let scale = state.baseline.take_growth(root_area, tally.leaf_area);
            let large = LARGE * bvh.root().aabb().half_area();
            let mut numbers = Vec::new();
            for threshold in [0.0, 0.1, 1.0, 30.0] {
                find(&bvh, scale, threshold, usize::MAX, &mut scratch);
                let found = &mut scratch.top.found;
                numbers.push(found.kept.len());
                // A node is above the frontier if its excess or its area is large; what is left
                // below counts as kept.
                let (mut kept, mut pairs, mut references) = (vec![], vec![], 0.0);
                bvh.visit(|_, node, _| {
                    let is_opened = |node: &Node| {
                        let is_large = !node.is_leaf() && node.aabb().half_area() > large;
                        excess(&bvh, node, scale) > threshold || is_large
                    };
                    if !is_opened(node) {
                        let has_reference = node.is_dynamic() && !node.is_leaf();
                        references += f64::from(if has_reference { node.reference() } else { 0.0 });
                        return;
                    }
                    pairs.push(node.first() as u32);
                    let children = [node.first(), node.first() + 1];
                    kept.extend(children.iter().filter(|&&n| !is_opened(&bvh.nodes()[n])).map(|&n| n as u32));
                });
                if excess(&bvh, bvh.root(), scale) <= threshold {
                    (kept, pairs, references) = (vec![], vec![], 0.0);
                }
                assert!((found.references - references).abs() <= 1e-9 * references, "{threshold}");
                for list in [&mut found.kept, &mut found.pairs, &mut kept, &mut pairs] {
                    list.sort_unstable();
                }
                assert_eq!((&found.kept, &found.pairs), (&kept, &pairs), "{threshold}");
            }
            let is_opened_in_part = numbers[3] < n / 5 && numbers[0] > n / 5;
            assert!(n < 1000 || !moves(1, n) || is_opened_in_part, "{numbers:?} of {n}");
        }
    }

    #[test]
    fn a_walk_that_finds_too_much_ends_early() {
        let boxes = |moved: f32| -> Vec<Aabb> {
            let at = |i: usize| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32);
            let away = |i: usize| moved * noise(0, i) * 1000.0;
            (0..100_000).map(|i| at(i) + away(i)).map(|p| Aabb::new(p, p + 0.5)).collect()
        };
        let mut bvh = build(&boxes(0.0), Builder::Lbvh).expect("few enough");
        take_baseline(&mut bvh);
        pass(&mut bvh, &boxes(1.0), None, &PassOptions::default());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let kept = |most| {
            let mut scratch = FrontierScratch::default();
            pool.install(|| find(&bvh, 1.0, 0.0, most, &mut scratch));
            scratch.top.found.kept.len()
        };
        let (all, some) = (kept(usize::MAX), kept(1000));
        assert!(all > 50_000 && (1001..all / 4).contains(&some), "{some} of {all}");
    }
}
