//! What every knob is measured with: the scene, how much to do, and where points go.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Bvh, sah_cost};
use rt_cpu::{Image, RenderOptions, render};

use super::effort::Effort;
use super::point::Point;
use crate::progress::Progress;
use crate::reproduce::journal::Journal;
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

    /// Renders a frame so many times: the image, and the time of the fastest, which is what least of the machine's other
    /// work got into.
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
        build(&self.stage.triangles(), Builder::Sweep, &BuildOptions::default(), None)
            .with_context(|| format!("{}: no tree", self.label))
    }

    /// SAH cost and trace time of a tree over those of a fresh one, `sweep`. The two are traced in turn, so that what else
    /// the machine does hits both alike.
    pub(super) fn over(&self, sweep: &Bvh, tree: &Bvh) -> [f64; 2] {
        let mut least = [f64::INFINITY; 2];
        for _ in 0..self.effort.repeats {
            for (least, tree) in least.iter_mut().zip([tree, sweep]) {
                *least = least.min(self.trace(tree, &self.flat(), self.effort.size, 1).1);
            }
            if least[0] + least[1] > LONG {
                break;
            }
        }
        [sah_cost(tree) / sah_cost(sweep), least[0] / least[1]]
    }
}

/// Milliseconds that are measured well enough in one go.
const LONG: f64 = 300.0;

/// Milliseconds of the fastest of so many runs; of fewer, if they are long.
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
