//! One tree for an animation known in advance: the SAH cost over several poses (Bittner and Meister
//! 2015, "T-SAH: animation optimized bounding volume hierarchies"), minimised by insertion.
//!
//! ```text
//! cost(T) = mean over poses of the SAH cost of T refitted to the pose
//! ```
//!
//! The root's area in each pose is the same for all trees. So this is the cost of a tree whose
//! nodes have one box in each pose, with sums of areas, relative to the root, instead of areas, and
//! `reinsert.rs` lowers it. Departures: it starts from the best of the trees built on each pose
//! alone. The caller chooses the poses; they are not picked from the animation in rounds.

use bvh_core::{Aabb, Bvh, Node, Primitives};

use crate::tree::{self, Tree};
use crate::{BuildError, Builder, Optimized, Reinsert, ReinsertScratch, build, raw, reinsert};

/// Builds one tree for all poses, to be refitted from frame to frame (Bittner and Meister 2015):
/// the best of the trees that [`Builder::Binned`] makes of each pose alone, then its mean cost over
/// all poses lowered as [`reinsert`](fn@crate::reinsert) lowers the SAH cost.
///
/// One primitive a leaf; boxes fit the first pose. For k poses it takes about k times the time of a
/// build and of a reinsertion, k² refits to compare the trees, and 96 k + 32 bytes a primitive.
///
/// # Errors
/// If there are no poses, too many primitives, or poses of different numbers of primitives.
///
/// ```
/// use bvh_build::{Reinsert, build_over_poses};
/// use bvh_core::{Aabb, Vec3};
///
/// let pose = |time: f32| -> Vec<Aabb> {
///     let corner = |i: usize| Vec3::new(i as f32, (i * 37 % 50) as f32 * time, 0.0);
///     (0..50).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect()
/// };
/// let (first, last) = (pose(0.0), pose(1.0));
/// let bvh = build_over_poses(&[&first, &last], &Reinsert::default())?;
/// assert!(bvh.validate(&first).is_ok());
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn build_over_poses<P: Primitives + ?Sized>(poses: &[&P], options: &Reinsert) -> Result<Bvh, BuildError> {
    let mut best: Option<(f64, Bvh, PoseBoxes)> = None;
    for pose in poses {
        let bvh = build(*pose, Builder::BinnedParallel)?;
        let boxes = PoseBoxes::new(&bvh, poses)?;
        let cost = boxes.cost(&bvh);
        if best.as_ref().is_none_or(|best| cost < best.0) {
            best = Some((cost, bvh, boxes));
        }
    }
    let (_, mut bvh, boxes) = best.ok_or(BuildError::NoPoses)?;
    optimize(&mut bvh, boxes, options);
    Ok(bvh)
}

/// Lowers the mean of the SAH costs over the poses that `boxes` has of the tree. Its own boxes then
/// fit the first pose.
fn optimize(bvh: &mut Bvh, boxes: PoseBoxes, options: &Reinsert) -> Optimized {
    raw::edit(bvh, |nodes| {
        for (node, bounds) in nodes.iter_mut().zip(boxes.boxes.chunks_exact(boxes.count())) {
            node.set_aabb(bounds[0]);
        }
        reinsert::optimize(&mut Posed { nodes, boxes }, options, &mut ReinsertScratch::default())
    })
}

/// The boxes of all nodes in all poses: those of one node together.
struct PoseBoxes {
    boxes: Vec<Aabb>,
    /// For each node the sum of its areas, scaled.
    areas: Vec<f64>,
    /// For each pose one over the number of poses and over the root's area; 0 if the root has no
    /// area.
    scales: Vec<f64>,
}

impl PoseBoxes {
    /// The boxes for at least one pose.
    fn new<P: Primitives + ?Sized>(bvh: &Bvh, poses: &[&P]) -> Result<Self, BuildError> {
        let (n, k) = (bvh.len(), poses.len());
        if let Some(pose) = poses.iter().position(|pose| pose.len() != n) {
            return Err(BuildError::PoseLength { pose, found: poses[pose].len(), expected: n });
        }
        let nodes = bvh.nodes().len();
        let mut boxes =
            Self { boxes: vec![Aabb::EMPTY; k * nodes], areas: vec![0.0; nodes], scales: vec![0.0; k] };
        let mut slots = Vec::new();
        bvh.visit(|n, _, _| slots.push(n));
        for &n in slots.iter().rev() {
            let node = &bvh.nodes()[n];
            if node.is_leaf() {
                for (bounds, pose) in boxes.boxes[k * n..].iter_mut().zip(poses) {
                    let boxes = bvh.primitives(node).iter().map(|&p| pose.aabb(p as usize));
                    *bounds = boxes.fold(Aabb::EMPTY, |bounds, aabb| bounds.union(aabb.sanitized()));
                }
            } else {
                boxes.join(n, node.first());
            }
        }
        for (scale, root) in boxes.scales.iter_mut().zip(&boxes.boxes) {
            let over = 1.0 / k as f64 / root.half_area_f64();
            *scale = if over.is_finite() { over } else { 0.0 };
        }
        slots.into_iter().for_each(|n| boxes.areas[n] = boxes.area(boxes.get(n)));
        Ok(boxes)
    }

    /// The mean of the SAH costs of the tree refitted to each pose.
    fn cost(&self, bvh: &Bvh) -> f64 {
        let mut cost = 0.0;
        bvh.visit(|n, node, _| cost += self.areas[n] * node.weight());
        cost
    }

    fn count(&self) -> usize {
        self.scales.len()
    }

    #[inline]
    fn get(&self, n: usize) -> &[Aabb] {
        let k = self.count();
        &self.boxes[k * n..k * n + k]
    }

    #[inline]
    fn area(&self, bounds: &[Aabb]) -> f64 {
        bounds.iter().zip(&self.scales).map(|(bounds, scale)| bounds.half_area_f64() * scale).sum()
    }

    /// Makes the boxes of node `n` those around the nodes `pair` and `pair + 1`; whether they
    /// changed.
    fn join(&mut self, n: usize, pair: usize) -> bool {
        let k = self.count();
        let mut changed = false;
        for i in 0..k {
            let joined = self.boxes[k * pair + i].union(self.boxes[k * pair + k + i]);
            changed |= std::mem::replace(&mut self.boxes[k * n + i], joined) != joined;
        }
        if changed {
            self.areas[n] = self.area(self.get(n));
        }
        changed
    }
}

/// Nodes whose area is the sum over poses.
struct Posed<'a> {
    nodes: &'a mut [Node],
    boxes: PoseBoxes,
}

impl Tree for Posed<'_> {
    type Bounds = Vec<Aabb>;

    fn nodes(&self) -> &[Node] {
        self.nodes
    }
    fn nodes_mut(&mut self) -> &mut [Node] {
        self.nodes
    }
    fn root(&self) -> usize {
        0
    }
    fn bounds(&self, n: usize) -> Vec<Aabb> {
        self.boxes.get(n).to_vec()
    }
    fn enlarge(&self, bounds: &mut Vec<Aabb>, n: usize) {
        for (bounds, other) in bounds.iter_mut().zip(self.boxes.get(n)) {
            *bounds = bounds.union(*other);
        }
    }
    fn area(&self, bounds: &Vec<Aabb>) -> f64 {
        self.boxes.area(bounds)
    }
    fn area_of(&self, n: usize) -> f64 {
        self.boxes.areas[n]
    }
    fn area_with(&self, n: usize, bounds: &Vec<Aabb>) -> f64 {
        let both = self.boxes.get(n).iter().zip(bounds).zip(&self.boxes.scales);
        both.map(|((a, b), scale)| a.union(*b).half_area_f64() * scale).sum()
    }
    fn copy(&mut self, from: usize, to: usize) {
        self.nodes[to] = self.nodes[from];
        let k = self.boxes.count();
        self.boxes.boxes.copy_within(k * from..k * from + k, k * to);
        self.boxes.areas[to] = self.boxes.areas[from];
    }
    fn refit(&mut self, n: usize) -> bool {
        self.boxes.join(n, self.nodes[n].first()) | tree::refit(self.nodes, n)
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Vec3, sah_cost};

    use super::*;
    use crate::build_with;
    use crate::tests::{options, streets};

    /// Boxes that all go somewhere else.
    fn moved(n: usize, time: f32) -> Vec<Aabb> {
        let away = |i: usize| Vec3::new((i % 7) as f32, (i % 11) as f32, (i % 5) as f32) * 0.1 * time;
        streets(n).iter().enumerate().map(|(i, b)| Aabb::new(b.min + away(i), b.max + away(i))).collect()
    }

    fn cost(bvh: &Bvh, poses: &[&Vec<Aabb>]) -> f64 {
        PoseBoxes::new(bvh, poses).expect("poses").cost(bvh)
    }

    #[test]
    fn the_cost_is_that_of_the_refitted_trees() {
        let all = [0.0, 1.0, 3.0].map(|time| moved(300, time));
        let bvh = build_with(&all[1], Builder::Sweep, &options(4)).expect("few enough");
        let poses = all.each_ref();
        let refitted = |boxes: &Vec<Aabb>| {
            let mut nodes = bvh.nodes().to_vec();
            for n in (0..nodes.len()).rev().filter(|&n| n != 1) {
                let bounds =
                    bvh.primitives(&nodes[n]).iter().fold(Aabb::EMPTY, |h, &p| h.union(boxes[p as usize]));
                let pair = nodes[n].first();
                let bounds = if nodes[n].is_leaf() {
                    bounds
                } else {
                    nodes[pair].aabb().union(nodes[pair + 1].aabb())
                };
                nodes[n].set_aabb(bounds);
            }
            sah_cost(&Bvh::new(&nodes, bvh.order().to_vec()).expect("a tree"))
        };
        let expected = all.iter().map(refitted).sum::<f64>() / 3.0;
        let found = cost(&bvh, &poses);
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} for {expected}");
        assert!((cost(&bvh, &poses[1..2]) / sah_cost(&bvh) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn one_tree_for_all_poses_costs_less_than_that_of_any() {
        let all = [0.0, 1.0, 3.0].map(|time| moved(2000, time));
        let poses = all.each_ref();
        let cost = |bvh: &Bvh| cost(bvh, &poses);
        let bvh = build_over_poses(&poses, &Reinsert::default()).expect("poses");
        bvh.validate(&all[0]).expect("valid");
        for boxes in &all {
            let alone = build_with(boxes, Builder::Sweep, &options(1)).expect("few enough");
            assert!(cost(&bvh) < 0.95 * cost(&alone), "{} to {}", cost(&bvh), cost(&alone));
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let again = pool.install(|| build_over_poses(&poses, &Reinsert::default())).expect("poses");
            assert_eq!(again.fingerprint(), bvh.fingerprint());
        }
    }

    #[test]
    fn any_tree_gets_cheaper_and_keeps_its_dynamic_bits() {
        let all = [0.0, 1.0, 3.0].map(|time| moved(1000, time));
        let poses = all.each_ref();
        let mut bvh = build_with(&all[2], Builder::Lbvh, &options(3)).expect("few enough");
        bvh.set_dynamic(|p| p % 2 == 0);
        let before = cost(&bvh, &poses);
        let boxes = PoseBoxes::new(&bvh, &poses).expect("poses");
        let done = optimize(&mut bvh, boxes, &Reinsert::default());
        let after = cost(&bvh, &poses);
        bvh.validate(&all[0]).expect("valid");
        assert!((done.before / before - 1.0).abs() < 1e-9 && (done.after / after - 1.0).abs() < 1e-9);
        assert!(after < 0.9 * before);
        let sum = bvh.static_area();
        bvh.set_dynamic(|p| p % 2 == 0);
        assert!((sum / bvh.static_area() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn poses_that_do_not_fit_are_refused() {
        let (few, many) = (streets(9), streets(10));
        let none: [&Vec<Aabb>; 0] = [];
        let uneven = [&many, &few];
        let wrong = BuildError::PoseLength { pose: 1, found: 9, expected: 10 };
        assert_eq!(wrong.to_string(), "pose 1 has 9 primitives; it should have 10");
        assert_eq!(build_over_poses(&none, &Reinsert::default()).unwrap_err(), BuildError::NoPoses);
        assert_eq!(build_over_poses(&uneven, &Reinsert::default()).unwrap_err(), wrong);
    }
}
