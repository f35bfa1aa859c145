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
use serde::{Deserialize, Serialize};

use self::bench::Bench;
pub(crate) use self::bench::Log;
pub(crate) use self::curves::{LEGEND, Section, sections};
pub(crate) use self::sentences::sentences;
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
pub(crate) fn of_scene(stage: &mut Stage, log: Log<'_>) -> Result<Vec<Point>> {
    let (label, mut bench) = (log.label, Bench { stage, log });
    each(label, &OF_A_SCENE, |knob| knob(&mut bench))?;
    Ok(bench.log.points)
}

/// Measures every other knob. Ends early when interrupted.
pub(crate) fn alone(mut log: Log<'_>) -> Result<Vec<Point>> {
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

/// One error of one setting. The names and the order of the columns are relied on by scripts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Point {
    /// Empty for knobs with input of their own.
    pub(crate) scene: String,
    /// The knob, and after "at" the condition, where there are several.
    pub(crate) knob: String,
    pub(crate) setting: String,
    pub(crate) is_default: bool,
    pub(crate) error_name: String,
    pub(crate) error: f64,
    pub(crate) unit: String,
    pub(crate) time_ms: f64,
    /// What was timed, and what else there is to say.
    pub(crate) note: String,
    /// Memory that the setting takes, where that is what it costs.
    pub(crate) bytes: Option<u64>,
    /// The factor within which errors are equal, where they are times: by so much the reference
    /// differs from itself.
    pub(crate) noise: Option<f64>,
}

impl Point {
    /// A setting of a knob and its time, without an error yet.
    fn new(knob: &str, setting: &str, is_default: bool, time_ms: f64) -> Self {
        let (knob, setting) = (knob.to_owned(), setting.to_owned());
        Self { knob, setting, is_default, time_ms, ..Self::default() }
    }

    /// The same setting with this error.
    fn with(&self, error_name: &str, error: f64, unit: &str) -> Self {
        Self { error_name: error_name.to_owned(), error, unit: unit.to_owned(), ..self.clone() }
    }
}
