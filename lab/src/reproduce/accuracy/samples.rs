//! Samples per pixel of the effects that are computed at random.

use std::time::Instant;

use anyhow::Result;
use bvh_core::Bvh;
use rt_cpu::{Bvh8, Image, RenderOptions, render_with};
use scenes::LightEffects;

use super::bench::Bench;
use super::point::Point;
use crate::interrupt;
use crate::render::default_samples;
use crate::stage::ms;

/// The error of the mean of 1, 2, 4 ... samples against the mean of many more, of another seed.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let own = bench.stage.scene.effects.light;
    let effects = [
        ("ambient occlusion", LightEffects { ambient_occlusion: true, diffuse_bounces: false, ..own }),
        ("diffuse bounces", LightEffects { ambient_occlusion: false, diffuse_bounces: true, ..own }),
    ];
    bench.pose_in_the_middle();
    bench.stage.smooth();
    let tree = bench.sweep()?;
    let mut wide = Bvh8::new();
    wide.update(&tree, &bench.stage.triangles());
    let counts = bench.effort.samples;
    let total: usize = counts.iter().map(|(most, reference)| most + reference).sum();
    let mut done = 0;
    for ((effect, light), (most, many)) in effects.into_iter().zip(counts) {
        let seed = bench.effort.seed;
        let mut converged = Mean::new(bench, &light, seed + 1);
        while converged.count < many && !interrupt::requested() {
            converged.add_sample(bench, &tree, &wide);
            done += 1;
            bench.done(done, total);
        }
        if converged.count < many {
            break;
        }
        let mut mean = Mean::new(bench, &light, seed);
        while mean.count < most && !interrupt::requested() {
            mean.add_sample(bench, &tree, &wide);
            done += 1;
            bench.done(done, total);
            if !mean.count.is_power_of_two() {
                continue;
            }
            let size = bench.effort.noise_size;
            bench.add(Point {
                knob: format!("samples of {effect}"),
                setting: format!("{} a pixel", mean.count),
                is_default: mean.count == default_samples(&light) as usize,
                error_name: "rms image error".to_owned(),
                error: root_mean_square(&mean, &converged),
                unit: "linear colour".to_owned(),
                time_ms: mean.time_ms,
                note: format!(
                    "time of {size} x {size} pixels; against {many} samples a pixel of another seed"
                ),
                ..Point::default()
            })?;
        }
    }
    Ok(())
}

/// The mean of samples taken so far, as their sum.
struct Mean {
    options: RenderOptions,
    sum: Image,
    sample: Image,
    count: usize,
    time_ms: f64,
}

impl Mean {
    fn new(bench: &Bench<'_>, light: &LightEffects, seed: u64) -> Self {
        let size = bench.effort.noise_size;
        let options = RenderOptions { seed, ..bench.stage.options_with(light) };
        Self { options, sum: Image::new(size, size), sample: Image::new(size, size), count: 0, time_ms: 0.0 }
    }

    fn add_sample(&mut self, bench: &Bench<'_>, tree: &Bvh, wide: &Bvh8) {
        let stage = &*bench.stage;
        let (mesh, light) = (stage.mesh(), stage.light());
        let camera = stage.camera(self.sum.width(), self.sum.height());
        self.options.sample = self.count as u32;
        let start = Instant::now();
        render_with(tree, wide, &mesh, &camera, Some(&light), &self.options, &mut self.sample);
        self.sum.add(&self.sample);
        self.time_ms += ms(start);
        self.count += 1;
    }
}

/// Over all pixels and channels.
fn root_mean_square(a: &Mean, b: &Mean) -> f64 {
    let channels = |mean: &Mean| {
        let count = mean.count as f64;
        mean.sum.pixels().iter().flatten().map(move |&c| f64::from(c) / count).collect::<Vec<_>>()
    };
    let (a, b) = (channels(a), channels(b));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}
