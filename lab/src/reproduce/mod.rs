//! `cargo xtask reproduce`: the paper's experiments, rerun and judged.

mod accuracy;
mod baseline;
pub(crate) mod chart;
mod check;
mod claims;
mod contestants;
mod decisions;
mod figures;
mod journal;
mod offline;
mod options;
mod output;
mod paper_binned;
mod peers;
mod pictures;
mod preset;
mod protocol;
mod record;
mod report;
mod results;
mod saved;
mod settle;
mod stages;
mod summary;

use std::time::Instant;

use anyhow::{Result, ensure};
use pivot_benches::embree::Device;
use scenes::Scene;

use self::accuracy::Point;
use self::journal::Journal;
use self::options::Experiment;
use self::output::Output;
use self::preset::Values;
use self::protocol::{Log, Named, Plan};
use self::record::Row;
use self::results::{Picture, Results, SceneFacts, SceneRun, Settings};
use self::saved::Saved;
use crate::compare::Row as Peer;
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
/// The strategy of figure 5.
const SPEED_STRATEGY: &str = "refit+rotate";
/// What runs for it: that, its strongest rival, and other updates to compare with.
const SPEED_STRATEGIES: [&str; 5] =
    [SPEED_STRATEGY, contestants::IDEAL_PARALLEL_BINNED, "refit", "refit+rebuild", "refit+rotate+regrow"];
/// The scene that starts from a bad tree, and the same from its other key frames, for the claim
/// that this mends it.
const MUSEUM: &str = "bart-museum";
const OTHER_KEYS: [&str; 4] = ["bart-museum:1", "bart-museum:2", "bart-museum:3", "bart-museum:4"];
/// What runs on those.
const KEY_STRATEGIES: [&str; 2] = [SPEED_STRATEGY, contestants::IDEAL];
/// The dragon whose pieces shear and shrink between few key frames, beside the one of rigid pieces.
const BLENDED: &str = "exploding-dragon:blended";
const RIGID: &str = "exploding-dragon";
/// What runs on that.
const BLENDED_STRATEGIES: [&str; 3] = ["refit", SPEED_STRATEGY, contestants::IDEAL];

/// How much of a scene is played for what its effects cost: they are compared with one another, so
/// small scenes and pictures do (`cargo xtask effects` plays more).
const EFFECTS: Played = Played { detail: 0.05, frames: 6, size: 128 };

/// What runs on a scene that serves one claim only.
fn supplement_strategies(label: &str) -> &'static [&'static str] {
    if label == BLENDED { &BLENDED_STRATEGIES } else { &KEY_STRATEGIES }
}

/// A scene to run: not loaded until its turn comes, unless it is a file, which may be broken.
struct Entry {
    source: String,
    label: String,
    loaded: Option<Scene>,
    /// Whether it serves one claim only.
    supplement: bool,
    /// What an earlier run has measured: all, or some rows of figures 4 and 6, and of figure 5.
    finished: Option<SceneRun>,
    begun: [Vec<Row>; 2],
}

impl Entry {
    fn new(source: &str, label: String, loaded: Option<Scene>, supplement: bool) -> Self {
        let begun = [Vec::new(), Vec::new()];
        Self { source: source.to_owned(), label, loaded, supplement, finished: None, begun }
    }

    /// The rows of figures 4 and 6, or else of figure 5, that need not be measured again.
    fn rows(&self, of_speeds: bool) -> Vec<&Row> {
        match &self.finished {
            Some(run) if of_speeds => run.speeds.iter().flat_map(|(_, rows)| rows).collect(),
            Some(run) => run.rows.iter().collect(),
            None => self.begun[usize::from(of_speeds)].iter().collect(),
        }
    }
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    args.ensure_used()?;
    let baseline = args.baseline.as_deref().map(saved::load).transpose()?.map(|saved| saved.results);
    if let Some(folder) = &args.from {
        let results = saved::load(folder)?.results;
        return Output::prepare(args.out())?.copy_from(folder)?.write(&results, baseline.as_ref());
    }
    let mut entries = entries(args)?;
    let mut results = Results {
        machine: Machine::read(),
        revision: Revision::read(),
        settings: args.settings(),
        scenes: Vec::new(),
        accuracy: Vec::new(),
        interrupted: true,
    };
    let embree = args.embree(results.settings.threads)?;
    let out = Output::prepare(args.out())?;
    let pool = pool::pool(results.settings.threads)?;
    match args.resume.then(|| earlier(&out, &results)).transpose()?.flatten() {
        Some(saved) => results.accuracy = take_over(saved, &mut entries, &results.settings),
        // First of all: with new rows beside it, it would name scenes as finished that have none.
        None => files::remove_old(&out.file("summary.json"))?,
    }
    let journals = Journals::open(args, &out, &entries, &results.accuracy)?;
    let settings = results.settings.clone();
    let mut bench = Bench { args, settings, out: &out, embree, journals };

    let (start, count) = (Instant::now(), entries.len());
    for (i, entry) in entries.into_iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        if let Some(finished) = entry.finished {
            results.scenes.push(finished);
            continue;
        }
        // Before each scene, so that a run that is killed leaves all but one of them.
        out.write_summary(&results)?;
        let left = left(start.elapsed(), i as f64, count as f64);
        files::remark(&format!("{}: scene {} of {count}{left}", entry.label, i + 1));
        let (run, points) = pool.install(|| bench.scene(entry))?;
        results.scenes.push(run);
        results.accuracy.extend(points);
    }
    if let Some(journal) = bench.journals.points.as_mut().filter(|_| args.scenes.is_empty()) {
        // Knobs without a scene are measured last, and again.
        results.accuracy.extend(pool.install(|| accuracy::alone(&args.effort(0), journal))?);
    }
    results.interrupted = interrupt::requested();
    let written = out.write(&results, baseline.as_ref());
    interrupt::say_how_to_go_on(&format!("{} --resume", results.settings.command));
    written
}

/// The earlier run in the same folder, if there is one, made with the same settings.
fn earlier(out: &Output, now: &Results) -> Result<Option<Saved>> {
    let folder = out.file("");
    if !out.file("summary.json").exists() {
        files::remark(&format!("note: {} holds no run to resume; starting a new one", folder.display()));
        return Ok(None);
    }
    let saved = saved::load(&folder)?;
    saved.ensure_same(now, &folder)?;
    Ok(Some(saved))
}

/// Gives the entries what an earlier run has measured of them, and returns the points of accuracy of
/// those that it finished.
fn take_over(mut saved: Saved, entries: &mut [Entry], settings: &Settings) -> Vec<Point> {
    for entry in &mut *entries {
        entry.finished = saved.finished(&entry.label);
        if entry.finished.is_none() {
            let strategies = match entry.supplement {
                true => supplement_strategies(&entry.label).len(),
                false => settings.strategies.len(),
            };
            entry.begun = saved.begun(&entry.label, strategies);
        }
    }
    let is_kept = |point: &Point| entries.iter().any(|e| e.finished.is_some() && e.label == point.scene);
    saved.results.accuracy.into_iter().filter(is_kept).collect()
}

/// The scenes asked for. Names are checked and files loaded before anything is measured.
fn entries(args: &Args) -> Result<Vec<Entry>> {
    let all = args.default_scenes();
    let sources = if args.scenes.is_empty() { &all } else { &args.scenes };
    ensure!(
        args.clip.is_none() || !args.scenes.is_empty(),
        "--clip chooses from a glTF file: name the file with --scene"
    );
    let mut entries: Vec<Entry> = Vec::new();
    for source in sources {
        let label = stage::label(source);
        let loaded = match &args.clip {
            Some(_) => Some(args.load(source)?),
            None => stage::load_first(source, || args.load(source))?,
        };
        // Two files may share a name, but not a row or a picture.
        let taken = |name: &str| entries.iter().any(|e| stage::slug(&e.label) == stage::slug(name));
        let mut names = (1..).map(|n| if n == 1 { label.clone() } else { format!("{label}-{n}") });
        let label = names.find(|name| !taken(name)).unwrap_or(label);
        entries.push(Entry::new(source, label, loaded, false));
    }
    let chosen = args.contestants();
    let runs = |name: &&str| chosen.iter().any(|c| c.name == *name);
    for (scene, others) in [(MUSEUM, &OTHER_KEYS[..]), (RIGID, &[BLENDED])] {
        for &label in others.iter().filter(|_| args.runs(Experiment::Claims)) {
            let has = |label: &str| entries.iter().any(|e| e.label == label);
            if supplement_strategies(label).iter().all(runs) && has(scene) && !has(label) {
                entries.push(Entry::new(label, label.to_owned(), None, true));
            }
        }
    }
    Ok(entries)
}

/// The files that rows go to while they are measured.
struct Journals {
    frames: Journal<Row>,
    speeds: Option<Journal<Row>>,
    points: Option<Journal<Point>>,
    peers: Option<Journal<Peer>>,
}

impl Journals {
    /// New files with what was measured before.
    fn open(args: &Args, out: &Output, entries: &[Entry], points: &[Point]) -> Result<Self> {
        let rows = |of_speeds| entries.iter().flat_map(move |entry| entry.rows(of_speeds));
        let any_speeds = entries.iter().any(|entry| args.runs_speeds(&entry.label));
        let peers = entries.iter().filter_map(|e| e.finished.as_ref()).flat_map(|run| &run.peers);
        let [accuracy, beside] = [Experiment::Accuracy, Experiment::Peers].map(|e| args.runs(e));
        Ok(Self {
            frames: Journal::create(&out.file("frames.csv"), rows(false))?,
            speeds: Journal::if_wanted(any_speeds, &out.file("fig5.csv"), rows(true))?,
            points: Journal::if_wanted(accuracy, &out.file("accuracy.csv"), points)?,
            peers: Journal::if_wanted(beside, &out.file("peers.csv"), peers)?,
        })
    }
}

/// What scenes are measured with.
struct Bench<'a> {
    args: &'a Args,
    settings: Settings,
    out: &'a Output,
    embree: Option<Device>,
    journals: Journals,
}

impl Bench<'_> {
    /// Measures everything on a scene that was asked for.
    fn scene(&mut self, entry: Entry) -> Result<(SceneRun, Vec<Point>)> {
        let args = self.args;
        let Entry { source, label, loaded, supplement, begun: [begun, begun_speeds], .. } = entry;
        let (mut stage, build_ms) = stage::timed(loaded.map_or_else(|| args.load(&source), Ok)?)?;
        let plan = self.plan(stage.triangles().indices.len(), supplement.then_some(label.as_str()));
        let mut run = SceneRun::new(SceneFacts { supplement, ..facts(&stage, build_ms, &plan, label) });
        let mut points = Vec::new();
        if args.runs_frames() {
            self.frames(&mut run, &mut stage, &plan, begun)?;
        }
        if args.runs_speeds(&run.facts.label) {
            self.speeds(&mut run, &mut stage, &plan, begun_speeds)?;
        }
        let for_claims = args.runs(Experiment::Claims) && !supplement;
        if for_claims && run.moves() && !interrupt::requested() {
            let (settled, memory) = settle::measure(&mut stage, plan.values.frames)?;
            (run.facts.settled, run.facts.memory) = (Some(settled), Some(memory));
        }
        if for_claims && run.facts.triangles <= plan.values.offline && !interrupt::requested() {
            run.offline = offline::measure(&mut stage, plan.values.size)?;
        }
        if args.runs(Experiment::Effects) && !supplement && !interrupt::requested() {
            run.facts.effect_costs = effects::measure(&source, args.clip.as_deref(), EFFECTS)?.0;
        }
        let label = run.facts.label.as_str();
        if let Some(journal) =
            self.journals.points.as_mut().filter(|_| !supplement && args.measures_accuracy_of(label))
        {
            points = accuracy::of_scene(label, &mut stage, &args.effort(run.facts.triangles), journal)?;
        }
        if let Some(journal) = self.journals.peers.as_mut().filter(|_| !supplement && !interrupt::requested())
        {
            let Values { peer_frames, size, .. } = plan.values;
            run.peers =
                compare::beside(label, &mut stage, plan.threads, peer_frames, size, self.embree.clone())?;
            journal.append(&run.peers)?;
        }
        run.facts.finished = !interrupt::requested();
        run.summarise(&self.settings.strategies);
        Ok((run, points))
    }

    fn plan(&self, triangles: usize, supplement: Option<&str>) -> Plan {
        let mut values = self.args.values();
        let mut contestants = self.args.contestants();
        contestants.retain(|c| !c.method.knows_animation() || triangles <= values.prepared);
        if let Some(label) = supplement {
            contestants.retain(|c| supplement_strategies(label).contains(&c.name));
            values.pictures = 0;
        }
        let Settings { threads, seed, .. } = self.settings;
        Plan { contestants, values, measure_every: values.interval(triangles), threads, seed }
    }

    /// Figures 4 and 6: all strategies, side by side.
    fn frames(&mut self, run: &mut SceneRun, stage: &mut Stage, plan: &Plan, begun: Vec<Row>) -> Result<()> {
        let SceneRun { facts, pictures: taken, .. } = run;
        let [size, map_size] = plan.values.picture_size;
        facts.hottest = pictures::hottest(stage, map_size);
        let take = |stage: &mut Stage, trees: &[Named<'_>], frame: usize| {
            let Some((_, tree)) = trees.first() else { return Ok(()) };
            let (file, path) = self.out.picture(&facts.label, frame, None);
            let bytes = pictures::picture(stage, tree, size, &path)?;
            taken.push(Picture { frame, strategy: None, file, bytes });
            for (name, tree) in trees.iter().filter(|(name, _)| pictures::HEAT_MAPS.contains(name)) {
                let (file, path) = self.out.picture(&facts.label, frame, Some(name));
                let bytes = pictures::heat_map(stage, tree, map_size, facts.hottest, &path)?;
                taken.push(Picture { frame, strategy: Some((*name).to_owned()), file, bytes });
            }
            Ok(())
        };
        if let Some(Row { round, frame, .. }) = begun.last() {
            facts.notes.push(format!(
                "resumed after loop {round}, frame {frame}: pictures of strategies up to there were compared in the run before"
            ));
        }
        let log = Log { done: begun, journal: &mut self.journals.frames };
        let (rows, checks) = protocol::measure(&facts.label, stage, plan, log, take)?;
        run.rows = rows;
        run.checks.add(&checks);
        Ok(())
    }

    /// Figure 5: one strategy, the same motion in fewer or more frames.
    fn speeds(
        &mut self,
        run: &mut SceneRun,
        stage: &mut Stage,
        plan: &Plan,
        mut begun: Vec<Row>,
    ) -> Result<()> {
        let Some(journal) = &mut self.journals.speeds else { return Ok(()) };
        let mut contestants = Contestant::all();
        contestants.retain(|c| SPEED_STRATEGIES.contains(&c.name));
        for frames in SPEEDS.into_iter().take_while(|_| !interrupt::requested()) {
            // As many samples of each, unless every frame is asked for.
            let measure_every = if plan.measure_every == 1 { 1 } else { frames / SPEEDS[0] };
            let values = Values { frames, loops: plan.values.speed_loops, pictures: 0, ..plan.values };
            let plan = Plan { contestants: contestants.clone(), values, measure_every, ..*plan };
            let done = begun.extract_if(.., |row| row.frames_per_loop == frames).collect();
            let log = Log { done, journal };
            let (rows, checks) = protocol::measure(&run.facts.label, stage, &plan, log, |_, _, _| Ok(()))?;
            run.speeds.push((frames, rows));
            run.checks.add(&checks);
        }
        Ok(())
    }
}

fn facts(stage: &Stage, build_ms: f64, plan: &Plan, label: String) -> SceneFacts {
    let scene = &stage.scene;
    let stats = bvh_core::stats(&stage.first_tree);
    SceneFacts {
        slug: stage::slug(&label),
        label,
        about: scene.about.to_owned(),
        triangles: stats.primitives,
        moving: scene.animation.topology().moves.iter().filter(|&&moves| moves).count(),
        plan: stage.plan().stages().map(|s| s.name().to_owned()).collect(),
        key_bytes: scene.key_bytes,
        measures: scene.measures.iter().map(|m| (m.name.clone(), m.value)).collect(),
        effects: scene.effects.names().map(str::to_owned).collect(),
        frames: plan.values.frames,
        measure_every: plan.measure_every,
        build_ms,
        candidates: stats.candidates as f64 / (stats.inner + stats.leaves).max(1) as f64,
        notes: scene.notes.clone(),
        ..SceneFacts::default()
    }
}
