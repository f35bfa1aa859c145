//! Whole frames: an update and a picture, in measured frames of a loop at the scene's own pace,
//! played once or more.

use anyhow::Result;
use pivot_benches::{Answers, Contest};
use rt_cpu::Pixel;

use super::Setting;
use super::lane::{Frame, lanes, play, rows, spread, turns, view};
use super::row::{Record, Row};
use super::trace::{SET_UP, set_up};
use crate::interrupt;
use crate::reproduce::median;
use crate::stage::{Stage, timed};

/// Plays loops, everyone from a tree of its first frame on: the work is the same in each run.
pub(super) fn measure(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    stage.pose(0.0);
    let mut lanes = lanes(Contest::Frame, stage, setting)?;
    let (mut reference, mut making) = (Answers::default(), Record::default());
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    for run in (1..=setting.runs).take_while(|_| !interrupt::requested()) {
        stage.pose(0.0);
        for lane in &mut lanes {
            lane.restart(stage)?;
            lane.update(stage)?;
        }
        let name = format!("frame, run {run} of {}", setting.runs);
        play(&name, stage, setting, true, |stage, turn, is_measured| {
            let view = view(stage, setting.size);
            let expected = is_measured.then(|| Frame::new(stage, view)).transpose()?;
            if let Some(expected) = &expected {
                reference.add(&expected.pixels, &expected.pixels);
                set_up(&mut making, stage, expected, &mut pixels);
            }
            for i in turns(lanes.len(), turn) {
                let lane = &mut lanes[i];
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
                let ((), trace_ms) = timed(|| lane.contestant.cast(&view, &mut pixels));
                lane.record.times_ms.push(update_ms + trace_ms);
                lane.record.updates_ms.push(update_ms);
                lane.record.answers.add(&pixels, &expected.pixels);
                lane.add_cost(expected);
            }
            Ok(())
        })?;
    }
    let frames = spread(stage.scene.frames.max(2), setting.frames).len();
    for record in lanes.iter_mut().map(|lane| &mut lane.record).chain([&mut making]) {
        for times in [&mut record.times_ms, &mut record.updates_ms] {
            *times = over_runs(times, frames);
        }
    }
    let mut rows = rows("frame", &lanes, setting, &reference);
    rows.push(making.row("frame", SET_UP, setting, &reference));
    Ok(rows)
}

/// The median of each frame over the runs, the last of which an interrupt may have cut off.
fn over_runs(times: &[f64], frames: usize) -> Vec<f64> {
    let over_runs = |frame: usize| median(times.iter().skip(frame).step_by(frames).copied());
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
