//! An `Updater` with a build under way may be dropped anywhere in a rayon pool. Each case runs in a
//! child process, because a stack overflow aborts the process and a deadlock never ends.

use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Bvh, Vec3};
use bvh_update::{Background, Strategy, Updater};
use rayon::prelude::*;

/// Names the case that a child process runs.
const CASE: &str = "PIVOT_DROP_CASE";
/// A child that takes longer counts as deadlocked. The cases take a second or two.
const PATIENCE: Duration = Duration::from_secs(120);

fn boxes(n: usize) -> Vec<Aabb> {
    let place = |i: usize| Vec3::new((i % 17) as f32, (i % 13) as f32, (i % 19) as f32);
    (0..n).map(place).map(|p| Aabb::new(p, p + 0.5)).collect()
}

/// An updater with a build under way.
fn busy(boxes: &Vec<Aabb>, tree: &Bvh, builder: Builder) -> Updater {
    let (mut bvh, mut updater) = (tree.clone(), Updater::default());
    let background = Background::default().with_builder(builder);
    updater.set_strategy(Strategy::Background(background)).update(&mut bvh, boxes).expect("same count");
    updater
}

fn tree(boxes: &Vec<Aabb>) -> Bvh {
    build(boxes, Builder::Lbvh).expect("few enough")
}

/// More tasks than a stack holds, if one runs on top of another.
fn many_drops(builder: Builder) {
    const TASKS: usize = 3000;
    let boxes = boxes(3000);
    let tree = tree(&boxes);
    (0..TASKS).into_par_iter().with_max_len(1).for_each(|_| drop(busy(&boxes, &tree, builder)));
}

/// Tasks that replace an `Updater` while they hold its lock: the old one is dropped under the lock.
fn drops_under_a_lock(builder: Builder) {
    const TASKS: usize = 8;
    let boxes = boxes(20_000);
    let tree = tree(&boxes);
    let shared = Mutex::new(Updater::default());
    (0..TASKS).into_par_iter().with_max_len(1).for_each(|_| {
        let new = busy(&boxes, &tree, builder);
        *shared.lock().expect("no panic") = new;
    });
}

/// Runs the case that the variable names: the part of the child process.
#[test]
#[ignore = "run by the tests below, in a process of its own"]
fn child() {
    let Ok(case) = std::env::var(CASE) else { return println!("skipped: {CASE} names no case") };
    let words: Vec<_> = case.split(' ').collect();
    let builder: Builder = words[1].parse().expect("known");
    let run = || match words[0] {
        "many" => many_drops(builder),
        "lock" => drops_under_a_lock(builder),
        name => panic!("no case is named {name}"),
    };
    match words[2].parse() {
        Ok(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(run);
        }
        // In the global pool.
        Err(_) => rayon::scope(|_| run()),
    }
    println!("done: {case}");
}

fn passes(case: &str) {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program)
        .args(["--exact", "child", "--ignored", "--nocapture"])
        .env(CASE, case)
        .env("RAYON_NUM_THREADS", "2")
        .stdout(Stdio::piped())
        .spawn()
        .expect("a process");
    let start = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if start.elapsed() > PATIENCE {
            child.kill().expect("a child");
            let _ = child.wait();
            panic!("{case}: deadlock");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = child.wait_with_output().expect("a child");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{case}: {}", output.status);
    assert!(text.contains(&format!("done: {case}")), "{case}: the child ran no case:\n{text}");
}

#[test]
fn dropping_thousands_of_busy_updaters_in_a_pool_overflows_no_stack() {
    passes("many binned 2");
    passes("many binned global");
    passes("many ploc 2");
    passes("many ploc global");
}

#[test]
fn dropping_a_busy_updater_under_a_lock_is_no_deadlock() {
    for builder in Builder::PER_FRAME {
        // With one thread, a build that wanted the caller's pool would wait for ever.
        for pool in ["1", "2", "global"] {
            passes(&format!("lock {} {pool}", builder.name()));
        }
    }
}
