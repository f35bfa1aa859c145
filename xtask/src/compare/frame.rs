//! Whole frames: an update and a picture, in measured frames of one loop at the scene's own pace.

use std::time::Instant;

use anyhow::Result;
use pivot_benches::{Answers, Contest};
use rt_cpu::Pixel;

use super::Setting;
use super::lane::{Frame, Lane, SetUp, spread, view};
use super::row::Row;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Stage, ms};

pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    setting.pool.install(|| measure_here(scene, stage, setting))
}

fn measure_here(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let progress = Progress::new(format!("frame, {scene}, {} threads", setting.threads), frames as u64);
    stage.pose(0.0);
    let mut lanes = Vec::new();
    for entry in setting.field(Contest::Frame) {
        let mut lane = Lane::new(entry, stage)?;
        lane.update(stage)?;
        lanes.push(lane);
    }
    let mut reference = Answers::default();
    let mut set_up = SetUp::default();
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    for frame in 1..frames {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, setting.size);
        let expected = measured.contains(&frame).then(|| Frame::new(stage, &view)).transpose()?;
        if let Some(expected) = &expected {
            expected.add_to(&mut reference);
            set_up.measure(stage, &view, expected, &mut pixels);
        }
        let count = lanes.len();
        for lane in (0..count).map(|i| (i + frame) % count) {
            let lane = &mut lanes[lane];
            let Some(expected) = &expected else {
                if lane.entry.keeps_tree {
                    lane.update(stage)?;
                }
                continue;
            };
            let update_ms = lane.update(stage)?;
            let start = Instant::now();
            lane.contestant.cast(&view, &mut pixels);
            lane.record.times_ms.push(update_ms + ms(start));
            lane.record.answers.add(&pixels, &expected.pixels);
            lane.add_cost(expected);
        }
        progress.at(frame as u64 + 1);
    }
    let rows = lanes.iter().map(|lane| lane.row("frame", scene, stage, setting.threads, &reference));
    Ok(rows.chain([set_up.row("frame", scene, stage, setting.threads, &reference)]).collect())
}
