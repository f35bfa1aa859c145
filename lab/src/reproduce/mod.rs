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
use scenes::Scene;

use self::accuracy::Point;
use self::journal::Journal;
use self::output::Output;
use self::protocol::{Log, Named, Plan};
use self::record::Row;
use self::results::{Picture, Results, SceneFacts, SceneRun, Settings};
use self::saved::Saved;
use crate::machine::{Machine, Revision};
use crate::progress::left;
use crate::stage::{self, Stage};
use crate::{compare, files, interrupt, pool};

pub(crate) use self::contestants::Contestant;
pub use self::options::Args;

/// Frames in a loop in figure 5.
const SPEEDS: [usize; 3] = [20, 100, 500];
/// The strategy of figure 5.
const SPEED_STRATEGY: &str = "refit+rotate";
/// What runs for it: that, and its strongest rival to compare with.
const SPEED_STRATEGIES: [&str; 2] = [SPEED_STRATEGY, contestants::IDEAL_PARALLEL_BINNED];
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

/// What runs on a scene that serves one claim only.
fn supplement_strategies(label: &str) -> &'static [&'static str] {
    if label == BLENDED { &BLENDED_STRATEGIES } else { &KEY_STRATEGIES }
}

/// A scene to run: not loaded until its turn comes, unless it is a file, which may be broken.
struct Entry {
    source: String,
    label: String,
    slug: String,
    loaded: Option<Scene>,
    /// Whether it serves one claim only.
    supplement: bool,
}

impl Entry {
    /// What it may take beside the others: in proportion to its triangles, and something for any.
    fn weight(&self, detail: Option<f32>) -> f64 {
        const ANY: f64 = 50_000.0;
        let known = scenes::list().iter().find(|info| info.name == self.source);
        let detail = detail.filter(|_| known.is_some_and(|info| info.effects.motion.gravity)).unwrap_or(1.0);
        let loaded = self.loaded.as_ref().map(|scene| scene.animation.topology().triangles.len());
        let triangles = loaded.or(known.map(|info| info.triangles)).unwrap_or(0);
        // Few strategies run on it then.
        let part = if self.supplement { 0.15 } else { 1.0 };
        part * (ANY + f64::from(detail) * triangles as f64)
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
    let entries = entries(args)?;
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
    let mut saved = args.resume.then(|| earlier(&out, &results)).transpose()?.flatten();
    let pool = pool::pool(results.settings.threads)?;

    // What is kept of an earlier run: scenes that were finished, and rows of one that was not.
    let mut kept = Vec::new();
    for entry in &entries {
        let finished = saved.as_mut().and_then(|saved| saved.finished(&entry.label));
        let strategies = match entry.supplement {
            true => supplement_strategies(&entry.label).len(),
            false => results.settings.strategies.len(),
        };
        let begun = saved.as_mut().filter(|_| finished.is_none());
        let begun = begun.map(|saved| saved.begun(&entry.label, strategies));
        kept.push((finished, begun.unwrap_or_default()));
    }
    let rows = |of: usize| -> Vec<Row> {
        let all = kept.iter().flat_map(|(finished, begun)| match (finished, of) {
            (Some(run), 0) => run.rows.clone(),
            (Some(run), _) => run.speeds.iter().flat_map(|(_, rows)| rows.clone()).collect(),
            (None, _) => begun[of].clone(),
        });
        all.collect()
    };
    if saved.is_none() {
        // First of all: with new rows beside it, it would name scenes as finished that have none.
        files::remove_old(&out.file("summary.json"))?;
    }
    let finished = || kept.iter().flat_map(|(finished, _)| finished);
    let any_speeds = entries.iter().any(|entry| args.runs_speeds(&entry.label));
    let mut frames = Journal::create(&out.file("frames.csv"), &rows(0))?;
    let mut speeds = Journal::if_wanted(any_speeds, &out.file("fig5.csv"), &rows(1))?;
    // Knobs without a scene are measured last, and again.
    let earlier = saved.map_or(Vec::new(), |saved| saved.results.accuracy);
    let is_kept = |point: &Point| finished().any(|run| run.facts.label == point.scene);
    results.accuracy = earlier.into_iter().filter(is_kept).collect();
    let mut points = Journal::if_wanted(args.runs_accuracy(), &out.file("accuracy.csv"), &results.accuracy)?;
    let beside = finished().flat_map(|run| &run.peers);
    let mut beside = Journal::if_wanted(args.runs_peers(), &out.file("peers.csv"), beside)?;

    let weights: Vec<f64> = entries.iter().map(|entry| entry.weight(args.values().detail)).collect();
    let (start, mut done) = (Instant::now(), 0.0);
    for (i, (entry, (finished, begun))) in entries.into_iter().zip(kept).enumerate() {
        if interrupt::requested() {
            break;
        }
        if let Some(finished) = finished {
            results.scenes.push(finished);
            continue;
        }
        // Before each scene, so that a run that is killed leaves all but one of them.
        out.write_summary(&results)?;
        let to_do: f64 = weights[i..].iter().sum();
        let left = left(start.elapsed(), done, done + to_do);
        files::remark(&format!("{}: scene {} of {}{left}", entry.label, i + 1, weights.len()));
        done += weights[i];
        let scene = entry.loaded.map_or_else(|| args.load(&entry.source), Ok)?;
        let run = pool.install(|| {
            let (mut stage, build_ms) = stage::timed(scene)?;
            let supplement = entry.supplement.then_some(entry.label.as_str());
            let plan = plan(args, &results.settings, stage.triangles().indices.len(), supplement);
            let mut run = SceneRun::new(facts(&stage, build_ms, &plan, entry.label, entry.slug));
            run.facts.supplement = entry.supplement;
            let [begun, begun_speeds] = begun;
            if args.runs_frames() {
                let mut log = Log { done: begun, journal: &mut frames };
                run_frames(&mut run, &mut stage, &plan, args, &mut log, &out)?;
            }
            if let Some(journal) = speeds.as_mut().filter(|_| args.runs_speeds(&run.facts.label)) {
                let mut log = Log { done: begun_speeds, journal };
                run_speeds(&mut run, &mut stage, &plan, args.values().speed_loops, &mut log)?;
            }
            let for_claims = args.runs_claims() && !entry.supplement;
            if for_claims && run.moves() && !interrupt::requested() {
                let (settled, memory) = settle::measure(&mut stage, plan.frames)?;
                (run.facts.settled, run.facts.memory) = (Some(settled), Some(memory));
            }
            if for_claims && run.facts.triangles <= args.values().offline && !interrupt::requested() {
                run.offline = offline::measure(&mut stage, plan.size)?;
            }
            if let Some(journal) =
                points.as_mut().filter(|_| !entry.supplement && args.measures_accuracy_of(&run.facts.label))
            {
                let effort = args.effort(run.facts.triangles);
                results.accuracy.extend(accuracy::of_scene(&run.facts.label, &mut stage, &effort, journal)?);
            }
            if let Some(journal) = beside.as_mut().filter(|_| !entry.supplement && !interrupt::requested()) {
                let (threads, frames) = (plan.threads, args.values().peer_frames);
                run.peers = compare::beside(
                    &run.facts.label,
                    &mut stage,
                    threads,
                    frames,
                    plan.size,
                    embree.clone(),
                )?;
                journal.append(&run.peers)?;
            }
            Ok::<_, anyhow::Error>(run)
        })?;
        results.scenes.push(run);
        if let Some(run) = results.scenes.last_mut() {
            run.facts.finished = !interrupt::requested();
        }
    }
    if let Some(journal) = points.as_mut().filter(|_| args.scenes.is_empty()) {
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
        let taken = |label: &str| entries.iter().any(|e| e.label == label || e.slug == stage::slug(label));
        let mut names = (1..).map(|n| if n == 1 { label.clone() } else { format!("{label}-{n}") });
        let label = names.find(|name| !taken(name)).unwrap_or(label);
        let (source, slug) = (source.clone(), stage::slug(&label));
        entries.push(Entry { source, slug, label, loaded, supplement: false });
    }
    let chosen = args.contestants();
    let supplements = [(MUSEUM, &OTHER_KEYS[..]), (RIGID, &[BLENDED])];
    for (scene, others) in supplements {
        for &label in others.iter().filter(|_| args.runs_claims()) {
            let all_run =
                supplement_strategies(label).iter().all(|name| chosen.iter().any(|c| c.name == *name));
            let is_wanted =
                entries.iter().any(|e| e.label == scene) && entries.iter().all(|e| e.label != label);
            if all_run && is_wanted {
                entries.push(Entry {
                    source: label.to_owned(),
                    slug: stage::slug(label),
                    label: label.to_owned(),
                    loaded: None,
                    supplement: true,
                });
            }
        }
    }
    Ok(entries)
}

fn plan(args: &Args, settings: &Settings, triangles: usize, supplement: Option<&str>) -> Plan {
    let values = args.values();
    let mut contestants = args.contestants();
    contestants.retain(|c| !c.method.knows_animation() || triangles <= values.prepared);
    if let Some(label) = supplement {
        contestants.retain(|c| supplement_strategies(label).contains(&c.name));
    }
    Plan {
        contestants,
        frames: values.frames,
        loops: values.loops,
        measure_every: values.interval(triangles),
        size: values.size,
        threads: settings.threads,
        traversal: values.traversal,
        check_frames: values.check_frames,
        check_rays: values.check_rays,
        pictures: if supplement.is_some() { 0 } else { values.pictures },
        seed: settings.seed,
    }
}

fn facts(stage: &Stage, build_ms: f64, plan: &Plan, label: String, slug: String) -> SceneFacts {
    let scene = &stage.scene;
    let stats = bvh_core::stats(&stage.first_tree);
    SceneFacts {
        label,
        slug,
        about: scene.about.to_owned(),
        triangles: stats.primitives,
        moving: scene.animation.topology().moves.iter().filter(|&&moves| moves).count(),
        plan: stage.plan().stages().map(|s| s.name().to_owned()).collect(),
        key_bytes: scene.key_bytes,
        measures: scene.measures.iter().map(|m| (m.name.clone(), m.value)).collect(),
        effects: scene.effects.names().map(str::to_owned).collect(),
        frames: plan.frames,
        measure_every: plan.measure_every,
        build_ms,
        candidates: stats.candidates as f64 / (stats.inner + stats.leaves).max(1) as f64,
        notes: scene.notes.clone(),
        ..SceneFacts::default()
    }
}

/// Figures 4 and 6: all strategies, side by side.
fn run_frames(
    run: &mut SceneRun,
    stage: &mut Stage,
    plan: &Plan,
    args: &Args,
    log: &mut Log<'_>,
    out: &Output,
) -> Result<()> {
    let SceneRun { facts, pictures: taken, .. } = run;
    let [size, map_size] = args.values().picture_size;
    facts.hottest = pictures::hottest(stage, map_size);
    let take = |stage: &mut Stage, trees: &[Named<'_>], frame: usize| {
        let (file, path) = out.picture(&facts.slug, frame);
        let Some((_, tree)) = trees.first() else { return Ok(()) };
        let bytes = pictures::picture(stage, tree, size, &path)?;
        taken.push(Picture { frame, strategy: None, file, bytes });
        for (name, tree) in trees.iter().filter(|(name, _)| pictures::HEAT_MAPS.contains(name)) {
            let (file, path) = out.heat_map(&facts.slug, frame, name);
            let bytes = pictures::heat_map(stage, tree, map_size, facts.hottest, &path)?;
            taken.push(Picture { frame, strategy: Some((*name).to_owned()), file, bytes });
        }
        Ok(())
    };
    if let Some(last) = log.done.last() {
        let (round, frame) = (last.round, last.frame);
        facts.notes.push(format!(
            "resumed after loop {round}, frame {frame}: pictures of strategies up to there were compared in the run before"
        ));
    }
    let (rows, checks) = protocol::measure(&facts.label, stage, plan, log.take(plan.frames), take)?;
    run.rows = rows;
    run.checks.add(&checks);
    Ok(())
}

/// Figure 5: one strategy, the same motion in fewer or more frames.
fn run_speeds(
    run: &mut SceneRun,
    stage: &mut Stage,
    plan: &Plan,
    loops: f64,
    log: &mut Log<'_>,
) -> Result<()> {
    let is_run = |c: &Contestant| SPEED_STRATEGIES.contains(&c.name);
    let contestants: Vec<_> = Contestant::all().into_iter().filter(is_run).collect();
    for frames in SPEEDS {
        if interrupt::requested() {
            break;
        }
        // As many samples of each, unless every frame is asked for.
        let measure_every = if plan.measure_every == 1 { 1 } else { frames / SPEEDS[0] };
        let contestants = contestants.clone();
        let plan = Plan { contestants, frames, loops, measure_every, pictures: 0, ..plan.clone() };
        let (rows, checks) =
            protocol::measure(&run.facts.label, stage, &plan, log.take(frames), |_, _, _| Ok(()))?;
        run.speeds.push((frames, rows));
        run.checks.add(&checks);
    }
    Ok(())
}
