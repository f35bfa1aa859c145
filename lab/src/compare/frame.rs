//! Whole frames: an update and a picture, in measured frames of a loop at the scene's own pace,
//! played once or more.

use std::time::Instant;

use anyhow::Result;
use pivot_benches::{Answers, Contest};
use rt_cpu::Pixel;

use super::Setting;
use super::lane::{Frame, Lane, SetUp, spread, view};
use super::row::{Row, median};
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Stage, ms};

pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    stage.pose(0.0);
    let mut lanes = Vec::new();
    for entry in setting.field(Contest::Frame) {
        lanes.push(Lane::new(entry, stage)?);
    }
    let (mut reference, mut set_up) = (Answers::default(), SetUp::default());
    for run in 1..=setting.runs {
        if run > 1 {
            stage.pose(0.0);
            for lane in &mut lanes {
                lane.contestant = lane.entry.make(&stage.triangles())?;
            }
        }
        if interrupt::requested() {
            break;
        }
        let name = format!("frame, {scene}, {} threads, run {run} of {}", setting.threads, setting.runs);
        let progress = Progress::new(name, frames as u64);
        play(&mut lanes, stage, setting, &measured, &progress, &mut reference, &mut set_up)?;
    }
    for record in lanes.iter_mut().map(|lane| &mut lane.record).chain([&mut set_up.record]) {
        for times in [&mut record.times_ms, &mut record.updates_ms] {
            *times = over_runs(times, measured.len());
        }
    }
    let rows = lanes.iter().map(|lane| lane.row("frame", scene, stage, setting.threads, &reference));
    Ok(rows.chain([set_up.row("frame", scene, stage, setting.threads, &reference)]).collect())
}

/// One loop, everyone from a tree of its first frame on: the work is the same in each run.
fn play(
    lanes: &mut [Lane],
    stage: &mut Stage,
    setting: &Setting,
    measured: &[usize],
    progress: &Progress,
    reference: &mut Answers,
    set_up: &mut SetUp,
) -> Result<()> {
    let frames = stage.scene.frames.max(2);
    for lane in lanes.iter_mut() {
        lane.update(stage)?;
    }
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    for frame in 1..frames {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, setting.size);
        let expected = measured.contains(&frame).then(|| Frame::new(stage, &view)).transpose()?;
        if let Some(expected) = &expected {
            expected.add_to(reference);
            set_up.measure(stage, &view, expected, &mut pixels);
        }
        let count = lanes.len();
        for lane in (0..count).map(|i| (i + frame) % count) {
            let lane = &mut lanes[lane];
            let Some(expected) = &expected else {
                if lane.entry.keeps_tree {
                    lane.update(stage)?;
                }
                if lane.contestant.learns() {
                    lane.contestant.cast(&view, &mut pixels);
                }
                continue;
            };
            let update_ms = lane.update(stage)?;
            let start = Instant::now();
            lane.contestant.cast(&view, &mut pixels);
            lane.record.times_ms.push(update_ms + ms(start));
            lane.record.updates_ms.push(update_ms);
            lane.record.answers.add(&pixels, &expected.pixels);
            lane.add_cost(expected);
        }
        progress.at(frame as u64 + 1);
    }
    Ok(())
}

/// The median of each frame over the runs, the last of which an interrupt may have cut off.
fn over_runs(times: &[f64], frames: usize) -> Vec<f64> {
    let over_runs = |frame: usize| {
        let mut runs: Vec<f64> = times.iter().skip(frame).step_by(frames).copied().collect();
        runs.sort_by(f64::total_cmp);
        median(&runs)
    };
    (0..frames.min(times.len())).map(over_runs).collect()
}

#[cfg(test)]
mod tests {
    use super::over_runs;

    #[test]
    fn a_frame_counts_by_its_median_over_the_runs() {
        let times = [1.0, 9.0, 3.0, 2.0, 4.0, 5.0, 90.0, 5.0];
        assert_eq!(over_runs(&times, 3), [2.0, 5.0, 4.0]);
        assert_eq!(over_runs(&times[..2], 3), [1.0, 9.0]);
        assert!(over_runs(&[], 3).is_empty());
    }
}
