//! The measurements that contestants are compared by.
//!
//! Of updates and builds it is the time from new positions to a tree that can be traced, with
//! whatever that library wants on the way, such as boxes of all triangles. Of rays it is the time
//! through trees that are fresh in each measured frame. Of whole frames it is an update and a
//! picture, at the scene's own pace.

use anyhow::Result;
use pivot_benches::{Answers, Contest, Contestant, Hits, LIMIT, Rays, bounces, set_up_rays};
use rayon::prelude::*;
use rt_cpu::{Bvh8, Pixel, TriangleTest, closest_hit};

use super::lane::{CHECK_SIZE, Frame, Record, in_rounds, lanes, play, rows, spread, turns, view};
use super::row::Row;
use super::{Setting, is_named};
use crate::interrupt;
use crate::reproduce::median;
use crate::stage::{Stage, timed};

/// Updates of the first frame, to build trees and to grow memory to its final size.
const WARM_UP: usize = 2;

/// Updates, and builds from nothing: the time from new positions to a tree that can be traced, with
/// whatever that library wants on the way, such as boxes of all triangles.
///
/// Contestants that keep their tree see every frame; those that rebuild see only the measured ones.
/// Builds get new contestants in every measured frame, with no memory from the frame before.
pub(super) fn updates(contest: Contest, stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
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
            // The limit has no tree, so no hits to compare.
            for lane in lanes.iter_mut().filter(|lane| lane.entry.name != LIMIT) {
                let mut pixels = vec![Pixel::default(); expected.pixels.len()];
                lane.contestant.cast(&expected.view, &mut pixels);
                lane.record.answers.add(&pixels, &expected.pixels);
                lane.add_cost(&expected);
            }
        }
        Ok(())
    })?;
    let mut rows = rows(what, &lanes, setting, &reference);
    for row in rows.iter_mut().filter(|row| row.contestant == LIMIT) {
        (row.what, row.agrees) = ("limit".to_owned(), true);
    }
    Ok(rows)
}

/// Times that everyone traces the rays of a frame, primary ones and bounces; the median counts.
const ROUNDS: usize = 3;
const BOUNCE_ROUNDS: usize = 5;

/// Name of the row with the time of making rays where shadow rays are made from corners: what
/// contestants that return no normals spend outside of the library, their user's part.
const SET_UP: &str = "ray set-up";

/// Milliseconds of the median of `N` runs.
fn median_of<const N: usize>(mut run: impl FnMut()) -> f64 {
    median([(); N].map(|()| timed(&mut run).1))
}

/// Makes the rays of a view, and records the time.
fn set_up(record: &mut Record, stage: &Stage, expected: &Frame, pixels: &mut [Pixel]) {
    let time = median_of::<3>(|| set_up_rays(&stage.triangles(), &expected.view, &expected.pixels, pixels));
    record.times_ms.push(time);
    record.answers.add(pixels, &expected.pixels);
}

/// Rows with the rays a second; as many `rays` were cast in each frame measured, on average.
fn with_rates(rows: Vec<Row>, rays: u64) -> impl Iterator<Item = Row> {
    rows.into_iter().map(move |row| {
        let rays_a_frame = rays as f64 / row.frames.max(1) as f64;
        Row { million_rays_per_s: Some(rays_a_frame / (row.median_ms * 1e3)), ..row }
    })
}

/// Primary rays, and shadow rays towards the point light, through trees that are fresh in each
/// measured frame.
pub(super) fn primary(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let mut lanes = lanes(Contest::Trace, stage, setting)?;
    let (mut reference, mut making, mut rays) = (Answers::default(), Record::default(), 0);
    let mut pixels = vec![Pixel::default(); setting.size as usize * setting.size as usize];
    play("trace", stage, setting, false, |stage, turn, _| {
        let expected = Frame::new(stage, view(stage, setting.size))?;
        reference.add(&expected.pixels, &expected.pixels);
        rays += expected.stats.rays_primary + expected.stats.rays_shadow;
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&expected);
        }
        set_up(&mut making, stage, &expected, &mut pixels);
        let cast = |contestant: &dyn Contestant, pixels: &mut Vec<Pixel>| {
            contestant.cast(&expected.view, pixels);
        };
        in_rounds((ROUNDS, turn), &mut lanes, &mut pixels, &expected.pixels, cast, Vec::clone);
        Ok(())
    })?;
    let rows = rows("trace", &lanes, setting, &reference);
    let making = making.row("trace", SET_UP, setting, &reference);
    Ok(with_rates(rows, rays).chain([making]).collect())
}

/// Rays that have little in common, through fresh trees: one diffuse bounce from what primary rays
/// hit, the same rays for everyone. The time that the wide view takes to make, and those of the
/// rays.
pub(super) fn incoherent(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let mut lanes = lanes(Contest::Incoherent, stage, setting)?;
    let (mut wide, mut making) = (Bvh8::default(), Record::default());
    let (mut reference, mut count) = (Answers::default(), 0);
    play("incoherent", stage, setting, false, |stage, turn, _| {
        let (seen, triangles) = (Frame::new(stage, view(stage, setting.size))?, stage.triangles());
        let time = median_of::<BOUNCE_ROUNDS>(|| wide.update(&seen.tree, &triangles));
        making.times_ms.push(time);
        let groups = bounces(&seen.view.camera, &triangles, &seen.pixels, turn as u64);
        count += groups.iter().map(Rays::len).sum::<usize>() as u64;
        let mut found: Vec<Hits> = groups.iter().map(|_| Hits::default()).collect();
        // Ray by ray through the tree itself: what everyone is to find.
        groups.par_iter().zip(&mut found).for_each(|(rays, hits)| {
            for i in 0..rays.len() {
                let (ray, test) = (rays.ray(i), TriangleTest::default());
                hits.set(i, closest_hit(&seen.tree, &triangles, &ray, rays.t_max[i], test));
            }
        });
        let expected = answers(&groups, &found);
        reference.add(&expected, &expected);
        for lane in &mut lanes {
            lane.update(stage)?;
            lane.add_cost(&seen);
        }
        let cast = |contestant: &dyn Contestant, found: &mut Vec<Hits>| {
            groups.par_iter().zip(found).for_each(|(rays, hits)| contestant.closest(rays, hits));
        };
        let turn = (BOUNCE_ROUNDS, turn);
        in_rounds(turn, &mut lanes, &mut found, &expected, cast, |found| answers(&groups, found));
        Ok(())
    })?;
    let making = making.row("view", "pivot wide", setting, &Answers::default());
    let making = Some(making).filter(|row| is_named(&setting.only, &row.contestant));
    let rows = rows("incoherent", &lanes, setting, &reference);
    Ok(making.into_iter().chain(with_rates(rows, count)).collect())
}

/// What the rays hit, in the form that views are compared in.
fn answers(groups: &[Rays], found: &[Hits]) -> Vec<Pixel> {
    let of = |(rays, hits): (&Rays, &Hits)| {
        (0..rays.len()).map(|i| Pixel::new(hits.get(i), false)).collect::<Vec<_>>()
    };
    groups.iter().zip(found).flat_map(of).collect()
}

/// Whole frames: an update and a picture, in measured frames of a loop at the scene's own pace,
/// played once or more.
///
/// Plays loops, everyone from a tree of its first frame on: the work is the same in each run.
pub(super) fn frames(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
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
