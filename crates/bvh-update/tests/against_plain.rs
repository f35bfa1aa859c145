//! The fast pass against the plain recursion: the same tree, bit for bit, on any number of threads
//! and at every SIMD level, and the same account of what was done.

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Aabb, Bvh, Node, SimdLevel, Vec3, sah_cost, stats};
use bvh_update::{Rotate, Strategy, UpdateError, Updater, plain};
use proptest::prelude::*;

/// A 64-bit mix (splitmix64), so that inputs need no state. Not from a crate: the failure that
/// `against_plain.proptest-regressions` records depends on the numbers.
fn noise(seed: u64, i: usize) -> Vec3 {
    let coordinate = |axis: u64| {
        let mut x = seed.wrapping_add((i as u64 * 3 + axis + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
    };
    Vec3::new(coordinate(0), coordinate(1), coordinate(2))
}

/// `n` boxes in a cube of 100, each drifting its own way.
fn boxes(n: usize, seed: u64, time: f32) -> Vec<Aabb> {
    (0..n)
        .map(|i| {
            let center = noise(seed, i) * 100.0 + (noise(seed ^ 1, i) - 0.5) * time;
            let half = noise(seed ^ 2, i) * 2.0;
            Aabb::new(center - half, center + half)
        })
        .collect()
}

fn tree(boxes: &[Aabb], max_leaf_size: u32) -> Bvh {
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    build_with(boxes, Builder::Binned, &options).expect("few enough")
}

fn rotating() -> Strategy {
    Strategy::RefitRotate(Rotate::default())
}

fn reporting(level: SimdLevel) -> Updater {
    let mut updater = Updater::with_level(Strategy::default(), level);
    updater.report_cost(true);
    updater
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// Plays `frames` of drift and checks every frame of every level and thread count against the plain
/// pass.
fn check(
    n: usize,
    seed: u64,
    step: f32,
    frames: usize,
    max_leaf_size: u32,
    moves: impl Fn(usize) -> bool + Copy,
) {
    let start = boxes(n, seed, 0.0);
    let pose = |frame: usize| -> Vec<Aabb> {
        let moved = boxes(n, seed, frame as f32 * step);
        start.iter().zip(moved).enumerate().map(|(i, (s, m))| if moves(i) { m } else { *s }).collect()
    };
    let budgets = [1, 2, 5].map(|period| Rotate::default().with_period(period));
    let rotating = budgets.map(|rotate| (Strategy::RefitRotate(rotate), Some(rotate)));
    for (strategy, rotate) in [(Strategy::Refit, None)].into_iter().chain(rotating) {
        let mut expected = tree(&start, max_leaf_size);
        expected.set_dynamic(moves);
        let mut contestants: Vec<_> = SimdLevel::available()
            .flat_map(|level| [1, 2, 3, 8].map(|threads| (level, threads)))
            .map(|(level, threads)| (level, threads, pool(threads), expected.clone(), reporting(level)))
            .collect();
        for frame in 1..=frames {
            let now = pose(frame);
            let applied = plain::update(&mut expected, &now, rotate);
            expected.validate(&now).expect("the plain pass leaves a valid, tight tree");
            let cost = sah_cost(&expected);
            let mut first_report = None;
            for (level, threads, pool, bvh, updater) in &mut contestants {
                let done =
                    pool.install(|| updater.set_strategy(strategy).update(bvh, &now)).expect("same count");
                assert_eq!(
                    bvh.fingerprint(),
                    expected.fingerprint(),
                    "{n} {level:?} {threads} threads, frame {frame}"
                );
                assert_eq!(done.rotations, applied);
                assert_eq!(done.height, expected.height());
                if rotate.is_none() {
                    let mut moving = 0;
                    expected.visit(|_, node, _| moving += u64::from(node.is_dynamic()));
                    assert_eq!(done.nodes_visited, moving);
                }
                let report = done.sah_cost.expect("known");
                assert!((report - cost).abs() <= 1e-6 * cost, "report {report}, is {cost}");
                // Decisions rest on it, so it must be the same to the bit.
                assert_eq!(
                    report.to_bits(),
                    first_report.get_or_insert(report).to_bits(),
                    "{level:?} {threads} threads"
                );
                bvh.validate(&now).expect("valid and tight");
            }
        }
    }
}

#[test]
fn same_tree_as_the_plain_pass_at_all_sizes() {
    for n in [0, 1, 2, 3, 4, 5, 17, 100, 1000] {
        check(n, 7, 10.0, 4, 1, |_| true);
    }
}

#[test]
fn same_tree_when_blocks_nest() {
    // Far more pairs than the top block and one below it hold.
    check(60_000, 3, 5.0, 3, 1, |_| true);
}

#[test]
fn same_tree_with_larger_leaves() {
    for max_leaf_size in [2, 3, 8] {
        check(3000, 5, 10.0, 4, max_leaf_size, |_| true);
    }
    check(3000, 5, 10.0, 4, 4, |i| i % 3 == 0);
}

/// Areas that vanish, overflow, or are no numbers, in every lane of a vector: most levels have one
/// node to some twenty.
#[test]
fn same_tree_with_boxes_of_all_sizes() {
    let pose = |n: usize, seed: u64, frame: u64| -> Vec<Aabb> {
        let random = |k: u64, i: usize| noise(seed + 100 * k + 10_000 * frame, i);
        let aabb = |i: usize| {
            let [unit, flat, _] = random(0, i).to_array().map(|x| (8.0 * x) as usize);
            let unit = [1e-38, 1e-20, 1.0, 1.0, 1.0, 1e15, 1e19, f32::NAN][unit];
            let thick = Vec3::from_array([0, 1, 2].map(|axis| if flat == axis { 0.0 } else { 1.0 }));
            let center = (random(1, i) - 0.5) * unit;
            let half = random(2, i) * thick * unit;
            Aabb::new(center - half, center + half)
        };
        (0..n).map(aabb).collect()
    };
    let (mut rotations, mut flat, mut huge) = (0, 0, 0);
    for (n, seed) in (2..40).flat_map(|n| (0..8).map(move |seed| (n, seed))).chain([(3000, 8)]) {
        let mut expected = tree(&pose(n, seed, 0), 1);
        let mut contestants: Vec<_> =
            SimdLevel::available().map(|level| (level, expected.clone(), reporting(level))).collect();
        for frame in 1..5 {
            let now = pose(n, seed, frame);
            let applied = plain::update(&mut expected, &now, Some(Rotate::default()));
            rotations += applied.iter().sum::<u64>();
            expected.visit(|_, node, _| {
                flat += usize::from(node.aabb().half_area() == 0.0);
                huge += usize::from(node.aabb().half_area() == f32::INFINITY);
            });
            for (level, bvh, updater) in &mut contestants {
                let done = updater.set_strategy(rotating()).update(bvh, &now).expect("same count");
                let (of, by_plain) = ((bvh.fingerprint(), done.rotations), (expected.fingerprint(), applied));
                assert_eq!(of, by_plain, "{n} {seed} {level:?}, frame {frame}");
            }
        }
    }
    assert!(rotations.min(flat as u64).min(huge as u64) > 1000, "{rotations} {flat} {huge}");
}

#[test]
fn same_tree_with_empty_leaves() {
    let inner = |left| Node::inner(Aabb::EMPTY, left);
    let leaf = |first, count| Node::leaf(Aabb::EMPTY, first, count);
    let trees: [&[Node]; 4] = [
        &[inner(2), Node::NOTHING, leaf(0, 2), leaf(2, 0)],
        &[inner(2), Node::NOTHING, inner(4), leaf(2, 0), leaf(0, 1), leaf(1, 1)],
        &[inner(2), Node::NOTHING, inner(4), Node::NOTHING, leaf(0, 1), leaf(1, 1)],
        // An inner node over nothing.
        &[inner(2), Node::NOTHING, inner(4), leaf(0, 2), leaf(2, 0), leaf(2, 0)],
    ];
    for (nodes, level) in trees.into_iter().flat_map(|nodes| SimdLevel::available().map(move |l| (nodes, l)))
    {
        for (strategy, rotate) in [(Strategy::Refit, None), (rotating(), Some(Rotate::default()))] {
            let mut bvh = Bvh::new(nodes, vec![0, 1]).expect("valid");
            let mut expected = bvh.clone();
            for frame in 1..4 {
                let mut now = boxes(2, 11, frame as f32);
                if frame == 2 {
                    now[1].max.x = f32::NAN;
                }
                plain::update(&mut expected, &now, rotate);
                reporting(level).set_strategy(strategy).update(&mut bvh, &now).expect("same count");
                assert_eq!(bvh.fingerprint(), expected.fingerprint(), "{level:?}, frame {frame}");
                bvh.validate(&now).expect("valid and tight");
            }
        }
    }
}

#[test]
fn same_tree_when_only_some_move() {
    check(3000, 5, 10.0, 6, 1, |i| i % 7 == 0);
    check(3000, 5, 10.0, 6, 1, |i| i < 40);
    check(3000, 5, 10.0, 3, 4, |i| i < 40);
}

#[test]
fn static_subtrees_are_not_visited() {
    let start = boxes(20_000, 1, 0.0);
    let mut bvh = tree(&start, 1);
    let mut updater = reporting(SimdLevel::best());
    let all = updater.set_strategy(rotating()).update(&mut bvh, &start).expect("same count");
    assert_eq!(all.nodes_visited as usize, 2 * 20_000 - 1);
    bvh.set_dynamic(|p| p == 77);
    let one = updater.set_strategy(rotating()).update(&mut bvh, &start).expect("same count");
    assert!(one.nodes_visited <= u64::from(bvh.height()) + 1, "visited {}", one.nodes_visited);
    bvh.set_dynamic(|_| false);
    let none = updater.set_strategy(rotating()).update(&mut bvh, &start).expect("same count");
    assert_eq!(none.nodes_visited, 0);
    let (report, cost) = (none.sah_cost.expect("known"), sah_cost(&bvh));
    assert!((report - cost).abs() < 1e-6 * cost, "report {report}, is {cost}");
}

#[test]
fn rotations_happen_where_they_are_needed_and_lower_the_cost() {
    let (start, end) = (boxes(5000, 9, 0.0), boxes(5000, 9, 80.0));
    let mut refitted = tree(&start, 1);
    let mut rotated = refitted.clone();
    let mut updater = reporting(SimdLevel::best());
    let refit = updater.set_strategy(Strategy::Refit).update(&mut refitted, &end).expect("same count");
    let rotate = updater.set_strategy(rotating()).update(&mut rotated, &end).expect("same count");
    assert!(refit.rotations_applied() == 0 && rotate.rotations_applied() > 500);
    assert!(rotate.rotations.iter().all(|&kind| kind > 0), "{:?}", rotate.rotations);
    assert!(rotate.sah_cost < refit.sah_cost.map(|c| 0.8 * c));
}

#[test]
fn a_still_scene_converges_and_stays() {
    let end = boxes(3000, 9, 200.0);
    let mut bvh = tree(&boxes(3000, 9, 0.0), 1);
    let mut updater = reporting(SimdLevel::best());
    let mut cost = f64::INFINITY;
    for pass in 0.. {
        let done = updater.set_strategy(rotating()).update(&mut bvh, &end).expect("same count");
        assert!(sah_cost(&bvh) <= cost, "a rotation raised the cost");
        cost = sah_cost(&bvh);
        if done.rotations_applied() == 0 {
            break;
        }
        assert!(pass < 200, "still rotating after {pass} passes over a still scene");
    }
    let settled = bvh.fingerprint();
    updater.set_strategy(rotating()).update(&mut bvh, &end).expect("same count");
    assert_eq!(bvh.fingerprint(), settled);
}

#[test]
fn blocks_are_recorded_once_asked_for_and_taken_once() {
    let (mut bvh, mut updater) = (tree(&boxes(20_000, 1, 0.0), 1), Updater::new(rotating()));
    let mut blocks = |updater: &mut Updater| {
        updater.update(&mut bvh, &boxes(20_000, 1, 5.0)).expect("same count");
        updater.take_costs().iter().map(|cost| cost.parent).collect::<Vec<_>>()
    };
    assert_eq!(blocks(&mut updater), []);
    updater.record_costs();
    let parents = blocks(&mut updater);
    assert!(parents.len() > 10 && parents[0].is_none(), "{parents:?}");
    assert!((1..parents.len()).all(|i| parents[i].is_some_and(|parent| parent < i)), "{parents:?}");
    assert!(updater.take_costs().is_empty());
}

#[test]
fn reordered_primitives_give_the_same_tree() {
    let start = boxes(3000, 4, 0.0);
    for (max_leaf_size, level) in [1, 4].into_iter().flat_map(|n| SimdLevel::available().map(move |l| (n, l)))
    {
        let mut plain_numbers = tree(&start, max_leaf_size);
        let mut in_order = plain_numbers.clone();
        let map = in_order.reorder_primitives();
        let mut updater = reporting(level);
        for frame in 1..4 {
            let mut now = boxes(3000, 4, frame as f32 * 20.0);
            // Some have no box in the second frame.
            now.iter_mut().step_by(100).filter(|_| frame == 2).for_each(|b| b.max.y = f32::NAN);
            let arranged: Vec<_> = map.iter().map(|&p| now[p as usize]).collect();
            for strategy in [Strategy::Refit, rotating()] {
                let updater = updater.set_strategy(strategy);
                let of_plain = updater.update(&mut plain_numbers, &now).expect("same count");
                let of_ordered = updater.update(&mut in_order, &arranged).expect("same count");
                assert_eq!(plain_numbers.nodes(), in_order.nodes());
                assert_eq!(of_plain.dropped, if frame == 2 { 30 } else { 0 });
                assert_eq!((of_plain.dropped, of_plain.sah_cost), (of_ordered.dropped, of_ordered.sah_cost));
            }
        }
    }
}

#[test]
fn primitives_that_are_not_finite_are_dropped_and_come_back() {
    let start = boxes(2000, 6, 0.0);
    let mut broken = start.clone();
    for i in (0..2000).step_by(100) {
        broken[i].max.y = [f32::NAN, f32::INFINITY][i / 100 % 2];
    }
    for (max_leaf_size, level) in [1, 4].into_iter().flat_map(|n| SimdLevel::available().map(move |l| (n, l)))
    {
        let mut bvh = tree(&start, max_leaf_size);
        let mut expected = bvh.clone();
        let mut updater = reporting(level);
        for (strategy, rotate) in [(Strategy::Refit, None), (rotating(), Some(Rotate::default()))] {
            for (now, dropped) in [(&broken, 20), (&start, 0)] {
                let done = updater.set_strategy(strategy).update(&mut bvh, now).expect("same count");
                plain::update(&mut expected, now, rotate);
                assert_eq!(bvh.fingerprint(), expected.fingerprint());
                assert_eq!(done.dropped, dropped);
                bvh.validate(now).expect("tight around the others");
                assert!(bvh.root().aabb().min.is_finite() && done.sah_cost.is_some_and(f64::is_finite));
                assert!(max_leaf_size > 1 || stats(&bvh).dropped as u64 == dropped);
            }
        }
    }
}

#[test]
fn costs_are_reported_where_areas_are_no_f32() {
    for unit in [1e-18_f32, 1e-15, 1e15, 1e18] {
        let scaled = |b: &Aabb| Aabb::new(b.min * unit, b.max * unit);
        let small: Vec<_> = boxes(2000, 6, 0.0).iter().map(scaled).collect();
        let mut bvh = tree(&small, 1);
        let reported = reporting(SimdLevel::best()).set_strategy(rotating()).update(&mut bvh, &small);
        let (reported, cost) = (reported.expect("same count").sah_cost.expect("asked for"), sah_cost(&bvh));
        assert!((reported - cost).abs() < 1e-4 * cost, "{unit}: {reported} for {cost}");
    }
}

#[test]
fn every_strategy_leaves_a_valid_tree_and_another_count_is_refused_or_rebuilt() {
    let (start, end) = (boxes(2000, 8, 0.0), boxes(2000, 8, 30.0));
    for strategy in Strategy::all() {
        let mut bvh = tree(&start, 1);
        let mut updater = reporting(SimdLevel::best());
        let done = updater.set_strategy(strategy).update(&mut bvh, &end).expect("same count");
        bvh.validate(&end).expect("valid and tight");
        assert_eq!(done.height, bvh.height());
        assert_eq!(strategy.name().parse(), Ok(strategy));
        let before = bvh.fingerprint();
        match (strategy, updater.set_strategy(strategy).update(&mut bvh, &end[1..])) {
            (Strategy::Rebuild(..) | Strategy::Auto(_), done) => {
                assert!(done.is_ok_and(|done| done.rebuilt), "{strategy}");
                bvh.validate(&end[1..]).expect("a new tree");
            }
            (_, done) => {
                assert_eq!(done.expect_err("one too few"), UpdateError::Count { tree: 2000, given: 1999 });
                assert_eq!(bvh.fingerprint(), before);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn same_tree_for_any_size_motion_and_leaf(
        n in 0usize..2500, seed: u64, step in 0.0f32..100.0, max_leaf_size in 1u32..6, period in 1usize..5
    ) {
        check(n, seed, step, 3, max_leaf_size, |i| i % period == 0);
    }
}
