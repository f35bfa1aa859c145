//! How frames are measured.
//!
//! The tree is built once, by the sweep builder over the first frame, and every strategy starts
//! from a copy of it. Then, frame by frame, the scene is posed once, and each strategy in turn
//! updates its own tree and renders with primary and shadow rays. Strategies take turns within a
//! frame, a different one first each time, so that whatever else the machine does hits all of them
//! alike. Then all have a second turn, each with a twin: another tree that has taken the same
//! course. The shortest update and the shorter picture count, since other work on the machine
//! seldom disturbs both turns; where updates are short, several twins make them. What takes long
//! has one turn.
//!
//! What builds in the background would slow the others, and have their time besides its own: each
//! such strategy plays the loops by itself. Before the first frame each runs once on a copy that is
//! thrown away. Checks, costs and pictures are made outside of what is timed.
//!
//! Frames that an earlier run has measured, and those between frames to measure, are only played:
//! strategies whose trees depend on the frames before update them. Of these strategies only those
//! that build in the background render, so that as much time goes by as in measured frames. These
//! updates are timed, too: few of many may be repairs, and the frames measured could hit or miss
//! them.

use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use anyhow::Result;
use rayon::prelude::*;
use rt_cpu::{RenderOptions, RenderStats};

use super::check::{self, Checks};
use super::contestants::{Contestant, POSES, load_of};
use super::journal::Journal;
use super::lane::{LONG_MS, Lane};
use super::preset::Values;
use super::record::{Row, rounded};
use crate::compare::turns;
use crate::interrupt;
use crate::progress::Progress;
use crate::stage::{Renderer, Stage, timed};

/// What to measure.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) contestants: Vec<Contestant>,
    pub(crate) values: Values,
    /// One frame of the loop in this number is measured. On the others strategies whose trees
    /// depend on the past update them, and only what builds in the background renders.
    pub(crate) measure_every: usize,
    pub(crate) threads: usize,
    pub(crate) seed: u64,
}

impl Plan {
    /// Frames in all loops together.
    pub(crate) fn steps(&self) -> usize {
        ((self.values.frames as f64 * self.values.loops).round() as usize).max(1)
    }

    fn is_measured(&self, frame: usize) -> bool {
        frame.is_multiple_of(self.measure_every)
    }

    /// Whether a frame is one of some that are spread evenly over those that are measured.
    fn is_one_of(&self, frame: usize, samples: usize) -> bool {
        let every = self.measure_every;
        let measured = self.values.frames.div_ceil(every);
        let samples = samples.min(measured);
        let is_sample = |i| i * (measured - 1) / (samples - 1).max(1) == frame / every;
        self.is_measured(frame) && (0..samples).any(is_sample)
    }
}

/// Sees the stage, posed, with the strategies whose trees fit the frame, on each frame that is to
/// have its picture taken.
pub(super) type TakePicture<'a> = dyn FnMut(&mut Stage, &[&Lane], usize) -> Result<()> + 'a;

/// What is measured already, and where the rest goes.
pub(super) struct Log<'a> {
    /// Rows of an earlier run, of whole steps from the first on; in `journal` already.
    pub(crate) done: Vec<Row>,
    pub(crate) journal: &'a mut Journal<Row>,
    pub(crate) checks: &'a mut Checks,
    pub(crate) picture: &'a mut TakePicture<'a>,
}

/// What the first strategy has shown of a frame: its name, its counts, and a hash of its picture.
type Shown = (&'static str, RenderStats, u64);

/// Measures all frames of a scene; rows go to the log frame by frame. Ends early when interrupted.
pub(super) fn measure(label: &str, stage: &mut Stage, plan: &Plan, mut log: Log<'_>) -> Result<Vec<Row>> {
    let Values { size, traversal, .. } = plan.values;
    let options = RenderOptions { smooth: false, timed: true, traversal, ..stage.render_options() };
    let (mut rows, mut done) = (Vec::new(), std::mem::take(&mut log.done));
    let mut run = Run {
        label: label.to_owned(),
        plan: plan.clone(),
        lanes: Vec::new(),
        renderer: Renderer::new(options, size),
        log,
        shown: HashMap::new(),
        rays: HashMap::new(),
    };
    // The strategies that take turns, then each that builds in the background.
    let mut contestants = plan.contestants.clone();
    contestants.sort_by_key(|c| c.method.depends_on_time());
    let groups = contestants.chunk_by(|_, next| !next.method.depends_on_time());
    for (i, group) in groups.enumerate().take_while(|_| !interrupt::requested()) {
        let is_of = |row: &mut Row| group.iter().any(|c| c.name == row.strategy);
        let done = done.extract_if(.., is_of).collect();
        // In a second turn the build may have ended, and the shorter time would be that without it.
        let turns = if group[0].method.depends_on_time() { 1 } else { plan.values.turns };
        // The first group is shown.
        let pictures = if i == 0 { plan.values.pictures } else { 0 };
        let values = Values { turns, pictures, ..plan.values };
        run.plan = Plan { contestants: group.to_vec(), values, ..plan.clone() };
        run.make_lanes(stage)?;
        rows.extend(run.measure(stage, done)?);
    }
    // After an interrupt, rows of an earlier run whose strategies had no turn.
    rows.extend(done);
    Ok(rows)
}

/// Strategies of a scene at work, and what all are compared with.
struct Run<'a> {
    label: String,
    plan: Plan,
    lanes: Vec<Lane>,
    renderer: Renderer,
    log: Log<'a>,
    /// By loop and frame.
    shown: HashMap<(usize, usize), Shown>,
    /// By frame: rays, and what they hit by brute force.
    rays: HashMap<usize, Vec<check::SampleRay>>,
}

impl Run<'_> {
    /// Makes the lanes of the plan, and runs each once on a copy of its tree.
    fn make_lanes(&mut self, stage: &mut Stage) -> Result<()> {
        let Self { plan, lanes, renderer, .. } = self;
        let knows = |c: &Contestant| c.method.knows_animation();
        let poses = if plan.contestants.iter().any(knows) { stage.positions(POSES) } else { Vec::new() };
        // One lane for each strategy, whatever number of contestants share it.
        let (mut names, mut contestants) = (HashSet::new(), plan.contestants.clone());
        contestants.retain(|c| names.insert(c.of));
        // Those of the plan before end first.
        lanes.clear();
        // Side by side: methods that know the animation take long to prepare, and that is not
        // counted.
        let (shared, load) = (&*stage, load_of(plan.values.size));
        let lane = |c: &Contestant| Lane::new(c, load, shared, &poses);
        *lanes = contestants.par_iter().map(lane).collect::<Result<_>>()?;
        stage.pose(0.0);
        lanes.iter_mut().try_for_each(|lane| lane.warm_up(stage, plan.values.turns, renderer))
    }

    /// Plays all frames of the plan.
    fn measure(&mut self, stage: &mut Stage, done: Vec<Row>) -> Result<Vec<Row>> {
        let Plan { values, threads, .. } = self.plan;
        let (steps, frames) = (self.plan.steps(), values.frames);
        let alone = self.lanes.first().filter(|lane| lane.method.depends_on_time());
        let who = alone.map_or(String::new(), |lane| format!(", {}", lane.name));
        let progress = Progress::new(format!("{}{who}, {frames} frames a loop", self.label), steps as u64);
        let replayed = done.last().map_or(0, |row| row.step() + 1);
        let mut all_rows = done;
        for step in (0..steps).take_while(|_| !interrupt::requested()) {
            let (round, frame) = (step / frames, step % frames);
            let time_s = stage.time_of(frame, frames);
            let (posed, animate_ms) = timed(|| stage.pose(time_s));
            let is_measured = step >= replayed && self.plan.is_measured(frame);
            let is_shown = round == 0 && self.plan.is_one_of(frame, values.pictures);
            self.play(stage, step, is_measured, is_shown)?;
            let rows = if is_measured {
                let common = Row {
                    scene: self.label.clone(),
                    threads,
                    round,
                    frame,
                    animate_ms: rounded(animate_ms),
                    frames_per_loop: frames,
                    time_s,
                    ..Row::default()
                };
                self.rows(&common.posed(&posed))
            } else {
                self.recall(&all_rows, step);
                Vec::new()
            };
            if round == 0 && self.plan.is_one_of(frame, values.check_frames) {
                self.check(stage, frame);
            }
            // Rows say that a frame is done: a run that is killed while it checks measures that
            // frame again. Differences that were found earlier are known to the summary alone.
            self.log.journal.append(&rows)?;
            all_rows.extend(rows);
            if is_shown {
                let current: Vec<_> = self.lanes.iter().filter(|lane| lane.is_current).collect();
                (self.log.picture)(stage, &current, frame)?;
            }
            progress.at(step as u64 + 1);
        }
        Ok(all_rows)
    }

    /// Plays a frame. If it is measured, all strategies update and render, and their pictures are
    /// compared with that of the first. Else they update trees that depend on the past, and those
    /// that are shown; what builds in the background renders, too, so that as much time goes by.
    fn play(&mut self, stage: &Stage, step: usize, is_measured: bool, is_shown: bool) -> Result<()> {
        let Plan { values, measure_every, .. } = self.plan;
        let (round, frame) = (step / values.frames, step % values.frames);
        for lane in &mut self.lanes {
            lane.begin(is_measured || is_shown || !lane.method.rebuilds());
        }
        let most_trees = self.lanes.iter().map(|lane| lane.trees.len()).max().unwrap_or(0);
        let is_traced_again = is_measured && values.turns > 1;
        let first = if is_measured { step / measure_every } else { frame };
        // All second turns, then the third ones of short updates, and so on.
        for turn in 0..if is_traced_again { most_trees.max(2) } else { most_trees } {
            for i in turns(self.lanes.len(), first) {
                let lane = &mut self.lanes[i];
                if lane.is_current {
                    lane.update(turn, stage)?;
                }
                if is_measured || lane.method.depends_on_time() {
                    lane.trace(turn, stage, &mut self.renderer);
                }
                // Twins were added by the first update, which may have been shorter than later
                // ones. Two turns in a row are seldom disturbed.
                if is_measured && turn == 1 && lane.update_ms > LONG_MS {
                    lane.trees.truncate(1);
                }
                if is_measured && turn == 0 {
                    let pixels = self.renderer.image.pixels();
                    let bits: &[u8] = bytemuck::cast_slice(pixels);
                    let hash = BuildHasherDefault::<DefaultHasher>::default().hash_one(bits);
                    let now = (lane.name, lane.stats, hash);
                    let (name, stats, picture) = self.shown.entry((round, frame)).or_insert(now);
                    if *name != lane.name {
                        let place =
                            format!("{}, loop {round}, frame {frame}, {name} and {}", self.label, lane.name);
                        self.log.checks.same_hits(&place, stats, &now.1);
                        self.log.checks.same_picture(&place, pixels.len(), *picture == hash);
                    }
                }
            }
        }
        Ok(())
    }

    /// The rows of a frame that was measured, one for each contestant, with all updates since the
    /// one before.
    fn rows(&mut self, common: &Row) -> Vec<Row> {
        self.lanes.iter_mut().for_each(|lane| lane.end(Some(lane.stats.nodes_visited)));
        let (rows, same): (Vec<_>, Vec<_>) = self.lanes.par_iter().map(|lane| lane.row(common)).unzip();
        for (lane, same) in self.lanes.iter_mut().zip(same) {
            (lane.updates, lane.updates_ms) = (0, 0.0);
            let place =
                format!("{}, loop {}, frame {}, {}", self.label, common.round, common.frame, lane.name);
            let what = format_args!("two trees of the same course have different costs");
            self.log.checks.expect(same, &place, what);
        }
        let row = |c: &Contestant| {
            let at = self.lanes.iter().position(|lane| lane.name == c.of)?;
            let row = rows[at].clone();
            let [update_ms, updates_ms] = [row.update_ms, row.updates_ms].map(|ms| rounded(c.factor * ms));
            let frame_ms = rounded(update_ms + row.trace_ms);
            Some(Row { strategy: c.name.to_owned(), update_ms, frame_ms, updates_ms, ..row })
        };
        self.plan.contestants.iter().filter_map(row).collect()
    }

    /// Ends a frame that is not measured. If an earlier run has measured it, its rays are reported,
    /// so that trees take the same course.
    fn recall(&mut self, rows: &[Row], step: usize) {
        let now: Vec<_> = rows.iter().filter(|row| row.step() == step).collect();
        for lane in &mut self.lanes {
            let row = now.iter().find(|row| row.strategy == lane.name);
            if lane.is_current {
                lane.end(row.map(|row| row.nodes_opened));
            }
            if !now.is_empty() {
                // Rows of an earlier run have the updates up to here.
                (lane.updates, lane.updates_ms) = (0, 0.0);
            }
        }
    }

    /// Compares what every tree finds with brute force.
    fn check(&mut self, stage: &Stage, frame: usize) {
        let Values { size, check_rays, .. } = self.plan.values;
        let (camera, triangles) = (stage.camera(size, size), stage.triangles());
        let sample = || check::sample(&camera, &triangles, check_rays, self.plan.seed ^ frame as u64);
        let rays = self.rays.entry(frame).or_insert_with(sample);
        let label = &self.label;
        let current = self.lanes.par_iter().filter(|lane| lane.is_current);
        let checked: Vec<_> = current
            .map(|lane| {
                let place = format!("{label}, frame {frame}, {}", lane.name);
                Checks::of_tree(&place, lane.tree(), &triangles, rays)
            })
            .collect();
        checked.iter().for_each(|checks| self.log.checks.add(checks));
    }
}
