//! How frames are measured.
//!
//! The tree is built once, by the sweep builder over the first frame, and every strategy starts from a copy of it.
//! Then, frame by frame, the scene is posed once, and each strategy in turn updates its own tree and renders with
//! primary and shadow rays. Strategies take turns within a frame, a different one first each time, so that whatever
//! else the machine does hits all of them alike. Before the first frame each runs once on a copy that is thrown
//! away. Checks, costs and pictures are made outside of what is timed.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use bvh_core::{Bvh, sah_cost};
use bvh_update::{Scratch, Strategy, Update, update};
use rt_cpu::{Image, RenderOptions, RenderStats, render};

use super::check::{self, Checks};
use super::contestants::{Contestant, Counted};
use super::record::{Records, Row};
use super::stages::primitives_refit;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Stage, ms};

/// What to measure.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) contestants: Vec<Contestant>,
    /// Frames in a loop.
    pub(crate) frames: usize,
    /// Loops, not necessarily whole.
    pub(crate) loops: f64,
    /// Rebuilds are measured on every frame of this number only: their trees depend on nothing else.
    pub(crate) rebuild_every: usize,
    /// Pixels on each side of the image.
    pub(crate) size: u32,
    pub(crate) threads: usize,
    /// Frames of the first loop to compare with brute force, and rays on each.
    pub(crate) check_frames: usize,
    pub(crate) check_rays: usize,
    pub(crate) seed: u64,
}

impl Plan {
    /// Frames in all loops together.
    pub(crate) fn steps(&self) -> usize {
        ((self.frames as f64 * self.loops).round() as usize).max(1)
    }

    /// Whether a frame is compared with brute force: a few of those on which every strategy is measured.
    fn is_checked(&self, frame: usize) -> bool {
        let every = self.rebuild_every;
        frame.is_multiple_of(every)
            && is_sampled(frame / every, self.frames.div_ceil(every), self.check_frames)
    }
}

/// A strategy at work: its tree and its memory.
struct Lane {
    strategy: Strategy,
    tree: Bvh,
    scratch: Scratch,
    last: Option<Measured>,
}

struct Measured {
    update: Update,
    update_ms: f64,
    stats: RenderStats,
    trace_ms: f64,
    sah_cost: f64,
    primitives_refit: u64,
}

/// Measures all frames of a scene; rows go to `records` frame by frame. `frame_done` sees the stage, posed, with
/// the tree of the first strategy, after each frame. Ends early when interrupted.
pub(crate) fn measure(
    label: &str,
    stage: &mut Stage,
    plan: &Plan,
    records: &mut Records,
    mut frame_done: impl FnMut(&mut Stage, &Bvh, usize) -> Result<()>,
) -> Result<(Vec<Row>, Checks)> {
    let steps = plan.steps();
    let progress = Progress::new(format!("{label}, {} frames a loop", plan.frames), steps as u64);
    let flat = RenderOptions { smooth: false, ..stage.render_options() };
    let mut lanes = lanes(stage, plan);
    // The first strategy's picture, and that of another to compare with.
    let mut images = [(); 2].map(|()| Image::new(plan.size, plan.size));
    stage.pose(0.0);
    for lane in &mut lanes {
        let mut warm = Lane { tree: lane.tree.clone(), ..Lane::new(lane.strategy, Bvh::default()) };
        warm.run(stage, plan.size, &flat, &mut images[0])?;
    }

    let mut all_rows = Vec::new();
    let mut checks = Checks::default();
    for step in 0..steps {
        if interrupt::requested() {
            break;
        }
        let (round, frame) = (step / plan.frames, step % plan.frames);
        let time = stage.time_of(frame, plan.frames);
        let start = Instant::now();
        let posed = stage.pose(time);
        let animate_ms = ms(start);

        let count = lanes.len();
        let mut reference = None;
        for i in (0..count).map(|i| (i + step) % count) {
            let lane = &mut lanes[i];
            lane.last = None;
            if lane.rebuilds() && !step.is_multiple_of(plan.rebuild_every) {
                continue;
            }
            let [first, other] = &mut images;
            let Some((reference_name, reference_stats)) = reference else {
                let measured = lane.run(stage, plan.size, &flat, first)?;
                reference = Some((lane.strategy.name(), measured.stats));
                lane.last = Some(measured);
                continue;
            };
            let measured = lane.run(stage, plan.size, &flat, other)?;
            let names = [reference_name, lane.strategy.name()];
            let place = format!("{label}, loop {round}, frame {frame}, {} and {}", names[0], names[1]);
            checks.same_hits(&place, &reference_stats, &measured.stats);
            checks.same_picture(&place, first, other);
            lane.last = Some(measured);
        }

        if round == 0 && plan.is_checked(frame) {
            let camera = stage.camera(plan.size, plan.size);
            let rays = check::sample(&camera, &stage.triangles(), plan.check_rays, plan.seed ^ frame as u64);
            for lane in lanes.iter().filter(|lane| lane.last.is_some()) {
                let place = format!("{label}, frame {frame}, {}", lane.strategy.name());
                checks.same_as_brute(&place, &lane.tree, &stage.triangles(), &rays);
                checks.valid(&place, &lane.tree, &stage.triangles());
            }
        }

        let rows: Vec<Row> = plan
            .contestants
            .iter()
            .filter_map(|c| Some((c, lanes.iter().find(|l| l.strategy == c.strategy)?.last.as_ref()?)))
            .map(|(c, measured)| Row {
                round,
                frame,
                animate_ms,
                time_s: time,
                ..measured.row(label, c.name, c.counted, plan).posed(&posed)
            })
            .collect();
        records.append(&rows)?;
        all_rows.extend(rows);
        if let Some(lane) = lanes.first() {
            frame_done(stage, &lane.tree, step)?;
        }
        progress.at(step as u64 + 1);
    }
    Ok((all_rows, checks))
}

/// Whether a frame is one of `samples` that are spread evenly over `frames`.
pub(crate) fn is_sampled(frame: usize, frames: usize, samples: usize) -> bool {
    let samples = samples.min(frames);
    (0..samples).any(|i| frame == if samples == 1 { 0 } else { i * (frames - 1) / (samples - 1) })
}

/// One lane for each strategy, whatever number of contestants share it.
fn lanes(stage: &Stage, plan: &Plan) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = Vec::new();
    for contestant in &plan.contestants {
        if lanes.iter().all(|lane| lane.strategy != contestant.strategy) {
            lanes.push(Lane::new(contestant.strategy, stage.first_tree.clone()));
        }
    }
    lanes
}

impl Lane {
    fn new(strategy: Strategy, tree: Bvh) -> Self {
        Self { strategy, tree, scratch: Scratch::new(), last: None }
    }

    /// Whether its tree depends on the current frame only.
    fn rebuilds(&self) -> bool {
        matches!(self.strategy, Strategy::Rebuild(..))
    }

    fn run(
        &mut self,
        stage: &Stage,
        size: u32,
        options: &RenderOptions,
        image: &mut Image,
    ) -> Result<Measured> {
        let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
        let start = Instant::now();
        let update = update(&mut self.tree, &mesh.triangles, &self.strategy, &mut self.scratch)
            .with_context(|| format!("{}: {} failed", stage.scene.name, self.strategy.name()))?;
        let update_ms = ms(start);
        let start = Instant::now();
        let stats = render(&self.tree, &mesh, &camera, Some(&light), options, image);
        let trace_ms = ms(start);
        let sah_cost = update.sah_cost.unwrap_or_else(|| sah_cost(&self.tree));
        let primitives_refit = primitives_refit(&self.tree, &update);
        Ok(Measured { update, update_ms, stats, trace_ms, sah_cost, primitives_refit })
    }
}

impl Measured {
    /// A row but for the fields that are the same for all strategies.
    fn row(&self, scene: &str, name: &'static str, counted: Counted, plan: &Plan) -> Row {
        let update_ms = counted.of(self.update_ms);
        Row {
            scene: scene.to_owned(),
            strategy: name,
            threads: plan.threads,
            update_ms,
            trace_ms: self.trace_ms,
            frame_ms: update_ms + self.trace_ms,
            sah_cost: self.sah_cost,
            rotations: self.update.rotations_applied(),
            height: self.update.height,
            nodes_visited: self.update.nodes_visited,
            rays_primary: self.stats.rays_primary,
            rays_shadow: self.stats.rays_shadow,
            hits: self.stats.hits,
            dropped: self.update.dropped,
            frames_per_loop: plan.frames,
            primitives_refit: self.primitives_refit,
            ..Row::default()
        }
    }
}

/// Makes a picture of the stage as it is, smooth, and gives the PNG file's bytes.
pub(crate) fn picture(stage: &mut Stage, tree: &Bvh, size: u32, path: &Path) -> Result<Vec<u8>> {
    stage.smooth();
    let mut image = Image::new(size, size);
    let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
    render(tree, &mesh, &camera, Some(&light), &stage.render_options(), &mut image);
    image.save_png(path)?;
    std::fs::read(path).with_context(|| format!("{}: cannot be read back", path.display()))
}
