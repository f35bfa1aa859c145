//! A contestant at work on a scene.
//!
//! It has a record, all are compared on one frame, and they take turns in one loop.

use anyhow::Result;
use bvh_core::{Bvh, sah_cost};
use pivot_benches::{Answers, Contest, Contestant, Entry, View};
use rt_cpu::{Pixel, PointLight, RenderOptions, RenderStats, Traversal, cast};
use scenes::LightEffects;

use super::Setting;
use super::row::Row;
use super::table::time;
use crate::interrupt;
use crate::progress::Progress;
use crate::reproduce::{Spread, median};
use crate::stage::{Stage, fresh_tree, timed};

/// Pixels on each side of the view that answers are compared on.
pub(super) const CHECK_SIZE: u32 = 128;

/// A contestant of a scene.
pub(super) struct Lane {
    pub(super) entry: Entry,
    pub(super) contestant: Box<dyn Contestant>,
    pub(super) record: Record,
}

/// What a contestant did on a scene.
#[derive(Clone, Debug, Default)]
pub(super) struct Record {
    /// Times of the measured frames.
    pub(super) times_ms: Vec<f64>,
    /// Of whole frames: the part of these that the update took.
    pub(super) updates_ms: Vec<f64>,
    /// Ratios of cost of the same frames.
    pub(super) costs: Vec<f64>,
    pub(super) answers: Answers,
}

impl Record {
    /// The row, compared to what the reference found.
    pub(super) fn row(&self, what: &str, contestant: &str, on: &Setting, reference: &Answers) -> Row {
        let times = Spread::of(self.times_ms.iter().copied()).unwrap_or_default();
        let costs = Spread::of(self.costs.iter().copied());
        let Answers { rays, hits, different, shadows_different, lit, t_sum } = self.answers;
        let row = Row {
            what: what.to_owned(),
            scene: on.scene.clone(),
            triangles: on.triangles,
            contestant: contestant.to_owned(),
            threads: on.threads,
            frames: self.times_ms.len(),
            median_ms: times.median,
            min_ms: times.min,
            max_ms: times.max,
            mean_ms: times.mean,
            mean_update_ms: Spread::of(self.updates_ms.iter().copied()).map(|t| t.mean),
            sah_over_sweep: costs.map(|c| c.mean),
            worst_sah_over_sweep: costs.map(|c| c.max),
            rays,
            hits,
            different,
            shadows_different,
            lit,
            t_sum,
            agrees: self.answers.agrees_with(reference),
            ..Row::default()
        };
        Row { ns_per_triangle: 1e6 * time(&row) / on.triangles.max(1) as f64, ..row }
    }
}

/// Everyone who takes part in a contest.
pub(super) fn lanes(contest: Contest, stage: &Stage, setting: &Setting) -> Result<Vec<Lane>> {
    let lane = |entry: Entry| {
        let contestant = entry.make(&stage.triangles())?;
        Ok(Lane { entry, contestant, record: Record::default() })
    };
    setting.field(contest).into_iter().map(lane).collect()
}

impl Lane {
    /// A new contestant in the place of this one; the record stays.
    pub(super) fn restart(&mut self, stage: &Stage) -> Result<()> {
        self.contestant = self.entry.make(&stage.triangles())?;
        Ok(())
    }

    /// Takes the positions of the stage, then updates; gives the time of the latter.
    pub(super) fn update(&mut self, stage: &Stage) -> Result<f64> {
        self.contestant.pose(stage.triangles().positions);
        let (updated, time_ms) = timed(|| self.contestant.update());
        updated?;
        Ok(time_ms)
    }

    /// Compares how good the tree is to a fresh sweep build.
    pub(super) fn add_cost(&mut self, frame: &Frame) {
        let ratio = self.contestant.sah_cost().map(|cost| cost / frame.sweep_cost);
        self.record.costs.extend(ratio.filter(|r| r.is_finite()));
    }
}

/// What everyone is compared to in one frame: a fresh sweep build, and what single rays find in it.
pub(super) struct Frame {
    pub(super) view: View,
    pub(super) tree: Bvh,
    pub(super) sweep_cost: f64,
    pub(super) pixels: Vec<Pixel>,
    /// Numbers of rays.
    pub(super) stats: RenderStats,
}

impl Frame {
    pub(super) fn new(stage: &Stage, view: View) -> Result<Self> {
        let (triangles, tree) = (stage.triangles(), fresh_tree(stage)?);
        let mut pixels = vec![Pixel::default(); view.camera.width as usize * view.camera.height as usize];
        let light = view.light.map(|position| PointLight { position, color: [1.0; 3] });
        let options = RenderOptions { traversal: Traversal::Single, ..RenderOptions::default() };
        let stats = cast(&tree, &triangles, &view.camera, light.as_ref(), &options, &mut pixels);
        Ok(Self { view, sweep_cost: sah_cost(&tree), tree, pixels, stats })
    }
}

/// The rows of one measurement: of all lanes, compared with what the reference found.
pub(super) fn rows(what: &str, lanes: &[Lane], setting: &Setting, all: &Answers) -> Vec<Row> {
    lanes.iter().map(|lane| lane.record.row(what, &lane.entry.name, setting, all)).collect()
}

/// The scene's view now, with the light where the scene has shadows.
pub(super) fn view(stage: &Stage, size: u32) -> View {
    let light = stage.scene.effects.light.contains(LightEffects::SHADOWS).then(|| stage.light().position);
    View { camera: stage.camera(size, size), light }
}

/// Plays a loop at the scene's own pace: `step` sees the stage posed, the number of steps before,
/// and whether the frame is to be measured. Frames that are not are left out unless `all` is set.
pub(super) fn play(
    what: &str,
    stage: &mut Stage,
    setting: &Setting,
    all: bool,
    mut step: impl FnMut(&mut Stage, usize, bool) -> Result<()>,
) -> Result<()> {
    let frames = stage.scene.frames.max(2);
    let measured = spread(frames, setting.frames);
    let name = format!("{what}, {}, {} threads", setting.scene, setting.threads);
    let progress = Progress::new(name, frames as u64);
    let wanted = (1..frames).filter(|frame| all || measured.contains(frame));
    for (number, frame) in wanted.enumerate().take_while(|_| !interrupt::requested()) {
        stage.pose(stage.time_of(frame, frames));
        step(stage, number, measured.contains(&frame))?;
        progress.at(frame as u64 + 1);
    }
    Ok(())
}

/// The order of `count` contestants in a turn: another comes first each time.
pub(crate) fn turns(count: usize, turn: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |i| (i + turn) % count)
}

/// Records the median time of each lane over rounds in which all take turns to `cast` into `found`,
/// and compares the `answers` of the first round.
pub(super) fn in_rounds<T>(
    (rounds, turn): (usize, usize),
    lanes: &mut [Lane],
    found: &mut T,
    expected: &[Pixel],
    cast: impl Fn(&dyn Contestant, &mut T),
    answers: impl Fn(&T) -> Vec<Pixel>,
) {
    let mut times = vec![Vec::new(); lanes.len()];
    for round in 0..rounds {
        for i in turns(lanes.len(), round + turn) {
            times[i].push(timed(|| cast(&*lanes[i].contestant, found)).1);
            if round == 0 {
                lanes[i].record.answers.add(&answers(found), expected);
            }
        }
    }
    lanes.iter_mut().zip(times).for_each(|(lane, times)| lane.record.times_ms.push(median(times)));
}

/// Frames to measure, spread evenly over the frames `1..frames` of a loop; frame 0 is where
/// everyone starts.
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
