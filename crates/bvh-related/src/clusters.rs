//! Clusters of triangles that move alike over an animation (Günther et al. 2006, "motion
//! decomposition").
//!
//! ```text
//! decompose(S):  for each pose k: the rotation and shift that take the centres of S in the first pose nearest to those in k
//!                residual of a triangle: how far its centre is from where these put it
//!                residuals small, against the triangles' size: S is a cluster
//!                else split S by the sign of the residuals along their widest direction;
//!                     a few times: fit both parts, let each triangle go where its residual is less   (Lloyd)
//!                     decompose(left), decompose(right)
//! ```

use bvh_core::glam::{DMat3, DVec3};
use bvh_core::{Aabb, Primitives, Triangles, Vec3};

use crate::rigid::{Motion, outer, widest};

/// Largest root mean square of a cluster's residuals, in diagonals of its average triangle.
const TOLERANCE: f64 = 0.5;

/// A cluster of at most this number of triangles is not split.
const SMALLEST: usize = 8;

/// Most triangles that a motion is fitted to; larger sets are sampled evenly.
const SAMPLE: usize = 10_000;

/// Rounds of assigning triangles to the nearer of two motions.
const ROUNDS: usize = 8;

/// Largest depth of splits: each split may take off one triangle only.
const DEEPEST: u32 = 64;

/// Sets of fewer triangles are decomposed by one thread.
const GRAIN: usize = 4096;

/// Where the centre of each triangle's box is in each pose.
pub(crate) struct Paths {
    /// All poses of one triangle together; NaN where its box is empty.
    centers: Vec<Vec3>,
    /// Squared diagonal of each triangle in the first pose.
    sizes: Vec<f64>,
    poses: usize,
}

impl Paths {
    /// The paths through poses of the same triangles.
    pub(crate) fn new(poses: &[Triangles<'_>]) -> Self {
        let n = poses.first().map_or(0, Primitives::len);
        let center = |aabb: Aabb| if aabb.is_empty() { Vec3::NAN } else { aabb.center() };
        let all = (0..n).flat_map(|p| poses.iter().map(move |pose| center(pose.aabb(p))));
        Self {
            centers: all.collect(),
            sizes: (0..n).map(|p| poses[0].aabb(p).extent().as_dvec3().length_squared()).collect(),
            poses: poses.len(),
        }
    }

    /// All triangles in clusters; those without a box in the first pose in none.
    pub(crate) fn clusters(&self) -> Vec<Vec<u32>> {
        let has_box = |&p: &u32| !self.at(p, 0).is_nan();
        let mut clusters = Vec::new();
        self.decompose((0..self.sizes.len() as u32).filter(has_box).collect(), 0, &mut clusters);
        clusters
    }

    fn at(&self, p: u32, pose: usize) -> DVec3 {
        self.centers[self.poses * p as usize + pose].as_dvec3()
    }

    /// The motion of a set in each pose.
    pub(crate) fn fit(&self, set: &[u32]) -> Vec<Motion> {
        let sample = || set.iter().step_by(set.len().div_ceil(SAMPLE).max(1));
        let pairs =
            |k| move || sample().map(move |&p| (self.at(p, 0), self.at(p, k))).filter(|(_, b)| !b.is_nan());
        (0..self.poses).map(|k| Motion::fit(pairs(k))).collect()
    }

    /// Vector from where a motion puts a triangle in pose `k` to where it is; zero for an empty
    /// box.
    fn residual(&self, p: u32, k: usize, motion: &Motion) -> DVec3 {
        let residual = self.at(p, k) - motion.apply(self.at(p, 0));
        if residual.is_nan() { DVec3::ZERO } else { residual }
    }

    /// Sum of squared residuals over all poses.
    fn squared(&self, p: u32, motions: &[Motion]) -> f64 {
        motions.iter().enumerate().map(|(k, motion)| self.residual(p, k, motion).length_squared()).sum()
    }

    /// Whether a set moves alike enough to be one cluster.
    fn are_alike(&self, set: &[u32], motions: &[Motion]) -> bool {
        let sum: f64 = set.iter().map(|&p| self.squared(p, motions)).sum();
        let size: f64 = set.iter().map(|&p| self.sizes[p as usize]).sum();
        sum <= TOLERANCE * TOLERANCE * size * self.poses as f64
    }

    /// Splits a set into clusters.
    fn decompose(&self, set: Vec<u32>, depth: u32, clusters: &mut Vec<Vec<u32>>) {
        if set.is_empty() {
            return;
        }
        let motions = self.fit(&set);
        let is_whole = depth == DEEPEST || set.len() <= SMALLEST || self.are_alike(&set, &motions);
        let Some([l, r]) = (if is_whole { None } else { self.split(&set, &motions) }) else {
            clusters.push(set);
            return;
        };
        if set.len() > GRAIN {
            let mut right = Vec::new();
            rayon::join(
                || self.decompose(l, depth + 1, clusters),
                || self.decompose(r, depth + 1, &mut right),
            );
            clusters.append(&mut right);
        } else {
            self.decompose(l, depth + 1, clusters);
            self.decompose(r, depth + 1, clusters);
        }
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
        if parts.iter().any(Vec::is_empty) {
            return None;
        }
        for _ in 0..ROUNDS {
            let [l, r] = [self.fit(&parts[0]), self.fit(&parts[1])];
            let next: [Vec<u32>; 2] =
                set.iter().partition::<Vec<_>, _>(|&&p| self.squared(p, &l) < self.squared(p, &r)).into();
            if next == parts || next.iter().any(Vec::is_empty) {
                break;
            }
            parts = next;
        }
        Some(parts)
    }
}
