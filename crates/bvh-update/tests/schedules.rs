//! The tasks of a pass in many orders: primitives that keep threads waiting here and there, as a
//! seed says, make the threads take other tasks at other times. Trees and tallies are those of one
//! thread, bit for bit.

use std::collections::HashSet;
use std::sync::atomic::{AtomicU8, Ordering};

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Primitives, Vec3};
use bvh_update::{Strategy, Updater};

/// Boxes that give way to other threads when they are asked for, and remember whom.
struct Waiting<'a> {
    boxes: &'a [Aabb],
    seed: u64,
    asked_by: Vec<AtomicU8>,
}

impl Primitives for Waiting<'_> {
    fn len(&self) -> usize {
        self.boxes.len()
    }

    fn bounds(&self, i: usize) -> Aabb {
        let thread = rayon::current_thread_index().map_or(0, |thread| thread as u8 + 1);
        self.asked_by[i].store(thread, Ordering::Relaxed);
        let mut random = fastrand::Rng::with_seed(self.seed.rotate_left(32) ^ i as u64);
        if random.u32(..257) == 0 {
            (0..random.u32(1..4)).for_each(|_| std::thread::yield_now());
        }
        self.boxes.aabb(i)
    }
}

fn boxes(frame: usize) -> Vec<Aabb> {
    let place = |i: usize| {
        let drift = Vec3::new((i % 7) as f32, (i % 5) as f32, (i % 3) as f32) * frame as f32 * 1.7;
        Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32) + drift
    };
    (0..9000).map(place).map(|p| Aabb::new(p, p + 0.7)).collect()
}

#[test]
fn no_schedule_changes_a_bit() {
    const FRAMES: usize = 3;
    const SEEDS: u64 = 30;
    let frames: Vec<_> = (0..FRAMES).map(boxes).collect();
    let first = build(&frames[0], Builder::Lbvh).expect("few enough");
    for name in ["refit", "refit+rotate", "refit+rotate+regrow"] {
        let strategy: Strategy = name.parse().expect("known");
        let run = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let (mut bvh, mut updater, mut report) = (first.clone(), Updater::default(), Vec::new());
            let mut schedule = Vec::new();
            for boxes in &frames {
                let asked_by = boxes.iter().map(|_| AtomicU8::new(0)).collect();
                let waiting = Waiting { boxes, seed, asked_by };
                report.push(
                    pool.install(|| updater.set_strategy(strategy).update(&mut bvh, &waiting))
                        .expect("same count"),
                );
                schedule.extend(waiting.asked_by.into_iter().map(AtomicU8::into_inner));
            }
            bvh.validate(&frames[FRAMES - 1]).expect("valid and tight");
            ((bvh.fingerprint(), report), schedule)
        };
        let (alone, _) = run(1, 0);
        let mut schedules = HashSet::new();
        for seed in 0..SEEDS {
            let (result, schedule) = run(2 + seed as usize % 5, seed);
            assert!(result == alone, "{name}, seed {seed}");
            schedules.insert(schedule);
        }
        println!("{name}: {} schedules", schedules.len());
        assert!(schedules.len() > SEEDS as usize / 4, "{name}: {} schedules only", schedules.len());
    }
}
