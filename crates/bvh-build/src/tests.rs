//! What every builder promises, on random and on hard input.

use std::collections::BTreeSet;

use bvh_core::{Aabb, Bvh, MAX_PRIMITIVES, Node, Primitives, Triangles, Vec3, sah_cost, stats};
use proptest::prelude::*;

use crate::{
    Anneal, BuildError, BuildOptions, BuildScratch, Builder, Reinsert, build_over_poses, build_with, rebuild,
};

const BUILDERS: usize = Builder::ALL.len();

/// A sequence of numbers in 0..1 (splitmix64), for input too large to be worth shrinking. Not from a
/// crate: recorded fingerprints depend on the numbers.
fn numbers(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1 << 24) as f32
    }
}

/// Triangles with edges of about `size` in the unit cube.
fn random_triangles(n: usize, size: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut next = numbers(n as u64);
    let mut point = || Vec3::new(next(), next(), next());
    let positions = (0..n).flat_map(|_| {
        let corner = point();
        [corner, corner + point() * size, corner + point() * size]
    });
    (positions.collect(), (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn random_boxes(n: usize, size: f32) -> Vec<Aabb> {
    let (positions, indices) = random_triangles(n, size);
    let triangles = Triangles { positions: &positions, indices: &indices };
    (0..n).map(|i| triangles.aabb(i)).collect()
}

/// Boxes of very uneven sizes, as in architecture: walls, floors and small things along streets.
pub(crate) fn streets(n: usize) -> Vec<Aabb> {
    let mut next = numbers(n as u64);
    (0..n)
        .map(|i| {
            let corner = Vec3::new(next(), 0.1 * next(), next());
            let size = Vec3::new(next(), next(), next()) * 0.3f32.powi(1 + (i % 5) as i32);
            let flat = Vec3::select(Vec3::AXES[i % 3].cmpgt(Vec3::ZERO), Vec3::ZERO, size);
            Aabb::new(corner, corner + flat)
        })
        .collect()
}

/// A tree that is one chain, the first box at the top; at least two boxes.
pub(crate) fn chain(boxes: &[Aabb]) -> Bvh {
    let n = boxes.len();
    let mut nodes = vec![Node::NOTHING; 2 * n];
    let mut rest = Node::leaf(boxes[n - 1].sanitized(), n as u32 - 1, 1);
    for i in (0..n - 1).rev() {
        let pair = 2 * i + 2;
        nodes[pair] = Node::leaf(boxes[i].sanitized(), i as u32, 1);
        nodes[pair + 1] = rest;
        rest = Node::parent(&nodes[pair], &nodes[pair + 1], pair as u32);
    }
    nodes[0] = rest;
    Bvh::new(&nodes, (0..n as u32).collect()).expect("a tree")
}

fn point_box(p: Vec3) -> Aabb {
    Aabb::new(p, p)
}

pub(crate) fn options(max_leaf_size: u32) -> BuildOptions {
    // Fewer passes than a tree that is made once deserves.
    let anneal = Anneal::default().with_passes(10);
    let reinsert = Reinsert::default().with_part(0.1).with_passes(2);
    BuildOptions { max_leaf_size, anneal, reinsert, ..BuildOptions::default() }
}

/// Builds with every builder and checks the trees.
fn check(boxes: &[Aabb], options: &BuildOptions) -> [Bvh; BUILDERS] {
    let trees = Builder::ALL.map(|builder| {
        let bvh = build_with(boxes, builder, options).expect("few enough");
        bvh.validate(boxes).unwrap_or_else(|e| panic!("{}: {e}", builder.name()));
        // What builders are trusted with: structure, heights and moving bits.
        let checked = Bvh::new(bvh.nodes(), bvh.order().to_vec()).expect("a tree");
        assert_eq!(checked.fingerprint(), bvh.fingerprint(), "{}", builder.name());
        if options.max_leaf_size == 1 {
            assert_eq!(bvh.nodes().len(), 2 * boxes.len().max(1), "{}", builder.name());
        }
        assert!(stats(&bvh).largest_leaf <= options.max_leaf_size as usize, "{}", builder.name());
        bvh
    });
    assert_eq!(trees[1].fingerprint(), trees[2].fingerprint(), "binned-parallel differs from binned");
    trees
}

fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -10f32..10.0,
        1 => (-3i8..3).prop_map(f32::from),
        1 => prop::num::f32::ANY,
        1 => prop::sample::select(vec![1e38, -1e38, f32::MAX, f32::MIN, 1e-45, -1e-40, -0.0, 1e18]),
    ]
}

fn any_box() -> impl Strategy<Value = Aabb> {
    prop::array::uniform6(coordinate()).prop_map(|c| {
        let [a, b] = [Vec3::new(c[0], c[1], c[2]), Vec3::new(c[3], c[4], c[5])];
        Aabb::around(&[a, b])
    })
}

proptest! {
    #[test]
    fn any_boxes_give_a_valid_tight_tree(
        boxes in prop::collection::vec(any_box(), 0..80),
        max_leaf_size in 1u32..10,
        bins in 0u32..300,
        search_radius in 0u32..40,
    ) {
        check(&boxes, &BuildOptions { max_leaf_size, bins, search_radius, ..options(1) });
    }
}

#[test]
fn names_are_those_of_the_result_files() {
    assert_eq!(
        Builder::ALL.map(Builder::name),
        [
            "sweep",
            "binned",
            "binned-parallel",
            "lbvh",
            "hlbvh",
            "ploc",
            "hill-climbed",
            "annealed",
            "reinserted"
        ]
    );
    for builder in Builder::ALL {
        assert_eq!(builder.name().parse(), Ok(builder));
    }
    let error = "bvh".parse::<Builder>().expect_err("no builder");
    assert!(
        error.to_string().starts_with("unknown builder 'bvh'; expected one of sweep, binned, "),
        "{error}"
    );
}

#[test]
fn no_one_and_two_primitives() {
    let [empty, ..] = check(&[], &options(1));
    assert_eq!(empty.nodes(), [Node::NOTHING; 2]);
    let boxes = random_boxes(2, 0.1);
    assert_eq!(check(&boxes[..1], &options(1)).map(|bvh| bvh.height()), [0; BUILDERS]);
    assert_eq!(check(&boxes, &options(1)).map(|bvh| bvh.height()), [1; BUILDERS]);
    assert_eq!(check(&[Aabb::EMPTY], &options(1)).map(|bvh| bvh.root().aabb()), [Aabb::EMPTY; BUILDERS]);
}

#[test]
fn too_many_primitives_are_refused() {
    struct Many;
    impl Primitives for Many {
        fn len(&self) -> usize {
            MAX_PRIMITIVES + 1
        }
        fn bounds(&self, _: usize) -> Aabb {
            unreachable!("refused before")
        }
    }
    let mut bvh = chain(&random_boxes(9, 0.1));
    bvh.set_dynamic(|p| p > 3);
    let before = (bvh.fingerprint(), bvh.static_area());
    for builder in Builder::ALL {
        let error = rebuild(&mut bvh, &Many, builder, &options(1), &mut BuildScratch::default())
            .expect_err("too many");
        assert_eq!((bvh.fingerprint(), bvh.static_area()), before, "{}", builder.name());
        assert_eq!(error, BuildError::TooManyPrimitives(MAX_PRIMITIVES + 1));
        assert_eq!(error.to_string(), "536870913 primitives given; at most 536870912 fit");
    }
}

#[test]
fn identical_primitives_give_a_balanced_tree() {
    for one in [Aabb::new(Vec3::ZERO, Vec3::ONE), point_box(Vec3::splat(7.0))] {
        assert_eq!(check(&vec![one; 90_000], &options(1)).map(|bvh| bvh.height()), [17; BUILDERS]);
    }
}

#[test]
fn points_on_a_line_give_a_shallow_tree() {
    // Every split costs nothing.
    let boxes: Vec<_> = (0..4096).map(|i| point_box(Vec3::X * i as f32)).collect();
    let [sweep, binned, ..] = check(&boxes, &options(1)).map(|bvh| bvh.height());
    assert!(sweep == 12 && binned <= 14, "{sweep}, {binned}");
}

#[test]
fn equal_centres_of_different_boxes() {
    let boxes: Vec<_> =
        (1..3000).map(|i| Aabb::new(Vec3::splat(-(i as f32)), Vec3::splat(i as f32))).collect();
    check(&boxes, &options(1));
}

#[test]
fn exponential_spacing_stays_within_the_height_bound() {
    for axes in [Vec3::X, Vec3::new(1.0, 0.5, 0.0), Vec3::ONE] {
        let spaced = |e: i32| point_box(axes * 2f32.powi(e));
        let boxes: Vec<_> = (-149..128).chain(-149..128).map(spaced).collect();
        // `check` refuses what is higher than allowed.
        check(&boxes, &options(1));
        let cube = |x: f32| Aabb::new(axes * x, axes * x + 0.2 * x);
        let cubes: Vec<_> = (-60..60).map(|e| cube(2f32.powi(e))).collect();
        let heights = check(&cubes, &options(1)).map(|bvh| bvh.height());
        assert!(heights.iter().any(|&height| height > 70), "{heights:?} are far from the bound");
    }
}

#[test]
fn a_build_over_nothing_drops_nothing() {
    let (mut bvh, mut scratch) = (Bvh::default(), BuildScratch::default());
    for (boxes, dropped) in [(&[Aabb::EMPTY][..], 1), (&[], 0)] {
        rebuild(&mut bvh, boxes, Builder::Lbvh, &BuildOptions::default(), &mut scratch).expect("few enough");
        assert_eq!(scratch.dropped(), dropped);
    }
}

#[test]
fn primitives_without_a_box_are_kept_apart() {
    let clean = random_boxes(500, 0.05);
    let mut boxes = clean.clone();
    for i in 0..100 {
        boxes.insert(i * 6, Aabb::EMPTY);
    }
    for (dirty, clean) in check(&boxes, &options(1)).into_iter().zip(check(&clean, &options(1))) {
        let [l, r] = dirty.children(dirty.root()).expect("inner");
        assert!(!l.aabb().is_empty() && r.aabb().is_empty());
        assert_eq!(stats(&dirty).dropped, 100);
        // The root above the two costs its own area more, that is 1.
        assert!((sah_cost(&dirty) - sah_cost(&clean) - 1.0).abs() < 1e-9);
    }
    check(&vec![Aabb::EMPTY; 1000], &options(4));
}

/// Boxes as they should not be given: NaN, infinite, inside out.
struct Careless(Vec<Aabb>);

impl Primitives for Careless {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn bounds(&self, i: usize) -> Aabb {
        self.0[i]
    }
}

#[test]
fn boxes_that_are_not_sanitized_are_set_apart_too() {
    let mut boxes = random_boxes(200, 0.1);
    let payload = f32::from_bits(0x7fff_ffff);
    for bad in [f32::NAN, payload, -payload, f32::INFINITY, f32::NEG_INFINITY] {
        boxes.push(Aabb::new(Vec3::splat(bad), Vec3::ONE));
        boxes.push(Aabb::new(Vec3::ZERO, Vec3::new(0.5, bad, 0.5)));
    }
    boxes.push(Aabb::new(Vec3::ONE, Vec3::ZERO));
    for builder in Builder::ALL {
        let bvh = build_with(&Careless(boxes.clone()), builder, &options(1)).expect("few enough");
        let [l, r] = bvh.children(bvh.root()).expect("inner");
        assert_eq!(r.aabb(), Aabb::EMPTY, "{}", builder.name());
        assert!(Aabb::new(Vec3::ZERO, Vec3::splat(1.2)).contains(&l.aabb()), "{}", builder.name());
    }
}

#[test]
fn scale_does_not_change_the_tree() {
    let boxes = random_boxes(1000, 0.1);
    let cost = check(&boxes, &options(1)).map(|bvh| sah_cost(&bvh));
    for power in [-100, -40, 40, 63, 100, 120] {
        let s = 2f32.powi(power);
        let scaled: Vec<_> = boxes.iter().map(|b| Aabb::new(b.min * s, b.max * s)).collect();
        let scaled = check(&scaled, &options(1)).map(|bvh| sah_cost(&bvh));
        for (a, b) in cost.iter().zip(scaled) {
            assert!((a / b - 1.0).abs() < 1e-3, "{a} and, times 2^{power}, {b}");
        }
    }
}

#[test]
fn extreme_extents_are_split_sensibly() {
    let boxes = random_boxes(3000, 0.02);
    let whole = |b: &Aabb| (b.min * 2.0 - 1.0, b.max * 2.0 - 1.0);
    for scale in [1e38, 3.3e38, 1e-38, 1e-42] {
        let scaled: Vec<_> = boxes
            .iter()
            .map(whole)
            .map(|(min, max)| Aabb::new(min * scale, max.min(Vec3::ONE) * scale).sanitized())
            .collect();
        for bvh in check(&scaled, &options(1)) {
            // A split in any order whatever costs over a thousand.
            assert!(sah_cost(&bvh) < 80.0, "{} at {scale}", sah_cost(&bvh));
        }
    }
}

#[test]
fn flat_scenes() {
    for flat in [Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)] {
        let boxes: Vec<_> = random_boxes(2000, 0.01)
            .iter()
            .map(|b| Aabb::new(b.min * flat + 3.0, b.max * flat + 3.0))
            .collect();
        check(&boxes, &options(1));
    }
}

#[test]
fn no_builder_costs_much_more_than_sweep() {
    for (n, size) in [(1000, 0.2), (5000, 0.02), (20_000, 0.05)] {
        let boxes = random_boxes(n, size);
        let [sweep, costs @ ..] = check(&boxes, &options(1)).map(|bvh| sah_cost(&bvh));
        for ((builder, cost), bound) in
            Builder::ALL[1..].iter().zip(costs).zip([1.03, 1.03, 1.25, 1.15, 1.12, 1.0, 1.0, 1.0])
        {
            let (name, over) = (builder.name(), cost / sweep);
            assert!(over <= bound, "{name}: {over} times sweep, for {n} of {size}");
        }
    }
}

/// Three quarters of all boxes in one cell of ten thousand on each axis: short codes are equal
/// there.
fn clustered() -> Vec<Aabb> {
    let mut boxes = random_boxes(4000, 0.02);
    let small = random_boxes(12_000, 0.02).into_iter().map(|b| Aabb::new(b.min * 3e-5, b.max * 3e-5));
    boxes.extend(
        small.enumerate().map(|(i, b)| if i % 2 == 0 { b } else { Aabb::new(b.min * 0.5, b.max * 0.5) }),
    );
    boxes
}

#[test]
fn long_codes_separate_clusters() {
    let [sweep, _, _, others @ ..] = check(&clustered(), &options(1)).map(|bvh| sah_cost(&bvh));
    assert!(others.iter().all(|cost| *cost < 1.3 * sweep), "{others:?} to {sweep}");
}

#[test]
fn clusters_that_wait_for_each_other_do_not_take_forever() {
    // Each is nearer to the next one than to the one before: left alone, two would join in each
    // round.
    let n = 50_000;
    let place = |i: i32| 4.0 * f64::from(i) - f64::from(i).powi(2) / f64::from(n);
    let boxes: Vec<_> = (0..n).map(|i| Vec3::new(place(i) as f32, 0.0, 0.0)).collect();
    let boxes: Vec<_> = boxes.into_iter().map(|p| Aabb::new(p, p + Vec3::new(0.0, 1.0, 1.0))).collect();
    check(&boxes, &options(1));
}

#[test]
fn more_bins_cost_less() {
    let boxes = random_boxes(20_000, 0.03);
    let cost = |bins| {
        let options = BuildOptions::default().with_bins(bins);
        sah_cost(&build_with(&boxes, Builder::Binned, &options).expect("few enough"))
    };
    assert!(cost(2) > cost(8) && cost(8) > cost(32));
}

#[test]
fn trees_do_not_depend_on_the_number_of_threads() {
    let mut boxes = random_boxes(60_000, 0.02);
    boxes.extend(random_boxes(3000, 0.8));
    boxes.extend([Aabb::EMPTY; 5]);
    for options in [options(1), options(6)] {
        let hash = |builder| build_with(&boxes, builder, &options).expect("few enough").fingerprint();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| Builder::ALL.map(hash))
        };
        let one = on(1);
        for threads in [2, 3, 8] {
            assert_eq!(on(threads), one, "{threads} threads");
        }
    }
}

#[test]
fn larger_leaves_lower_cost_and_node_count() {
    let boxes = random_boxes(5000, 0.3);
    let single = check(&boxes, &options(1));
    let large = check(&boxes, &options(8));
    for (single, large) in single.iter().zip(&large) {
        assert!(large.nodes().len() < single.nodes().len() * 3 / 4);
        assert!(sah_cost(large) < sah_cost(single));
        // Leaves are cut off the same tree.
        assert_eq!(single.order(), large.order());
    }
}

#[test]
fn recycled_memory_gives_the_same_tree() {
    let (few, many) = (random_boxes(300, 0.1), random_boxes(5000, 0.1));
    let mut scratch = BuildScratch::default();
    for builder in Builder::ALL {
        for (old, new) in [(&few, &many), (&many, &few)] {
            let fresh = build_with(new, builder, &options(2)).expect("few enough");
            let old = build_with(old, builder, &options(1)).expect("few enough");
            let mut recycled = old;
            for size in [1, 2] {
                rebuild(&mut recycled, new, builder, &options(size), &mut scratch).expect("few enough");
            }
            assert_eq!(fresh.fingerprint(), recycled.fingerprint());
        }
    }
}

/// Fingerprints of trees, one after the other, as one number.
fn combined(fingerprints: impl Iterator<Item = u64>) -> u64 {
    fingerprints.fold(0, |all, one| (all.rotate_left(5) ^ one).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

#[test]
fn trees_have_the_recorded_bits() {
    let mut dropped = random_boxes(700, 0.1);
    dropped[300..320].fill(Aabb::EMPTY);
    let tiny: Vec<_> = streets(900).iter().map(|b| Aabb::new(b.min * 1e-30, b.max * 1e-30)).collect();
    let mut inputs: Vec<_> = [0, 1, 2, 3, 4, 5, 31, 33, 300, 5000].map(|n| random_boxes(n, 0.1)).into();
    inputs.extend([
        streets(12_000),
        random_boxes(30_000, 0.01),
        dropped,
        tiny,
        clustered(),
        vec![Aabb::EMPTY; 9],
    ]);
    let mut settings = vec![options(1), options(4), options(u32::MAX)];
    settings.push(BuildOptions { bins: 7, search_radius: 3, ..options(1) });
    let found = |builder| {
        let tree = |boxes, options| build_with(boxes, builder, options).expect("few enough").fingerprint();
        combined(inputs.iter().flat_map(|boxes| settings.iter().map(move |options| tree(boxes, options))))
    };
    let poses = |n: usize| {
        [0.0, 0.5, 2.0].map(|time: f32| {
            let shift =
                |i: usize| Vec3::new((i / 30 % 7) as f32, (i / 30 % 5) as f32, (i / 90) as f32) * time;
            let boxes = streets(n).into_iter().enumerate();
            boxes.map(|(i, b)| Aabb::new(b.min + shift(i), b.max + shift(i))).collect::<Vec<_>>()
        })
    };
    let over_time = || {
        combined([1, 50, 2000].into_iter().map(|n| {
            let all = poses(n);
            let poses = all.each_ref();
            let over = build_over_poses(&poses, &Reinsert::default()).expect("poses");
            over.fingerprint()
        }))
    };
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let fingerprints = pool.install(|| (Builder::ALL.map(found), over_time()));
        assert_eq!(fingerprints, RECORDED, "{threads} threads");
    }
}

/// Of each builder, and of trees over poses.
const RECORDED: ([u64; BUILDERS], u64) = (
    [
        507752670387339701,
        1015269251409889371,
        1015269251409889371,
        16282481283302893487,
        7956648727570482824,
        1431451613882314260,
        17980395928278572633,
        16378328106242461967,
        3574502549255439901,
    ],
    12503028036526930358,
);

/// Gives another number of primitives each time it is asked.
struct Liar {
    boxes: Vec<Aabb>,
    asked: std::sync::atomic::AtomicUsize,
}

impl Primitives for Liar {
    fn len(&self) -> usize {
        let asked = self.asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        [300, 297, 20, 3, 400][asked % 5]
    }
    fn bounds(&self, i: usize) -> Aabb {
        self.boxes[i]
    }
}

#[test]
fn the_number_of_primitives_is_asked_once_a_build() {
    for builder in Builder::ALL {
        for first in 0..5 {
            let liar = Liar { boxes: random_boxes(400, 0.1), asked: first.into() };
            let bvh = build_with(&liar, builder, &options(3)).expect("few enough");
            let checked = Bvh::new(bvh.nodes(), bvh.order().to_vec()).expect("a tree");
            assert_eq!(
                (bvh.len(), checked.fingerprint()),
                ([300, 297, 20, 3, 400][first], bvh.fingerprint())
            );
            let poses = [&liar, &liar];
            if let Ok(tree) = build_over_poses(&poses, &Reinsert::default()) {
                Bvh::new(tree.nodes(), tree.order().to_vec()).expect("a tree");
            }
        }
    }
}

/// An HLBVH is an LBVH below the largest nodes of at most 32 primitives, and a better tree above
/// these.
#[test]
fn hlbvh_keeps_morton_clusters_under_a_better_top() {
    /// The primitives of each node that has at most 32, in order.
    fn clusters(bvh: &Bvh) -> BTreeSet<Vec<u32>> {
        fn under(bvh: &Bvh, n: usize, all: &mut BTreeSet<Vec<u32>>) -> Vec<u32> {
            let node = bvh.nodes()[n];
            let mut primitives = bvh.primitives(&node).to_vec();
            if !node.is_leaf() {
                primitives = [node.first(), node.first() + 1].map(|child| under(bvh, child, all)).concat();
                primitives.sort_unstable();
            }
            if primitives.len() <= 32 {
                all.insert(primitives.clone());
            }
            primitives
        }
        let mut all = BTreeSet::new();
        under(bvh, 0, &mut all);
        all
    }
    for boxes in [random_boxes(5000, 0.02), streets(5000)] {
        let [lbvh, hlbvh] =
            [Builder::Lbvh, Builder::Hlbvh].map(|builder| crate::build(&boxes[..], builder).expect("few"));
        let (wanted, found) = (clusters(&lbvh), clusters(&hlbvh));
        assert!(wanted.is_subset(&found), "{} of {}", wanted.intersection(&found).count(), wanted.len());
        assert!(sah_cost(&hlbvh) < sah_cost(&lbvh), "{} {}", sah_cost(&hlbvh), sah_cost(&lbvh));
    }
}
