//! What small trees take from a thread outside of rayon's pool, as a program with many small meshes
//! calls it: `cargo run --release -p pivot-benches --example small_trees`. Updates by an
//! [`Updater`], by the free function, which makes one in each call, and builds.

use std::error::Error;
use std::time::Instant;

use bvh_build::{BuildOptions, BuildScratch, Builder, build, rebuild};
use bvh_core::{Aabb, Bvh, Vec3};
use bvh_update::{Load, Rotate, Strategy, Updater, refit_and_rotate};

/// Boxes updated in one measurement; the least of several counts.
const BOXES: usize = 400_000;
const REPEATS: usize = 9;

fn main() -> Result<(), Box<dyn Error>> {
    println!("us     update by                                    build");
    println!("boxes  refit+rotate  free function    auto  rays      lbvh     ploc   binned");
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
        let rotate = Updater::new(Strategy::RefitRotate(Rotate::default()));
        let auto = Updater::default();
        let mut few_rays = Updater::default();
        few_rays.report(Load::SingleRays(10));
        print!("{n:5}");
        for (width, mut updater) in [(14, Some(rotate)), (15, None), (8, Some(auto)), (6, Some(few_rays))] {
            let us = least(&frames, |bvh, boxes| {
                match &mut updater {
                    Some(updater) => updater.update(bvh, boxes)?,
                    None => refit_and_rotate(bvh, boxes)?,
                };
                Ok(())
            })?;
            print!("{us:width$.2}");
        }
        for builder in [Builder::Lbvh, Builder::Ploc, Builder::Binned] {
            let mut scratch = BuildScratch::default();
            let us = least(&frames, |bvh, boxes| {
                Ok(rebuild(bvh, boxes, builder, &BuildOptions::default(), &mut scratch)?)
            })?;
            print!("{us:9.2}");
        }
        println!();
    }
    Ok(())
}

/// Microseconds that one frame takes, the least mean of several.
fn least(
    frames: &[Vec<Aabb>],
    mut update: impl FnMut(&mut Bvh, &Vec<Aabb>) -> Result<(), Box<dyn Error>>,
) -> Result<f64, Box<dyn Error>> {
    let mut bvh = build(&frames[0], Builder::Sweep)?;
    let updates = BOXES / frames[0].len();
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        for boxes in frames.iter().cycle().take(updates) {
            update(&mut bvh, boxes)?;
        }
        least = least.min(start.elapsed().as_secs_f64() / updates as f64);
    }
    bvh.validate(&frames[(updates - 1) % frames.len()])?;
    Ok(1e6 * least)
}
