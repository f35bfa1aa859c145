//! Motion decomposition (Günther, Friedrich, Wald, Seidel, Slusallek 2006, "Ray tracing animated
//! scenes using motion decomposition"): primitives that move alike share a subtree.
//!
//! ```text
//! decompose(S):  for each pose k: the rotation and shift that take the centres of S in the first pose nearest to those in k
//!                residual of a primitive: how far it is from where these put it
//!                residuals small, against the primitives' size: S is a cluster
//!                else split S by the sign of the residuals along their widest direction;
//!                     a few times: fit both parts, let each primitive go where its residual is less   (Lloyd)
//!                     decompose(left), decompose(right)
//! parts:         a cluster in several places is split; neighbours that move alike are joined
//! tree:          a sweep over each part, its boxes grown by the residuals; above them one tree, T-SAH over all poses
//! ```
//!
//! Departures: clusters are split in two recursively, where the paper adds seeds until residuals
//! are small. Motions are rigid, not affine, because boxes in world space grow where a map
//! stretches. Only the centres of the primitives' boxes are known. There are no local coordinates
//! and no tree over the clusters in each frame, but one tree, which is refitted.

use bvh_core::glam::{DMat3, DVec3};
use bvh_core::{Aabb, Bvh, Node, Primitives};
use rayon::prelude::*;

use crate::options::with_methods;
use crate::poses::{best_start, check};
use crate::rigid::{Motion, outer, widest};
use crate::{BuildError, Builder, Pose, Reinsert, ReinsertScratch, build, optimize_over_poses, refit};

/// Settings of [`build_by_motion`]: when primitives count as moving alike.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Decomposition {
    /// Largest root mean square of a cluster's residuals, in diagonals of its average primitive;
    /// 0.5 by default.
    pub tolerance: f64,
    /// A cluster of at most this number of primitives is not split; 8 by default.
    pub smallest: u32,
    /// The budget of the tree above the clusters.
    pub top: Reinsert,
}

with_methods!(Decomposition: with_tolerance(tolerance: f64), with_smallest(smallest: u32),
    with_top(top: Reinsert));

impl Default for Decomposition {
    fn default() -> Self {
        Self { tolerance: 0.5, smallest: 8, top: Reinsert::default() }
    }
}

/// Builds one tree for all poses, to be refitted from frame to frame (Günther et al. 2006): a
/// subtree over each group of primitives that move alike, and a tree of low cost over all poses
/// above them. One primitive a leaf; boxes fit the first pose.
///
/// For pieces that fly apart. [`optimize_over_poses`] improves the tree further, but gets as far
/// from other trees. Runs on all threads of the current rayon pool; the tree is the same for any
/// number of them. O(k n log n) for k poses in practice.
///
/// # Errors
/// If there are no poses, too many primitives, or poses of different numbers of primitives.
///
/// ```
/// use bvh_build::{Decomposition, Pose, build_by_motion};
/// use bvh_core::{Aabb, Vec3};
///
/// // Two pieces, mixed at first, that part along x.
/// let pose = |time: f32| -> Vec<Aabb> {
///     let corner = |i: i32| Vec3::new(i as f32 + (i % 2 * 2 - 1) as f32 * time, 0.0, 0.0);
///     (0..40).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect()
/// };
/// let (first, last) = (pose(0.0), pose(100.0));
/// let bvh = build_by_motion(&[Pose::new(&first), Pose::new(&last)], &Decomposition::default())?;
/// assert!(bvh.validate(&first).is_ok());
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn build_by_motion<P: Primitives + ?Sized>(
    poses: &[Pose<'_, P>],
    options: &Decomposition,
) -> Result<Bvh, BuildError> {
    let first = poses.first().ok_or(BuildError::NoPoses)?.primitives;
    check(first.len(), poses)?;
    let fallback = || build(first, Builder::Sweep);
    let has_box = |p: &u32| !first.aabb(*p as usize).sanitized().is_empty();
    let (moving, dropped): (Vec<u32>, Vec<u32>) = (0..first.len() as u32).partition(has_box);
    let paths = Paths::new(poses);
    let mut found = Vec::new();
    paths.decompose(moving, options, 0, &mut found);
    if found.len() < 2 {
        return fallback();
    }
    let apart = found.par_iter().map(|set| part(set, first)).collect::<Result<Vec<_>, _>>()?;
    let mut parts: Vec<_> = apart.into_iter().flatten().collect();
    let split = top(&parts, poses, &options.top)?;
    let mut whole = Vec::new();
    let last = paths.merge(&split, 0, &mut parts, options, &mut whole);
    whole.extend(last);
    parts = whole;
    if !dropped.is_empty() {
        parts.push(dropped);
    }
    if parts.len() < 2 {
        return fallback();
    }
    let top = top(&parts, poses, &options.top)?;
    let subtrees = parts.par_iter().map(|set| paths.tree(set, first)).collect::<Result<Vec<_>, _>>()?;
    let (mut nodes, order) = graft(&top, &subtrees, &parts);
    refit(&mut nodes, &order, first);
    // Only a tree that would be too high is refused.
    Bvh::new(&nodes, order).or_else(|_| fallback())
}

/// Splits a cluster that is in several places: where two subtrees of the tree over it have together
/// less area than their parent.
fn part<P: Primitives + ?Sized>(set: &[u32], first: &P) -> Result<Vec<Vec<u32>>, BuildError> {
    let boxes: Vec<_> = set.iter().map(|&p| first.aabb(p as usize)).collect();
    let bvh = build(&boxes, Builder::Sweep)?;
    let (mut parts, mut todo) = (Vec::new(), vec![0]);
    while let Some(n) = todo.pop() {
        let node = &bvh.nodes()[n];
        if is_compact(&bvh, node) {
            let mut below = Vec::new();
            let mut stack = vec![*node];
            while let Some(node) = stack.pop() {
                below.extend(bvh.primitives(&node).iter().map(|&i| set[i as usize]));
                stack.extend(bvh.children(&node).into_iter().flatten());
            }
            parts.push(below);
        } else {
            todo.extend([node.first() + 1, node.first()]);
        }
    }
    Ok(parts)
}

/// Whether a node has no more area than its children together.
fn is_compact(bvh: &Bvh, node: &Node) -> bool {
    bvh.children(node).is_none_or(|children| {
        let below: f64 = children.iter().map(|child| child.aabb().half_area_f64()).sum();
        node.aabb().half_area_f64() <= below
    })
}

/// The tree of least cost over all poses above the clusters.
fn top<P: Primitives + ?Sized>(
    parts: &[Vec<u32>],
    poses: &[Pose<'_, P>],
    options: &Reinsert,
) -> Result<Bvh, BuildError> {
    let bounds = |set: &Vec<u32>, primitives: &P| {
        let boxes = set.iter().map(|&p| primitives.aabb(p as usize).sanitized());
        boxes.fold(Aabb::EMPTY, Aabb::union)
    };
    let boxes: Vec<Vec<Aabb>> =
        poses.iter().map(|pose| parts.iter().map(|set| bounds(set, pose.primitives)).collect()).collect();
    let poses: Vec<_> = poses
        .iter()
        .zip(&boxes)
        .map(|(pose, boxes)| Pose { primitives: boxes, weight: pose.weight })
        .collect();
    let mut top = best_start(&poses, Builder::Sweep)?;
    optimize_over_poses(&mut top, &poses, options, &mut ReinsertScratch::new())?;
    Ok(top)
}

/// Puts the tree over each cluster in the place of its leaf in `top`; gives nodes and order.
fn graft(top: &Bvh, subtrees: &[Bvh], parts: &[Vec<u32>]) -> (Vec<Node>, Vec<u32>) {
    let (mut nodes, mut order) = (vec![Node::NOTHING; 2], Vec::new());
    let mut todo = vec![(top, None, 0, 0)];
    while let Some((tree, part, from, to)) = todo.pop() {
        let node = tree.nodes()[from];
        match (tree.primitives(&node), part) {
            (&[leaf], None) => todo.push((&subtrees[leaf as usize], Some(leaf as usize), 0, to)),
            (&[leaf], Some(part)) => {
                nodes[to] = Node::leaf(node.aabb(), order.len() as u32, 1);
                order.push(parts[part][leaf as usize]);
            }
            _ => {
                let pair = nodes.len();
                nodes.extend([Node::NOTHING; 2]);
                nodes[to] = Node::inner(node.aabb(), pair as u32);
                todo.push((tree, part, node.first() + 1, pair + 1));
                todo.push((tree, part, node.first(), pair));
            }
        }
    }
    (nodes, order)
}

/// Where the centre of each primitive is in each pose.
struct Paths {
    /// All poses of one primitive together; NaN where its box is empty.
    centers: Vec<DVec3>,
    /// Squared diagonal of each primitive in the first pose.
    sizes: Vec<f64>,
    poses: usize,
}

/// Rounds of assigning primitives to the nearer of two motions.
const ROUNDS: usize = 8;

/// Largest depth of splits: each split may take off one primitive only.
const DEEPEST: u32 = 64;

/// Sets of fewer primitives are decomposed by one thread.
const GRAIN: usize = 4096;

impl Paths {
    fn new<P: Primitives + ?Sized>(poses: &[Pose<'_, P>]) -> Self {
        let n = poses[0].primitives.len();
        let center = |aabb: Aabb| if aabb.is_empty() { DVec3::NAN } else { aabb.center().as_dvec3() };
        let aabb = |k: usize, p: usize| poses[k].primitives.aabb(p).sanitized();
        Self {
            centers: (0..n * poses.len()).map(|i| center(aabb(i % poses.len(), i / poses.len()))).collect(),
            sizes: (0..n).map(|p| aabb(0, p).extent().as_dvec3().length_squared()).collect(),
            poses: poses.len(),
        }
    }

    fn of(&self, p: u32) -> &[DVec3] {
        &self.centers[self.poses * p as usize..][..self.poses]
    }

    /// The motion of a set in each pose.
    fn fit(&self, set: &[u32]) -> Vec<Motion> {
        let paths = || set.iter().map(|&p| self.of(p));
        let pairs =
            |k: usize| move || paths().map(move |path| (path[0], path[k])).filter(|(_, b)| !b.is_nan());
        (0..self.poses).map(|k| Motion::fit(pairs(k))).collect()
    }

    /// Vector from where a motion puts a primitive in pose `k` to where it is; zero for an empty
    /// box.
    fn residual(&self, p: u32, k: usize, motion: &Motion) -> DVec3 {
        let residual = self.of(p)[k] - motion.apply(self.of(p)[0]);
        if residual.is_nan() { DVec3::ZERO } else { residual }
    }

    /// Sum of squared residuals over all poses.
    fn squared(&self, p: u32, motions: &[Motion]) -> f64 {
        motions.iter().enumerate().map(|(k, motion)| self.residual(p, k, motion).length_squared()).sum()
    }

    /// Whether a set moves alike enough to be one cluster.
    fn are_alike(&self, set: &[u32], motions: &[Motion], options: &Decomposition) -> bool {
        let sum: f64 = set.iter().map(|&p| self.squared(p, motions)).sum();
        let size: f64 = set.iter().map(|&p| self.sizes[p as usize]).sum();
        sum <= options.tolerance.powi(2) * size * self.poses as f64
    }

    /// Splits a set into clusters.
    fn decompose(&self, set: Vec<u32>, options: &Decomposition, depth: u32, clusters: &mut Vec<Vec<u32>>) {
        if set.is_empty() {
            return;
        }
        let motions = self.fit(&set);
        let is_whole = depth == DEEPEST
            || set.len() <= options.smallest.max(1) as usize
            || self.are_alike(&set, &motions, options);
        let Some([l, r]) = (if is_whole { None } else { self.split(&set, &motions) }) else {
            clusters.push(set);
            return;
        };
        if set.len() > GRAIN {
            let mut right = Vec::new();
            rayon::join(
                || self.decompose(l, options, depth + 1, clusters),
                || self.decompose(r, options, depth + 1, &mut right),
            );
            clusters.append(&mut right);
        } else {
            self.decompose(l, options, depth + 1, clusters);
            self.decompose(r, options, depth + 1, clusters);
        }
    }

    /// Joins clusters that are neighbours in the tree `top`, in one place, and move alike:
    /// splitting cuts some pieces. Gives the cluster of all primitives below node `n`, if they are
    /// one cluster; other clusters go to `whole`.
    fn merge(
        &self,
        top: &Bvh,
        n: usize,
        parts: &mut [Vec<u32>],
        options: &Decomposition,
        whole: &mut Vec<Vec<u32>>,
    ) -> Option<Vec<u32>> {
        let node = &top.nodes()[n];
        if let &[part] = top.primitives(node) {
            return Some(std::mem::take(&mut parts[part as usize]));
        }
        let l = self.merge(top, node.first(), parts, options, whole);
        let r = self.merge(top, node.first() + 1, parts, options, whole);
        if let (Some(l), Some(r)) = (&l, &r)
            && is_compact(top, node)
        {
            let both = [l.as_slice(), r].concat();
            if self.are_alike(&both, &self.fit(&both), options) {
                return Some(both);
            }
        }
        whole.extend(l.into_iter().chain(r));
        None
    }

    /// The tree over a cluster, over boxes that have room for all residuals.
    fn tree<P: Primitives + ?Sized>(&self, set: &[u32], first: &P) -> Result<Bvh, BuildError> {
        let motions = self.fit(set);
        let grown = |&p: &u32| {
            let residuals =
                motions.iter().enumerate().map(|(k, motion)| self.residual(p, k, motion).length());
            let reach = residuals.fold(0.0, f64::max) as f32;
            let aabb = first.aabb(p as usize).sanitized();
            Aabb::new(aabb.min - reach, aabb.max + reach).sanitized()
        };
        let boxes: Vec<_> = set.iter().map(grown).collect();
        build(&boxes, Builder::Sweep)
    }

    /// Splits a set in two that each move more alike; `None` if the residuals do not separate it.
    fn split(&self, set: &[u32], motions: &[Motion]) -> Option<[Vec<u32>; 2]> {
        let sum_in =
            |k: usize| set.iter().map(|&p| self.residual(p, k, &motions[k]).length_squared()).sum::<f64>();
        let sums: Vec<f64> = (0..self.poses).map(sum_in).collect();
        let worst = (1..self.poses).fold(0, |worst, k| if sums[k] > sums[worst] { k } else { worst });
        let residual = |p: u32| self.residual(p, worst, &motions[worst]);
        let spread = set.iter().fold(DMat3::ZERO, |sum, &p| sum + outer(residual(p), residual(p)));
        let axis = widest(spread);
        let mut parts: [Vec<u32>; 2] =
            set.iter().partition::<Vec<_>, _>(|&&p| residual(p).dot(axis) < 0.0).into();
        for _ in 0..ROUNDS {
            if parts.iter().any(Vec::is_empty) {
                return None;
            }
            let [l, r] = [self.fit(&parts[0]), self.fit(&parts[1])];
            let next: [Vec<u32>; 2] =
                set.iter().partition::<Vec<_>, _>(|&&p| self.squared(p, &l) < self.squared(p, &r)).into();
            if next == parts {
                break;
            }
            if next.iter().all(|part| !part.is_empty()) {
                parts = next;
            } else {
                break;
            }
        }
        Some(parts)
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::Vec3;
    use bvh_core::glam::DQuat;

    use super::*;
    use crate::tests::streets;
    use crate::{build_over_poses, cost_over_poses};

    /// Cubes of 3 x 3 x 3 boxes each, tightly packed, that fly off in all directions and turn as
    /// they go.
    fn burst(pieces: usize, time: f32) -> Vec<Aabb> {
        let at = |i: usize| Vec3::new((i % 27 % 3) as f32, (i % 9 / 3) as f32, (i % 27 / 9) as f32) - 1.0;
        let piece = |i: usize| {
            let home = Vec3::new((i % 8) as f32, (i / 8 % 8) as f32, (i / 64) as f32) * 3.0;
            let hash = (i as u32).wrapping_mul(0x9e37_79b9);
            let part = |shift: u32| (hash >> shift & 0xff) as f32 / 128.0 - 1.0;
            (home, Vec3::new(part(0), part(8), part(16)) * 60.0, part(24) * 3.0)
        };
        let place = |i: usize| {
            let (home, speed, turn) = piece(i / 27);
            let (sin, cos) = (turn * time).sin_cos();
            let p = at(i % 27);
            home + speed * time + Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z)
        };
        (0..27 * pieces).map(place).map(|p| Aabb::new(p - 0.7, p + 0.7)).collect()
    }

    fn poses(all: &[Vec<Aabb>]) -> Vec<Pose<'_, Vec<Aabb>>> {
        all.iter().map(Pose::new).collect()
    }

    fn tree(boxes: &Vec<Aabb>) -> Bvh {
        build(boxes, Builder::Sweep).expect("few enough")
    }

    #[test]
    fn pieces_that_fly_apart_get_a_cheaper_tree() {
        let all: Vec<_> = [0.0, 0.3, 1.0].into_iter().map(|time| burst(200, time)).collect();
        let poses = poses(&all);
        let cost = |bvh: &Bvh| cost_over_poses(bvh, &poses).expect("poses");
        let bvh = build_by_motion(&poses, &Decomposition::default()).expect("poses");
        bvh.validate(&all[0]).expect("valid");
        let alone = all.iter().map(|boxes| cost(&tree(boxes))).fold(f64::INFINITY, f64::min);
        assert!(cost(&bvh) < 0.95 * alone, "{} to {alone}", cost(&bvh));
        assert!(cost(&bvh) < 0.4 * cost(&tree(&all[0])));
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let again = pool.install(|| build_by_motion(&poses, &Decomposition::default()));
            assert_eq!(again.expect("poses").fingerprint(), bvh.fingerprint());
        }
    }

    #[test]
    fn rigid_pieces_become_clusters_of_their_own() {
        let all = [0.0, 0.5, 1.0].map(|time| burst(60, time));
        let mut clusters = Vec::new();
        let set = (0..60 * 27).collect();
        Paths::new(&poses(&all)).decompose(set, &Decomposition::default(), 0, &mut clusters);
        // Some pieces move alike by chance, and few are cut.
        assert!((40..=80).contains(&clusters.len()), "{}", clusters.len());
        let pieces = |c: &Vec<u32>| {
            let mut pieces: Vec<_> = c.iter().map(|p| p / 27).collect();
            pieces.dedup();
            pieces.len()
        };
        assert!(clusters.iter().map(pieces).sum::<usize>() < 80);
    }

    #[test]
    fn a_rigid_scene_gets_the_tree_of_its_first_pose() {
        let turn = |time: f32| -> Vec<Aabb> {
            let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -2.0) / 3.0, f64::from(time)).as_quat();
            streets(300)
                .iter()
                .map(|b| turn * b.center() + 9.0 * time)
                .map(|p| Aabb::new(p - 0.1, p + 0.1))
                .collect()
        };
        let all = [0.0, 1.0, 2.5].map(turn);
        let bvh = build_by_motion(&poses(&all), &Decomposition::default()).expect("poses");
        assert_eq!(bvh.fingerprint(), tree(&all[0]).fingerprint());
    }

    #[test]
    fn hard_input_gives_valid_trees() {
        let same = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 500];
        let huge = |s: f32| streets(300).iter().map(|b| Aabb::new(b.min * s, b.max * s)).collect::<Vec<_>>();
        let mut gone = burst(10, 1.0);
        gone[40..150].fill(Aabb::EMPTY);
        let points: Vec<_> = burst(10, 0.5).iter().map(|b| Aabb::new(b.min, b.min)).collect();
        let chain = |s: f32| {
            (0..200).map(move |i| Aabb::around(&[Vec3::ZERO, Vec3::new(s * 1.5f32.powi(i), 1.0, 1.0)]))
        };
        for all in [
            vec![vec![], vec![]],
            vec![burst(1, 0.0)[..1].to_vec(), burst(1, 1.0)[..1].to_vec()],
            vec![burst(1, 0.0)[..2].to_vec(), burst(1, 1.0)[..2].to_vec()],
            vec![same.clone(), same.clone()],
            vec![huge(1e-42), huge(3e38)],
            vec![huge(1.0), huge(1e18), huge(0.0)],
            vec![burst(10, 0.0), gone.clone(), points.clone()],
            vec![gone, burst(10, 0.0)],
            vec![vec![Aabb::EMPTY; 100], burst(4, 0.0)[..100].to_vec()],
            vec![points, burst(10, 0.0)],
            vec![chain(1.0).collect(), chain(-1.0).collect()],
        ] {
            let poses = poses(&all);
            for options in [
                Decomposition::default(),
                Decomposition { tolerance: f64::NAN, smallest: 0, ..Decomposition::default() },
            ] {
                let bvh = build_by_motion(&poses, &options).expect("poses");
                bvh.validate(&all[0]).expect("valid");
            }
            let bvh = build_over_poses(&poses, &Reinsert::default()).expect("poses");
            bvh.validate(&all[0]).expect("valid");
            assert!(cost_over_poses(&bvh, &poses).expect("poses").is_finite());
        }
    }
}
