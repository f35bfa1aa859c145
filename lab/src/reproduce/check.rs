//! What every strategy must agree on: pictures among themselves, hits with brute force, boxes with
//! the primitives.

use std::fmt;

use bvh_core::{Bvh, Ray, Triangles};
use rayon::prelude::*;
use rt_cpu::{Camera, Hit, RenderStats, TriangleTest, closest_hit, closest_hit_brute};
use serde::{Deserialize, Serialize};

/// A ray, and what it hits by brute force.
pub(crate) type SampleRay = (Ray, Option<Hit>);

/// What was compared, and what differed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Checks {
    /// Pictures of two strategies on one frame, compared by hashes of all their bits.
    pub(crate) pictures: u64,
    pub(crate) pixels: u64,
    /// Rays whose closest hit was compared with that of a caster that tests every triangle.
    pub(crate) rays: u64,
    /// Of those, rays that hit something.
    pub(crate) rays_hit: u64,
    /// Updated trees whose structure, boxes, heights and marks were validated.
    pub(crate) trees: u64,
    /// Whatever was not equal or not valid.
    pub(crate) differences: u64,
    /// The first of them.
    pub(crate) first_difference: Option<String>,
}

impl Checks {
    /// Adds what was checked elsewhere.
    pub(crate) fn add(&mut self, other: &Self) {
        self.pictures += other.pictures;
        self.pixels += other.pixels;
        self.rays += other.rays;
        self.rays_hit += other.rays_hit;
        self.trees += other.trees;
        self.differences += other.differences;
        if self.first_difference.is_none() {
            self.first_difference.clone_from(&other.first_difference);
        }
    }

    /// Counts a difference unless something `holds`.
    pub(crate) fn expect(&mut self, holds: bool, place: &str, what: fmt::Arguments<'_>) {
        if !holds {
            self.differences += 1;
            self.first_difference.get_or_insert_with(|| format!("{place}: {what}"));
        }
    }

    /// Counts of hits and shadow rays of two strategies.
    pub(crate) fn same_hits(&mut self, place: &str, a: &RenderStats, b: &RenderStats) {
        for (what, a, b) in [
            ("hits", a.hits, b.hits),
            ("shadow rays", a.rays_shadow, b.rays_shadow),
            ("pixels in shadow", a.shadowed, b.shadowed),
        ] {
            self.expect(a == b, place, format_args!("{a} and {b} {what}"));
        }
    }

    /// Compares pictures of two strategies. `same` says whether all bits of their `pixels` pixels
    /// are equal.
    pub(crate) fn same_picture(&mut self, place: &str, pixels: usize, same: bool) {
        self.pictures += 1;
        self.pixels += pixels as u64;
        self.expect(same, place, format_args!("pixels differ"));
    }

    /// Everything a tree promises, and hits through it with those by brute force.
    pub(crate) fn of_tree(place: &str, tree: &Bvh, triangles: &Triangles<'_>, rays: &[SampleRay]) -> Self {
        let mut checks = Self { rays: rays.len() as u64, trees: 1, ..Self::default() };
        for (ray, expected) in rays {
            checks.rays_hit += u64::from(expected.is_some());
            let found = closest_hit(tree, triangles, ray, f32::INFINITY, TriangleTest::default());
            let what = format_args!("a ray hits {found:?}, but by brute force {expected:?}");
            checks.expect(found == *expected, place, what);
        }
        if let Err(error) = tree.validate(triangles) {
            checks.expect(false, place, format_args!("{error}"));
        }
        checks
    }
}

/// Rays through random pixels, with what they hit if every triangle is tested.
pub(crate) fn sample(camera: &Camera, triangles: &Triangles<'_>, count: usize, seed: u64) -> Vec<SampleRay> {
    let mut random = fastrand::Rng::with_seed(seed);
    let rays: Vec<Ray> =
        (0..count).map(|_| camera.ray(random.u32(0..camera.width), random.u32(0..camera.height))).collect();
    rays.into_par_iter()
        .map(|ray| (ray, closest_hit_brute(triangles, &ray, f32::INFINITY, TriangleTest::default())))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_differs_is_counted_and_the_first_is_named() {
        let (mut checks, stats) = (Checks::default(), RenderStats { hits: 3, ..RenderStats::default() });
        checks.same_hits("equal", &stats, &stats);
        checks.same_picture("equal", 16, true);
        checks.expect(true, "equal", format_args!("costs"));
        assert_eq!((checks.differences, checks.pictures, checks.pixels), (0, 1, 16));
        checks.expect(false, "twin", format_args!("costs"));
        checks.same_picture("picture", 16, false);
        checks.same_hits("hits", &stats, &RenderStats { hits: 4, ..stats });
        let mut all = Checks::default();
        all.add(&checks);
        assert_eq!((all.differences, all.pictures, all.pixels), (3, 2, 32));
        assert!(all.first_difference.unwrap().starts_with("twin: "));
    }
}
