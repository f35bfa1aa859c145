//! The walk that finds the frontier of a repair: in parallel over the upper part of the tree, and
//! in a part breadth-first down, so that nodes can be fetched ahead, and back up.

use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_core::{Bvh, Node, prefetch};

use crate::refit::SMALL;

/// Parts of the walk, for threads to share; a small tree has one. The number is fixed, so the sums
/// do not depend on the number of threads.
// Half and double: docs/TUNING.md.
const PARTS: usize = 512;

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
}

/// An inner node that a part of the walk has listed.
struct Listed {
    slot: u32,
    /// How many of its children are listed.
    inner_children: u32,
    /// Its own excess, on the way up also that below it.
    excess: f64,
}

/// A part of the walk: its nodes, each before those below it, and what it has found.
#[derive(Default)]
struct Part {
    list: Vec<Listed>,
    found: Frontier,
}

/// Memory of the walk: its parts, and what they have found together.
#[derive(Default)]
pub(super) struct FrontierScratch {
    parts: Vec<Part>,
    pub(super) found: Frontier,
}

/// Finds the subtrees whose excess is at most `threshold`. Where there are more than `most`, not
/// all are found. O(n) for the n nodes above dynamic primitives and the large static ones.
pub(super) fn find(bvh: &Bvh, scale: f64, threshold: f64, most: usize, scratch: &mut FrontierScratch) {
    let FrontierScratch { parts, found } = scratch;
    found.clear();
    if bvh.root().is_leaf() {
        return;
    }
    let used = if bvh.nodes().len() <= SMALL { 1 } else { PARTS };
    parts.resize_with(used.max(parts.len()), Part::default);
    let parts = &mut parts[..used];
    parts.iter_mut().for_each(|part| part.found.clear());
    let large = LARGE * bvh.root().aabb().half_area();
    let kept = AtomicUsize::new(0);
    let walk = Walk { nodes: bvh.nodes(), scale, threshold, large, most, kept: &kept };
    let excess = walk.fork(0, parts);
    for Part { found: part, .. } in parts.iter() {
        found.cost += part.cost;
        found.static_cost += part.static_cost;
        found.references += part.references;
        if excess > threshold {
            found.kept.extend_from_slice(&part.kept);
            found.pairs.extend_from_slice(&part.pairs);
        }
    }
}

struct Walk<'a> {
    nodes: &'a [Node],
    scale: f64,
    threshold: f64,
    large: f32,
    most: usize,
    /// Subtrees kept so far below nodes that were opened for their excess. The walk ends early
    /// where more than `most` are.
    kept: &'a AtomicUsize,
}

impl Walk<'_> {
    /// Gives the excess at and below a node: as [`below`](Self::below), by several threads.
    fn fork(&self, slot: usize, parts: &mut [Part]) -> f64 {
        let node = &self.nodes[slot];
        if !self.is_walked(node) {
            return 0.0;
        }
        if parts.len() == 1 || node.height() < 2 {
            let part = &mut parts[0];
            if self.kept.load(Ordering::Relaxed) > self.most {
                // What is found no longer matters, but that there is too much.
                return f64::INFINITY;
            }
            let excess = self.below(slot, part);
            if excess > self.threshold {
                self.kept.fetch_add(part.found.kept.len(), Ordering::Relaxed);
            }
            return excess;
        }
        let (left, right) = parts.split_at_mut(parts.len() / 2);
        let below = rayon::join(|| self.fork(node.first(), left), || self.fork(node.first() + 1, right));
        let excess = self.own_excess(node) + (below.0 + below.1);
        self.judge(node, excess, below.into(), &mut parts[0].found);
        excess
    }

    /// Gives the excess at and below a node.
    fn below(&self, slot: usize, part: &mut Part) -> f64 {
        let Part { list, found } = part;
        list.clear();
        self.push_inner(slot, list);
        let mut next = 0;
        while next < list.len() {
            let node = &self.nodes[list[next].slot as usize];
            list[next].excess = self.own_excess(node);
            if node.height() > 1 {
                let before = list.len();
                self.push_inner(node.first(), list);
                self.push_inner(node.first() + 1, list);
                list[next].inner_children = (list.len() - before) as u32;
            }
            next += 1;
        }
        // Children stand in the order of their parents, so on the way up they are the last of those
        // not yet taken.
        let mut end = list.len();
        for i in (0..list.len()).rev() {
            let first = end - list[i].inner_children as usize;
            let (above, children) = list[..end].split_at_mut(first);
            end = first;
            let listed = &mut above[i];
            listed.excess += children.iter().map(|child| child.excess).sum::<f64>();
            let node = &self.nodes[listed.slot as usize];
            let of = |slot| children.iter().find(|child| child.slot == slot).map_or(0.0, |c| c.excess);
            let left = node.first() as u32;
            self.judge(node, listed.excess, [of(left), of(left + 1)], found);
        }
        list.first().map_or(0.0, |root| root.excess)
    }

    /// Whether there may be something at or below a node. What stands still has not grown; it is
    /// opened only where it is large.
    fn is_walked(&self, node: &Node) -> bool {
        !node.is_leaf() && (node.is_dynamic() || node.aabb().half_area() > self.large)
    }

    /// Lists a node, if it is to be walked, and fetches its children if they are inner nodes.
    fn push_inner(&self, slot: usize, list: &mut Vec<Listed>) {
        let node = &self.nodes[slot];
        if self.is_walked(node) {
            if node.height() > 1 {
                prefetch(self.nodes, node.first());
            }
            list.push(Listed { slot: slot as u32, inner_children: 0, excess: 0.0 });
        }
    }

    /// By how much the area of an inner node exceeds its reference.
    fn own_excess(&self, node: &Node) -> f64 {
        if !node.is_dynamic() {
            return 0.0;
        }
        let excess = f64::from(node.aabb().half_area()) - self.scale * f64::from(node.reference());
        if excess > 0.0 { excess } else { 0.0 }
    }

    /// Opens an inner node or leaves it closed, given the excess at and below it, and at and below
    /// its children.
    fn judge(&self, node: &Node, excess: f64, below: [f64; 2], found: &mut Frontier) {
        if !self.is_opened(node, excess) {
            found.references += f64::from(node.reference());
            return;
        }
        let pair = node.first();
        found.cost += node.sah_term();
        found.static_cost += node.static_term();
        found.pairs.push(pair as u32);
        for (child, below) in (pair..).zip(below) {
            if !self.is_opened(&self.nodes[child], below) {
                found.kept.push(child as u32);
            }
        }
    }

    fn is_opened(&self, node: &Node, excess: f64) -> bool {
        excess > self.threshold || !node.is_leaf() && node.aabb().half_area() > self.large
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

    /// The excess at and below a node, by definition. O(n).
    fn excess(bvh: &Bvh, node: &Node, scale: f64) -> f64 {
        let Some(pair) = bvh.children(node) else { return 0.0 };
        let own = f64::from(node.aabb().half_area()) - scale * f64::from(node.reference());
        let own = if node.is_dynamic() { own.max(0.0) } else { 0.0 };
        own + pair.iter().map(|child| excess(bvh, child, scale)).sum::<f64>()
    }

    #[test]
    fn the_frontier_is_where_excess_ends() {
        let at = |i: usize, k: usize| (i.wrapping_mul(k) % 99_991) as f32 * 1e-3;
        for (n, builder) in [(3, Builder::Sweep), (500, Builder::Lbvh), (20_000, Builder::Lbvh)] {
            let pose = |moved: f32| -> Vec<Aabb> {
                let corner = |i: usize| Vec3::new(at(i, 7919), at(i, 104_729), at(i, 1_299_709));
                let away = |i: usize| if i.is_multiple_of(50) { moved * at(i, 31) } else { 0.0 };
                (0..n).map(|i| corner(i) + away(i)).map(|corner| Aabb::new(corner, corner + 0.4)).collect()
            };
            let mut bvh = build(&pose(0.0), builder).expect("few enough");
            bvh.set_dynamic(|p| p % 7 != 0);
            take_baseline(&mut bvh);
            let tally = pass(&mut bvh, &pose(0.1), None, &PassOptions::default());
            let root_area = bvh.root().aabb().half_area_f64();
            let state = State::of_mut(parts(&mut bvh).state);
            let scale = state.baseline.take_growth(root_area, tally.leaf_area);
            let large = LARGE * bvh.root().aabb().half_area();
            let (mut numbers, mut scratch) = (Vec::new(), FrontierScratch::default());
            for threshold in [0.0, 0.1, 1.0, 30.0] {
                find(&bvh, scale, threshold, usize::MAX, &mut scratch);
                let found = &mut scratch.found;
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
                assert!((found.references - references).abs() <= 1e-9 * references, "{threshold}");
                if excess(&bvh, bvh.root(), scale) <= threshold {
                    (kept, pairs) = (vec![], vec![]);
                }
                for list in [&mut found.kept, &mut found.pairs, &mut kept, &mut pairs] {
                    list.sort_unstable();
                }
                assert_eq!((&found.kept, &found.pairs), (&kept, &pairs), "{threshold}");
            }
            assert!(n < 1000 || numbers[3] < n / 5 && numbers[0] > n / 5, "{numbers:?} of {n}");
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
        take_baseline(&mut bvh);
        pass(&mut bvh, &boxes(1.0), None, &PassOptions::default());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let kept = |most| {
            let mut scratch = FrontierScratch::default();
            pool.install(|| find(&bvh, 1.0, 0.0, most, &mut scratch));
            scratch.found.kept.len()
        };
        let (all, some) = (kept(usize::MAX), kept(1000));
        assert!(all > 50_000 && (1001..all / 4).contains(&some), "{some} of {all}");
    }
}
