//! Selective restructuring (Yoon, Curtis, Manocha 2007, "Ray tracing dynamic scenes using selective
//! restructuring"), from its abstract and from memory.
//!
//! ```text
//! loss(A, B)   = area(A ∩ B) / area(root) * (1 + the lesser height of A and B)
//!                visits that a ray through the root is expected to waste because it cannot cull A or B
//! efficiency   = 1 - area(A ∩ B) / area(A ∪ B), the culling efficiency of the pair; loss is its complement, weighted
//! queue        of pairs, at first the root's children; the greatest loss first
//! pair (A, B)  whose loss has grown since its nodes were made:
//!                  the subtrees a few levels below A and B are divided again between A and B, trees built over both shares
//!                  kept if it saves more node area than THRESHOLD for each of these subtrees (benefit over cost)
//!                  else again with more levels, as long as the loss is above THRESHOLD for each subtree
//!              then the pairs of children: those of A, those of B, and one of A with one of B
//! ```
//!
//! A pair of siblings stands for a node, so every level of the hierarchy is looked at. A pair of
//! nodes from different places exchanges subtrees across the tree. Departures: benefit is the
//! exact saving of SAH cost, not an estimate. The paper's constants are not known here; THRESHOLD
//! follows from today's costs. The first update takes the tree as it is for good.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use bvh_build::Builder;
use bvh_core::{Aabb, Branch, Bvh};

use crate::part::{area_of, step, tree_over};

/// Least loss, and least benefit, in node visits of a ray through the root, for each subtree that a
/// trial shares out. Estimated: 0.4 µs a subtree, 5 ns a visit, a picture of a million rays.
const THRESHOLD: f64 = 8e-5;

/// Subtrees taken from below one node of a pair in the first trial, and the factor from one trial
/// to the next.
const WIDTH: usize = 8;

/// Pairs looked at in an update, at most, for each hundred nodes. More give the same costs on three
/// scenes (`reproduce fig6 --frames 20 --loops 1 --strategy restructure --strategy ideal`).
const PAIRS: usize = 1;

/// Trials share out at most 256 subtrees in an update, and one for each of this number of
/// primitives.
const PRIMITIVES: usize = 8;

/// Loss has grown if it is above this multiple of what it was.
const GROWN: f64 = 1.2;

/// What is kept from one update to the next.
#[derive(Debug, Default)]
pub(crate) struct Restructure {
    /// Loss of pairs, by their slots, when they were made or a trial failed.
    rest: HashMap<(usize, usize), f64>,
    has_begun: bool,
}

/// A pair of nodes, by their paths from the root.
type Pair = [Vec<usize>; 2];

/// The pairs that wait.
struct Queue {
    /// By an upper bound of the loss of a pair and of all below it, the greatest first; of equal
    /// ones the first pushed. Bounds are above zero, and so in the order of their bits.
    heap: BinaryHeap<(u64, Reverse<usize>, Pair)>,
    pushed: usize,
    root_area: f64,
    /// Subtrees that trials may still share out.
    budget: usize,
}

impl Restructure {
    /// Restructures a refitted tree; gives the number of subtrees that were divided again.
    pub(crate) fn update(&mut self, bvh: &mut Bvh) -> usize {
        let root_area = bvh.root().aabb().half_area_f64();
        let budget = 256 + bvh.len() / PRIMITIVES;
        let mut queue = Queue { heap: BinaryHeap::new(), pushed: 0, root_area, budget };
        queue.push_children(bvh, &[0]);
        let mut shared_out = 0;
        let most = 16 + bvh.nodes().len() * PAIRS / 100;
        for _ in 0..most {
            let Some((.., mut pair)) = queue.heap.pop() else { break };
            // An earlier pair may have moved these nodes.
            if pair.iter().any(|path| bvh.end_of(path).is_err()) {
                continue;
            }
            shared_out += self.look(bvh, &mut pair, &mut queue);
            queue.push_below(bvh, &pair);
        }
        self.has_begun = true;
        shared_out
    }

    /// Shares out the subtrees below a pair whose loss has grown, if that pays; how many there are.
    /// First few, then more, until the loss is no more than it was, or too small for their number.
    fn look(&mut self, bvh: &mut Bvh, paths: &mut Pair, queue: &mut Queue) -> usize {
        let root_area = queue.root_area;
        let ends = |paths: &Pair| paths.each_ref().map(|path| path[path.len() - 1]);
        let mut now = loss(bvh, ends(paths), root_area);
        let before = self.rest.get(&ends(paths).into()).copied().unwrap_or(0.0);
        let (mut width, mut tried, mut shared_out) = (WIDTH, 0, 0);
        if now <= 3.0 * THRESHOLD || now <= GROWN * before {
            return 0;
        }
        while self.has_begun && now > GROWN * before && now > THRESHOLD * (2 * width) as f64 {
            // What is left over is for the next update.
            let Some(left) = queue.budget.checked_sub(2 * width) else { return shared_out };
            queue.budget = left;
            match self.share_out(bvh, paths, width, root_area) {
                Ok(count) => shared_out += count,
                // No more subtrees than before.
                Err(count) if count <= tried => break,
                Err(count) => tried = count,
            }
            now = loss(bvh, ends(paths), root_area);
            width *= WIDTH;
        }
        self.rest.insert(ends(paths).into(), now);
        shared_out
    }

    /// Tries to share out about `width` subtrees below each node of a pair; gives their number, as
    /// an error if it did not pay.
    fn share_out(
        &mut self,
        bvh: &mut Bvh,
        paths: &mut Pair,
        width: usize,
        root_area: f64,
    ) -> Result<usize, usize> {
        let [(mut kept, below_a), (more, below_b)] =
            paths.each_ref().map(|path| below(bvh, path[path.len() - 1], width));
        kept.extend(more);
        let count = kept.len();
        if count < 3 {
            return Err(count);
        }
        let top = paths[0].iter().zip(&paths[1]).take_while(|(a, b)| a == b).count();
        let area = |&n: &usize| bvh.nodes()[n].aabb().half_area_f64();
        let chain = |path: &Vec<usize>| path[top..path.len() - 1].iter().map(area).sum::<f64>();
        let before = below_a + below_b + chain(&paths[0]) + chain(&paths[1]) + area(&paths[0][top - 1]);
        let shapes = shapes(bvh, paths, top, &kept).into_iter();
        let best = shapes.map(|shape| (area_of(bvh, &shape), shape)).min_by(|a, b| a.0.total_cmp(&b.0));
        let pays = |after: f64| before - after > THRESHOLD * count as f64 * root_area;
        let (_, shape) = best.filter(|&(after, _)| pays(after)).ok_or(count)?;
        let slots = bvh.rewire(&paths[0][..top], &shape).map_err(|_| count)?;
        for &branch in &shape {
            if let Branch::Inner(l, r) = branch {
                let pair = [slots[l], slots[r]];
                self.rest.insert(pair.into(), loss(bvh, pair, root_area));
            }
        }
        // The same turns lead to where the pair is now.
        for path in paths {
            for i in top..path.len() {
                path[i] = bvh.nodes()[path[i - 1]].first() + path[i] % 2;
            }
        }
        Ok(count)
    }
}

/// Both ways to share out `kept` between the places where two paths end: shapes of the part of the
/// tree below the first `top` steps, which the paths have in common.
fn shapes(bvh: &Bvh, paths: &Pair, top: usize, kept: &[usize]) -> Vec<Vec<Branch>> {
    // Fails beyond the greatest number of primitives alone.
    let builder = if kept.len() > 8 * WIDTH { Builder::BinnedParallel } else { Builder::Sweep };
    let Ok(mut both) = tree_over(bvh, kept, builder) else { return Vec::new() };
    let Some(Branch::Inner(l, r)) = both.pop() else { return Vec::new() };
    let shape = |mut ends: [usize; 2]| {
        let mut shape = both.clone();
        for (end, path) in ends.iter_mut().zip(paths) {
            for n in path[top..].iter().rev().take(path.len() - top - 1) {
                continue_up(&mut shape, end, *n);
            }
        }
        shape.push(Branch::Inner(ends[0], ends[1]));
        shape
    };
    vec![shape([l, r]), shape([r, l])]
}

/// Joins a branch, in the place of slot `n`, with the subtree beside it.
fn continue_up(shape: &mut Vec<Branch>, branch: &mut usize, n: usize) {
    shape.push(Branch::Kept(n ^ 1));
    let beside = shape.len() - 1;
    shape.push(if n.is_multiple_of(2) {
        Branch::Inner(*branch, beside)
    } else {
        Branch::Inner(beside, *branch)
    });
    *branch = shape.len() - 1;
}

impl Queue {
    fn push(&mut self, bound: f64, paths: Pair) {
        if bound > 2.0 * THRESHOLD {
            self.heap.push((bound.to_bits(), Reverse(self.pushed), paths));
            self.pushed += 1;
        }
    }

    /// The children of one node.
    fn push_children(&mut self, bvh: &Bvh, path: &[usize]) {
        let Some(node) = path.last().map(|&n| bvh.nodes()[n]) else { return };
        if !node.is_leaf() {
            let bound = node.aabb().half_area_f64() / self.root_area * f64::from(node.height());
            self.push(bound, [0, 1].map(|i| step(path, node.first() + i)));
        }
    }

    /// The pairs below a pair: the children of each, and one of each.
    fn push_below(&mut self, bvh: &Bvh, [a, b]: &Pair) {
        let are_siblings = a[..a.len() - 1] == b[..b.len() - 1];
        let children = [a, b].map(|path| {
            let node = bvh.nodes()[path[path.len() - 1]];
            if node.is_leaf() {
                vec![path.clone()]
            } else {
                vec![step(path, node.first()), step(path, node.first() + 1)]
            }
        });
        if are_siblings {
            self.push_children(bvh, a);
            self.push_children(bvh, b);
        }
        if children.iter().all(|children| children.len() == 1) {
            return;
        }
        for a in &children[0] {
            for b in &children[1] {
                let bound = loss(bvh, [a[a.len() - 1], b[b.len() - 1]], self.root_area);
                self.push(bound, [a.clone(), b.clone()]);
            }
        }
    }
}

/// Node visits that a ray through the root is expected to waste because it hits both nodes.
fn loss(bvh: &Bvh, [a, b]: [usize; 2], root_area: f64) -> f64 {
    let [a, b] = [bvh.nodes()[a], bvh.nodes()[b]];
    let (min, max) = (a.aabb().min.max(b.aabb().min), a.aabb().max.min(b.aabb().max));
    if !min.cmple(max).all() {
        return 0.0;
    }
    Aabb::new(min, max).half_area_f64() / root_area * f64::from(1 + a.height().min(b.height()))
}

/// The subtrees a few levels below a node, about `width`, and the area of the nodes above them: the
/// largest are opened first.
fn below(bvh: &Bvh, n: usize, width: usize) -> (Vec<usize>, f64) {
    let (mut leaves, mut opened) = (Vec::new(), 0.0);
    // Areas above zero are in the order of their bits.
    let area = |n: usize| bvh.nodes()[n].aabb().half_area_f64();
    let mut inner = BinaryHeap::from([(area(n).to_bits(), n)]);
    while leaves.len() + inner.len() < width {
        let Some((_, n)) = inner.pop() else { break };
        let node = &bvh.nodes()[n];
        if node.is_leaf() {
            leaves.push(n);
        } else {
            opened += area(n);
            inner.extend([node.first(), node.first() + 1].map(|n| (area(n).to_bits(), n)));
        }
    }
    leaves.extend(inner.into_iter().map(|(_, n)| n));
    (leaves, opened)
}

#[cfg(test)]
mod tests {
    use bvh_build::build;
    use bvh_core::{Vec3, sah_cost};
    use bvh_update::refit;

    use super::*;

    /// Streets of cubes: 32 groups of 16 that lie far apart.
    fn groups() -> Vec<Aabb> {
        let corner =
            |i: usize| Vec3::new((i / 16) as f32 * 100.0, (i % 4) as f32 * 2.0, (i % 16 / 4) as f32 * 2.0);
        (0..512).map(corner).map(|p| Aabb::new(p, p + 1.0)).collect()
    }

    /// The deepest node above all primitives of these groups, and what lies below it.
    fn above(bvh: &Bvh, groups: std::ops::Range<u32>) -> (usize, Vec<usize>) {
        let children = |n: usize| {
            let node = bvh.nodes()[n];
            (!node.is_leaf()).then(|| [node.first(), node.first() + 1]).into_iter().flatten()
        };
        let mut top = 0;
        while let Some(child) = children(top).find(|&child| above_all(bvh, child, &groups)) {
            top = child;
        }
        let mut nodes = vec![top];
        for i in 0.. {
            let Some(&n) = nodes.get(i) else { break };
            nodes.extend(children(n));
        }
        (top, nodes)
    }

    fn above_all(bvh: &Bvh, n: usize, groups: &std::ops::Range<u32>) -> bool {
        let (mut count, mut todo) = (0, vec![bvh.nodes()[n]]);
        while let Some(node) = todo.pop() {
            count += bvh.primitives(&node).iter().filter(|&p| groups.contains(&(p / 16))).count();
            todo.extend(bvh.children(&node).into_iter().flatten());
        }
        count == 16 * groups.len()
    }

    /// Two neighbouring groups trade places, one half of each: their nodes overlap while the cost
    /// of the whole tree is hardly above that of a fresh one.
    #[test]
    fn the_pair_that_overlaps_is_restructured_and_nothing_else() {
        let mut boxes = groups();
        let mut bvh = build(&boxes, Builder::Sweep).expect("few");
        let mut system = Restructure::default();
        assert_eq!(system.update(&mut bvh), 0);
        for i in 0..8 {
            boxes.swap(12 * 16 + i, 13 * 16 + i);
        }
        refit(&mut bvh, &boxes).expect("as many");
        let (bad, before) = (sah_cost(&bvh), bvh.clone());
        let fresh = sah_cost(&build(&boxes, Builder::Sweep).expect("few"));
        assert!((1.01..1.1).contains(&(bad / fresh)), "{}", bad / fresh);
        assert!(system.update(&mut bvh) > 0);
        bvh.validate(&boxes).expect("valid");
        assert!(sah_cost(&bvh) < 1.001 * fresh, "{} {fresh}", sah_cost(&bvh));
        let (top, inside) = above(&before, 12..14);
        assert!(inside.len() < 300, "{}", inside.len());
        for n in (0..bvh.nodes().len()).filter(|&n| n == top || !inside.contains(&n)) {
            assert_eq!(bvh.nodes()[n].aabb(), before.nodes()[n].aabb(), "{n}");
        }
        assert_eq!(system.update(&mut bvh), 0);
    }

    #[test]
    fn pairs_that_are_far_apart_in_the_tree_exchange_subtrees() {
        let mut boxes = groups();
        let mut bvh = build(&boxes, Builder::Sweep).expect("few");
        let mut system = Restructure::default();
        system.update(&mut bvh);
        for i in 0..8 {
            boxes.swap(3 * 16 + i, 28 * 16 + i);
        }
        refit(&mut bvh, &boxes).expect("as many");
        let bad = sah_cost(&bvh);
        for _ in 0..4 {
            system.update(&mut bvh);
            bvh.validate(&boxes).expect("valid");
        }
        let fresh = sah_cost(&build(&boxes, Builder::Sweep).expect("few"));
        assert!(bad > 1.2 * fresh && sah_cost(&bvh) < 1.2 * fresh, "{bad} {} {fresh}", sah_cost(&bvh));
        for group in (0..32).filter(|group| ![3, 28].contains(group)) {
            assert_eq!(
                above(&bvh, group..group + 1).1.len(),
                31,
                "group {group} stays a subtree of its 16 leaves"
            );
        }
    }
}
