//! `cargo xtask soak`: many loops of a scene under each strategy, with bounds on what must not
//! grow.
//!
//! A short form of it is a test, `hard_cases::motion::ten_thousand_frames_in_a_loop`.

use std::time::Instant;

use anyhow::{Result, anyhow, ensure};
use bvh_build::{Builder, build};
use bvh_core::{Bvh, sah_cost};
use bvh_update::{Strategy, UnknownName, Updater};
use scenes::SceneOptions;

use crate::machine::resident_mib;
use crate::pool::Threads;
use crate::progress::Progress;
use crate::stage::{self, Stage, ms};
use crate::{CheckFailed, files, interrupt};

/// Arguments of `soak`.
#[derive(clap::Args)]
pub struct Args {
    /// A scene's name, or an animation file; repeatable
    #[arg(long = "scene", value_name = "NAME|FILE", default_value = "n-body")]
    scenes: Vec<String>,
    /// A strategy's name; repeatable
    #[arg(long = "strategy", value_name = "NAME", default_values = ["refit+rotate", "refit+rotate+regrow", "auto"])]
    strategies: Vec<String>,
    /// Frames to play
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(2000..))]
    frames: u32,
    /// Frames in a loop
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=100))]
    per_loop: u32,
    /// Fraction of the triangles, where the scene can be made coarser
    #[arg(long, value_name = "F")]
    detail: Option<f32>,
    #[command(flatten)]
    threads: Threads,
}

/// What time, cost, height and memory may be at the end at most, times those of the first tenth of the frames.
///
/// Two runs of `cargo xtask soak --scene exploding-dragon --detail 0.05 --strategy refit+rotate` had 0.99 and 1.13 times the
/// time, for other work on the machine. Memory rises until the largest subtree has been rebuilt that ever is: with
/// `--scene fairy-forest --strategy auto` to 139 MiB, 1.22 times, after 30,000 frames, and 139 after 60,000.
const MOST: [f64; 4] = [1.25, 1.1, 1.3, 1.25];

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    let parse = |name: &String| name.parse().map_err(|e: UnknownName| anyhow!("{name}: {e}"));
    let strategies: Vec<Strategy> = args.strategies.iter().map(parse).collect::<Result<_>>()?;
    let options = SceneOptions { detail: args.detail, ..SceneOptions::default() };
    let load = |source: &str| stage::load_with(source, None, options.clone());
    let mut loaded = Vec::new();
    for source in &args.scenes {
        loaded.push((source, stage::load_first(source, || load(source))?));
    }
    let pool = args.threads.pool()?;
    files::print("scene, strategy, frames: first and last ms a frame; cost over a fresh tree; height; MiB")?;
    let (mut broken, mut rest) = (Vec::new(), Vec::new());
    for (source, scene) in loaded {
        if interrupt::requested() {
            rest.push(format!("--scene {source}"));
            continue;
        }
        let mut stage = stage::ready(scene.map_or_else(|| load(source), Ok)?)?;
        for strategy in &strategies {
            if !interrupt::requested() {
                broken.extend(pool.install(|| soak(source, &mut stage, strategy, args))?);
            }
            // What was interrupted has played too few frames to be judged.
            if interrupt::requested() {
                rest.push(format!("--scene {source} --strategy {}", strategy.name()));
            }
        }
    }
    interrupt::say_how_to_go_on(&format!("the same command with {}", rest.join(", then ")));
    ensure!(broken.is_empty(), CheckFailed(broken.join("; ")));
    Ok(())
}

/// What is known of some frames.
#[derive(Default)]
struct Window {
    /// In ms.
    times: Vec<f64>,
    costs: Vec<f64>,
    /// The greatest.
    height: u32,
    /// The most, in MiB: what has been freed goes back to the system late, and not always.
    memory: f64,
}

impl Window {
    /// Means of time and of cost over a fresh tree's: strategies that rebuild now and then have rare expensive frames.
    fn measures(&self) -> [f64; 4] {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        [mean(&self.times), mean(&self.costs), f64::from(self.height), self.memory]
    }
}

fn soak(label: &str, stage: &mut Stage, strategy: &Strategy, args: &Args) -> Result<Vec<String>> {
    let (frames, per_loop) = (args.frames as usize, args.per_loop as usize);
    let progress = Progress::new(format!("{label}, {}", strategy.name()), frames as u64);
    let mut bvh = Bvh::clone(&stage.first_tree);
    let mut updater = Updater::default();
    let (mut first, mut last, mut done) = (Window::default(), Window::default(), 0);
    // Whole loops, since the work depends on where in the loop a frame is.
    let compared = frames / 10 - frames / 10 % per_loop;
    for frame in 1..=frames {
        if interrupt::requested() {
            break;
        }
        // The jump from the last frame of a loop to the first is part of the test.
        stage.pose(stage.time_of(frame % per_loop, per_loop));
        let start = Instant::now();
        let report = stage.update(&mut bvh, updater.set_strategy(*strategy))?;
        let time = ms(start);
        let window = if frame <= compared { &mut first } else { &mut last };
        if frame <= compared || frame + compared > frames {
            window.times.push(time);
            window.height = window.height.max(report.height);
            // By the place in the loop, so that both have the same.
            if (frame % per_loop).is_multiple_of(20) {
                let fresh = build(&stage.triangles(), Builder::Sweep)?;
                window.costs.push(sah_cost(&bvh) / sah_cost(&fresh));
                window.memory = window.memory.max(resident_mib());
            }
        }
        if frame % 100 == 0 || frame == frames {
            bvh.validate(&stage.triangles())
                .map_err(|e| CheckFailed(format!("{label}, {}, frame {frame}: {e}", strategy.name())))?;
        }
        progress.at(frame as u64);
        done = frame;
    }
    drop(progress);
    let who = format!("{label}, {}", strategy.name());
    let names = ["time a frame", "cost over a fresh tree", "height", "memory"];
    let (first, last) = (first.measures(), last.measures());
    let [time, cost, height, memory] = std::array::from_fn(|i| [first[i], last[i]]);
    files::print(&format!(
        "{who}, {done}: {:.3} {:.3} ms; {:.3} {:.3}; {:.0} {:.0}; {:.1} {:.1} MiB",
        time[0], time[1], cost[0], cost[1], height[0], height[1], memory[0], memory[1]
    ))?;
    if done < frames {
        return Ok(Vec::new());
    }
    let words = (0..names.len()).filter(|&i| last[i] > first[i] * MOST[i]).map(|i| {
        format!("{who}: {} from {:.3} to {:.3}, more than {} times", names[i], first[i], last[i], MOST[i])
    });
    Ok(words.collect())
}
