//! Updates where motion diverges (Garanzha 2008, "Efficient clustered BVH update algorithm for
//! highly-dynamic models"), from its abstract and from memory.
//!
//! ```text
//! rest(N)      distance between the centres of N's children, and N's diagonal, when N was made
//! N diverges   if that distance has changed by more than STRETCH diagonals: its children moved apart, or into each other
//! cluster      a largest subtree without a node that diverges: its primitives move together
//! structural motion: few clusters below a node that diverges
//!                  the root of one cluster is taken out and put where it costs least, the cluster stays as it is
//! explosion:       more than FEW clusters below a node that diverges
//!                  a tree is built over the roots of these clusters, in the place of that above them
//! ```
//!
//! The abstract gives the two cases and that no two rebuilds overlap; here the topmost node that
//! diverges decides for all below it. How divergence is measured, and the constants, are not known;
//! distances of centres do not change where a part turns as a whole. The place of a cluster is
//! found by branch and bound (Bittner, Hapala, Havran 2013).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use bvh_build::{BuildError, Builder};
use bvh_core::{Aabb, Branch, Bvh};

use crate::part::{step, tree_over};

/// Diagonals by which the distance of children has to change.
const STRETCH: f32 = 0.25;

/// Most clusters below a node that are put elsewhere one by one.
const FEW: usize = 8;

/// What is kept from one update to the next.
#[derive(Debug, Default)]
pub(crate) struct Divergent {
    /// Of each inner node, by the pair of its children.
    rest: Vec<Rest>,
    /// Of each inner node, as of this frame.
    diverges: Vec<bool>,
    broken: Vec<bool>,
}

/// How a node was when it was made.
#[derive(Clone, Copy, Debug, Default)]
struct Rest {
    distance: f32,
    diagonal: f32,
    is_known: bool,
}

impl Divergent {
    /// Repairs a refitted tree; gives the number of clusters that got another place.
    pub(crate) fn update(&mut self, bvh: &mut Bvh) -> Result<usize, BuildError> {
        let pairs = bvh.nodes().len() / 2;
        self.rest.resize(pairs, Rest::default());
        self.diverges.resize(pairs, false);
        self.broken.resize(pairs, false);
        self.observe(bvh, 0);
        let (mut clusters, mut lone) = (0, Vec::new());
        let mut todo = vec![vec![0]];
        while let Some(path) = todo.pop() {
            let n = path[path.len() - 1];
            if !self.is_broken(bvh, n) {
                continue;
            }
            let pair = bvh.nodes()[n].first();
            if !self.diverges[pair / 2] {
                todo.extend([pair + 1, pair].map(|child| step(&path, child)));
                continue;
            }
            let below = self.clusters(bvh, n);
            if below.len() > FEW {
                clusters += self.rebuild(bvh, &path, &below)?;
            } else {
                self.lowest(bvh, path, &mut lone);
            }
        }
        for path in lone {
            clusters += usize::from(bvh.end_of(&path).is_ok() && self.reinsert(bvh, &path));
        }
        Ok(clusters)
    }

    /// Notes for each node below `n` whether it diverges; whether any does.
    fn observe(&mut self, bvh: &Bvh, n: usize) -> bool {
        let node = &bvh.nodes()[n];
        let Some([l, r]) = bvh.children(node) else { return false };
        let pair = node.first();
        let distance = l.aabb().center().distance(r.aabb().center());
        let rest = &mut self.rest[pair / 2];
        if !rest.is_known {
            *rest = Rest { distance, diagonal: node.aabb().extent().length(), is_known: true };
        }
        let diverges = (distance - rest.distance).abs() > STRETCH * rest.diagonal;
        let broken = [pair, pair + 1].map(|child| self.observe(bvh, child));
        self.diverges[pair / 2] = diverges;
        self.broken[pair / 2] = diverges || broken[0] || broken[1];
        self.broken[pair / 2]
    }

    fn is_broken(&self, bvh: &Bvh, n: usize) -> bool {
        let node = &bvh.nodes()[n];
        !node.is_leaf() && self.broken[node.first() / 2]
    }

    /// The roots of the clusters below a node.
    fn clusters(&self, bvh: &Bvh, n: usize) -> Vec<usize> {
        let (mut clusters, mut todo) = (Vec::new(), vec![n]);
        while let Some(n) = todo.pop() {
            if self.is_broken(bvh, n) {
                let pair = bvh.nodes()[n].first();
                todo.extend([pair + 1, pair]);
            } else {
                clusters.push(n);
            }
        }
        clusters
    }

    /// Paths to the nodes that diverge above two clusters.
    fn lowest(&self, bvh: &Bvh, path: Vec<usize>, found: &mut Vec<Vec<usize>>) {
        let pair = bvh.nodes()[path[path.len() - 1]].first();
        let broken = [pair, pair + 1].map(|child| self.is_broken(bvh, child));
        for i in (0..2).filter(|&i| broken[i]) {
            self.lowest(bvh, step(&path, pair + i), found);
        }
        if broken == [false; 2] {
            found.push(path);
        }
    }

    /// Builds a new tree over clusters below the end of a path; gives how many there are.
    fn rebuild(&mut self, bvh: &mut Bvh, path: &[usize], clusters: &[usize]) -> Result<usize, BuildError> {
        let shape = tree_over(bvh, clusters, Builder::BinnedParallel)?;
        // Only a tree that would be too high is refused.
        let Ok(slots) = bvh.rewire(path, &shape) else { return Ok(0) };
        for (branch, slot) in shape.iter().zip(slots) {
            if matches!(branch, Branch::Inner(..)) {
                self.rest[bvh.nodes()[slot].first() / 2].is_known = false;
            }
        }
        Ok(clusters.len())
    }

    /// Takes the lower child of the node at the end of a path out of the tree and puts it where it
    /// costs least; whether that is another place.
    fn reinsert(&mut self, bvh: &mut Bvh, path: &[usize]) -> bool {
        let [.., n] = *path else { return false };
        let Some([l, r]) = bvh.children(&bvh.nodes()[n]) else { return false };
        let moved = bvh.nodes()[n].first() + usize::from(r.height() < l.height());
        let Some(target) = best_place(bvh, path, moved) else { return false };
        let top = path.iter().zip(&target).take_while(|(a, b)| a == b).count();
        let (mut shape, mut made) = (Vec::new(), Vec::new());
        let edit = Edit { removed: n, moved, target: target[target.len() - 1], open: [path, &target] };
        edit.write(bvh, path[top - 1], &mut shape, &mut made);
        let Ok(slots) = bvh.rewire(&path[..top], &shape) else { return false };
        let rest: Vec<_> = made.iter().map(|&(_, old)| old.map(|pair| self.rest[pair / 2])).collect();
        for (&(branch, _), rest) in made.iter().zip(rest) {
            self.rest[bvh.nodes()[slots[branch]].first() / 2] = rest.unwrap_or_default();
        }
        true
    }
}

/// A reinsertion: `moved` leaves its parent `removed` and goes beside `target`.
struct Edit<'a> {
    removed: usize,
    moved: usize,
    target: usize,
    /// Paths whose nodes get other children.
    open: [&'a [usize]; 2],
}

impl Edit<'_> {
    /// Appends the new shape of what is below slot `n`, and for each new inner node the pair of the
    /// old one that it stands for.
    fn write(
        &self,
        bvh: &Bvh,
        n: usize,
        shape: &mut Vec<Branch>,
        made: &mut Vec<(usize, Option<usize>)>,
    ) -> usize {
        let pair = bvh.nodes()[n].first();
        let branch = if n == self.removed {
            return self.write(bvh, self.moved ^ 1, shape, made);
        } else if self.open.iter().any(|path| path[..path.len() - 1].contains(&n)) {
            let [l, r] = [0, 1].map(|i| self.write(bvh, pair + i, shape, made));
            made.push((shape.len(), Some(pair)));
            Branch::Inner(l, r)
        } else {
            Branch::Kept(n)
        };
        shape.push(branch);
        if n == self.target {
            shape.push(Branch::Kept(self.moved));
            made.push((shape.len(), None));
            shape.push(Branch::Inner(shape.len() - 2, shape.len() - 1));
        }
        shape.len() - 1
    }
}

/// The path to the node beside which the subtree `moved` adds the least area; `None` if that is
/// where it is. Its parent is at the end of `path`.
fn best_place(bvh: &Bvh, path: &[usize], moved: usize) -> Option<Vec<usize>> {
    let aabb = bvh.nodes()[moved].aabb();
    let removed = path[path.len() - 1];
    // The nodes above as they are without it.
    let mut without = bvh.nodes()[moved ^ 1].aabb();
    let mut shrunk: Vec<(usize, Aabb)> = vec![(removed, without)];
    for &n in path[1..].iter().rev() {
        without = without.union(bvh.nodes()[n ^ 1].aabb());
        shrunk.push((path[path.iter().position(|&p| p == n)? - 1], without));
    }
    let box_of = |n: usize| {
        let known = shrunk.iter().find(|(above, _)| *above == n);
        known.map_or(bvh.nodes()[n].aabb(), |(_, aabb)| *aabb)
    };
    let joined = |n: usize| box_of(n).union(aabb).half_area_f64();
    // Beside its sibling, where it is.
    let here: f64 = shrunk.iter().skip(1).map(|&(n, aabb)| joined(n) - aabb.half_area_f64()).sum();
    let mut best = (here + joined(removed), None);
    // Nodes that were found, each with the number of the one above it. The queue holds numbers of
    // such nodes. The next is the node above which all areas together would grow least, and of
    // equals the first found. Growth is never negative, and so in the order of its bits.
    let mut found = vec![(0, 0)];
    let mut queue = BinaryHeap::from([Reverse((0.0_f64.to_bits(), 0))]);
    while let Some(Reverse((grown, i))) = queue.pop() {
        let grown = f64::from_bits(grown);
        if grown + aabb.half_area_f64() >= best.0 {
            break;
        }
        let (n, _) = found[i];
        let cost = grown + joined(n);
        // The node that goes away is no place, and its other child is where `moved` is now.
        if n != removed && n != moved ^ 1 && cost < best.0 {
            best = (cost, Some(i));
        }
        let node = &bvh.nodes()[n];
        let below = if n == removed { grown } else { cost - box_of(n).half_area_f64() };
        if node.is_leaf() || below + aabb.half_area_f64() >= best.0 {
            continue;
        }
        for child in [node.first(), node.first() + 1].into_iter().filter(|&child| child != moved) {
            queue.push(Reverse((below.to_bits(), found.len())));
            found.push((child, i));
        }
    }
    let above = |&i: &usize| (i > 0).then(|| found[i].1);
    let mut path: Vec<_> = std::iter::successors(Some(best.1?), above).map(|i| found[i].0).collect();
    path.reverse();
    Some(path)
}

#[cfg(test)]
mod tests {
    use bvh_build::build;
    use bvh_core::{Vec3, sah_cost};
    use bvh_update::refit;

    use super::*;

    /// Three groups of 64 cubes around these places.
    fn groups(places: [f32; 3]) -> Vec<Aabb> {
        let corner =
            |i: usize| Vec3::new((i % 4) as f32 * 1.5, (i / 4 % 4) as f32 * 1.5, (i / 16 % 4) as f32 * 1.5);
        (0..192).map(|i| corner(i) + Vec3::X * places[i / 64]).map(|p| Aabb::new(p, p + 1.0)).collect()
    }

    /// The primitives below each node, sorted.
    fn sets(bvh: &Bvh) -> Vec<Vec<u32>> {
        let mut sets = Vec::new();
        bvh.visit(|_, node, _| {
            let (mut all, mut todo) = (Vec::new(), vec![*node]);
            while let Some(node) = todo.pop() {
                all.extend_from_slice(bvh.primitives(&node));
                todo.extend(bvh.children(&node).into_iter().flatten());
            }
            all.sort_unstable();
            sets.push(all);
        });
        sets.sort();
        sets
    }

    fn updated(system: &mut Divergent, bvh: &mut Bvh, boxes: &Vec<Aabb>) -> usize {
        refit(bvh, boxes).expect("as many");
        let clusters = system.update(bvh).expect("few");
        bvh.validate(boxes).expect("valid");
        clusters
    }

    #[test]
    fn a_cluster_that_flies_off_is_put_elsewhere_as_it_is() {
        let boxes = groups([0.0, 20.0, 200.0]);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few");
        let mut system = Divergent::default();
        assert_eq!(updated(&mut system, &mut bvh, &boxes), 0);
        let before = sets(&bvh);
        let pair: Vec<u32> = (0..128).collect();
        assert!(before.contains(&pair));
        // The first group flies from the second to the third.
        let moved = groups([180.0, 20.0, 200.0]);
        assert_eq!(updated(&mut system, &mut bvh, &moved), 1);
        let after = sets(&bvh);
        let new: Vec<u32> = (0..64).chain(128..192).collect();
        assert!(after.contains(&new));
        // One set has gone and one has come: no other node was touched.
        assert!(before.iter().all(|set| *set == pair || after.contains(set)));
        let fresh = sah_cost(&build(&moved, Builder::Sweep).expect("few"));
        assert!(sah_cost(&bvh) < 1.01 * fresh);
        assert_eq!(updated(&mut system, &mut bvh, &moved), 0);
    }

    /// The box below `n` and the area of all inner nodes there, as they are once `moved` stands
    /// beside `target`, or nowhere.
    fn area_with(bvh: &Bvh, n: usize, moved: usize, target: Option<usize>) -> (Aabb, f64) {
        let node = &bvh.nodes()[n];
        let mut below = (node.aabb(), 0.0);
        if !node.is_leaf() {
            let kept = [0, 1].map(|i| node.first() + i).into_iter().filter(|&child| child != moved);
            let kept: Vec<_> = kept.map(|child| area_with(bvh, child, moved, target)).collect();
            below = match kept[..] {
                [l, r] => {
                    let aabb = l.0.union(r.0);
                    (aabb, l.1 + r.1 + aabb.half_area_f64())
                }
                _ => kept[0],
            };
        }
        if target == Some(n) {
            let aabb = below.0.union(bvh.nodes()[moved].aabb());
            below = (aabb, below.1 + aabb.half_area_f64());
        }
        below
    }

    #[test]
    fn the_best_place_is_that_of_a_search_without_bounds() {
        let (mut stayed, mut left) = (0, 0);
        for seed in 0..20 {
            let noise = |i: usize| (i as f32 * Vec3::new(0.618, 0.755, 0.570)).fract();
            let boxes = |frame: usize| -> Vec<_> {
                let place = |i| noise(37 * (seed + 1) * i) + (frame * seed) as f32 * 0.1 * noise(i + 7);
                (0..40).map(|i| Aabb::new(place(i), place(i) + 0.3 * noise(i + 1))).collect()
            };
            // Trees that are as good as new, and others whose boxes have moved since.
            let mut bvh = build(&boxes(0), Builder::Sweep).expect("few");
            refit(&mut bvh, &boxes(1)).expect("as many");
            let mut todo = vec![vec![0]];
            while let Some(path) = todo.pop() {
                let removed = path[path.len() - 1];
                let Some(_) = bvh.children(&bvh.nodes()[removed]) else { continue };
                let pair = bvh.nodes()[removed].first();
                todo.extend([0, 1].map(|i| step(&path, pair + i)));
                for moved in [pair, pair + 1].into_iter().filter(|_| removed != 0) {
                    let cost = |target| area_with(&bvh, 0, moved, Some(target)).1;
                    let (mut places, mut all) = (Vec::new(), vec![0]);
                    while let Some(n) = all.pop() {
                        places.extend(Some(n).filter(|&n| n != removed && n != moved ^ 1));
                        let node = &bvh.nodes()[n];
                        let below = (0..2).filter(|_| !node.is_leaf()).map(|i| node.first() + i);
                        all.extend(below.filter(|&child| child != moved));
                    }
                    let least = places.into_iter().map(cost).fold(f64::INFINITY, f64::min);
                    let here = cost(moved ^ 1);
                    let found = best_place(&bvh, &path, moved).map(|path| cost(path[path.len() - 1]));
                    *(if found.is_some() { &mut left } else { &mut stayed }) += 1;
                    let (found, truth) = (found.unwrap_or(here), least.min(here));
                    assert!((found - truth).abs() < 1e-9 * truth, "seed {seed}: {found} {truth}");
                }
            }
        }
        assert!(stayed > 100 && left > 100, "{stayed} {left}");
    }

    #[test]
    fn an_exploded_cluster_is_rebuilt_and_no_other() {
        let mut boxes = groups([0.0, 20.0, 200.0]);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few");
        let mut system = Divergent::default();
        updated(&mut system, &mut bvh, &boxes);
        let before = sets(&bvh);
        for (i, aabb) in boxes[..64].iter_mut().enumerate() {
            let p = Vec3::new((i * 37 % 64) as f32, (i * 11 % 64) as f32, (i * 23 % 64) as f32) * 3.0;
            *aabb = Aabb::new(p - 200.0, p - 199.0);
        }
        refit(&mut bvh, &boxes).expect("as many");
        let bad = sah_cost(&bvh);
        assert!(updated(&mut system, &mut bvh, &boxes) > FEW);
        assert!(sah_cost(&bvh) < 0.7 * bad, "{} {bad}", sah_cost(&bvh));
        let after = sets(&bvh);
        let is_other = |set: &&Vec<u32>| set.iter().all(|&p| p >= 64);
        assert!(before.iter().filter(is_other).all(|set| after.contains(set)));
    }

    #[test]
    fn parts_that_turn_or_move_together_are_left_alone() {
        let boxes = groups([0.0, 20.0, 200.0]);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few");
        let mut system = Divergent::default();
        for angle in [0.0f32, 0.5, 1.0, 3.0] {
            let (sin, cos) = angle.sin_cos();
            let turned =
                |p: Vec3| Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z + 90.0 * angle);
            let boxes: Vec<_> =
                boxes.iter().map(|b| turned(b.center())).map(|p| Aabb::new(p - 0.5, p + 0.5)).collect();
            assert_eq!(updated(&mut system, &mut bvh, &boxes), 0, "{angle}");
        }
    }
}
