//! Queries against the same questions asked of every primitive.

use std::ops::ControlFlow::{Break, Continue};

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Aabb, Bvh, Ray, Vec3, Visits};
use proptest::prelude::*;

fn boxes() -> impl Strategy<Value = Vec<Aabb>> {
    let one = prop::array::uniform6(0f32..10.0).prop_map(|c| {
        let corner = Vec3::new(c[0], c[1], c[2]);
        Aabb::new(corner, corner + Vec3::new(c[3], c[4], c[5]) * 0.3)
    });
    prop::collection::vec(prop_oneof![9 => one, 1 => Just(Aabb::EMPTY)], 0..120)
}

fn tree(boxes: &Vec<Aabb>, max_leaf_size: u32) -> Bvh {
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    build_with(boxes, Builder::Binned, &options).expect("few enough")
}

fn overlaps(bvh: &Bvh, boxes: &Vec<Aabb>, query: &Aabb, most: usize) -> (Vec<usize>, Visits) {
    let mut found = Vec::new();
    let visits = bvh.for_each_overlap(boxes, query, |p| {
        found.push(p);
        if found.len() == most { Break(()) } else { Continue(()) }
    });
    (found, visits)
}

fn pairs(bvh: &Bvh, boxes: &Vec<Aabb>, most: usize) -> (Vec<(usize, usize)>, Visits) {
    let mut found = Vec::new();
    let visits = bvh.for_each_pair(boxes, |a, b| {
        found.push((a.min(b), a.max(b)));
        if found.len() == most { Break(()) } else { Continue(()) }
    });
    (found, visits)
}

proptest! {
    #[test]
    fn box_and_pair_queries_find_what_overlaps_once_and_stop_early(
        boxes in boxes(), size in prop::sample::select(vec![1u32, 4, 50]), at in prop::array::uniform3(0f32..10.0)
    ) {
        let (bvh, n) = (tree(&boxes, size), boxes.len());
        let query = Aabb::new(Vec3::from(at), Vec3::from(at) + 3.0);
        let expected: Vec<_> = (0..n).filter(|&i| boxes[i].overlaps(&query)).collect();
        let (mut found, all) = overlaps(&bvh, &boxes, &query, usize::MAX);
        found.sort_unstable();
        prop_assert_eq!(&found, &expected);
        prop_assert!(all.queries == 1 && all.nodes < bvh.nodes().len() as u64);
        let (first, visits) = overlaps(&bvh, &boxes, &query, 1);
        prop_assert!(first.len() == expected.len().min(1) && visits.nodes <= all.nodes);

        let below = |b: usize| (0..b).map(move |a| (a, b));
        let mut expected: Vec<_> = (0..n).flat_map(below).filter(|&(a, b)| boxes[a].overlaps(&boxes[b])).collect();
        expected.sort_unstable();
        let (mut found, all) = pairs(&bvh, &boxes, usize::MAX);
        found.sort_unstable();
        prop_assert_eq!(&found, &expected);
        let (first, visits) = pairs(&bvh, &boxes, 2);
        prop_assert!(first.len() == expected.len().min(2) && visits.nodes <= all.nodes);
    }

    #[test]
    fn rays_and_points_find_the_nearest_box(
        boxes in boxes(), size in prop::sample::select(vec![1u32, 4]), c in prop::array::uniform6(-3f32..13.0)
    ) {
        let bvh = tree(&boxes, size);
        let (from, to) = (Vec3::new(c[0], c[1], c[2]), Vec3::new(c[3], c[4], c[5]));
        let ray = Ray::new(from, to - from);
        let hit = |p: usize| ray.enters(&boxes[p], f32::INFINITY);
        let expected = (0..boxes.len()).filter_map(hit).fold(f32::INFINITY, f32::min);
        let (t, visits) = bvh.cast_ray(&ray, f32::INFINITY, |p, t_max| {
            Continue(hit(p).map_or(t_max, |t| t.min(t_max)))
        });
        prop_assert_eq!(t, expected);
        let mut tested = 0;
        let (t, any) = bvh.cast_ray(&ray, f32::INFINITY, |_, _| { tested += 1; Break(-7.0) });
        prop_assert!(tested <= 1 && (tested == 1) == (t == -7.0) && any.nodes <= visits.nodes);

        let distance = |p: usize| boxes[p].distance_squared(from);
        let expected = (0..boxes.len()).map(distance).fold(f32::INFINITY, f32::min);
        let to_box = |aabb: &Aabb| aabb.distance_squared(from);
        let (nearest, visits) = bvh.nearest(f32::INFINITY, to_box, |p, _| distance(p));
        prop_assert_eq!(nearest.map_or(f32::INFINITY, |(_, d)| d), expected);
        prop_assert!(nearest.is_none_or(|(p, d)| distance(p) == d) && visits.queries == 1);
        prop_assert_eq!(bvh.nearest(expected, to_box, |p, _| distance(p)).0, None, "nothing is nearer");
    }
}

#[test]
fn few_nodes_are_visited() {
    let corner = |i: u32| Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0);
    let boxes: Vec<_> = (0..10_000).map(|i| Aabb::new(corner(i), corner(i) + 0.5)).collect();
    let bvh = tree(&boxes, 1);
    let nodes: u64 = (0..50).map(|i| overlaps(&bvh, &boxes, &boxes[i * 200], usize::MAX).1.nodes).sum();
    assert!(nodes > 50 * 8 && nodes < 50 * 40, "{nodes}");
    let point = Vec3::new(50.2, 50.2, 3.0);
    let (nearest, visits) =
        bvh.nearest(f32::INFINITY, |b| b.distance_squared(point), |p, _| boxes[p].distance_squared(point));
    assert!(nearest.is_some_and(|(p, _)| p == 5050) && visits.nodes < 60, "{nearest:?} {visits:?}");
}

#[test]
fn a_negative_or_nan_distance_ends_a_ray() {
    let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 20];
    let ray = Ray::new(Vec3::new(0.5, 0.5, -1.0), Vec3::Z);
    for end in [-1.0, f32::NAN] {
        let mut tested = 0;
        tree(&boxes, 4).cast_ray(&ray, f32::INFINITY, |_, _| {
            tested += 1;
            Continue(end)
        });
        assert_eq!(tested, 1);
    }
}
