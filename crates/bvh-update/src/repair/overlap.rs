//! Nodes that get in each other's way.
//!
//! Rays in the overlap of two boxes enter both. All pairs of nodes with much overlap are found from the top down:
//!
//! ```text
//! separate(N, N):   if A(N) > threshold:       separate(L, L), separate(R, R), separate(L, R)
//! separate(N, M):   if A(N and M) > threshold: open the larger of the two; separate each of its children and the other
//! ```
//!
//! What is opened, and all above it, is built again over the subtrees that are left, no two of which overlap much. The
//! benefit of opening a node is the half area of an overlap, its price one more subtree, so the threshold is their
//! ratio. O(p) for p pairs that overlap by more than it, on one thread, plus the build.
//!
//! The idea is that of selective restructuring (Yoon, Curtis, Manocha 2007), whose metric of culling efficiency and
//! restructuring pair by pair are not followed here.

use bvh_core::{Aabb, Node};

use super::RepairScratch;
use crate::quality::TreeCost;

/// Memory of the search.
#[derive(Default)]
pub(crate) struct Overlaps {
    pairs: Vec<[u32; 2]>,
    /// A bit for each node slot.
    opened: Vec<u64>,
}

/// Two nodes are separated if the half area of their overlap exceeds this part of the share that an average primitive
/// had in the sum of areas when the tree was last built.
const OPENED: f64 = 0.5;

/// Most pairs of nodes separated, for each subtree of the largest frontier.
const PAIRS: usize = 8;

/// Finds what to open, where primitives have that share, and puts the subtrees that are left and the pairs of nodes
/// above them into `scratch`; gives up, with `false`, where there will be more than `most`.
pub(crate) fn open(nodes: &[Node], share: f64, most: usize, scratch: &mut RepairScratch) -> bool {
    let RepairScratch { frontier, pairs, opened, overlaps, .. } = scratch;
    let threshold = (OPENED * share) as f32;
    frontier.clear();
    pairs.clear();
    *opened = TreeCost::default();
    if !overlaps.find(nodes, threshold, PAIRS * most) {
        return false;
    }
    Opened { nodes, threshold, is_opened: &overlaps.opened, frontier, pairs, cost: opened }.collect(0);
    true
}

impl Overlaps {
    fn find(&mut self, nodes: &[Node], threshold: f32, most: usize) -> bool {
        let Self { pairs, opened } = self;
        opened.clear();
        opened.resize(nodes.len().div_ceil(64), 0);
        pairs.clear();
        pairs.push([0, 0]);
        let mut left = most;
        while let Some([a, b]) = pairs.pop() {
            let (n, m) = (&nodes[a as usize], &nodes[b as usize]);
            if a == b {
                if !n.is_leaf() && n.aabb().half_area() > threshold {
                    let l = n.first() as u32;
                    pairs.extend([[l, l], [l + 1, l + 1], [l, l + 1]]);
                }
                continue;
            }
            if overlap(n.aabb(), m.aabb()) <= threshold || n.is_leaf() && m.is_leaf() {
                continue;
            }
            if left == 0 {
                return false;
            }
            left -= 1;
            let n_is_larger = n.aabb().half_area() >= m.aabb().half_area();
            let (open, other) = if m.is_leaf() || !n.is_leaf() && n_is_larger { (a, b) } else { (b, a) };
            opened[open as usize / 64] |= 1 << (open % 64);
            let first = nodes[open as usize].first() as u32;
            pairs.extend([[first, other], [first + 1, other]]);
        }
        true
    }
}

/// Half area of what two boxes have in common.
fn overlap(a: Aabb, b: Aabb) -> f32 {
    // What is between boxes that are apart has an extent along some axes, too.
    if a.overlaps(&b) { Aabb::new(a.min.max(b.min), a.max.min(b.max)).half_area() } else { 0.0 }
}

struct Opened<'a> {
    nodes: &'a [Node],
    threshold: f32,
    is_opened: &'a [u64],
    frontier: &'a mut Vec<u32>,
    pairs: &'a mut Vec<u32>,
    cost: &'a mut TreeCost,
}

impl Opened<'_> {
    /// Collects what there is at and below a node; whether it is opened, or anything below it.
    fn collect(&mut self, n: usize) -> bool {
        let node = &self.nodes[n];
        // No smaller node can have such an overlap.
        if node.is_leaf() || node.aabb().half_area() <= self.threshold {
            return false;
        }
        let pair = node.first();
        let below = [pair, pair + 1].map(|child| self.collect(child));
        let is_open = self.is_opened[n / 64] >> (n % 64) & 1 == 1 || below.contains(&true);
        if is_open {
            self.pairs.push(pair as u32);
            self.cost.add(node);
            self.frontier
                .extend((pair as u32..).zip(below).filter(|&(_, below)| !below).map(|(child, _)| child));
        }
        is_open
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Bvh, Vec3};

    use super::*;

    /// Boxes of many sizes that get in each other's way.
    fn tangle() -> Bvh {
        let at = |i: u32, k: u32| (i.wrapping_mul(k) % 997) as f32 * 0.1;
        let boxes: Vec<_> = (0..3000)
            .map(|i| (Vec3::new(at(i, 7919), at(i, 104_729), at(i, 1_299_709)), 1.0 + (i % 5) as f32))
            .map(|(corner, size)| Aabb::new(corner, corner + size))
            .collect();
        build(&boxes, Builder::Lbvh).expect("few enough")
    }

    #[test]
    fn what_is_kept_does_not_overlap_and_nothing_is_lost() {
        let bvh = tangle();
        let nodes = bvh.nodes();
        for share in [100.0, 400.0, 1600.0] {
            let mut scratch = RepairScratch::default();
            assert!(open(nodes, share, 3000, &mut scratch));
            let cut = &scratch.frontier;
            assert!((10..3000).contains(&cut.len()) && scratch.pairs.len() == cut.len() - 1, "{}", cut.len());
            let kept: Vec<_> = cut.iter().map(|&n| &nodes[n as usize]).collect();
            for (i, n) in kept.iter().enumerate() {
                for m in &kept[..i] {
                    let area = overlap(n.aabb(), m.aabb());
                    assert!(area <= share as f32 || n.is_leaf() && m.is_leaf(), "{area} of {share}");
                }
            }
            let mut covered = vec![0; bvh.len()];
            let mut below = cut.clone();
            while let Some(n) = below.pop() {
                let node = &nodes[n as usize];
                bvh.primitives(node).iter().for_each(|&p| covered[p as usize] += 1);
                below.extend(
                    bvh.children(node).iter().flat_map(|_| [node.first() as u32, node.first() as u32 + 1]),
                );
            }
            assert!(covered.iter().all(|&c| c == 1));
        }
    }

    #[test]
    fn separate_boxes_do_not_overlap() {
        let at = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 2.0, 2.0, 2.0));
        assert_eq!([0.0, 1.0, 2.0, 2.5, 7.0].map(|x| overlap(at(0.0), at(x))), [12.0, 8.0, 4.0, 0.0, 0.0]);
        // In rows, with gaps between: nothing is in the way of anything.
        let boxes: Vec<_> = (0..3000).map(|i| at((i % 60) as f32 * 2.5)).collect();
        let place = |i: usize| Vec3::new(0.0, (i / 60) as f32 * 2.5, 0.0);
        let boxes: Vec<_> =
            boxes.iter().enumerate().map(|(i, b)| Aabb::new(b.min + place(i), b.max + place(i))).collect();
        let bvh = build(&boxes, Builder::Sweep).expect("few enough");
        let mut scratch = RepairScratch::default();
        assert!(open(bvh.nodes(), 0.0, 3000, &mut scratch) && scratch.frontier.is_empty());
    }

    #[test]
    fn too_many_pairs_are_given_up() {
        let mut scratch = RepairScratch::default();
        assert!(!open(tangle().nodes(), 1.0, 10, &mut scratch));
        // Where no area is large enough to count, nothing is found.
        assert!(open(tangle().nodes(), f64::NAN, 10, &mut scratch) && scratch.frontier.is_empty());
    }
}
