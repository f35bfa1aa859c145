//! Tracing: primary rays and shadow rays towards the point light, through trees fresh in each
//! measured frame.

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

/// Pictures a frame and contestant; their median counts.
const ROUNDS: usize = 3;

pub(super) fn measure(scene: &str, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let progress =
        Progress::new(format!("trace, {scene}, {} threads", setting.threads), measured.len() as u64);
    let entries = setting.field(Contest::Trace);
    let mut lanes = entries.into_iter().map(|entry| Lane::new(entry, stage)).collect::<Result<Vec<_>>>()?;
    let mut reference = Answers::default();
    let mut set_up = SetUp::default();
    let (mut rays, mut done) = (0, 0);
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    for (step, &frame) in measured.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, frames));
        let view = view(stage, setting.size);
        let expected = Frame::new(stage, &view)?;
        expected.add_to(&mut reference);
        rays += expected.stats.rays_primary + expected.stats.rays_shadow;
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&expected);
        }
        set_up.measure(stage, &view, &expected, &mut pixels);
        done += 1;
        let mut times = vec![Vec::new(); lanes.len()];
        for round in 0..ROUNDS {
            let count = lanes.len();
            for i in (0..count).map(|i| (i + round + step) % count) {
                let start = Instant::now();
                lanes[i].contestant.cast(&view, &mut pixels);
                times[i].push(ms(start));
                if round == 0 {
                    lanes[i].record.answers.add(&pixels, &expected.pixels);
                }
            }
        }
        for (lane, mut times) in lanes.iter_mut().zip(times) {
            times.sort_by(f64::total_cmp);
            lane.record.times_ms.push(median(&times));
        }
        progress.at(step as u64 + 1);
    }
    let rays_a_frame = rays as f64 / f64::from(done.max(1));
    let with_rate = |row: Row| Row { million_rays_per_s: Some(rays_a_frame / (row.median_ms * 1e3)), ..row };
    let rows = lanes.iter().map(|lane| lane.row("trace", scene, stage, setting.threads, &reference));
    let set_up = set_up.row("trace", scene, stage, setting.threads, &reference);
    Ok(rows.map(with_rate).chain([set_up]).collect())
}
