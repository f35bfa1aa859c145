//! Small trees are built and updated on the calling thread alone: outside of rayon's pool even a
//! join that does nothing takes microseconds.

use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Vec3};
use bvh_update::{Strategy, Updater};

/// Clusters that fly apart and come back, so that strategies repair and rebuild.
fn pose(n: usize, step: usize) -> Vec<Aabb> {
    let scatter = |i: usize| Vec3::new(0.8192, 0.6710, 0.5497).map(|x| (x * i as f32).fract());
    let corner = |i: usize| scatter(i / 10) * 9.0 + scatter(i) + scatter(7 * i) * (step % 8 * 3) as f32;
    (0..n).map(corner).map(|corner| Aabb::new(corner, corner + 0.3)).collect()
}

/// All but those that build in a thread of their own.
fn strategies() -> impl Iterator<Item = Strategy> {
    Strategy::all().into_iter().filter(|strategy| !matches!(strategy, Strategy::Background(_)))
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
        for n in [2, 16, 1000] {
            for builder in Builder::PER_FRAME {
                build(&pose(n, 0), builder).expect("few enough");
                sender.send(format!("{} of {n}", builder.name())).expect("a receiver");
            }
            for strategy in strategies() {
                let mut bvh = build(&pose(n, 0), Builder::Sweep).expect("few enough");
                let mut updater = Updater::new(strategy);
                for step in 0..40 {
                    updater.update(&mut bvh, &pose(n, step)).expect("same count");
                }
                sender.send(format!("{} of {n}", strategy.name())).expect("a receiver");
            }
        }
    });
    let mut done = String::from("nothing");
    for _ in 0..3 * (Builder::PER_FRAME.len() + strategies().count()) {
        let next = receiver.recv_timeout(Duration::from_secs(60));
        done = next.unwrap_or_else(|error| panic!("{error} after {done}"));
    }
}
