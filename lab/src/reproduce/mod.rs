//! `cargo xtask reproduce`: the paper's experiments, rerun and judged.

mod accuracy;
pub(crate) mod chart;
mod check;
mod claims;
mod contestants;
mod figures;
mod journal;
mod lane;
mod offline;
mod options;
mod output;
mod paper_binned;
mod pictures;
mod preset;
mod protocol;
pub(crate) mod record;
mod report;
mod results;
mod saved;
mod settle;
pub(crate) mod stages;
mod summary;

use std::time::Instant;

use anyhow::Result;
use bvh_core::sah_cost;
use pivot_benches::embree::Device;
use scenes::{FrameStage, Scene};

use self::accuracy::Point;
use self::journal::Journal;
use self::lane::Lane;
use self::options::Experiment;
use self::output::Output;
use self::preset::Values;
use self::protocol::{Log, Plan};
use self::record::Row;
use self::results::{Results, SceneRun, Settings};
use crate::compare::{Row as Peer, Setting};
use crate::effects::{self, Played};
use crate::machine::{Machine, Revision};
use crate::progress::left;
use crate::stage::{self, Stage};
use crate::{compare, files, interrupt, pool};

pub(crate) use self::contestants::Contestant;
pub use self::options::Args;
pub(crate) use self::results::{Spread, median};

/// Frames in a loop in figure 5.
const SPEEDS: [usize; 3] = [20, 100, 500];
/// Frames of each loop that are measured for figure 5, where not all are.
const SPEED_SAMPLES: usize = 10;
/// The strategy of figure 5.
const SPEED_STRATEGY: &str = "refit+rotate";
/// What runs for it: that, its strongest rival, and other updates to compare with.
const SPEED_STRATEGIES: [&str; 5] =
    [SPEED_STRATEGY, contestants::IDEAL_PARALLEL_BINNED, "refit", "refit+rebuild", "refit+rotate+regrow"];
/// What runs for it with that many frames in a loop: fast motion is judged beside other updates.
fn speed_strategies(frames: usize) -> &'static [&'static str] {
    if frames == SPEEDS[0] { &SPEED_STRATEGIES } else { &SPEED_STRATEGIES[..1] }
}
/// The scene that starts from a bad tree, and the same from its other key frames, for the claim
/// that this mends it.
const MUSEUM: &str = "bart-museum";
const OTHER_KEYS: [&str; 4] = ["bart-museum:1", "bart-museum:2", "bart-museum:3", "bart-museum:4"];
/// The dragon whose pieces shear and shrink between few key frames, beside the one of rigid pieces.
const BLENDED: &str = "exploding-dragon:blended";
/// Scenes that serve one claim only: beside which scene they run, and with which strategies.
const SUPPLEMENTS: [(&str, &[&str], &[&str]); 2] = [
    (MUSEUM, &OTHER_KEYS, &[SPEED_STRATEGY, contestants::IDEAL]),
    ("exploding-dragon", &[BLENDED], &["refit", SPEED_STRATEGY, "refit+rotate+regrow", contestants::IDEAL]),
];

/// Load above which times are noisy.
const QUIET: f64 = 0.5;

/// How much of a scene is played for what its effects cost: they are compared with one another, so
/// small scenes and pictures do (`cargo xtask effects` plays more).
const EFFECTS: Played = Played { detail: 0.05, frames: 6, size: 128, seed: 0 };

/// A scene to run: not loaded until its turn comes, unless it is a file, which may be broken.
#[derive(Default)]
struct Entry {
    source: String,
    label: String,
    loaded: Option<Scene>,
    /// What runs on it, if it serves one claim only.
    supplement: Option<&'static [&'static str]>,
    /// What an earlier run has measured.
    before: SceneRun,
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    args.ensure_used()?;
    if let Some(folder) = &args.from {
        let (results, _) = saved::load(folder)?;
        return Output::prepare(args.out())?.copy_from(folder)?.write(&results);
    }
    let mut entries = entries(args)?;
    if interrupt::requested() {
        // While files were loaded. What the folder holds stays as it is.
        return Ok(());
    }
    let mut results = Results {
        machine: Machine::read(),
        revision: Revision::read(),
        settings: args.settings(),
        scenes: Vec::new(),
        accuracy: Vec::new(),
        interrupted: true,
    };
    let embree = match args.runs(Experiment::Peers) {
        true => compare::embree(args.embree.as_deref(), results.settings.threads)?,
        false => None,
    };
    let out = Output::prepare(args.out())?;
    let pool = pool::pool(results.settings.threads)?;
    let (folder, summary) = (out.file(""), out.file("summary.json"));
    if args.resume && summary.exists() {
        results.accuracy = saved::take_over(&folder, &results, &mut entries)?;
    } else {
        saved::ensure_ended(&folder)?;
        if args.resume {
            let folder = folder.display();
            files::remark(&format!("note: {folder} holds no run to resume; starting a new one"));
        }
        // First of all: with new rows beside it, it would name scenes as finished that have none.
        files::remove_old(&summary)?;
    }
    // It would be mistaken for this run's.
    files::remove_old(&out.file("report.html"))?;
    let mut bench = Bench::new(args, &results, &out, &entries)?;

    if let Some(load) = results.machine.load.filter(|&load| load > QUIET) {
        files::remark(&format!(
            "warning: the load was {load:.2} processes before the run; times will be noisy"
        ));
    }
    let (start, count) = (Instant::now(), entries.len());
    let finished = entries.iter().filter(|entry| entry.before.finished).count();
    for (i, entry) in entries.into_iter().enumerate() {
        if entry.before.finished {
            results.scenes.push(entry.before);
            continue;
        }
        if interrupt::requested() {
            break;
        }
        // Before each scene, so that a run that is killed leaves all but one of them.
        out.write_summary(&results, &claims::judge(&results))?;
        // Those of an earlier run take no time, and come first.
        let [done, to_do] = [i, count].map(|n| n.saturating_sub(finished) as f64);
        let left = left(start.elapsed(), done, to_do);
        files::remark(&format!("{}: scene {} of {count}{left}", entry.label, i + 1));
        let (run, points) = pool.install(|| bench.scene(entry, embree.clone()))?;
        results.scenes.push(run);
        results.accuracy.extend(points);
    }
    if let Some(journal) = bench.points.as_mut().filter(|_| args.scenes.is_empty()) {
        // Knobs without a scene are measured last, and again.
        let log = accuracy::Log::new("", args, 0, journal);
        results.accuracy.extend(pool.install(|| accuracy::alone(log))?);
    }
    results.interrupted = interrupt::requested();
    let written = out.write(&results);
    interrupt::say_how_to_go_on(&format!("{} --resume", results.settings.command));
    written
}

/// The scenes asked for. Names are checked and files loaded before anything is measured.
fn entries(args: &Args) -> Result<Vec<Entry>> {
    let mut entries: Vec<Entry> = Vec::new();
    let sources = args.sources();
    for (source, label) in sources.iter().cloned().zip(stage::labels(&sources)) {
        let loaded = match &args.clip {
            Some(_) => Some(args.load(&source)?),
            None => stage::load_first(&source, || args.load(&source))?,
        };
        entries.push(Entry { source, label, loaded, ..Entry::default() });
    }
    let chosen = args.contestants();
    let runs = |name: &&str| chosen.iter().any(|c| c.name == *name);
    let wanted = |strategies: &[&str]| args.runs(Experiment::Claims) && strategies.iter().all(runs);
    for (scene, others, strategies) in SUPPLEMENTS.into_iter().filter(|s| wanted(s.2)) {
        for &label in others {
            let has = |label: &str| entries.iter().any(|e| e.label == label);
            if has(scene) && !has(label) {
                let (source, label, supplement) = (label.to_owned(), label.to_owned(), Some(strategies));
                entries.push(Entry { source, label, supplement, ..Entry::default() });
            }
        }
    }
    Ok(entries)
}

/// What scenes are measured with, and the files that rows go to meanwhile.
struct Bench<'a> {
    args: &'a Args,
    settings: Settings,
    out: &'a Output,
    frames: Journal<Row>,
    speeds: Option<Journal<Row>>,
    points: Option<Journal<Point>>,
    peers: Option<Journal<Peer>>,
}

impl<'a> Bench<'a> {
    /// With new files, which hold what was measured before.
    fn new(args: &'a Args, results: &Results, out: &'a Output, entries: &[Entry]) -> Result<Self> {
        let before = || entries.iter().map(|entry| &entry.before);
        let rows: Vec<_> = before().flat_map(|run| run.rows.clone()).collect();
        let speeds: Vec<_> = before().flat_map(|run| run.speed_rows.clone()).collect();
        let peers: Vec<_> = before().flat_map(|run| run.peers.clone()).collect();
        let any_speeds =
            entries.iter().any(|entry| entry.supplement.is_none() && args.runs_speeds(&entry.label));
        let [accuracy, beside] = [Experiment::Accuracy, Experiment::Peers].map(|e| args.runs(e));
        Ok(Self {
            args,
            settings: results.settings.clone(),
            out,
            frames: Journal::create(&out.file("frames.csv"), &rows)?,
            speeds: Journal::if_wanted(any_speeds, &out.file("fig5.csv"), &speeds)?,
            points: Journal::if_wanted(accuracy, &out.file("accuracy.csv"), &results.accuracy)?,
            peers: Journal::if_wanted(beside, &out.file("peers.csv"), &peers)?,
        })
    }

    /// Measures everything on a scene that was asked for.
    fn scene(&mut self, entry: Entry, embree: Option<Device>) -> Result<(SceneRun, Vec<Point>)> {
        let args = self.args;
        let Entry { source, label, loaded, supplement, before } = entry;
        let is_main = supplement.is_none();
        let (mut stage, build_ms) = stage::ready_timed(loaded.map_or_else(|| args.load(&source), Ok)?)?;
        let plan = self.plan(stage.triangles().indices.len(), supplement);
        let supplement = !is_main;
        let described = described(&stage, build_ms, &plan, label.clone());
        let mut run = SceneRun { supplement, checks: before.checks, ..described };
        let mut points = Vec::new();
        if args.runs_frames() {
            self.frames(&mut run, &mut stage, &plan, before.rows)?;
        }
        if is_main && args.runs_speeds(&label) {
            self.speeds(&mut run, &mut stage, &plan, before.speed_rows)?;
        }
        let goes_on = |experiment| is_main && args.runs(experiment) && !interrupt::requested();
        if goes_on(Experiment::Claims) && run.moves() {
            let (settled, memory) = settle::measure(&mut stage, plan.values.frames)?;
            (run.settled, run.memory) = (Some(settled), Some(memory));
        }
        let is_small = run.triangles <= plan.values.offline;
        if goes_on(Experiment::Claims) && is_small && claims::judges_annealing(&label) {
            run.offline = offline::measure(&mut stage, plan.values.size)?;
        }
        if goes_on(Experiment::Effects) {
            let played = Played { seed: self.settings.seed, ..EFFECTS };
            run.effect_costs = effects::measure(&source, args.clip.as_deref(), played)?;
        }
        if let Some(journal) = self.points.as_mut().filter(|_| is_main && args.measures_accuracy_of(&label)) {
            let log = accuracy::Log::new(&label, args, run.triangles, journal);
            points = accuracy::of_scene(&mut stage, log)?;
        }
        if let Some(journal) = self.peers.as_mut().filter(|_| goes_on(Experiment::Peers)) {
            let Values { peer_frames: frames, size, .. } = plan.values;
            let (triangles, threads) = (run.triangles, plan.threads);
            let (scene, only, runs) = (label, Vec::new(), 1);
            let setting = Setting { scene, triangles, threads, embree, only, frames, runs, size };
            run.peers = compare::beside(&mut stage, &setting)?;
            journal.append(&run.peers)?;
        }
        (run.accuracy_rows, run.peer_rows) = (points.len(), run.peers.len());
        run.finished = !interrupt::requested();
        run.summarise(&self.settings.strategies);
        Ok((run, points))
    }

    fn plan(&self, triangles: usize, supplement: Option<&[&str]>) -> Plan {
        let mut values = self.args.values();
        let mut contestants = self.args.contestants();
        contestants.retain(|c| !c.method.knows_animation() || triangles <= values.prepared);
        if let Some(strategies) = supplement {
            contestants.retain(|c| strategies.contains(&c.name));
            values.pictures = 0;
        }
        let Settings { threads, seed, .. } = self.settings;
        let measure_every = values.interval(triangles);
        // Where fewer frames are measured since they take long, second turns would take long, too.
        // A limit for each picture would favour what is slower.
        if measure_every > values.interval(0) {
            values.turns = 1;
        }
        Plan { contestants, values, measure_every, threads, seed }
    }

    /// Figures 4 and 6: all strategies, side by side.
    fn frames(&mut self, run: &mut SceneRun, stage: &mut Stage, plan: &Plan, begun: Vec<Row>) -> Result<()> {
        let SceneRun { label, hottest, pictures: taken, checks, .. } = run;
        let [size, map_size] = plan.values.picture_size;
        *hottest = pictures::hottest(stage, map_size);
        let mut take = |stage: &mut Stage, lanes: &[&Lane], frame: usize| {
            // All trees show the same picture, as the checks make sure.
            let costs = lanes.iter().map(|lane| (sah_cost(lane.tree()), lane.tree()));
            let Some((_, best)) = costs.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(()) };
            let png = pictures::picture(stage, best, size)?;
            taken.push(self.out.picture(label, frame, None, png)?);
            for lane in lanes.iter().filter(|lane| pictures::HEAT_MAPS.contains(&lane.name)) {
                let jpeg = pictures::heat_map(stage, lane.tree(), map_size, *hottest)?;
                taken.push(self.out.picture(label, frame, Some(lane.name), jpeg)?);
            }
            Ok(())
        };
        if let Some(Row { round, frame, .. }) = begun.last() {
            run.notes.push(format!(
                "resumed after loop {round}, frame {frame}: pictures of strategies up to there were compared in the run before"
            ));
        }
        let log = Log { done: begun, journal: &mut self.frames, checks, picture: &mut take };
        run.rows = protocol::measure(label, stage, plan, log)?;
        Ok(())
    }

    /// Figure 5: one strategy, the same motion in fewer or more frames.
    fn speeds(&mut self, run: &mut SceneRun, stage: &mut Stage, plan: &Plan, begun: Vec<Row>) -> Result<()> {
        let Some(journal) = &mut self.speeds else { return Ok(()) };
        for frames in SPEEDS.into_iter().take_while(|_| !interrupt::requested()) {
            // As many samples of each, unless every frame is asked for.
            let measure_every = if plan.measure_every == 1 { 1 } else { frames / SPEED_SAMPLES };
            let values = Values { frames, loops: plan.values.speed_loops, pictures: 0, ..plan.values };
            let mut contestants = Contestant::all();
            contestants.retain(|c| speed_strategies(frames).contains(&c.name));
            let plan = Plan { contestants, values, measure_every, ..*plan };
            let done = begun.iter().filter(|row| row.frames_per_loop == frames).cloned().collect();
            let log = Log { done, journal, checks: &mut run.checks, picture: &mut |_, _, _| Ok(()) };
            let rows = protocol::measure(&run.label, stage, &plan, log)?;
            run.speed_rows.extend(rows);
        }
        Ok(())
    }
}

/// What is known of a scene before anything is measured.
fn described(stage: &Stage, build_ms: f64, plan: &Plan, label: String) -> SceneRun {
    let scene = &stage.scene;
    let stats = bvh_core::stats(&stage.first_tree);
    SceneRun {
        slug: stage::slug(&label),
        label,
        about: scene.about.to_owned(),
        triangles: stats.primitives,
        moving: scene.animation.topology().moves.iter().filter(|&&moves| moves).count(),
        plan: stage.scene.effects.stages().map(FrameStage::name).collect(),
        key_bytes: scene.key_bytes,
        measures: scene.measures.iter().map(|m| (m.name.clone(), m.value)).collect(),
        effects: scene.effects.names().collect(),
        frames: plan.values.frames,
        measure_every: plan.measure_every,
        build_ms,
        candidates: stats.candidates as f64 / (stats.inner + stats.leaves).max(1) as f64,
        notes: scene.notes.clone(),
        ..SceneRun::default()
    }
}
