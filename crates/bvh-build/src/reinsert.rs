//! Optimisation by insertion (Bittner, Hapala, Havran 2013, "Fast insertion-based optimization of
//! bounding volume hierarchies"; in parallel: Meister and Bittner 2018, "Parallel reinsertion for
//! bounding volume hierarchy optimization").
//!
//! ```text
//! in each pass:
//!     candidates = the children of the nodes of greatest inefficiency                              (Bittner et al.)
//!     for each, in parallel: search the tree for the place where it saves most area           (Meister and Bittner)
//!     for each found, greatest saving first:
//!         take it out, its sibling in the place of their parent
//!         put it back in beside what is now at the place found, if the tree as it is now gets cheaper; else where it was
//! ```
//!
//! Departures: moves found in parallel are not locked against each other. They are applied one
//! after the other and only if the tree as it is then gets cheaper, by more than rounding. So no
//! move makes the tree worse, and the tree does not depend on the number of threads. Any ancestor
//! is a place, too, not only the nodes beside the path to the root. The search goes depth first.

use bvh_core::{Bvh, COST_TRAVERSE, MAX_HEIGHT, Node, prefetch};
use rayon::prelude::*;

use crate::tree::{Boxes, Tree};
use crate::{Optimized, raw};

/// The budget of [`reinsert`](fn@reinsert).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Reinsert {
    /// Fraction of the inner nodes whose children are tried in each pass, those of the greatest
    /// inefficiency; 1 by default. 0.01 suits a repair of a tree that is refitted in every frame.
    pub part: f64,
    /// Largest number of passes, 20 by default. A pass that saves less than a thousandth of the
    /// cost is the last.
    pub passes: u32,
}

bvh_core::with_methods!(Reinsert: with_part(part: f64), with_passes(passes: u32));

impl Default for Reinsert {
    fn default() -> Self {
        Self { part: 1.0, passes: 20 }
    }
}

/// A pass that saves less than this fraction of the cost is the last.
const MIN_SAVING: f64 = 1e-3;

/// A move has to save more than this part of what taking the node out frees. Rotations compare
/// areas rounded to `f32`: where two trees are equal but for rounding, rotations would undo every
/// move. What is freed counts as at least the smallest `f32` with all its digits, also where it
/// rounds to 0 or less.
const LEAST_SAVED: f64 = 1e-6;

/// Memory that [`reinsert`](fn@reinsert) keeps from one call to the next, about 50 bytes a
/// primitive if all nodes are tried. It has no influence on results.
#[derive(Default)]
pub struct ReinsertScratch {
    parents: Vec<u32>,
    worst: Vec<Worst>,
    found: Vec<Move>,
}

impl std::fmt::Debug for ReinsertScratch {
    /// The name alone: the content means nothing between calls.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ReinsertScratch").finish_non_exhaustive()
    }
}

/// Takes subtrees out of the tree and puts them back where they cost least, within a budget
/// (Bittner et al. 2013, Meister and Bittner 2018).
///
/// Boxes must be up to date, and the order of primitives is kept. A parent that moves with its
/// child takes along its reference area. A move that would make the tree higher than [`MAX_HEIGHT`]
/// is refused. Searches on all threads of the current rayon pool; the tree is the same for any
/// number of them. A move that saves less area than 1.2e-44 is refused. O(n) a pass, and a search
/// for each node tried, O(n) at worst.
///
/// ```
/// use bvh_build::{Builder, Reinsert, ReinsertScratch, build, reinsert};
/// use bvh_core::{Aabb, Vec3};
///
/// let corner = |i: usize| Vec3::new((i * 37 % 100) as f32, (i * 61 % 100) as f32, 0.0);
/// let boxes: Vec<_> = (0..500).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect();
/// let mut bvh = build(&boxes, Builder::fast())?;
/// // The worst tenth of the nodes, once.
/// let budget = Reinsert::default().with_part(0.1).with_passes(1);
/// let done = reinsert(&mut bvh, &budget, &mut ReinsertScratch::default());
/// assert!(done.changes > 0 && done.after < done.before);
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn reinsert(bvh: &mut Bvh, options: &Reinsert, scratch: &mut ReinsertScratch) -> Optimized {
    raw::edit(bvh, |nodes| optimize(&mut Boxes { nodes, root: 0 }, options, scratch))
}

/// An inner node and its inefficiency.
#[derive(Clone, Copy)]
struct Worst {
    inefficiency: f64,
    pair: u32,
}

/// A node, the place to put it, and the area saved by that.
#[derive(Clone, Copy, Debug, Default)]
struct Move {
    saving: f64,
    from: u32,
    to: u32,
}

/// Fewest nodes that a task searches places for; not tuned.
const PART: usize = 16;

pub(crate) fn optimize<T: Tree>(
    tree: &mut T,
    options: &Reinsert,
    scratch: &mut ReinsertScratch,
) -> Optimized {
    let ReinsertScratch { parents, worst, found } = scratch;
    let unit = tree.area_of(tree.root());
    let cost = |area: f64| if unit > 0.0 { area / unit } else { 0.0 };
    let area = rank(tree, parents, worst);
    let mut report = Optimized { passes: 0, changes: 0, before: cost(area), after: cost(area) };
    let most = (options.part.clamp(0.0, 1.0) * worst.len() as f64).ceil() as usize;
    let mut left = area;
    for pass in 0..options.passes {
        if pass > 0 {
            left = rank(tree, parents, worst);
        }
        if most < worst.len() {
            worst.select_nth_unstable_by(most, |a, b| {
                b.inefficiency.total_cmp(&a.inefficiency).then(a.pair.cmp(&b.pair))
            });
            worst.truncate(most);
            // Neighbours in memory are neighbours in the tree, mostly.
            worst.sort_unstable_by_key(|node| node.pair);
        }
        let (frozen, parents_now) = (&*tree, &*parents);
        let search = |stack: &mut Vec<(f64, u32)>, i: usize| {
            best_move(frozen, parents_now, worst[i / 2].pair as usize + i % 2, stack)
        };
        let nodes = (0..2 * worst.len()).into_par_iter().with_min_len(PART);
        nodes.map_init(Vec::new, search).collect_into_vec(found);
        found.retain(|one| one.saving > 0.0);
        found.sort_unstable_by(|a, b| b.saving.total_cmp(&a.saving).then(a.from.cmp(&b.from)));
        let mut saved = 0.0;
        for one in &*found {
            let saving = apply(tree, parents, one.from as usize, one.to as usize);
            report.changes += u64::from(saving > 0.0);
            saved += saving;
        }
        report.passes += 1;
        report.after = cost(left - saved);
        if saved <= MIN_SAVING * left {
            break;
        }
    }
    report
}

/// Lists the number of the node above each pair, and the inefficiency of each inner node; gives the
/// sum of all areas times weights.
fn rank<T: Tree>(tree: &T, parents: &mut Vec<u32>, worst: &mut Vec<Worst>) -> f64 {
    let nodes = tree.nodes();
    parents.clear();
    parents.resize(nodes.len() / 2, 0);
    worst.clear();
    let (mut sum, mut todo) = (0.0, vec![tree.root()]);
    while let Some(n) = todo.pop() {
        let node = &nodes[n];
        let area = tree.area_of(n);
        sum += area * node.weight();
        if !node.is_leaf() {
            let pair = node.first();
            parents[pair / 2] = n as u32;
            let below = [tree.area_of(pair), tree.area_of(pair + 1)];
            worst.push(Worst { inefficiency: inefficiency(area, below), pair: pair as u32 });
            todo.extend([pair + 1, pair]);
        }
    }
    sum
}

/// Inefficiency of a node: its area times its ratios to the mean and to the least area of its
/// children (Bittner et al. 2013). Infinite if a child has no area.
fn inefficiency(area: f64, [l, r]: [f64; 2]) -> f64 {
    let (mean, least) = (0.5 * (l + r), l.min(r));
    if area > 0.0 { area * (area / mean) * (area / least) } else { 0.0 }
}

/// Finds the place where the node in slot `n` saves most area, if it saves any.
///
/// The search goes from the node's parent upwards. At each ancestor it tries the ancestor itself,
/// without the node, and the nodes in the ancestor's other subtree. Beside a node X the node costs
/// the area of both together, plus the growth of the nodes between X and the ancestor. That growth
/// is a lower bound for all places below X.
fn best_move<T: Tree>(tree: &T, parents: &[u32], n: usize, stack: &mut Vec<(f64, u32)>) -> Move {
    let nodes = tree.nodes();
    let bounds = tree.bounds(n);
    let own = tree.area(&bounds);
    let mut best = Move { saving: 0.0, from: n as u32, to: 0 };
    let mut sibling = n ^ 1;
    let mut pivot = parents[n / 2] as usize;
    // The area saved by taking the node out, up to the pivot; and the pivot without the node.
    let mut freed = tree.area_of(pivot);
    let mut rest = tree.bounds(sibling);
    let mut is_parent = true;
    loop {
        stack.push((freed, sibling as u32));
        while let Some((left, at)) = stack.pop() {
            // Any place costs at least the node's own area.
            if left - own <= best.saving {
                continue;
            }
            let node = &nodes[at as usize];
            let first = node.first();
            if !node.is_leaf() {
                prefetch(nodes, first);
            }
            let below = left - tree.area_with(at as usize, &bounds);
            if below > best.saving {
                (best.saving, best.to) = (below, at);
            }
            let left = below + tree.area_of(at as usize);
            if !node.is_leaf() && left - own > best.saving {
                stack.extend([(left, first as u32 + 1), (left, first as u32)]);
            }
        }
        if !is_parent {
            tree.enlarge(&mut rest, sibling);
            let area = tree.area_of(pivot);
            // Beside the pivot itself: their parent is as large as the pivot was.
            freed += area - tree.area(&rest);
            if freed - area > best.saving {
                (best.saving, best.to) = (freed - area, pivot as u32);
            }
        }
        is_parent = false;
        if pivot == tree.root() {
            return best;
        }
        sibling = pivot ^ 1;
        pivot = parents[pivot / 2] as usize;
    }
}

/// Moves the node in slot `n` beside the node in slot `to` if that saves area in the tree as it is
/// now; gives the saving.
fn apply<T: Tree>(tree: &mut T, parents: &mut [u32], n: usize, to: usize) -> f64 {
    let (pair, sibling, parent) = (n & !1, n ^ 1, parents[n / 2] as usize);
    if to == n || to == sibling || to == parent {
        return 0.0;
    }
    let (reference, taken) = (tree.nodes()[parent].reference(), tree.area_of(parent));
    tree.copy(sibling, parent);
    adopt(tree, parents, parent);
    let freed = taken - refit_above(tree, parents, parent);
    let saved = price(tree, parents, n, to).map_or(f64::NEG_INFINITY, |price| freed - price);
    // Moving it back undoes everything exactly, because bounds are minima and maxima.
    let least = LEAST_SAVED * freed.max(f32::MIN_POSITIVE.into());
    let to = if saved > least { to } else { parent };
    tree.copy(to, sibling);
    adopt(tree, parents, sibling);
    let nodes = tree.nodes_mut();
    nodes[to] = Node::parent(&nodes[pair], &nodes[pair + 1], pair as u32);
    nodes[to].set_reference(reference);
    adopt(tree, parents, to);
    tree.refit(to);
    refit_above(tree, parents, to);
    if to == parent { 0.0 } else { COST_TRAVERSE * saved }
}

/// Area that it costs to put the node in slot `n`, which has been taken out, beside the node in
/// slot `to`. `None` if `to` is below `n`, or if the tree would get too high.
fn price<T: Tree>(tree: &T, parents: &[u32], n: usize, to: usize) -> Option<f64> {
    let bounds = tree.bounds(n);
    let mut price = tree.area_with(to, &bounds);
    let (mut at, mut depth) = (to, u32::from(tree.root() != 0));
    while at != tree.root() {
        at = parents[at / 2] as usize;
        depth += 1;
        if at == n {
            return None;
        }
        price += tree.area_with(at, &bounds) - tree.area_of(at);
    }
    let height = 1 + tree.nodes()[n].height().max(tree.nodes()[to].height());
    (depth + height <= MAX_HEIGHT).then_some(price)
}

/// Lists node `n` as the parent of its children.
fn adopt<T: Tree>(tree: &T, parents: &mut [u32], n: usize) {
    let node = &tree.nodes()[n];
    if !node.is_leaf() {
        parents[node.first() / 2] = n as u32;
    }
}

/// Refits all nodes above slot `n` that change; gives the change of their area.
fn refit_above<T: Tree>(tree: &mut T, parents: &[u32], mut n: usize) -> f64 {
    let mut change = 0.0;
    while n != tree.root() {
        n = parents[n / 2] as usize;
        let before = tree.area_of(n);
        if !tree.refit(n) {
            break;
        }
        change += tree.area_of(n) - before;
    }
    change
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3, sah_cost};
    use proptest::prelude::*;

    use super::*;
    use crate::tests::{chain, streets};
    use crate::{Builder, build};

    fn start(boxes: &Vec<Aabb>) -> Bvh {
        build(boxes, Builder::Lbvh).expect("few enough")
    }

    fn all(passes: u32) -> Reinsert {
        Reinsert { part: 1.0, passes }
    }

    /// The tree with node `n` out of it and beside `to`, made from scratch; its sum of inner areas.
    fn moved_by_hand(bvh: &Bvh, n: usize, to: usize) -> f64 {
        fn area(bvh: &Bvh, at: usize, n: usize, to: usize) -> (Aabb, f64) {
            let node = &bvh.nodes()[at];
            let (mut bounds, mut sum) = (node.aabb(), 0.0);
            if !node.is_leaf() {
                let children = [node.first(), node.first() + 1];
                let parts = children.map(|child| (child != n).then(|| area(bvh, child, n, to)));
                sum = parts.iter().flatten().map(|part| part.1).sum();
                bounds = parts.iter().flatten().fold(Aabb::EMPTY, |bounds, part| bounds.union(part.0));
                if !children.contains(&n) {
                    sum += bounds.half_area_f64();
                }
            }
            if at == to {
                let (other, below) = area(bvh, n, usize::MAX, usize::MAX);
                bounds = bounds.union(other);
                sum += below + bounds.half_area_f64();
            }
            (bounds, sum)
        }
        area(bvh, 0, n, to).1
    }

    fn inner_area(bvh: &Bvh) -> f64 {
        let mut sum = 0.0;
        bvh.visit(|_, node, _| sum += if node.is_leaf() { 0.0 } else { node.aabb().half_area_f64() });
        sum
    }

    fn is_below(bvh: &Bvh, at: usize, n: usize) -> bool {
        let node = &bvh.nodes()[n];
        at == n || !node.is_leaf() && (is_below(bvh, at, node.first()) || is_below(bvh, at, node.first() + 1))
    }

    proptest! {
        #[test]
        fn the_place_found_is_the_best_of_all_and_saves_what_it_says(
            corners in prop::collection::vec(prop::array::uniform6(0f32..1.0), 3..12),
        ) {
            let point = |c: &[f32]| Vec3::new(c[0], c[1], c[2]);
            let boxes: Vec<_> = corners.iter().map(|c| Aabb::around(&[point(&c[..3]), point(&c[3..])])).collect();
            let bvh = start(&boxes);
            let mut nodes = bvh.nodes().to_vec();
            let (mut parents, mut worst) = (Vec::new(), Vec::new());
            rank(&Boxes { nodes: &mut nodes, root: 0 }, &mut parents, &mut worst);
            let before = inner_area(&bvh);
            for n in 2..nodes.len() {
                let tree = Boxes { nodes: &mut nodes, root: 0 };
                let found = best_move(&tree, &parents, n, &mut Vec::new());
                let parent = parents[n / 2] as usize;
                let places = (0..tree.nodes.len()).filter(|&to| to != 1 && to != parent && !is_below(&bvh, to, n));
                let least = places.map(|to| moved_by_hand(&bvh, n, to)).fold(before, f64::min);
                prop_assert!((before - found.saving - least).abs() < 1e-9, "{found:?}: {before} to {least}");
                // `apply` may refuse less: what it frees is below the area of 12 nodes of 3 each.
                if found.saving > 36.0 * LEAST_SAVED {
                    let mut nodes = nodes.clone();
                    let mut tree = Boxes { nodes: &mut nodes, root: 0 };
                    let saved = apply(&mut tree, &mut parents.clone(), n, found.to as usize);
                    let after = Bvh::new(&nodes, bvh.order().to_vec()).expect("a tree");
                    after.validate(&boxes).expect("valid");
                    prop_assert!((saved - found.saving).abs() < 1e-9);
                    prop_assert!((before - saved - inner_area(&after)).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_move_that_does_not_pay_leaves_everything_as_it_was() {
        let boxes = streets(200);
        let mut bvh = start(&boxes);
        reinsert(&mut bvh, &all(100), &mut ReinsertScratch::default());
        let mut nodes = bvh.nodes().to_vec();
        let (mut parents, mut worst) = (Vec::new(), Vec::new());
        let mut tree = Boxes { nodes: &mut nodes, root: 0 };
        rank(&tree, &mut parents, &mut worst);
        let before = parents.clone();
        let mut refused = 0;
        for n in 2..tree.nodes.len() {
            for to in (0..tree.nodes.len()).step_by(7).filter(|&to| to != 1) {
                if best_move(&tree, &parents, n, &mut Vec::new()).saving == 0.0 {
                    assert_eq!(apply(&mut tree, &mut parents, n, to), 0.0);
                    refused += 1;
                }
            }
        }
        assert!(refused > 10_000);
        assert!(nodes == bvh.nodes() && parents == before);
    }

    #[test]
    fn a_small_budget_brings_most_of_it() {
        let boxes = streets(5000);
        let over = |options: Reinsert| {
            let mut bvh = start(&boxes);
            bvh.set_dynamic(|p| p % 16 == 0);
            let done = reinsert(&mut bvh, &options, &mut ReinsertScratch::default());
            bvh.validate(&boxes).expect("valid");
            assert!((done.after / sah_cost(&bvh) - 1.0).abs() < 1e-9, "{done:?}");
            let still = bvh.static_area();
            bvh.set_dynamic(|p| p % 16 == 0);
            assert!(still > 0.0 && (still / bvh.static_area() - 1.0).abs() < 1e-12);
            done.after / done.before
        };
        let [none, few, most] =
            [all(0), Reinsert::default().with_part(0.05).with_passes(3), all(20)].map(over);
        assert!(none == 1.0 && few < 0.95 && most < few, "{few}, {most}");
        assert_eq!(over(Reinsert::default().with_part(f64::NAN).with_passes(2)), 1.0);
        assert_eq!(over(Reinsert::default().with_part(7.0).with_passes(2)), over(all(2)));
    }

    #[test]
    fn no_scale_makes_a_tree_worse() {
        for scale in [1e-22, 1e-19, 1.0, 1e19, 1e25, 1e33] {
            let boxes: Vec<_> =
                streets(500).iter().map(|b| Aabb::new(b.min * scale, b.max * scale)).collect();
            let mut bvh = start(&boxes);
            let done = reinsert(&mut bvh, &all(20), &mut ReinsertScratch::default());
            assert!(sah_cost(&bvh) <= done.before, "{scale}: {done:?}");
            assert!(scale < 1e-20 || done.after < 0.95 * done.before, "{scale}: {done:?}");
        }
    }

    #[test]
    fn references_add_up_to_what_they_did() {
        let boxes = streets(1000);
        let mut bvh = start(&boxes);
        raw::edit(&mut bvh, |nodes| {
            for node in nodes.iter_mut() {
                node.set_reference(node.aabb().half_area());
            }
        });
        let sum = |bvh: &Bvh| bvh.nodes().iter().map(|node| f64::from(node.reference())).sum::<f64>();
        let before = sum(&bvh);
        assert!(reinsert(&mut bvh, &all(3), &mut ReinsertScratch::default()).changes > 100);
        assert!((sum(&bvh) / before - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_height_bound_is_kept() {
        let at = |i: u32| Vec3::splat((i * 37 % 97) as f32);
        let boxes: Vec<_> = (0..=MAX_HEIGHT).map(at).map(|p| Aabb::new(p, p + Vec3::ONE)).collect();
        let mut bvh = chain(&boxes);
        let done = reinsert(&mut bvh, &all(20), &mut ReinsertScratch::default());
        bvh.validate(&boxes).expect("valid");
        assert!(done.after < 0.5 * done.before, "{done:?}");
    }
}
