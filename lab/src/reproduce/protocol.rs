//! How frames are measured.
//!
//! The tree is built once, by the sweep builder over the first frame, and every strategy starts
//! from a copy of it. Then, frame by frame, the scene is posed once, and each strategy in turn
//! updates its own tree and renders with primary and shadow rays. Strategies take turns within a
//! frame, a different one first each time, so that whatever else the machine does hits all of them
//! alike. Before the first frame each runs once on a copy that is thrown away. Checks, costs and
//! pictures are made outside of what is timed.
//!
//! Frames that an earlier run has measured, and those between frames to measure, are only played:
//! strategies whose trees depend on the frames before update them, and nothing is rendered or
//! timed.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_core::{Bvh, Triangles, Vec3, sah_cost};
use bvh_update::{Decision, Load, Update};
use rt_cpu::{Image, RenderOptions, RenderStats, Traversal, render};

use super::check::{self, Checks};
use super::contestants::{Contestant, Counted, Keeper, Method, POSES};
use super::journal::Journal;
use super::record::Row;
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
    /// One frame of the loop in this number is measured. On the others strategies whose trees
    /// depend on the past update them, unmeasured.
    pub(crate) measure_every: usize,
    /// Pixels on each side of the image.
    pub(crate) size: u32,
    pub(crate) threads: usize,
    pub(crate) traversal: Traversal,
    /// Frames of the first loop to compare with brute force, and rays on each.
    pub(crate) check_frames: usize,
    pub(crate) check_rays: usize,
    /// Frames of the first loop to take pictures of.
    pub(crate) pictures: usize,
    pub(crate) seed: u64,
}

impl Plan {
    /// Frames in all loops together.
    pub(crate) fn steps(&self) -> usize {
        ((self.frames as f64 * self.loops).round() as usize).max(1)
    }

    /// Rays that a picture may take: from the eye, and from the light.
    fn rays(&self) -> u64 {
        2 * u64::from(self.size).pow(2)
    }

    fn is_measured(&self, frame: usize) -> bool {
        frame.is_multiple_of(self.measure_every)
    }

    /// Whether a frame of the first loop is compared with brute force.
    fn is_checked(&self, frame: usize) -> bool {
        self.is_one_of(frame, self.check_frames)
    }

    /// Whether a frame of the first loop has its picture taken.
    fn is_pictured(&self, frame: usize) -> bool {
        self.is_one_of(frame, self.pictures)
    }

    /// Whether a frame is one of some that are spread evenly over those that are measured.
    fn is_one_of(&self, frame: usize, samples: usize) -> bool {
        let every = self.measure_every;
        self.is_measured(frame) && is_sampled(frame / every, self.frames.div_ceil(every), samples)
    }
}

/// A strategy at work: its tree and its memory.
struct Lane {
    name: &'static str,
    method: Method,
    tree: Bvh,
    keeper: Keeper,
    /// Whether the tree fits the present frame.
    is_current: bool,
    last: Option<Measured>,
    /// The longest frame so far.
    longest_ms: f64,
}

struct Measured {
    update: Update,
    update_ms: f64,
    stats: RenderStats,
    trace_ms: f64,
    sah_cost: f64,
    primitives_refit: u64,
}

/// A tree that fits the frame, and whose it is.
pub(crate) type Named<'a> = (&'static str, &'a Bvh);

/// What is measured already, and where the rest goes.
pub(crate) struct Log<'a> {
    /// Rows of an earlier run, of whole steps from the first on; in `journal` already.
    pub(crate) done: Vec<Row>,
    pub(crate) journal: &'a mut Journal<Row>,
}

impl Log<'_> {
    /// The log of one run: rows of as many frames a loop.
    pub(crate) fn take(&mut self, frames: usize) -> Log<'_> {
        let done = self.done.extract_if(.., |row| row.frames_per_loop == frames).collect();
        Log { done, journal: self.journal }
    }
}

/// Measures all frames of a scene; rows go to the log frame by frame. `picture` sees the stage,
/// posed, with the trees of all strategies, on each frame that is to have its picture taken. Ends
/// early when interrupted.
pub(crate) fn measure(
    label: &str,
    stage: &mut Stage,
    plan: &Plan,
    Log { done, journal }: Log<'_>,
    mut picture: impl FnMut(&mut Stage, &[Named<'_>], usize) -> Result<()>,
) -> Result<(Vec<Row>, Checks)> {
    let steps = plan.steps();
    let progress = Progress::new(format!("{label}, {} frames a loop", plan.frames), steps as u64);
    let replayed = done.last().map_or(0, |row| row.round * plan.frames + row.frame + 1);
    let traversal = plan.traversal;
    let flat = RenderOptions { smooth: false, timed: true, traversal, ..stage.render_options() };
    let mut lanes = lanes(stage, plan)?;
    // The first strategy's picture, and that of another to compare with.
    let mut images = [(); 2].map(|()| Image::new(plan.size, plan.size));
    stage.pose(0.0);
    // A method that knows the animation refits like the others, and would be prepared again.
    for lane in lanes.iter().filter(|lane| !lane.method.knows_animation()) {
        let mut warm = Lane::new(lane.name, lane.method, stage, &[])?;
        warm.run(stage, plan.size, &flat, &mut images[0])?;
    }

    let mut all_rows = done;
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
        for i in (0..count).map(|i| (i + step / plan.measure_every) % count) {
            let lane = &mut lanes[i];
            (lane.last, lane.is_current) = (None, true);
            if step < replayed || !plan.is_measured(frame) {
                lane.is_current = !lane.method.rebuilds() || round == 0 && plan.is_pictured(frame);
                if lane.is_current {
                    lane.update(stage)?;
                    lane.recall(&all_rows, round, frame);
                }
                continue;
            }
            let [first, other] = &mut images;
            let Some((reference_name, reference_stats)) = reference else {
                let measured = lane.run(stage, plan.size, &flat, first)?;
                reference = Some((lane.name, measured.stats));
                lane.last = Some(measured);
                continue;
            };
            let measured = lane.run(stage, plan.size, &flat, other)?;
            let names = [reference_name, lane.name];
            let place = format!("{label}, loop {round}, frame {frame}, {} and {}", names[0], names[1]);
            checks.same_hits(&place, &reference_stats, &measured.stats);
            checks.same_picture(&place, first, other);
            lane.last = Some(measured);
        }

        if round == 0 && plan.is_checked(frame) {
            let camera = stage.camera(plan.size, plan.size);
            let rays = check::sample(&camera, &stage.triangles(), plan.check_rays, plan.seed ^ frame as u64);
            for lane in lanes.iter().filter(|lane| lane.is_current) {
                let place = format!("{label}, frame {frame}, {}", lane.name);
                checks.same_as_brute(&place, &lane.tree, &stage.triangles(), &rays);
                checks.valid(&place, &lane.tree, &stage.triangles());
            }
        }

        let rows: Vec<Row> = plan
            .contestants
            .iter()
            .filter_map(|c| Some((c, lanes.iter().find(|l| l.name == c.of)?.last.as_ref()?)))
            .map(|(c, measured)| Row {
                round,
                frame,
                animate_ms,
                time_s: time,
                ..measured.row(label, c.name, c.counted, plan).posed(&posed)
            })
            .collect();
        journal.append(&rows)?;
        all_rows.extend(rows);
        if round == 0 && plan.is_pictured(frame) {
            let current = lanes.iter().filter(|lane| lane.is_current);
            let trees: Vec<_> = current.map(|lane| (lane.name, &lane.tree)).collect();
            picture(stage, &trees, frame)?;
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
fn lanes(stage: &mut Stage, plan: &Plan) -> Result<Vec<Lane>> {
    let knows = |c: &Contestant| c.method.knows_animation();
    let poses = if plan.contestants.iter().any(knows) { stage.positions(POSES) } else { Vec::new() };
    let mut lanes: Vec<Lane> = Vec::new();
    for contestant in &plan.contestants {
        if lanes.iter().all(|lane| lane.name != contestant.of) {
            let method = contestant.method.for_rays(plan.rays());
            lanes.push(Lane::new(contestant.of, method, stage, &poses)?);
        }
    }
    Ok(lanes)
}

impl Lane {
    fn new(name: &'static str, method: Method, stage: &Stage, poses: &[Vec<Vec3>]) -> Result<Self> {
        let mut tree = stage.first_tree.clone();
        let indices = stage.triangles().indices;
        let poses: Vec<_> = poses.iter().map(|positions| Triangles { positions, indices }).collect();
        let keeper = method.keeper(&mut tree, &poses).with_context(|| format!("{name}: not prepared"))?;
        Ok(Self { name, method, tree, keeper, is_current: false, last: None, longest_ms: 0.0 })
    }

    fn update(&mut self, stage: &Stage) -> Result<Update> {
        self.method
            .run(&mut self.tree, &stage.triangles(), &mut self.keeper)
            .with_context(|| format!("{}: {} failed", stage.scene.name, self.name))
    }

    /// Reports the rays of a frame that an earlier run has measured, so that the tree takes the
    /// same course.
    fn recall(&mut self, rows: &[Row], round: usize, frame: usize) {
        let is_it = |row: &&Row| row.strategy == self.name && [row.round, row.frame] == [round, frame];
        if let Some(row) = rows.iter().find(is_it) {
            self.keeper.report(Load::PacketNodes(row.nodes_opened));
        }
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
        let update = self.update(stage)?;
        let update_ms = ms(start);
        let start = Instant::now();
        let stats = render(&self.tree, &mesh, &camera, Some(&light), options, image);
        let mut trace_ms = ms(start);
        // Else the machine's interruptions would decide which frame takes longest.
        if update_ms + trace_ms > self.longest_ms {
            let start = Instant::now();
            render(&self.tree, &mesh, &camera, Some(&light), options, image);
            trace_ms = trace_ms.min(ms(start));
            self.longest_ms = self.longest_ms.max(update_ms + trace_ms);
        }
        self.keeper.report(Load::PacketNodes(stats.nodes_visited));
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
            strategy: name.to_owned(),
            threads: plan.threads,
            update_ms,
            frame_ms: update_ms + self.trace_ms,
            sah_cost: self.sah_cost,
            rotations: self.update.rotations_applied(),
            height: self.update.height,
            nodes_visited: self.update.nodes_visited,
            dropped: self.update.dropped,
            frames_per_loop: plan.frames,
            primitives_refit: self.primitives_refit,
            decision: in_words(self.update.decision),
            ..Row::default()
        }
        .traced(&self.stats, self.trace_ms)
    }
}

/// A decision without commas, which would part columns for a simple reader.
fn in_words(decision: Decision) -> String {
    decision.to_string().replace(',', ";")
}
