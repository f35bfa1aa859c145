//! Updates allocate nothing once their updater memory is large enough.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Vec3};
use bvh_update::{Decision, Degraded, Leaves, PartialRebuild, Rotate, Strategy, Updater};

/// Counts what is asked of the system's allocator.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: passes everything on to the system's allocator.
#[expect(unsafe_code, reason = "an allocator is unsafe to write")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(start, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Pieces of a sheet that fly apart.
fn pose(step: usize) -> Vec<Aabb> {
    let place = |i: usize| {
        let piece = (i / 10 % 10 + i / 1000 * 10) as f32;
        let away = Vec3::new((piece * 1.7).sin(), (piece * 2.3).cos(), (piece * 3.1).sin());
        Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0) + away * (step * 5) as f32
    };
    (0..10_000).map(place).map(|corner| Aabb::new(corner, corner + Vec3::new(1.1, 1.1, 0.1))).collect()
}

#[test]
fn a_motion_seen_before_allocates_nothing() {
    let poses: Vec<_> = (0..8).map(pose).collect();
    let built = build(&poses[0], Builder::Sweep).expect("few enough");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    for strategy in [
        Strategy::Refit,
        Strategy::RefitRotate(Rotate::default()),
        Strategy::PartialRebuild(PartialRebuild::default()),
        Strategy::Leaves(Leaves { period: 1, ..Leaves::default() }),
        Strategy::Degraded(Degraded { threshold: f64::INFINITY, ..Degraded::default() }),
    ] {
        let mut updater = Updater::default();
        let mut play = || {
            let mut bvh = built.clone();
            let mut step = |pose: &Vec<Aabb>| {
                let before = ALLOCATIONS.load(Relaxed);
                let report = updater.set_strategy(strategy).update(&mut bvh, pose).expect("same count");
                assert!(!report.rebuilt, "a new tree takes new memory");
                (ALLOCATIONS.load(Relaxed) - before, report.decision != Decision::AsAlways)
            };
            // The first update of a tree takes a look at it.
            step(&poses[0]);
            poses[1..].iter().map(step).fold((0, false), |sum, one| (sum.0 + one.0, sum.1 | one.1))
        };
        let [_, (allocations, repaired)] = pool.install(|| [play(), play()]);
        assert_eq!(allocations, 0, "{}", strategy.name());
        assert_eq!(repaired, matches!(strategy, Strategy::PartialRebuild(_)), "{}", strategy.name());
    }
}
