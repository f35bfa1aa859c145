//! What building in the background costs: the longest pause of any frame, how old its trees are, their memory, and the
//! time that their thread takes.
//!
//! Played alone, every frame of a loop at its own pace, since the thread in the background takes time from whatever is
//! measured beside it.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use bvh_update::{Background, Decision, Rotate, Scratch, Strategy, update};
use rt_cpu::{Pixel, PointLight, RenderOptions, cast};

use super::Setting;
use super::lane::view;
use super::row::median;
use super::table::threads_of;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Stage, ms};

/// What the longest frame may take, over the median.
const REACH: f64 = 1.2;

/// Frames played before those that count, in which memory grows to its size.
const WARM_UP: usize = 3;

pub(super) fn strategies() -> [Strategy; 2] {
    [None, Some(Rotate::default())]
        .map(|rotate| Strategy::Background(Background { rotate, ..Background::default() }))
}

pub(super) fn contestant(strategy: &Strategy) -> String {
    format!("pivot {}", strategy.name())
}

/// A few lines for each way of building in the background.
pub(super) fn measure(stage: &mut Stage, setting: &Setting) -> Result<String> {
    let named = strategies().into_iter().filter(|strategy| setting.is_named(&contestant(strategy)));
    let strategies: Vec<Strategy> = named.collect();
    if strategies.is_empty() {
        return Ok(String::new());
    }
    let mut text = format!(
        "\nbuilt in the background, {}, every frame of a loop\n  {:<26} {:>10} {:>10} {:>10} {:>12} {:>12} {:>10} {:>10} {:>10}\n",
        threads_of(setting.threads),
        "",
        "median ms",
        "longest",
        format!("<= {REACH}"),
        "update alone",
        "frames/tree",
        "delay",
        "MiB",
        "cores"
    );
    for strategy in strategies {
        if !interrupt::requested() {
            text += &setting.pool.install(|| play(&strategy, stage, setting))?;
        }
    }
    Ok(text)
}

fn play(strategy: &Strategy, stage: &mut Stage, setting: &Setting) -> Result<String> {
    let frames = stage.scene.frames.max(2);
    let progress = Progress::new(format!("{}, {} threads", strategy.name(), setting.threads), frames as u64);
    let mut tree = stage.first_tree.clone();
    let mut scratch = Scratch::new();
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    let options = RenderOptions::default();
    let (mut updates, mut pictures, mut swaps) = (Vec::new(), Vec::new(), 0);
    let (mut delay, mut bytes, mut build_time) = (0, 0, Duration::ZERO);
    let mut began = Instant::now();
    for step in 0..frames + WARM_UP {
        if interrupt::requested() {
            break;
        }
        if step == WARM_UP {
            began = Instant::now();
        }
        let frame = step.saturating_sub(WARM_UP);
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, setting.size);
        let light = view.light.map(|position| PointLight { position, color: [1.0; 3] });
        let start = Instant::now();
        let told = update(&mut tree, &stage.triangles(), strategy, &mut scratch)
            .with_context(|| format!("{}: {} failed", stage.scene.name, strategy.name()))?;
        let update_ms = ms(start);
        let start = Instant::now();
        cast(&tree, &stage.triangles(), &view.camera, light.as_ref(), &options, &mut pixels);
        if step >= WARM_UP {
            updates.push(update_ms);
            pictures.push(ms(start));
            if let (Decision::Swap, Some(cost)) = (told.decision, scratch.background_cost()) {
                swaps += 1;
                delay += cost.delay;
                bytes = bytes.max(cost.bytes);
                build_time += cost.build_time;
            }
        }
        progress.at(step as u64 + 1);
    }
    let played = began.elapsed();
    let longest = |times: &[f64]| {
        let mut sorted = times.to_vec();
        sorted.sort_by(f64::total_cmp);
        (median(&sorted), sorted.last().copied().unwrap_or_default())
    };
    let (update_median, update_longest) = longest(&updates);
    let (picture_median, _) = longest(&pictures);
    // What is seen differs from frame to frame and is nothing that a strategy does; its updates are.
    let frame_median = update_median + picture_median;
    let frame_longest = update_longest + picture_median;
    Ok(format!(
        "  {:<26} {frame_median:>10.3} {frame_longest:>10.3} {:>10.3} {:>12.3} {:>12.1} {:>10.1} {:>10.1} {:>10.2}\n",
        strategy.name(),
        frame_longest / frame_median,
        update_longest / update_median,
        updates.len() as f64 / f64::from(swaps.max(1)),
        f64::from(delay) / f64::from(swaps.max(1)),
        bytes as f64 / f64::from(1 << 20),
        build_time.as_secs_f64() / played.as_secs_f64(),
    ))
}
