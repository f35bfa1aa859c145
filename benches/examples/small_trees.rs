//! What an update of a small tree costs, by refit and rotations, from a thread outside of rayon's
//! pool, as a program with many small meshes calls it: `cargo run --release -p pivot-benches
//! --example small_trees`.

use std::time::Instant;

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Vec3};
use bvh_update::{Rotate, Strategy, Updater};

/// Boxes updated in one measurement; the least of several counts.
const BOXES: usize = 400_000;
const REPEATS: usize = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("boxes   us an update   ns a box   KB kept");
    for n in [16, 64, 256, 1000, 4000] {
        // Spread evenly, each with a direction of its own.
        let point = |i: usize| (Vec3::new(0.8192, 0.6710, 0.5497) * i as f32).fract();
        let moving: Vec<_> = (0..n).map(|i| (10.0 * point(i), point(7 * i + 3) - 0.5)).collect();
        // There and back.
        let frames: Vec<Vec<Aabb>> = (0..20)
            .map(|i| 0.1 * (10_i32 - i).abs() as f32)
            .map(|time| moving.iter().map(|&(at, step)| at + step * time).collect::<Vec<_>>())
            .map(|corners| corners.into_iter().map(|corner| Aabb::new(corner, corner + 0.3)).collect())
            .collect();
        let mut bvh = build(&frames[0], Builder::Sweep)?;
        let mut updater = Updater::new(Strategy::RefitRotate(Rotate::default()));
        let updates = BOXES / n;
        let mut least = f64::INFINITY;
        for _ in 0..REPEATS {
            let start = Instant::now();
            for boxes in frames.iter().cycle().take(updates) {
                updater.update(&mut bvh, boxes)?;
            }
            least = least.min(start.elapsed().as_secs_f64() / updates as f64);
        }
        bvh.validate(&frames[(updates - 1) % frames.len()])?;
        let kept = updater.pass_memory() / 1000;
        println!("{n:5}   {:12.2}   {:8.1}   {kept:7}", 1e6 * least, 1e9 * least / n as f64);
    }
    Ok(())
}
