//! What accuracy costs in time: for every knob that buys accuracy, its settings with their errors
//! and their times.
//!
//! A knob is a function that measures all of its settings on one scene, one of [`KNOBS`]; its
//! points make a curve per error, which becomes a panel of the figures and a sentence of the
//! report. Errors are taken against something independent and finer: a fresh sweep build, `f64`
//! arithmetic, topology, a simulation with many more key frames, an image with many more samples of
//! another seed.

mod advice;
mod bench;
mod curve;
mod effort;
mod motion;
mod point;
mod samples;
mod section;
mod trees;
mod triangle_tests;

use anyhow::Result;

use self::bench::Bench;
pub(crate) use self::effort::Effort;
pub(crate) use self::point::Point;
pub(crate) use self::section::{charts, sentences};
use super::journal::Journal;
use crate::interrupt;
use crate::stage::Stage;

/// Every knob, in the order of the report.
const KNOBS: [fn(&mut Bench<'_>) -> Result<()>; 6] = [
    trees::strategies,
    trees::builders,
    triangle_tests::measure,
    motion::substeps,
    motion::key_frames,
    samples::measure,
];

/// Measures every knob that `source`, the scene on the stage, has. Ends early when interrupted.
pub(crate) fn measure(
    label: &str,
    source: &str,
    stage: &mut Stage,
    effort: &Effort,
    journal: &mut Journal<Point>,
) -> Result<Vec<Point>> {
    let mut bench = Bench::new(label, source, stage, effort, journal, KNOBS.len());
    for knob in KNOBS {
        if interrupt::requested() {
            break;
        }
        knob(&mut bench)?;
        bench.next_knob();
    }
    Ok(bench.points)
}
