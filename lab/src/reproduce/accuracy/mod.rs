//! What accuracy costs in time: for every knob that buys accuracy, its settings with their errors
//! and their times.
//!
//! A knob is a function that measures all of its settings, on a scene ([`OF_A_SCENE`]) or on input
//! of its own ([`ALONE`]). Errors are taken against something independent: a fresh sweep build,
//! `f64` arithmetic, topology, a simulation with a step many times finer, a closed form.

mod bench;
mod curves;
mod guards;
mod motion;
mod samples;
mod sentences;
mod trees;
mod triangle_tests;

use anyhow::Result;

use self::bench::{Bench, Log};
pub(crate) use self::bench::{Effort, Point};
pub(crate) use self::curves::{LEGEND, Section, sections};
pub(crate) use self::sentences::sentences;
use super::journal::Journal;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::Stage;

/// The knobs of a scene.
const OF_A_SCENE: [fn(&mut Bench<'_>) -> Result<()>; 5] =
    [trees::strategies, trees::builders, triangle_tests::in_frames, guards::measure, trees::height_bounds];

/// The knobs with input of their own. Their points name no scene.
const ALONE: [fn(&mut Log<'_>) -> Result<()>; 4] =
    [triangle_tests::on_a_wall, samples::measure, motion::steps, motion::key_frames];

/// Measures every knob of the scene on the stage. Ends early when interrupted.
pub(crate) fn of_scene(
    label: &str,
    stage: &mut Stage,
    effort: &Effort,
    journal: &mut Journal<Point>,
) -> Result<Vec<Point>> {
    let mut bench = Bench { stage, log: Log::new(label, effort, journal) };
    each(label, &OF_A_SCENE, |knob| knob(&mut bench))?;
    Ok(bench.log.points)
}

/// Measures every other knob. Ends early when interrupted.
pub(crate) fn alone(effort: &Effort, journal: &mut Journal<Point>) -> Result<Vec<Point>> {
    let mut log = Log::new("", effort, journal);
    each("", &ALONE, |knob| knob(&mut log))?;
    Ok(log.points)
}

fn each<K>(label: &str, knobs: &[K], mut measure: impl FnMut(&K) -> Result<()>) -> Result<()> {
    let progress = Progress::new(format!("{label} accuracy").trim_start(), knobs.len() as u64);
    for (knob, done) in knobs.iter().zip(1..).take_while(|_| !interrupt::requested()) {
        measure(knob)?;
        progress.at(done);
    }
    Ok(())
}
