//! Small trees are updated, and built for each frame, on the calling thread alone: outside of
//! rayon's pool even a join that does nothing takes microseconds. Strategies that build in the
//! background are left out.

use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Vec3};
use bvh_update::{Decision, Load, Strategy, Updater};

const SIZES: [usize; 4] = [2, 16, 1000, 1024];

/// Pieces of a sheet that fly apart, again and again.
fn pose(n: usize, step: usize) -> Vec<Aabb> {
    let corner = |i: usize| {
        let (x, y) = (i % 32, i / 32);
        let piece = (x / 3 + y / 3 * 11) as f32;
        let away = Vec3::new((piece * 1.7).sin(), (piece * 2.3).cos(), (piece * 3.1).sin());
        Vec3::new(x as f32, y as f32, 0.0) + away * (step % 20 * 3) as f32
    };
    (0..n).map(corner).map(|corner| Aabb::new(corner, corner + Vec3::new(1.1, 1.1, 0.1))).collect()
}

/// Those that build no tree in a thread of their own, and `Auto` for single rays.
fn updaters() -> impl Iterator<Item = (&'static str, Updater)> {
    let strategies = Strategy::all().into_iter();
    let here = strategies.filter(|strategy| !matches!(strategy, Strategy::Background(_)));
    let mut few_rays = Updater::default();
    few_rays.report(Load::SingleRays(20));
    here.map(|strategy| (strategy.name(), Updater::new(strategy))).chain([("few rays", few_rays)])
}

/// One test, since the pool is that of the process.
#[test]
fn small_trees_need_no_other_thread() {
    // Threads that never begin to work: who hands them something waits for ever.
    let sleep = |_| loop {
        thread::park();
    };
    rayon::ThreadPoolBuilder::new().num_threads(3).start_handler(sleep).build_global().expect("the first");
    let (sender, receiver) = channel();
    thread::spawn(move || {
        // The last has as many nodes as small trees have at most.
        for n in SIZES {
            for builder in Builder::PER_FRAME {
                build(&pose(n, 0), builder).expect("few enough");
                sender.send((0, format!("{} of {n}", builder.name()))).expect("a receiver");
            }
            for (name, mut updater) in updaters() {
                let mut bvh = build(&pose(n, 0), Builder::Sweep).expect("few enough");
                let mut most_subtrees = 0;
                for step in 0..60 {
                    bvh.set_dynamic(|p| step < 20 || p % 10 > 0);
                    let done = updater.update(&mut bvh, &pose(n, step)).expect("same count");
                    if let Decision::PartialRebuild { subtrees } = done.decision {
                        most_subtrees = most_subtrees.max(subtrees);
                    }
                }
                sender.send((most_subtrees, format!("{name} of {n}"))).expect("a receiver");
            }
        }
    });
    let mut repaired = 0;
    let mut last = String::from("nothing");
    for _ in 0..SIZES.len() * (Builder::PER_FRAME.len() + updaters().count()) {
        let next = receiver.recv_timeout(Duration::from_secs(60));
        let (subtrees, name) = next.unwrap_or_else(|error| panic!("{error} after {last}"));
        repaired += usize::from(subtrees > 150);
        last = name;
    }
    assert!(repaired > 3, "{repaired} strategies have put a high top onto a tree");
}
