//! What every knob is measured with: the scene, how much to do, and where points go.

use std::iter::once;
use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::{Bvh, sah_cost};
use rt_cpu::{Image, RenderOptions, render};

use super::effort::Effort;
use super::point::Point;
use crate::interrupt;
use crate::progress::Progress;
use crate::reproduce::journal::Journal;
use crate::reproduce::results::Spread;
use crate::stage::{Stage, ms};

/// A scene under measurement.
pub(super) struct Bench<'a> {
    /// The scene's name in tables.
    label: &'a str,
    /// What it was loaded by.
    pub(super) source: &'a str,
    pub(super) stage: &'a mut Stage,
    pub(super) effort: &'a Effort,
    journal: &'a mut Journal<Point>,
    progress: Progress,
    knob: u64,
    pub(super) points: Vec<Point>,
}

/// Steps of the progress of each knob.
const STEPS: f64 = 100.0;

impl<'a> Bench<'a> {
    pub(super) fn new(
        label: &'a str,
        source: &'a str,
        stage: &'a mut Stage,
        effort: &'a Effort,
        journal: &'a mut Journal<Point>,
        knobs: usize,
    ) -> Self {
        let progress = Progress::new(format!("{label}, accuracy"), (knobs as f64 * STEPS) as u64);
        Self { label, source, stage, effort, journal, progress, knob: 0, points: Vec::new() }
    }

    /// Takes what was measured; it is in the file when this returns.
    pub(super) fn add(&mut self, point: Point) -> Result<()> {
        // To a tenth of a microsecond.
        let time_ms = (point.time_ms * 1e4).round() / 1e4;
        let point = Point { scene: self.label.to_owned(), time_ms, ..point };
        self.journal.append(std::slice::from_ref(&point))?;
        self.points.push(point);
        Ok(())
    }

    /// Shows how much of the current knob is done.
    pub(super) fn done(&self, steps: usize, of: usize) {
        self.progress.at(self.knob * STEPS as u64 + (STEPS * steps as f64 / of.max(1) as f64) as u64);
    }

    pub(super) fn next_knob(&mut self) {
        self.knob += 1;
        self.done(0, 1);
    }

    /// Moves the scene to the middle of its loop, where it has moved far from where it began.
    pub(super) fn pose_in_the_middle(&mut self) {
        self.stage.pose(0.5 * self.stage.scene.animation.duration());
    }

    /// Rendering as the paper times it: with what the scene calls for, flat.
    pub(super) fn flat(&self) -> RenderOptions {
        RenderOptions { smooth: false, ..self.stage.render_options() }
    }

    /// Renders a frame `times` times: the image, and the time of the fastest, which is what least
    /// of the machine's other work got into.
    pub(super) fn trace(&self, tree: &Bvh, options: &RenderOptions, size: u32, times: usize) -> (Image, f64) {
        let stage = &*self.stage;
        let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
        let mut image = Image::new(size, size);
        let time = fastest(times, || {
            render(tree, &mesh, &camera, Some(&light), options, &mut image);
        });
        (image, time)
    }

    /// A fresh tree by the sweep builder over the current pose.
    pub(super) fn sweep(&self) -> Result<Bvh> {
        build(&self.stage.triangles(), Builder::Sweep).with_context(|| format!("{}: no tree", self.label))
    }

    /// SAH cost and trace time of trees over those of a fresh one, `sweep`; nothing after an
    /// interrupt.
    ///
    /// Trees are traced in rounds, the fresh one several times among them. A ratio is the median
    /// over rounds of a time over the median of the fresh tree's in the same round, so that what
    /// else the machine does hits both alike, and one outlier nothing. The fresh tree's turns over
    /// one another show the noise.
    pub(super) fn over(&self, sweep: &Bvh, trees: &[&Bvh]) -> Option<Over> {
        let part = trees.len().div_ceil(FRESH).max(1);
        // Nothing stands for the fresh one.
        let parts = trees.chunks(part).flat_map(|part| once(None).chain(part.iter().copied().map(Some)));
        let turns: Vec<Option<&Bvh>> = parts.chain([None]).collect();
        let mut ratios = vec![Vec::new(); turns.len()];
        for round in 0..self.effort.rounds {
            if interrupt::requested() {
                return None;
            }
            let mut times = vec![0.0; turns.len()];
            // From another one on each time: who comes first may find the machine otherwise.
            for turn in (0..turns.len()).map(|i| (i + round) % turns.len()) {
                times[turn] = self.trace(turns[turn].unwrap_or(sweep), &self.flat(), self.effort.size, 1).1;
            }
            for (turn, ratios) in ratios.iter_mut().enumerate() {
                let fresh = (0..turns.len()).filter(|&other| turns[other].is_none() && other != turn);
                ratios.push(times[turn] / median(fresh.map(|other| times[other]).collect()));
            }
        }
        let mut over = Over { errors: Vec::new(), selves: Vec::new() };
        for (turn, ratios) in turns.into_iter().zip(ratios) {
            let ratio = median(ratios);
            match turn {
                Some(tree) => over.errors.push([sah_cost(tree) / sah_cost(sweep), ratio]),
                None => over.selves.push(ratio),
            }
        }
        Some(over)
    }
}

/// Turns of the fresh tree in a round, beside one at its end.
const FRESH: usize = 2;

/// Trees beside a fresh one.
pub(super) struct Over {
    /// Ratios of SAH cost and of trace time, of each tree.
    pub(super) errors: Vec<[f64; 2]>,
    /// Ratios of the fresh tree's trace times to one another, a number for each of its turns.
    pub(super) selves: Vec<f64>,
}

/// The factor by which ratios differ that should all be 1.
pub(super) fn noise(selves: &[f64]) -> f64 {
    let least = selves.iter().copied().fold(1.0, f64::min);
    selves.iter().copied().fold(1.0, f64::max) / least
}

/// The median; NaN of nothing.
fn median(values: Vec<f64>) -> f64 {
    Spread::of(values).map_or(f64::NAN, |spread| spread.median)
}

/// Milliseconds that are measured well enough in one go.
const LONG: f64 = 300.0;

/// Milliseconds of the fastest of `runs` runs; of fewer, if they are long.
pub(super) fn fastest(runs: usize, mut run: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..runs.max(1) {
        let start = Instant::now();
        run();
        least = least.min(ms(start));
        if least > LONG {
            break;
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_how_far_apart_equal_trees_are() {
        assert_eq!(noise(&[]), 1.0);
        assert_eq!(noise(&[1.25, 1.5]), 1.5);
        assert_eq!(noise(&[0.5, 1.25, 0.75]), 2.5);
        // One outlier among the rounds is none of the median's.
        assert_eq!(median(vec![1.0, 9.0, 1.0, 1.5, 1.0]), 1.0);
        assert!(median(Vec::new()).is_nan());
    }
}
