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
use crate::reproduce::median;
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

/// Most frames at the start that as many at the end are compared with: the whole loops in them,
/// since the work depends on where in the loop a frame is. Medians of 100 frames of 0.3 ms differed by
/// 12 %: `cargo xtask soak --scene exploding-dragon --detail 0.05 --strategy auto`.
const FIRST: usize = 500;
/// What must hold at the end, against those first frames.
const SLOWER: f64 = 1.1;
const COSTLIER: f64 = 1.1;
const HIGHER: f64 = 1.3;
const MORE_MEMORY: f64 = 1.05;

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
    times: Vec<f64>,
    costs: Vec<f64>,
    /// The greatest.
    height: u32,
}

impl Window {
    /// Median time in ms; mean cost over a fresh tree's, since of what is rebuilt now and then the
    /// greatest is a matter of luck; and height.
    fn measures(self) -> [f64; 3] {
        let cost = self.costs.iter().sum::<f64>() / self.costs.len().max(1) as f64;
        [median(self.times), cost, f64::from(self.height)]
    }
}

fn soak(label: &str, stage: &mut Stage, strategy: &Strategy, args: &Args) -> Result<Vec<String>> {
    let (frames, per_loop) = (args.frames as usize, args.per_loop as usize);
    let progress = Progress::new(format!("{label}, {}", strategy.name()), frames as u64);
    let mut bvh = Bvh::clone(&stage.first_tree);
    let mut updater = Updater::default();
    let (mut first, mut last) = (Window::default(), Window::default());
    let (mut memory, mut done) = ([0.0; 2], 0);
    let compared = FIRST - FIRST % per_loop;
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
            if (frame % per_loop).is_multiple_of(5) {
                let fresh = build(&stage.triangles(), Builder::Sweep)?;
                window.costs.push(sah_cost(&bvh) / sah_cost(&fresh));
            }
        }
        if frame % 1000 == 0 || frame == frames {
            bvh.validate(&stage.triangles())
                .map_err(|e| CheckFailed(format!("{label}, {}, frame {frame}: {e}", strategy.name())))?;
        }
        // After a check, which takes memory of its own.
        if frame == FIRST * 2 {
            memory[0] = resident_mib();
        }
        progress.at(frame as u64);
        done = frame;
    }
    memory[1] = resident_mib();
    drop(progress);
    let who = format!("{label}, {}", strategy.name());
    let ([time, cost, height], [last_time, last_cost, last_height]) = (first.measures(), last.measures());
    files::print(&format!(
        "{who}, {done}: {time:.3} {last_time:.3} ms; {cost:.3} {last_cost:.3}; [{height}, {last_height}]; {:.1} {:.1} MiB",
        memory[0], memory[1]
    ))?;
    let measures = [
        ("time a frame", [time, last_time], SLOWER),
        ("cost over a fresh tree", [cost, last_cost], COSTLIER),
        ("height", [height, last_height], HIGHER),
        ("memory", memory, MORE_MEMORY),
    ];
    if done < frames {
        return Ok(Vec::new());
    }
    let broken = measures.into_iter().filter(|(_, [from, to], most)| *to > from * most);
    let words = broken.map(|(what, [from, to], most)| {
        format!("{who}: {what} from {from:.3} to {to:.3}, more than {most} times")
    });
    Ok(words.collect())
}
