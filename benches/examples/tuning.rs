//! What the numbers in the code are judged by: builders and strategies on triangles that drift
//! apart, in a pool of all cores. Change a number, and run this before and after:
//! `cargo run --release -p pivot-benches --example tuning`. `docs/TUNING.md` has half and double of
//! each number.

use bvh_build::{Builder, build};
use bvh_core::{Bvh, Triangles, Vec3, sah_cost};
use bvh_update::{PartialRebuild, Rotate, Strategy, Updater};
use pivot_benches::measure::timed;
use pivot_tests::noise;

const TRIANGLES: [u32; 2] = [100_000, 1_000_000];
const REPEATS: usize = 7;
const FRAMES: usize = 16;

/// Corners of unconnected triangles in a cube, at a time.
fn positions(n: u32, time: f32) -> Vec<Vec3> {
    let point = |seed, i: u32| noise(seed, i as usize) - 0.5;
    let size = 4.0 / (n as f32).sqrt();
    let corner = |i: u32| point(0, i / 3) + time * point(1, i / 3) + size * point(2, i);
    (0..3 * n).map(corner).collect()
}

fn print(name: &str, n: u32, ns: f64, cost: f64) {
    println!("{name:<24} {n:>8} {:>8.2} ns a triangle, SAH cost {cost:.2}", ns / f64::from(n));
}

fn main() {
    for n in TRIANGLES {
        let indices: Vec<_> = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let frames: Vec<_> = (0..FRAMES).map(|frame| positions(n, 0.1 * frame as f32)).collect();
        let triangles = |frame: usize| Triangles { positions: &frames[frame], indices: &indices };
        let build = |builder| build(&triangles(0), builder).expect("few enough");
        for builder in Builder::PER_FRAME {
            let runs: [(f64, Bvh); REPEATS] = std::array::from_fn(|_| timed(|| build(builder)));
            let least = runs.iter().map(|run| run.0).fold(f64::INFINITY, f64::min);
            print(builder.name(), n, least, sah_cost(&runs[0].1));
        }
        for strategy in [
            Strategy::Refit,
            Strategy::RefitRotate(Rotate::default()),
            Strategy::PartialRebuild(PartialRebuild::default()),
        ] {
            let (mut least, mut least_first) = (f64::INFINITY, f64::INFINITY);
            let mut cost = 0.0;
            for _ in 0..3 {
                let (mut bvh, mut updater) = (build(Builder::Ploc), Updater::new(strategy));
                let mut update = |frame| timed(|| updater.update(&mut bvh, &triangles(frame))).0;
                let first = update(0);
                least_first = least_first.min(first);
                least = least.min((first + (1..FRAMES).map(&mut update).sum::<f64>()) / FRAMES as f64);
                cost = sah_cost(&bvh);
            }
            print(strategy.name(), n, least, cost);
            println!("{:<24} {:>17.2} ns a triangle in the first update", "", least_first / f64::from(n));
        }
    }
}
