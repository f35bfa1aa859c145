//! What accuracy costs in time: for every knob that buys accuracy, its settings with their errors
//! and their times.
//!
//! A knob is a function that measures all of its settings, on a scene ([`OF_A_SCENE`]) or on input
//! of its own ([`ALONE`]). Errors are taken against something independent: a fresh sweep build,
//! `f64` arithmetic, topology, a simulation with a step many times finer, a closed form.
//!
//! This file has what knobs are measured with: how much to do, points and where they go, a scene.

mod curves;
mod guards;
mod motion;
mod samples;
mod sentences;
mod trees;
mod triangle_tests;

use std::iter::once;

use anyhow::Result;
use bvh_core::{Bvh, Triangles, sah_cost};
use rt_cpu::{Pixel, RenderOptions, cast};
use serde::{Deserialize, Serialize};

pub(crate) use self::curves::{LEGEND, Section, sections};
pub(crate) use self::sentences::sentences;
use super::journal::Journal;
use super::preset::{MANY, Preset, Values};
use super::record::rounded;
use super::{Spread, median};
use crate::compare::turns;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Renderer, Stage, timed};

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

/// How much is measured of each knob, by preset. What one knob alone has stands with that knob.
#[derive(Clone, Debug)]
pub(crate) struct Effort {
    preset: Preset,
    /// Frames in a loop, over which strategies update their trees.
    frames: usize,
    /// Whether the scene is so large that a fifth of the loop is played, and nothing annealed.
    is_cut: bool,
    /// Pixels on a side of the images that are timed.
    size: u32,
    /// Runs of which the fastest counts, where one run is short.
    repeats: usize,
    /// Rounds in which contestants take turns.
    rounds: usize,
    seed: u64,
}

impl Effort {
    /// For a scene of `triangles` triangles.
    pub(crate) fn new(preset: Preset, values: &Values, triangles: usize, seed: u64) -> Self {
        let Values { frames, size, .. } = *values;
        let is_cut = preset != Preset::Full && triangles > MANY;
        let size = size.min(preset.pick([512, 512, size]));
        let (repeats, rounds) = (preset.pick([1, 3, 5]), preset.pick([3, 7, 9]));
        Self { preset, frames, is_cut, size, repeats, rounds, seed }
    }

    /// What belongs to the preset, of three.
    fn pick<T>(&self, of: [T; 3]) -> T {
        self.preset.pick(of)
    }
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

/// Where points go, and how much is to be measured.
struct Log<'a> {
    /// The scene's name in tables; empty if there is none.
    label: &'a str,
    effort: &'a Effort,
    journal: &'a mut Journal<Point>,
    points: Vec<Point>,
}

impl<'a> Log<'a> {
    fn new(label: &'a str, effort: &'a Effort, journal: &'a mut Journal<Point>) -> Self {
        Self { label, effort, journal, points: Vec::new() }
    }

    /// Takes what was measured; it is in the file when this returns. After an interrupt nothing is
    /// taken: it may be of fewer rounds or frames than the rest.
    fn add(&mut self, point: Point) -> Result<()> {
        if interrupt::requested() {
            return Ok(());
        }
        let point = Point { scene: self.label.to_owned(), time_ms: rounded(point.time_ms), ..point };
        self.journal.append(std::slice::from_ref(&point))?;
        self.points.push(point);
        Ok(())
    }

    /// Takes a tree with its errors over a fresh one: SAH cost, which has no noise, and trace time.
    fn add_tree(&mut self, point: &Point, [cost, trace_ms]: [f64; 2], noise: f64) -> Result<()> {
        self.add(point.with("SAH cost over a fresh sweep build", cost, "ratio"))?;
        self.add(Point { noise: Some(noise), ..point.with("trace time", trace_ms, "ms") })
    }
}

/// A scene under measurement.
struct Bench<'a> {
    stage: &'a mut Stage,
    log: Log<'a>,
}

impl Bench<'_> {
    /// Whether anything moves.
    fn moves(&self) -> bool {
        self.stage.scene.animation.topology().moves.contains(&true)
    }

    /// Moves the scene to the middle of its loop, where it has moved far from where it began.
    fn pose_in_the_middle(&mut self) {
        self.stage.pose(0.5 * self.stage.scene.animation.duration());
    }

    /// Rendering as the paper times it: with what the scene calls for, flat.
    fn flat(&self) -> RenderOptions {
        RenderOptions { smooth: false, ..self.stage.render_options() }
    }

    /// Renders a frame and gives the time.
    fn trace(&self, tree: &Bvh, options: &RenderOptions) -> f64 {
        Renderer::new(*options, self.log.effort.size).draw(self.stage, tree).1
    }

    /// What the scene's camera sees of triangles, and where its light arrives.
    fn see(&self, tree: &Bvh, triangles: &Triangles<'_>, options: &RenderOptions) -> Vec<Pixel> {
        let (stage, size) = (&*self.stage, self.log.effort.size);
        let mut pixels = vec![Pixel::default(); (size * size) as usize];
        cast(tree, triangles, &stage.camera(size, size), Some(&stage.light()), options, &mut pixels);
        pixels
    }

    /// SAH cost over that of a fresh tree, `sweep`, and trace time, of trees; and the trace times of
    /// the fresh tree in each of its turns. Nothing after an interrupt.
    ///
    /// Trees are traced in turns, and the fresh one several times a round: its times beside one
    /// another show the noise.
    fn over(&self, sweep: &Bvh, trees: &[&Bvh]) -> Option<(Vec<[f64; 2]>, Vec<f64>)> {
        let part = trees.len().div_ceil(FRESH).max(1);
        // Nothing stands for the fresh one.
        let parts = trees.chunks(part).flat_map(|part| once(None).chain(part.iter().copied().map(Some)));
        let turns: Vec<Option<&Bvh>> = parts.chain([None]).collect();
        // Short frames are disturbed the most, and more rounds of them cost little.
        let more = (SHORT / self.trace(sweep, &self.flat())).clamp(1.0, 6.0);
        let times = in_turns(self.log.effort.rounds * more as usize, turns.len(), |turn| {
            Ok(self.trace(turns[turn].unwrap_or(sweep), &self.flat()))
        });
        let (mut errors, mut selves) = (Vec::new(), Vec::new());
        for (turn, time_ms) in turns.into_iter().zip(times.ok()?) {
            match turn {
                Some(tree) => errors.push([sah_cost(tree) / sah_cost(sweep), time_ms]),
                None => selves.push(time_ms),
            }
        }
        (!interrupt::requested()).then_some((errors, selves))
    }
}

/// Turns of the fresh tree in a round, beside one at its end.
const FRESH: usize = 2;

/// The factor by which times differ that should all be one, to the digits that say something.
fn noise(selves: &[f64]) -> f64 {
    let factor = Spread::of(selves.iter().copied()).map_or(1.0, |times| times.max / times.min);
    (factor * 1e3).round() / 1e3
}

/// Numbers in a million.
fn in_a_million(count: usize, of: usize) -> f64 {
    1e6 * count as f64 / of.max(1) as f64
}

/// How many pixels in a million see another triangle, or are lit otherwise.
fn differing(a: &[Pixel], b: &[Pixel]) -> f64 {
    let seen = |pixel: &Pixel| (pixel.hit().map(|hit| hit.primitive), pixel.is_lit());
    in_a_million(a.iter().zip(b).filter(|(a, b)| seen(a) != seen(b)).count(), a.len())
}

/// Milliseconds of a frame below which more rounds are measured.
const SHORT: f64 = 20.0;

/// Milliseconds that are measured well enough in one go.
const LONG: f64 = 300.0;

/// Milliseconds of the fastest of `runs` runs; of fewer, if they are long.
fn fastest(runs: usize, mut run: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..runs.max(1) {
        least = least.min(timed(&mut run).1);
        if least > LONG {
            break;
        }
    }
    least
}

/// The milliseconds of each of `count` contestants that take turns for `rounds` rounds, another
/// first each time; `run` does a turn and gives its milliseconds. Ends early when interrupted.
///
/// A contestant's time is its median share of a round, times the shortest round: what else the
/// machine does slows all turns of a round alike.
fn in_turns(rounds: usize, count: usize, mut run: impl FnMut(usize) -> Result<f64>) -> Result<Vec<f64>> {
    let (mut shares, mut shortest) = (vec![Vec::new(); count], f64::INFINITY);
    for round in (0..rounds.max(1)).take_while(|&round| round == 0 || !interrupt::requested()) {
        let mut times = vec![0.0; count];
        for i in turns(count, round) {
            times[i] = run(i)?;
        }
        let whole: f64 = times.iter().sum();
        shortest = shortest.min(whole);
        shares.iter_mut().zip(times).for_each(|(shares, time)| shares.push(time / whole));
    }
    Ok(shares.into_iter().map(|shares| median(shares) * shortest).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_how_far_apart_equal_trees_are() {
        assert_eq!(noise(&[]), 1.0);
        assert_eq!(noise(&[1.0, 1.5]), 1.5);
        assert_eq!(noise(&[0.5, 1.25, 0.75]), 2.5);
    }

    #[test]
    fn contestants_take_turns_and_slow_rounds_count_for_little() {
        let mut order = Vec::new();
        let times = in_turns(3, 2, |turn| {
            order.push(turn);
            // The second round takes nine times as long.
            Ok([1.0, 3.0][turn] * if (3..=4).contains(&order.len()) { 9.0 } else { 1.0 })
        });
        assert_eq!((order, times.unwrap()), (vec![0, 1, 1, 0, 0, 1], vec![1.0, 3.0]));
    }
}
