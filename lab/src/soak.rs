//! `cargo xtask soak`: many loops of a scene under each strategy, with bounds on what must not
//! grow.
//!
//! A short form of it is a test, `hard_cases::motion::ten_thousand_frames_in_a_loop`.

use anyhow::{Result, ensure};
use bvh_core::{Bvh, sah_cost};
use bvh_update::{Strategy, Updater};
use scenes::{FrameStage, SceneOptions};

use crate::machine::resident_mib;
use crate::pool::Threads;
use crate::progress::Progress;
use crate::stage::{self, Stage, timed};
use crate::{CheckFailed, files, interrupt};

/// Arguments of `soak`.
#[derive(clap::Args)]
pub struct Args {
    /// A scene's name, or an animation file; repeatable
    #[arg(long = "scene", value_name = "NAME|FILE", default_value = "n-body")]
    scenes: Vec<String>,
    /// A strategy's name; repeatable
    #[arg(long = "strategy", value_name = "NAME", default_values = ["refit+rotate", "refit+rotate+regrow", "auto"])]
    strategies: Vec<Strategy>,
    /// Frames to play
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1000..))]
    frames: u32,
    /// Frames in a loop
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=100))]
    per_loop: u32,
    /// Fraction of the triangles, where the scene can be made coarser [default: 1]
    #[arg(long, value_name = "F")]
    detail: Option<f32>,
    #[command(flatten)]
    threads: Threads,
}

/// What must hold at the end: time against a new tree in turns with the old one, cost and height
/// against the first tenth of the frames, and memory against the middle. What each row measured
/// stands in `docs/HARD_CASES.md`.
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
    let options = SceneOptions { detail: args.detail, ..SceneOptions::default() };
    let load = |source: &str| stage::load_with(source, None, options.clone());
    let scenes = args.scenes.iter().map(|source| Ok((source, stage::load_first(source, || load(source))?)));
    let loaded: Vec<_> = scenes.collect::<Result<_>>()?;
    let pool = args.threads.pool()?;
    files::print(
        "scene, strategy, frames: ms a frame of a new tree and of this; cost over a fresh tree; height; MiB",
    )?;
    let (mut broken, mut rest) = (Vec::new(), Vec::new());
    for (source, scene) in loaded {
        if interrupt::requested() {
            rest.push(format!("--scene {source}"));
            continue;
        }
        let mut stage = stage::ready(scene.map_or_else(|| load(source), Ok)?)?;
        for strategy in &args.strategies {
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
    /// Over those of fresh trees.
    costs: Vec<f64>,
    /// The greatest.
    height: u32,
    /// The most, in MiB: what has been freed goes back to the system late, and not always.
    memory: f64,
}

fn soak(label: &str, stage: &mut Stage, strategy: &Strategy, args: &Args) -> Result<Vec<String>> {
    let (frames, per_loop) = (args.frames as usize, args.per_loop as usize);
    let who = format!("{label}, {}", strategy.name());
    let progress = Progress::new(who.as_str(), frames as u64);
    let start = |stage: &Stage| (Bvh::clone(&stage.first_tree), Updater::new(*strategy));
    let mut old = start(stage);
    let mut windows = <[Window; 3]>::default();
    // Whole loops, since the work depends on where in the loop a frame is.
    let tenth = frames / 10 - frames / 10 % per_loop;
    for frame in (1..=frames).take_while(|_| !interrupt::requested()) {
        // The jump from the last frame of a loop to the first is part of the test.
        stage.pose(stage.time_of(frame % per_loop, per_loop));
        let (bvh, updater) = &mut old;
        let report = stage.update(bvh, updater)?;
        let window =
            [tenth, frames / 2, frames].iter().position(|&end| (end - tenth..end).contains(&(frame - 1)));
        if let Some(window) = window.map(|w| &mut windows[w]) {
            window.height = window.height.max(report.height);
            // By the place in the loop, so that all have the same; five places at least, since a
            // refitted tree is as good as a fresh one at the first.
            if (frame % per_loop).is_multiple_of((per_loop / 5).clamp(1, 20)) {
                let fresh = stage::fresh_tree(stage)?;
                window.costs.push(sah_cost(bvh) / sah_cost(&fresh));
                window.memory = window.memory.max(resident_mib());
            }
        }
        if frame % 100 == 0 || frame == frames {
            bvh.validate(&stage.triangles())
                .map_err(|e| CheckFailed(format!("{who}, frame {frame}: {e}")))?;
        }
        progress.at(frame as u64);
    }
    drop(progress);
    // Other work on the machine slows both trees: with the first and the last tenth of the frames
    // two runs of `cargo xtask soak --scene exploding-dragon --detail 0.05 --strategy refit+rotate`
    // had ratios of 0.99 and 1.13.
    let (mut trees, mut times) = ([start(stage), old], [0.0; 2]);
    let is_updated = stage.scene.effects.calls_for(FrameStage::Update);
    for frame in (1..=tenth).take_while(|_| is_updated && !interrupt::requested()) {
        stage.pose(stage.time_of(frame % per_loop, per_loop));
        for i in [frame % 2, 1 - frame % 2] {
            let (bvh, updater) = &mut trees[i];
            let (updated, time_ms) = timed(|| stage.update(bvh, updater));
            updated?;
            times[i] += time_ms / tenth as f64;
        }
    }
    if interrupt::requested() {
        return Ok(Vec::new());
    }
    let [first, middle, last] = windows;
    // Means: strategies that rebuild now and then have rare poor trees.
    let cost = |w: &Window| w.costs.iter().sum::<f64>() / w.costs.len().max(1) as f64;
    let measures = [
        ("time a frame", times, SLOWER),
        ("cost over a fresh tree", [cost(&first), cost(&last)], COSTLIER),
        ("height", [f64::from(first.height), f64::from(last.height)], HIGHER),
        ("memory", [middle.memory, last.memory], MORE_MEMORY),
    ];
    let [time, cost, height, memory] = measures.map(|(_, values, _)| values);
    files::print(&format!(
        "{who}, {frames}: {:.3} {:.3} ms; {:.3} {:.3}; {:.0} {:.0}; {:.1} {:.1} MiB",
        time[0], time[1], cost[0], cost[1], height[0], height[1], memory[0], memory[1]
    ))?;
    let broken = measures.into_iter().filter(|(_, [from, to], most)| *to > from * most);
    let words = broken.map(|(what, [from, to], most)| {
        format!("{who}: {what} from {from:.3} to {to:.3}, more than {most} times")
    });
    Ok(words.collect())
}
