//! A contestant with its record, and the frame that all are compared on.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Bvh, sah_cost};
use pivot_benches::{Answers, Contestant, Entry, LIMIT, View, set_up_rays};
use rt_cpu::{Pixel, PointLight, RenderOptions, RenderStats, Traversal, cast};

use super::row::{Record, Row};
use crate::stage::{Stage, ms};

/// Pixels on each side of the view that answers are compared on.
pub(super) const CHECK_SIZE: u32 = 128;

/// A contestant of a scene.
pub(super) struct Lane {
    pub(super) entry: Entry,
    pub(super) contestant: Box<dyn Contestant>,
    pub(super) record: Record,
}

impl Lane {
    pub(super) fn new(entry: Entry, stage: &Stage) -> Result<Self> {
        let contestant = entry.make(&stage.triangles())?;
        Ok(Self { entry, contestant, record: Record::default() })
    }

    /// Takes the positions of the stage, then updates; gives the time of the latter.
    pub(super) fn update(&mut self, stage: &Stage) -> Result<f64> {
        self.contestant.pose(stage.triangles().positions);
        let start = Instant::now();
        self.contestant.update()?;
        Ok(ms(start))
    }

    /// Compares what the contestant finds, and how good its tree is, to a fresh sweep build.
    pub(super) fn check(&mut self, frame: &Frame, view: &View) {
        if self.entry.name == LIMIT {
            return;
        }
        let mut pixels = vec![Pixel::default(); frame.pixels.len()];
        self.contestant.cast(view, &mut pixels);
        self.record.answers.add(&pixels, &frame.pixels);
        self.add_cost(frame);
    }

    pub(super) fn add_cost(&mut self, frame: &Frame) {
        let ratio = self.contestant.sah_cost().map(|cost| cost / frame.sweep_cost);
        self.record.costs.extend(ratio.filter(|r| r.is_finite()));
    }

    pub(super) fn row(
        &self,
        what: &'static str,
        scene: &str,
        stage: &Stage,
        threads: usize,
        all: &Answers,
    ) -> Row {
        let triangles = stage.triangles().indices.len();
        let work = self.contestant.work();
        Row { work, ..self.record.row(what, scene, triangles, &self.entry.name, threads, all) }
    }
}

/// What everyone is compared to in one frame: a fresh sweep build, and what single rays find in it.
pub(super) struct Frame {
    pub(super) tree: Bvh,
    pub(super) sweep_cost: f64,
    pub(super) pixels: Vec<Pixel>,
    /// Numbers of rays.
    pub(super) stats: RenderStats,
}

impl Frame {
    pub(super) fn new(stage: &Stage, view: &View) -> Result<Self> {
        let triangles = stage.triangles();
        let tree = build(&triangles, Builder::Sweep, &BuildOptions::default(), None)
            .with_context(|| format!("{}: no tree", stage.scene.name))?;
        let mut pixels = vec![Pixel::default(); view.camera.width() as usize * view.camera.height() as usize];
        let light = view.light.map(|position| PointLight { position, color: [1.0; 3] });
        let options = RenderOptions { traversal: Traversal::Single, ..RenderOptions::default() };
        let stats = cast(&tree, &triangles, &view.camera, light.as_ref(), &options, &mut pixels);
        Ok(Self { sweep_cost: sah_cost(&tree), tree, pixels, stats })
    }

    /// What the reference found, added to what it found before.
    pub(super) fn add_to(&self, all: &mut Answers) {
        all.add(&self.pixels, &self.pixels);
    }
}

/// Name of the row that tells what making rays takes.
pub(super) const SET_UP: &str = "ray set-up";

/// What every contestant but this project's packets spends outside of the library: its user's part.
#[derive(Default)]
pub(super) struct SetUp {
    pub(super) record: Record,
}

impl SetUp {
    /// Makes the rays of a view three times; the median counts.
    pub(super) fn measure(&mut self, stage: &Stage, view: &View, frame: &Frame, pixels: &mut [Pixel]) {
        let mut times = [0.0; 3];
        for time in &mut times {
            let start = Instant::now();
            set_up_rays(&stage.triangles(), view, &frame.pixels, pixels);
            *time = ms(start);
        }
        times.sort_by(f64::total_cmp);
        self.record.times_ms.push(times[1]);
        self.record.answers.add(pixels, &frame.pixels);
    }

    pub(super) fn row(
        &self,
        what: &'static str,
        scene: &str,
        stage: &Stage,
        threads: usize,
        all: &Answers,
    ) -> Row {
        self.record.row(what, scene, stage.triangles().indices.len(), SET_UP, threads, all)
    }
}

/// The scene's view now, with the light where the scene has shadows.
pub(super) fn view(stage: &Stage, size: u32) -> View {
    let light = stage.scene.effects.light.shadows.then(|| stage.light().position);
    View { camera: stage.camera(size, size), light }
}

/// Frames to measure, spread evenly over the frames `1..frames` of a loop; frame 0 is where everyone starts.
pub(super) fn spread(frames: usize, measured: usize) -> Vec<usize> {
    let last = frames.saturating_sub(1).max(1);
    let mut all: Vec<usize> = (1..=measured).map(|i| (i * last).div_ceil(measured).max(1)).collect();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measured_frames_are_spread_over_the_loop() {
        assert_eq!(spread(101, 4), [25, 50, 75, 100]);
        assert_eq!(spread(3, 20), [1, 2]);
        // A still scene has one frame, which is measured again.
        assert_eq!(spread(1, 20), [1]);
    }
}
