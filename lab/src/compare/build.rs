//! Builds from nothing: every measured frame gets new contestants, with no memory from the frame
//! before.

use anyhow::Result;
use pivot_benches::{Answers, Contest};

use super::Setting;
use super::lane::{CHECK_SIZE, Frame, Lane, spread, view};
use super::row::{Record, Row};
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::Stage;

pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let progress =
        Progress::new(format!("build, {scene}, {} threads", setting.threads), measured.len() as u64);
    let contestants = || setting.field(Contest::Build);
    let names: Vec<String> = contestants().into_iter().map(|entry| entry.name).collect();
    let mut records = vec![Record::default(); names.len()];
    let mut reference = Answers::default();
    for (step, &frame) in measured.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, CHECK_SIZE);
        let expected = Frame::new(stage, &view)?;
        expected.add_to(&mut reference);
        let mut entries: Vec<_> = contestants().into_iter().zip(&mut records).collect();
        let turn = step % entries.len();
        entries.rotate_left(turn);
        for (entry, record) in entries {
            let mut lane = Lane::new(entry, stage)?;
            lane.record = std::mem::take(record);
            let time = lane.update(stage)?;
            lane.record.times_ms.push(time);
            lane.check(&expected, &view);
            *record = lane.record;
        }
        progress.at(step as u64 + 1);
    }
    let triangles = stage.triangles().indices.len();
    let row = |(name, record): (&String, &Record)| {
        record.row("build", scene, triangles, name, setting.threads, &reference)
    };
    Ok(names.iter().zip(&records).map(row).collect())
}
