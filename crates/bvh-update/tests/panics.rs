//! Primitives that panic in the middle of an update: the tree is a valid one all the same, and the
//! next update makes it tight.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Bvh, Node, Primitives, Vec3};
use bvh_update::{Strategy, Updater, plain};

const N: usize = 3000;

/// Every tenth box stands still.
fn boxes(time: f32) -> Vec<Aabb> {
    let place = |i: usize| {
        let time = if i.is_multiple_of(10) { 0.0 } else { time };
        let rest = Vec3::new((i % 17) as f32, (i % 13) as f32, (i % 19) as f32);
        rest + Vec3::new((i * 7 % 11) as f32, (i * 5 % 7) as f32, (i * 3 % 5) as f32) * time
    };
    (0..N).map(place).map(|p| Aabb::new(p, p + 0.5)).collect()
}

/// Boxes that panic once they have been asked for a given number of times.
struct Fragile {
    boxes: Vec<Aabb>,
    left: AtomicUsize,
}

impl Primitives for Fragile {
    fn len(&self) -> usize {
        self.boxes.len()
    }

    fn bounds(&self, i: usize) -> Aabb {
        let left = self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        assert!(left.is_ok(), "asked once too often");
        self.boxes[i]
    }
}

/// Gives another number of boxes each time it is asked.
struct Liar(Vec<Aabb>, AtomicUsize);

impl Primitives for Liar {
    fn len(&self) -> usize {
        [N, N - 3, 20, 3, N + 100][self.1.fetch_add(1, Ordering::Relaxed) % 5]
    }

    fn bounds(&self, i: usize) -> Aabb {
        self.0[i % N]
    }
}

#[test]
fn a_number_of_primitives_that_changes_leaves_a_valid_tree_which_honest_updates_mend() {
    let (start, end) = (boxes(0.0), boxes(1.0));
    for strategy in Strategy::all() {
        for first in 0..5 {
            let mut bvh = build(&start, Builder::Sweep).expect("few enough");
            bvh.set_dynamic(|p| first == 0 || !p.is_multiple_of(10));
            let liar = Liar(boxes(0.5), first.into());
            let mut updater = Updater::new(strategy);
            for _ in 0..4 {
                // It may refuse the number.
                let _ = updater.update(&mut bvh, &liar);
                check(&bvh, strategy.name());
            }
            let mut bvh =
                if bvh.len() == N { bvh } else { build(&start, Builder::Sweep).expect("few enough") };
            updater.update(&mut bvh, &end).unwrap_or_else(|e| panic!("{}: {e}", strategy.name()));
            check(&bvh, strategy.name());
            bvh.validate(&end).unwrap_or_else(|e| panic!("{}: {e}", strategy.name()));
        }
    }
}

/// No update asks for the primitives of a leaf that has none, wherever it says that they are.
#[test]
fn empty_leaves_are_asked_for_nothing() {
    struct Strict(Vec<Aabb>);
    impl Primitives for Strict {
        fn len(&self) -> usize {
            self.0.len()
        }

        fn bounds(&self, i: usize) -> Aabb {
            self.0[i]
        }

        fn prefetch_index(&self, i: usize) {
            assert!(i < self.len());
        }
    }
    let boxes = boxes(0.0)[..3].to_vec();
    let leaf = |slot: usize| Node::leaf(boxes[slot % 3], slot as u32, u32::from(slot < 3));
    let (far, at_end) = (leaf(99), leaf(3));
    let (l, r) = (Node::parent(&leaf(0), &at_end, 4), Node::parent(&leaf(1), &leaf(2), 6));
    let some = [Node::parent(&l, &r, 2), Node::NOTHING, l, r, leaf(0), at_end, leaf(1), leaf(2)];
    let none = [Node::parent(&far, &at_end, 2), Node::NOTHING, far, at_end];
    for strategy in Strategy::all() {
        for (nodes, order) in [(&some[..], vec![1, 0, 2]), (&some, vec![0, 1, 2]), (&none, vec![])] {
            let strict = Strict(boxes[..order.len()].to_vec());
            let mut bvh = Bvh::new(nodes, order).expect("valid");
            let mut updater = Updater::new(strategy);
            let fragile = Fragile { boxes: strict.0.clone(), left: 2.into() };
            let result = catch_unwind(AssertUnwindSafe(|| updater.update(&mut bvh, &fragile)));
            assert!(result.is_err() || bvh.is_empty(), "the third box panics");
            if bvh.len() == strict.len() {
                updater.update(&mut bvh, &strict).expect("same count");
                bvh.validate(&strict).expect("valid");
            }
        }
    }
}

/// Heights and moving bits are those that the leaves make, and so is the sum over what stands
/// still.
fn check(bvh: &Bvh, what: &str) {
    let again = Bvh::new(bvh.nodes(), bvh.order().to_vec()).unwrap_or_else(|e| panic!("{what}: {e}"));
    again.visit(|n, node, _| {
        let report = &bvh.nodes()[n];
        assert_eq!(
            (report.height(), report.is_dynamic()),
            (node.height(), node.is_dynamic()),
            "{what}, node {n}"
        );
    });
    let (report, sum) = (bvh.static_area(), again.static_area());
    assert!((report - sum).abs() <= 1e-9 * sum, "{what}: {report} stands still, not {sum}");
}

#[test]
fn a_panic_in_the_middle_of_an_update_leaves_a_valid_tree() {
    let (start, end, after) = (boxes(0.0), boxes(1.0), boxes(1.5));
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        for strategy in Strategy::all() {
            for calls in [0, 10, N / 2, N - 1, N + 100] {
                let mut bvh = build(&start, Builder::Binned).expect("few enough");
                bvh.set_dynamic(|p| p % 10 > 0);
                let mut updater = Updater::default();
                let fragile = Fragile { boxes: end.clone(), left: AtomicUsize::new(calls) };
                let updated = catch_unwind(AssertUnwindSafe(|| {
                    pool.install(|| updater.set_strategy(strategy).update(&mut bvh, &fragile))
                }));
                let what = format!("{}, {calls} calls, {threads} threads", strategy.name());
                assert!(updated.is_err() || calls >= N * 9 / 10, "{what}");
                if bvh.is_empty() {
                    // Builders leave an empty tree; `Auto` builds beside the old one after a pass.
                    let builds_in_place = matches!(
                        strategy,
                        Strategy::Rebuild(..) | Strategy::Degraded(_) | Strategy::PartialRebuild(_)
                    );
                    assert!(builds_in_place, "{what}");
                    continue;
                }
                check(&bvh, &what);
                updater
                    .set_strategy(strategy)
                    .update(&mut bvh, &after)
                    .unwrap_or_else(|e| panic!("{what}: {e}"));
                check(&bvh, &what);
                bvh.validate(&after).unwrap_or_else(|e| panic!("{what}: {e}"));
            }
        }
    }
}

#[test]
fn the_plain_pass_and_a_mask_that_panic_leave_valid_trees() {
    let start = boxes(0.0);
    let mut bvh = build(&start, Builder::Binned).expect("few enough");
    let fragile = Fragile { boxes: boxes(1.0), left: AtomicUsize::new(N / 2) };
    let rotate = Some(bvh_update::Rotate::default());
    assert!(catch_unwind(AssertUnwindSafe(|| plain::update(&mut bvh, &fragile, rotate))).is_err());
    check(&bvh, "plain");
    assert!(catch_unwind(AssertUnwindSafe(|| plain::update(&mut bvh, &start[1..], rotate))).is_err());
    check(&bvh, "one too few");
    plain::update(&mut bvh, &start, rotate);
    bvh.validate(&start).expect("valid and tight");
    let mask = |p| {
        assert!(p != N / 2, "no such primitive");
        p % 2 > 0
    };
    assert!(catch_unwind(AssertUnwindSafe(|| bvh.set_dynamic(mask))).is_err());
    check(&bvh, "mask");
    assert!(bvh.root().is_dynamic() && bvh.static_area() == 0.0);
    let hash = bvh.fingerprint();
    bvh.set_dynamic(|_| true);
    assert_eq!(bvh.fingerprint(), hash);
}
