//! What every knob is measured with: the scene, how much to do, and where points go.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Bvh, sah_cost};
use rt_cpu::{Image, RenderOptions, render};

use super::effort::Effort;
use super::point::{Log, Point};
use crate::progress::Progress;
use crate::stage::{Stage, ms};

/// A scene under measurement.
pub(super) struct Bench<'a> {
    /// The scene's name in tables.
    label: &'a str,
    /// What it was loaded by.
    pub(super) source: &'a str,
    pub(super) stage: &'a mut Stage,
    pub(super) effort: &'a Effort,
    log: &'a mut Log,
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
        log: &'a mut Log,
        knobs: usize,
    ) -> Self {
        let progress = Progress::new(format!("{label}, accuracy"), (knobs as f64 * STEPS) as u64);
        Self { label, source, stage, effort, log, progress, knob: 0, points: Vec::new() }
    }

    /// Takes what was measured; it is in the file when this returns.
    pub(super) fn add(&mut self, point: Point) -> Result<()> {
        // To a tenth of a microsecond.
        let time_ms = (point.time_ms * 1e4).round() / 1e4;
        let point = Point { scene: self.label.to_owned(), time_ms, ..point };
        self.log.append(&point)?;
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

    /// Renders a frame, and once more for each further repeat: the image, and the time of the fastest, which is what
    /// least of the machine's other work got into.
    pub(super) fn trace(&self, tree: &Bvh, options: &RenderOptions, size: u32) -> (Image, f64) {
        let stage = &*self.stage;
        let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
        let mut image = Image::new(size, size);
        let time = fastest(self.effort.repeats, || {
            render(tree, &mesh, &camera, Some(&light), options, &mut image);
        });
        (image, time)
    }

    /// A fresh tree by the sweep builder over the current pose.
    pub(super) fn sweep(&self) -> Result<Bvh> {
        build(&self.stage.triangles(), Builder::Sweep, &BuildOptions::default(), None)
            .with_context(|| format!("{}: no tree", self.label))
    }

    /// How good such a tree is, for all others to be measured against.
    pub(super) fn yardstick(&self) -> Result<Yardstick> {
        let tree = self.sweep()?;
        let (_, trace_ms) = self.trace(&tree, &self.flat(), self.effort.size);
        Ok(Yardstick { cost: sah_cost(&tree), trace_ms })
    }

    /// SAH cost and trace time of a tree over those of the yardstick.
    pub(super) fn over(&self, yardstick: &Yardstick, tree: &Bvh) -> [f64; 2] {
        let (_, trace_ms) = self.trace(tree, &self.flat(), self.effort.size);
        [sah_cost(tree) / yardstick.cost, trace_ms / yardstick.trace_ms]
    }
}

/// A fresh sweep build, as good as it is to trace.
pub(super) struct Yardstick {
    cost: f64,
    trace_ms: f64,
}

/// Milliseconds of the fastest of so many runs.
pub(super) fn fastest(runs: usize, mut run: impl FnMut()) -> f64 {
    let times = (0..runs.max(1)).map(|_| {
        let start = Instant::now();
        run();
        ms(start)
    });
    times.fold(f64::INFINITY, f64::min)
}
