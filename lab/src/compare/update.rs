//! Updates, and builds from nothing: the time from new positions to a tree that can be traced, with
//! whatever that library wants on the way, such as boxes of all triangles.

use anyhow::Result;
use pivot_benches::{Answers, Contest, LIMIT};

use super::Setting;
use super::lane::{CHECK_SIZE, Frame, lanes, play, rows, turns, view};
use super::row::Row;
use crate::stage::Stage;

/// Updates of the first frame, to build trees and to grow memory to its final size.
const WARM_UP: usize = 2;

/// Contestants that keep their tree see every frame; those that rebuild see only the measured ones.
/// Builds get new contestants in every measured frame, with no memory from the frame before.
pub(super) fn measure(contest: Contest, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let builds = contest == Contest::Build;
    let what = if builds { "build" } else { "update" };
    stage.pose(0.0);
    let mut lanes = lanes(contest, stage, setting)?;
    for lane in lanes.iter_mut().filter(|_| !builds) {
        for _ in 0..WARM_UP {
            lane.update(stage)?;
        }
    }
    let mut reference = Answers::default();
    play(what, stage, setting, !builds, |stage, turn, is_measured| {
        for i in turns(lanes.len(), turn) {
            let lane = &mut lanes[i];
            if builds {
                lane.restart(stage)?;
            }
            if is_measured || lane.entry.keeps_tree {
                let time = lane.update(stage)?;
                lane.record.times_ms.extend(is_measured.then_some(time));
            }
        }
        if is_measured {
            let expected = Frame::new(stage, view(stage, CHECK_SIZE))?;
            reference.add(&expected.pixels, &expected.pixels);
            lanes.iter_mut().for_each(|lane| lane.check(&expected));
        }
        Ok(())
    })?;
    let mut rows = rows(what, &lanes, setting, &reference);
    for row in rows.iter_mut().filter(|row| row.contestant == LIMIT) {
        // No tree, so no hits to compare.
        (row.what, row.agrees) = ("limit".to_owned(), true);
    }
    Ok(rows)
}
