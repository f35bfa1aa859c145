//! Updates allocate nothing once their threads and updaters have the memory that they need.

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Bvh, Vec3};
use bvh_update::{Decision, Degraded, PartialRebuild, Rotate, Strategy, Updater, refit_and_rotate};
use pivot_allocations::of_process;

/// Pieces of a sheet that fly apart.
fn pose(n: usize, step: usize) -> Vec<Aabb> {
    let place = |i: usize| {
        let piece = (i / 10 % 10 + i / 1000 * 10) as f32;
        let away = Vec3::new((piece * 1.7).sin(), (piece * 2.3).cos(), (piece * 3.1).sin());
        Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0) + away * (step * 5) as f32
    };
    (0..n).map(place).map(|corner| Aabb::new(corner, corner + Vec3::new(1.1, 1.1, 0.1))).collect()
}

/// Allocations of an update to each pose in turn, and whether any update repaired the tree.
fn play(updater: &mut Updater, built: &Bvh, poses: &[Vec<Aabb>]) -> (Vec<usize>, bool) {
    let (mut bvh, mut has_repaired) = (built.clone(), false);
    let counted = |pose| {
        let (count, report) = of_process(|| updater.update(&mut bvh, pose));
        let report = report.expect("same count");
        assert!(!report.rebuilt, "a new tree takes new memory");
        has_repaired |= matches!(report.decision, Decision::PartialRebuild { .. });
        count
    };
    let counts = poses.iter().map(counted).collect();
    (counts, has_repaired)
}

/// One test, since the counter is that of the process.
#[test]
fn passes_allocate_in_a_thread_s_first_update_only_and_others_in_the_first_loop_only() {
    let poses_of = |n: usize| (0..8).map(|step| pose(n, step)).collect::<Vec<_>>();
    let poses = poses_of(10_000);
    let built = build(&poses[0], Builder::Sweep).expect("few enough");
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        // Threads allocate as they begin, and that may be later.
        pool.broadcast(|_| ());
        pool
    };
    let [one, three] = [1, 3].map(on);
    // A thread that has updated a small tree has what larger ones need, whatever their size.
    let (small, many) = (poses_of(100), poses_of(80_000));
    let mut other = build(&small[0], Builder::Sweep).expect("few enough");
    one.install(|| refit_and_rotate(&mut other, &small[1])).expect("same count");
    let large = build(&many[0], Builder::Lbvh).expect("few enough");
    for strategy in [Strategy::Refit, Strategy::RefitRotate(Rotate::default())] {
        let counts =
            |pool: &rayon::ThreadPool| pool.install(|| play(&mut Updater::new(strategy), &built, &poses)).0;
        assert_eq!(counts(&one).into_iter().max(), Some(0), "{strategy}");
        let (counts_of_many, _) = one.install(|| play(&mut Updater::new(strategy), &large, &many));
        assert_eq!(counts_of_many.into_iter().max(), Some(0), "{strategy}, 80,000 boxes");
        // A thread that steals for the first time in its life allocates, whenever that may be.
        assert_eq!(counts(&three).into_iter().min(), Some(0), "{strategy}, 3 threads");
    }
    let never = Degraded::default().with_threshold(f64::INFINITY);
    for strategy in [Strategy::PartialRebuild(PartialRebuild::default()), Strategy::Degraded(never)] {
        let mut updater = Updater::new(strategy);
        let [_, (counts, has_repaired)] = one.install(|| [0, 1].map(|_| play(&mut updater, &built, &poses)));
        // The first update of a tree takes a look at it.
        assert_eq!(counts[1..].iter().max(), Some(&0), "{strategy}");
        assert_eq!(has_repaired, matches!(strategy, Strategy::PartialRebuild(_)), "{strategy}");
    }
}
