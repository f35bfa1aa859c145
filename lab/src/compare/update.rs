//! Updates: one loop, played at the scene's own pace.
//!
//! Contestants that keep their tree see every frame; those that rebuild see only the measured ones.
//! What counts is the time from new positions to a tree that can be traced, with whatever that
//! library wants on the way, such as boxes of all triangles.

use anyhow::Result;
use pivot_benches::{Answers, Contest, LIMIT};

use super::Setting;
use super::lane::{CHECK_SIZE, Frame, Lane, spread, view};
use super::row::Row;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::Stage;

/// Updates of the first frame, to build trees and to grow memory to its final size.
const WARM_UP: usize = 2;

pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let progress = Progress::new(format!("update, {scene}, {} threads", setting.threads), frames as u64);
    stage.pose(0.0);
    let mut lanes = Vec::new();
    for entry in setting.field(Contest::Update) {
        let mut lane = Lane::new(entry, stage)?;
        for _ in 0..WARM_UP {
            lane.update(stage)?;
        }
        lanes.push(lane);
    }
    let mut reference = Answers::default();
    for frame in 1..frames {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let is_measured = measured.contains(&frame);
        let count = lanes.len();
        for lane in (0..count).map(|i| (i + frame) % count) {
            let lane = &mut lanes[lane];
            if is_measured || lane.entry.keeps_tree {
                let time = lane.update(stage)?;
                if is_measured {
                    lane.record.times_ms.push(time);
                }
            }
        }
        if is_measured {
            let view = view(stage, CHECK_SIZE);
            let expected = Frame::new(stage, &view)?;
            expected.add_to(&mut reference);
            lanes.iter_mut().for_each(|lane| lane.check(&expected, &view));
        }
        progress.at(frame as u64 + 1);
    }
    let mut rows: Vec<Row> =
        lanes.iter().map(|lane| lane.row("update", scene, stage, setting.threads, &reference)).collect();
    for row in rows.iter_mut().filter(|row| row.contestant == LIMIT) {
        // No tree, so no hits to compare.
        (row.what, row.agrees) = ("limit".to_owned(), true);
    }
    Ok(rows)
}
