//! Queries through closures against the same questions asked of every primitive, on trees fresh and
//! updated.

use std::collections::BTreeSet;
use std::ops::ControlFlow::{Break, Continue};

use bvh_build::{BuildOptions, Builder, build, build_with};
use bvh_core::{
    Aabb, Bvh, Primitives, Ray, TriangleTest, Triangles, Vec3, Visits, any_hit_counted, closest_hit_brute,
    closest_hit_counted,
};
use bvh_update::{Rotate, Strategy, Updater};
use pivot_tests::{Motion, Soup, closest_hit, noise};
use proptest::prelude::*;

/// A tree over a soup that has moved since it was built, and the soup as it is now.
fn moved(n: usize, seed: u64, motion: Motion, max_leaf_size: u32) -> (Bvh, Soup, Vec<Vec3>) {
    let soup = Soup::new(n, seed);
    let start = soup.pose(motion, 0);
    let triangles = Triangles { positions: &start, indices: &soup.triangles };
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    let mut bvh = build_with(&triangles, Builder::Binned, &options).expect("few enough");
    let now = soup.pose(motion, 3);
    let triangles = Triangles { positions: &now, indices: &soup.triangles };
    let strategy = Strategy::RefitRotate(Rotate::default());
    Updater::new(strategy).update(&mut bvh, &triangles).expect("same count");
    (bvh, soup, now)
}

fn overlapping(bvh: &Bvh, primitives: &dyn Primitives, query: &Aabb) -> Vec<usize> {
    let mut found = Vec::new();
    bvh.for_each_overlap(primitives, query, |p| {
        found.push(p);
        Continue(())
    });
    found.sort_unstable();
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn boxes_that_overlap_are_found_once_each(
        n in 0usize..300, seed: u64, motion in prop::sample::select(&Motion::ALL[..]), at in 0usize..9
    ) {
        let (bvh, soup, now) = moved(n, seed, motion, 1);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let corner = noise(seed ^ 5, at) * 10.0;
        let query = Aabb::new(corner, corner + noise(seed ^ 6, at) * 5.0);
        let expected: Vec<_> = (0..n).filter(|&i| triangles.aabb(i).overlaps(&query)).collect();
        prop_assert_eq!(overlapping(&bvh, &triangles, &query), expected);
        prop_assert_eq!(overlapping(&bvh, &triangles, &Aabb::EMPTY), Vec::<usize>::new());
    }

    #[test]
    fn larger_leaves_give_the_same(n in 0usize..300, seed: u64) {
        let (bvh, soup, now) = moved(n, seed, Motion::Divergent, 4);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let query = Aabb::new(Vec3::splat(2.0), Vec3::splat(6.0));
        let found = overlapping(&bvh, &triangles, &query);
        let expected: Vec<_> = (0..n).filter(|&i| triangles.aabb(i).overlaps(&query)).collect();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn pairs_that_overlap_are_found_once_each(
        n in 0usize..150, seed: u64, motion in prop::sample::select(&Motion::ALL[..])
    ) {
        let (bvh, soup, now) = moved(n, seed, motion, 1);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let mut found = BTreeSet::new();
        let mut twice = 0;
        bvh.for_each_pair(&triangles, |a, b| {
            twice += usize::from(!found.insert((a.min(b), a.max(b))));
            Continue(())
        });
        let expected: BTreeSet<_> = (0..n)
            .flat_map(|a| (a + 1..n).map(move |b| (a, b)))
            .filter(|&(a, b)| triangles.aabb(a).overlaps(&triangles.aabb(b)))
            .collect();
        prop_assert_eq!(twice, 0);
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn rays_find_the_nearest_triangle_and_end_when_asked(
        n in 1usize..300, seed: u64, motion in prop::sample::select(&Motion::ALL[..])
    ) {
        let (bvh, soup, now) = moved(n, seed, motion, 1);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        for i in 0..20 {
            let (from, to) = (noise(seed ^ 7, i) * 30.0 - 10.0, noise(seed ^ 8, i) * 10.0);
            let ray = Ray::new(from, to - from);
            // The test of one triangle is that of the oracle, so the nearest must be, too.
            let mut tested = 0;
            let mut nearest = None;
            bvh.cast_ray(&ray, f32::INFINITY, |p, t_max| {
                tested += 1;
                match closest_hit(&now, &soup.triangles[p..=p], from, to - from) {
                    Some((t, _)) if nearest.is_none_or(|(best, _)| t < best) => {
                        nearest = Some((t, p));
                        // Rounded up, so that a nearer one is not lost.
                        Continue((t as f32).next_up().min(t_max))
                    }
                    _ => Continue(t_max),
                }
            });
            prop_assert_eq!(nearest, closest_hit(&now, &soup.triangles, from, to - from));
            let mut any = 0;
            let (end, _) = bvh.cast_ray(&ray, f32::INFINITY, |_, _| { any += 1; Break(-1.0) });
            prop_assert!(any <= 1 && (any == 0) == (end == f32::INFINITY), "{any} tests, then {end}");
            prop_assert!(tested >= any);
            let fours = moved(n, seed, motion, 4).0;
            let mut any_of_four = 0;
            fours.cast_ray(&ray, f32::INFINITY, |_, _| { any_of_four += 1; Break(-1.0) });
            prop_assert!(any_of_four <= 1, "a walk goes on within its leaf");
            let brute = closest_hit_brute(&triangles, &ray, f32::INFINITY, TriangleTest::Double);
            prop_assert!(brute.is_none() || any == 1, "a ray that hits enters a leaf");
        }
    }
}

/// What an engine picks with: hits with weights, and what finding them took.
#[test]
fn picks_are_those_of_brute_force_and_visits_are_counted() {
    let (bvh, soup, now) = moved(2000, 5, Motion::Smooth, 1);
    let triangles = Triangles { positions: &now, indices: &soup.triangles };
    let mut hits = 0;
    for triangle in soup.triangles.iter().step_by(20) {
        let corners = triangle.map(|v| now[v as usize]);
        let target = (corners[0] + corners[1] + corners[2]) / 3.0;
        let from = Vec3::splat(-20.0);
        let ray = Ray::new(from, target - from);
        let truth = closest_hit_brute(&triangles, &ray, f32::INFINITY, TriangleTest::Watertight);
        let (mut closest, mut any) = (Visits::default(), Visits::default());
        let test = TriangleTest::Watertight;
        assert_eq!(closest_hit_counted(&bvh, &triangles, &ray, f32::INFINITY, test, &mut closest), truth);
        assert_eq!(any_hit_counted(&bvh, &triangles, &ray, f32::INFINITY, test, &mut any), truth.is_some());
        assert_eq!((closest.queries, any.queries), (1, 1));
        assert!(closest.nodes > 0 && closest.nodes < 1000, "{closest:?}");
        assert!(any.primitives <= closest.primitives && any.nodes <= closest.nodes, "{any:?} {closest:?}");
        if let Some(hit) = truth {
            assert!((hit.weights().iter().sum::<f32>() - 1.0).abs() < 1e-5, "{hit:?}");
            let point = hit.interpolate(triangles.corners(hit.primitive as usize));
            let along = from + ray.direction() * hit.t;
            assert!((point - along).length() < 1e-3, "{point} {along}");
            hits += 1;
        }
    }
    assert!(hits > 90, "{hits}");
}

/// Rounding puts the entry into these boxes behind `t_max`, but not what is in them.
#[test]
fn leaves_at_t_max_are_tested() {
    let mut by_rounding = 0;
    for i in 0..10_000u32 {
        let ray = Ray::new(Vec3::ZERO, Vec3::new(0.0, 0.0, 1.0 + i as f32 * 1.3e-5));
        let corner = Vec3::new(1.0, 1.0, 0.0);
        let middle = ray.direction() * 3.0;
        let flat = |distance| Aabb::new(middle * distance - corner, middle * distance + corner);
        let boxes = [flat(1.0), flat(1.0), flat(2.0)];
        let bvh = build(&boxes, Builder::Sweep).expect("few");
        let entry = ray.enters(&boxes[0], 3.0).expect("reached");
        by_rounding += u32::from(entry > 3.0);
        let mut tested = [0; 3];
        bvh.cast_ray(&ray, 3.0, |p, t_max| {
            tested[p] += 1;
            Continue(t_max)
        });
        assert_eq!(tested, [1, 1, 0], "direction {i}");
        // The same after a hit at 3, when the other is on the stack.
        let mut tested = [0; 3];
        bvh.cast_ray(&ray, f32::INFINITY, |p, _| {
            tested[p] += 1;
            Continue(3.0)
        });
        assert_eq!(tested, [1, 1, 0], "direction {i}");
    }
    assert!(by_rounding > 100, "{by_rounding}");
}

#[test]
fn queries_that_are_empty_or_not_finite_find_nothing() {
    let (bvh, soup, now) = moved(100, 3, Motion::PartlyNonFinite, 1);
    let triangles = Triangles { positions: &now, indices: &soup.triangles };
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut min, mut max) = (Vec3::MIN, Vec3::MAX);
            min[axis] = if bad == f32::NEG_INFINITY { f32::NAN } else { bad };
            assert!(overlapping(&bvh, &triangles, &Aabb::new(min, Vec3::MAX)).is_empty(), "{min}");
            max[axis] = if bad == f32::INFINITY { f32::NAN } else { bad };
            assert!(overlapping(&bvh, &triangles, &Aabb::new(Vec3::MIN, max)).is_empty(), "{max}");
        }
    }
    let target = Aabb::around(&soup.triangles[1].map(|v| now[v as usize])).center();
    let ray = Ray::new(Vec3::splat(-20.0), target + 20.0);
    assert!(bvh.cast_ray(&ray, f32::INFINITY, |_, _| Break(-1.0)).0 < 0.0, "it goes right through");
    for t_max in [f32::NAN, -1.0, f32::NEG_INFINITY] {
        bvh.cast_ray(&ray, t_max, |p, _| panic!("{p} before {t_max}"));
    }
    bvh.cast_ray(&Ray::new(Vec3::NAN, Vec3::ONE), f32::INFINITY, |p, _| panic!("{p}"));
}

/// Signed distances to balls, asked for within several of them.
#[test]
fn the_nearest_may_be_at_a_negative_distance() {
    let (center, radius) = (|p: usize| Vec3::X * p as f32, |p: usize| 1.0 + (p * 7 % 10) as f32);
    let boxes: Vec<_> = (0..10).map(|p| Aabb::new(center(p) - radius(p), center(p) + radius(p))).collect();
    let bvh = build(&boxes, Builder::Sweep).expect("few enough");
    let point = Vec3::new(4.5, 0.25, 0.0);
    let distance = |p: usize| point.distance(center(p)) - radius(p);
    // No place in a box is deeper in a ball than half its least extent.
    let bound = |aabb: &Aabb| aabb.distance_squared(point).sqrt() - (aabb.max - aabb.min).min_element() / 2.0;
    let least = (0..10).map(|p| (p, distance(p))).min_by(|a, b| a.1.total_cmp(&b.1));
    assert_eq!(bvh.nearest(f32::INFINITY, bound, |p, _| distance(p)).0, least);
    assert_eq!(bvh.nearest(-1.0, bound, |p, _| distance(p)).0, least, "from a negative limit on");
}

#[test]
fn nothing_is_found_in_an_empty_tree() {
    let bvh = Bvh::default();
    let everywhere = Aabb::new(Vec3::MIN, Vec3::MAX);
    assert!(overlapping(&bvh, &[], &everywhere).is_empty());
    bvh.for_each_pair(&[], |a, b| panic!("{a} and {b}"));
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    assert_eq!(bvh.cast_ray(&ray, 5.0, |p, _| panic!("{p}")).0, 5.0);
}
