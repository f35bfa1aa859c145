//! Queries through closures against the same questions asked of every primitive, on trees fresh and
//! updated.

use std::ops::ControlFlow::{Break, Continue};

use bvh_build::{BuildOptions, Builder, build, build_with};
use bvh_core::{
    Aabb, Bvh, MAX_HEIGHT, Node, Primitives, Ray, TriangleTest, Triangles, Vec3, Visits, any_hit_counted,
    closest_hit_brute, closest_hit_counted, closest_hit_where,
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

/// The primitives that a query finds until it has found `most`.
fn overlapping(bvh: &Bvh, primitives: &dyn Primitives, query: &Aabb, most: usize) -> (Vec<usize>, Visits) {
    let mut found = Vec::new();
    let visits = bvh.for_each_overlap(primitives, query, |p| {
        found.push(p);
        if found.len() == most { Break(()) } else { Continue(()) }
    });
    found.sort_unstable();
    (found, visits)
}

/// The pairs that a query finds until it has found `most`.
fn pairs(bvh: &Bvh, primitives: &dyn Primitives, most: usize) -> (Vec<(usize, usize)>, Visits) {
    let mut found = Vec::new();
    let visits = bvh.for_each_pair(primitives, |a, b| {
        found.push((a.min(b), a.max(b)));
        if found.len() == most { Break(()) } else { Continue(()) }
    });
    found.sort_unstable();
    (found, visits)
}

/// All pairs of primitives whose boxes overlap.
fn all_pairs(primitives: &dyn Primitives) -> Vec<(usize, usize)> {
    let n = primitives.len();
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    pairs.filter(|&(a, b)| primitives.aabb(a).overlaps(&primitives.aabb(b))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn boxes_and_pairs_that_overlap_are_found_once_each_until_the_query_breaks(
        n in 0usize..150, seed: u64, motion in prop::sample::select(&Motion::ALL[..]),
        max_leaf_size in prop::sample::select(vec![1u32, 4, 50])
    ) {
        let (bvh, soup, now) = moved(n, seed, motion, max_leaf_size);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let corner = noise(seed ^ 5, 0) * 10.0;
        let query = Aabb::new(corner, corner + noise(seed ^ 6, 0) * 5.0);
        let expected: Vec<_> = (0..n).filter(|&i| triangles.aabb(i).overlaps(&query)).collect();
        let (found, all) = overlapping(&bvh, &triangles, &query, usize::MAX);
        prop_assert_eq!(&found, &expected);
        prop_assert!(all.queries == 1 && all.nodes < bvh.nodes().len() as u64);
        let (first, visits) = overlapping(&bvh, &triangles, &query, 1);
        prop_assert!(first.len() == expected.len().min(1) && visits.nodes <= all.nodes);

        let expected = all_pairs(&triangles);
        let (found, all) = pairs(&bvh, &triangles, usize::MAX);
        prop_assert_eq!(&found, &expected);
        let (first, visits) = pairs(&bvh, &triangles, 2);
        prop_assert!(first.len() == expected.len().min(2) && visits.nodes <= all.nodes);
    }

    #[test]
    fn pairs_of_two_trees_and_of_what_is_awake_are_those_of_brute_force(
        n in 0usize..120, m in 0usize..120, seed: u64, motion in prop::sample::select(&Motion::ALL[..]),
        max_leaf_size in prop::sample::select(vec![1u32, 4, 50])
    ) {
        let (mut bvh, soup, now) = moved(n, seed, motion, max_leaf_size);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let (other, others, then) = moved(m, seed ^ 1, Motion::Smooth, 1);
        let others = Triangles { positions: &then, indices: &others.triangles };
        let both = (0..n).flat_map(|a| (0..m).map(move |b| (a, b)));
        let expected: Vec<_> = both.filter(|&(a, b)| triangles.aabb(a).overlaps(&others.aabb(b))).collect();
        let between = |most: usize| {
            let mut found = Vec::new();
            let visits = bvh.for_each_pair_between(&triangles, &other, &others, |a, b| {
                found.push((a, b));
                if found.len() == most { Break(()) } else { Continue(()) }
            });
            found.sort_unstable();
            (found, visits)
        };
        let (found, all) = between(usize::MAX);
        prop_assert_eq!(&found, &expected);
        prop_assert!(between(2).0.len() == expected.len().min(2) && all.queries == 1);

        let is_awake = |p: usize| !p.is_multiple_of(3);
        bvh.set_dynamic(is_awake);
        let mut found = Vec::new();
        let awake = bvh.for_each_dynamic_pair(&triangles, |a, b| {
            found.push((a.min(b), a.max(b)));
            Continue(())
        });
        found.sort_unstable();
        let expected: Vec<_> = all_pairs(&triangles);
        let is_wanted = |&(a, b): &(usize, usize)| is_awake(a) || is_awake(b);
        let wanted: Vec<_> = expected.iter().copied().filter(is_wanted).collect();
        // Sleepers beside something awake in one leaf count as awake.
        prop_assert!(max_leaf_size > 1 || found == wanted);
        let is_found = |pair: &(usize, usize)| found.binary_search(pair).is_ok();
        prop_assert!(wanted.iter().all(is_found) && found.iter().all(|pair| expected.contains(pair)));
        let (_, every) = pairs(&bvh, &triangles, usize::MAX);
        prop_assert!(awake.nodes <= every.nodes && awake.primitives <= every.primitives);
    }

    #[test]
    fn points_find_the_nearest_box(
        n in 0usize..150, seed: u64, motion in prop::sample::select(&Motion::ALL[..]),
        max_leaf_size in prop::sample::select(vec![1u32, 4])
    ) {
        let (bvh, soup, now) = moved(n, seed, motion, max_leaf_size);
        let triangles = Triangles { positions: &now, indices: &soup.triangles };
        let point = noise(seed ^ 5, 0) * 16.0 - 3.0;
        let distance = |p: usize| triangles.aabb(p).distance_squared(point);
        let expected = (0..n).map(distance).fold(f32::INFINITY, f32::min);
        let to_box = |aabb: &Aabb| aabb.distance_squared(point);
        let (nearest, visits) = bvh.nearest(f32::INFINITY, to_box, |p, _| distance(p));
        prop_assert_eq!(nearest.map_or(f32::INFINITY, |(_, d)| d), expected);
        prop_assert!(nearest.is_none_or(|(p, d)| distance(p) == d) && visits.queries == 1);
        prop_assert_eq!(bvh.nearest(expected, to_box, |p, _| distance(p)).0, None, "nothing is nearer");
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

#[test]
fn few_nodes_are_visited() {
    let corner = |i: u32| Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0);
    let boxes: Vec<_> = (0..10_000).map(|i| Aabb::new(corner(i), corner(i) + 0.5)).collect();
    let bvh = build(&boxes, Builder::Binned).expect("few enough");
    let queries = (0..50).map(|i| overlapping(&bvh, &boxes, &boxes[i * 200], usize::MAX).1);
    let (queries, nodes) = queries.fold((0, 0), |sum, v| (sum.0 + v.queries, sum.1 + v.nodes));
    assert!(queries == 50 && nodes > 50 * 8 && nodes < 50 * 40, "{queries} queries, {nodes} nodes");
    let point = Vec3::new(50.2, 50.2, 3.0);
    let (nearest, visits) =
        bvh.nearest(f32::INFINITY, |b| b.distance_squared(point), |p, _| boxes[p].distance_squared(point));
    assert!(nearest.is_some_and(|(p, _)| p == 5050) && visits.nodes < 60, "{nearest:?} {visits:?}");
}

/// Two chains below the root, in which every box overlaps every other. The deeper child is the one
/// that a query turns to first, so that each level leaves an entry on the stack.
#[test]
fn the_highest_trees_fit_the_stacks_of_all_queries() {
    const LEAVES: u32 = MAX_HEIGHT;
    for deeper_is_left in [true, false] {
        // The deeper, the nearer to a ray from the left and to its origin.
        let level = |i: u32| if i == LEAVES - 1 { LEAVES - 2 } else { i };
        let boxes: Vec<_> = (0..2 * LEAVES)
            .map(|i| Aabb::new(Vec3::new(-1.0 - level(i % LEAVES) as f32, -1.0, -1.0), Vec3::ONE))
            .collect();
        let leaf = |i: u32| Node::leaf(boxes[i as usize], i, 1);
        let mut nodes = vec![Node::NOTHING; 2];
        let mut add = |deeper: Node, other: Node| {
            let pair = if deeper_is_left { [deeper, other] } else { [other, deeper] };
            nodes.extend(pair);
            Node::parent(&pair[0], &pair[1], nodes.len() as u32 - 2)
        };
        let chains = [0, LEAVES].map(|first| {
            let rest = (first..first + LEAVES - 1).rev();
            rest.fold(leaf(first + LEAVES - 1), |deeper, i| add(deeper, leaf(i)))
        });
        nodes[0] = add(chains[0], chains[1]);
        let bvh = Bvh::new(&nodes, (0..2 * LEAVES).collect()).expect("a tree");
        bvh.validate(&boxes).expect("valid");
        assert_eq!(bvh.height(), MAX_HEIGHT);

        let everywhere = Aabb::new(Vec3::MIN, Vec3::MAX);
        let all: Vec<_> = (0..boxes.len()).collect();
        assert_eq!(overlapping(&bvh, &boxes, &everywhere, usize::MAX).0, all);
        assert_eq!(pairs(&bvh, &boxes, usize::MAX).0, all_pairs(&boxes));
        let mut between = 0;
        bvh.for_each_pair_between(&boxes, &bvh.clone(), &boxes, |_, _| {
            between += 1;
            Continue(())
        });
        assert_eq!(between, boxes.len().pow(2));
        let ray = Ray::new(Vec3::new(-200.0, 0.0, 0.0), Vec3::X);
        let mut met = Vec::new();
        bvh.cast_ray(&ray, f32::INFINITY, |p, t_max| {
            met.push(p);
            Continue(t_max)
        });
        met.sort_unstable();
        assert_eq!(met, all);
        let distance = |aabb: &Aabb| aabb.distance_squared(ray.origin());
        let mut asked = 0;
        // No distance to a primitive ends the walk early.
        let (nearest, _) = bvh.nearest(f32::INFINITY, distance, |_, _| {
            asked += 1;
            f32::INFINITY
        });
        assert_eq!((nearest, asked), (None, all.len()));
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
        // Behind the first hit lies the first one of all others.
        let mut others = Visits::default();
        let is_other = |p: u32| truth.is_none_or(|first| first.primitive != p);
        let second = closest_hit_where(&bvh, &triangles, &ray, f32::INFINITY, test, &mut others, |hit| {
            is_other(hit.primitive)
        });
        let mut rest = soup.triangles.clone();
        if let Some(first) = truth {
            rest[first.primitive as usize] = [u32::MAX; 3];
        }
        let rest = Triangles { positions: &now, indices: &rest };
        assert_eq!(second, closest_hit_brute(&rest, &ray, f32::INFINITY, test));
        others += closest;
        assert_eq!(others.queries, 2);
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
    assert!(overlapping(&bvh, &triangles, &Aabb::EMPTY, 1).0.is_empty());
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut min, mut max) = (Vec3::MIN, Vec3::MAX);
            min[axis] = if bad == f32::NEG_INFINITY { f32::NAN } else { bad };
            assert!(overlapping(&bvh, &triangles, &Aabb::new(min, Vec3::MAX), 1).0.is_empty(), "{min}");
            max[axis] = if bad == f32::INFINITY { f32::NAN } else { bad };
            assert!(overlapping(&bvh, &triangles, &Aabb::new(Vec3::MIN, max), 1).0.is_empty(), "{max}");
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

#[test]
fn a_negative_or_nan_distance_ends_a_ray() {
    let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 20];
    let bvh = build_with(&boxes, Builder::Binned, &BuildOptions::default().with_max_leaf_size(4));
    let bvh = bvh.expect("few enough");
    let ray = Ray::new(Vec3::new(0.5, 0.5, -1.0), Vec3::Z);
    for end in [-1.0, f32::NAN] {
        let mut tested = 0;
        bvh.cast_ray(&ray, f32::INFINITY, |_, _| {
            tested += 1;
            Continue(end)
        });
        assert_eq!(tested, 1);
    }
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
    assert!(overlapping(&bvh, &[], &everywhere, 1).0.is_empty());
    bvh.for_each_pair(&[], |a, b| panic!("{a} and {b}"));
    let unit = [Aabb::new(Vec3::ZERO, Vec3::ONE)];
    let one = build(&unit, Builder::Sweep).expect("one");
    bvh.for_each_pair_between(&[], &one, &unit, |a, b| panic!("{a} and {b}"));
    one.for_each_pair_between(&unit, &bvh, &[], |a, b| panic!("{a} and {b}"));
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    assert_eq!(bvh.cast_ray(&ray, 5.0, |p, _| panic!("{p}")).0, 5.0);
}
