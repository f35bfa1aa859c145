//! `cargo xtask reproduce`: the paper's experiments, rerun and judged.

mod accuracy;
mod chart;
mod check;
mod claims;
mod contestants;
mod figures;
mod options;
mod output;
mod preset;
mod protocol;
mod record;
mod report;
mod results;
mod stages;
mod summary;

use anyhow::{Result, ensure};
use bvh_core::Bvh;
use scenes::Scene;

use self::output::Output;
use self::protocol::Plan;
use self::record::Records;
use self::results::{Picture, Results, SceneFacts, SceneRun, Settings};
use crate::machine::{Machine, Revision};
use crate::stage::{self, Stage};
use crate::{interrupt, pool};

pub(crate) use self::contestants::Contestant;
pub(crate) use self::options::Args;
pub(crate) use self::protocol::picture;

/// Frames in a loop in figure 5.
const SPEEDS: [usize; 3] = [20, 100, 500];
/// The strategy of figure 5.
const SPEED_STRATEGY: &str = "refit+rotate";
/// Pixels on a side of the report's pictures, at least and at most.
const PICTURE_SIZE: (u32, u32) = (240, 400);

/// A scene to run: not loaded until its turn comes, unless it is a file, which may be broken.
struct Entry {
    source: String,
    label: String,
    slug: String,
    loaded: Option<Scene>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let entries = entries(args)?;
    let out = Output::prepare(args.out())?;
    let mut results = Results {
        machine: Machine::read(),
        revision: Revision::read(),
        settings: args.settings(),
        scenes: Vec::new(),
        interrupted: false,
    };
    let pool = pool::pool(results.settings.threads)?;
    let mut records = Records::create(&out.file("frames.csv"))?;
    let any_speeds = entries.iter().any(|entry| args.runs_speeds(&entry.label));
    let mut speed_records = any_speeds.then(|| Records::create(&out.file("fig5.csv"))).transpose()?;
    let mut accuracy_log =
        args.runs_accuracy().then(|| accuracy::Log::create(&out.file("accuracy.csv"))).transpose()?;
    for entry in entries {
        if interrupt::requested() {
            break;
        }
        eprintln!("{}", entry.label);
        let scene = entry.loaded.map_or_else(|| args.load(&entry.source), Ok)?;
        let run = pool.install(|| {
            let mut stage = Stage::new(scene)?;
            let plan = plan(args, &results.settings, stage.triangles().indices.len());
            let mut run = SceneRun::new(facts(&stage, &plan, entry.label, entry.slug));
            if args.runs_frames() {
                run_frames(&mut run, &mut stage, &plan, args.values().pictures, &mut records, &out)?;
            }
            if let Some(records) = speed_records.as_mut().filter(|_| args.runs_speeds(&run.facts.label)) {
                run_speeds(&mut run, &mut stage, &plan, args.values().speed_loops, records)?;
            }
            if let Some(log) = &mut accuracy_log {
                let label = &run.facts.label;
                run.accuracy = accuracy::measure(label, &entry.source, &mut stage, &args.effort(), log)?;
            }
            Ok::<_, anyhow::Error>(run)
        })?;
        results.scenes.push(run);
    }
    results.interrupted = interrupt::requested();
    out.write(&results)
}

/// The scenes asked for. Names are checked and files loaded before anything is measured.
fn entries(args: &Args) -> Result<Vec<Entry>> {
    let all: Vec<String> = scenes::list().iter().map(|info| info.name.to_owned()).collect();
    let sources = if args.scenes.is_empty() { &all } else { &args.scenes };
    ensure!(
        args.clip.is_none() || !args.scenes.is_empty(),
        "--clip chooses from a glTF file: name the file with --scene"
    );
    let mut entries: Vec<Entry> = Vec::new();
    for source in sources {
        let label = stage::label(source);
        let is_file = !all.contains(source);
        let loaded = (is_file || args.clip.is_some()).then(|| args.load(source)).transpose()?;
        // Two files may share a name, but not a row or a picture.
        let taken = |label: &str| entries.iter().any(|e| e.label == label || e.slug == stage::slug(label));
        let mut names = (1..).map(|n| if n == 1 { label.clone() } else { format!("{label}-{n}") });
        let label = names.find(|name| !taken(name)).unwrap_or(label);
        entries.push(Entry { source: source.clone(), slug: stage::slug(&label), label, loaded });
    }
    Ok(entries)
}

fn plan(args: &Args, settings: &Settings, triangles: usize) -> Plan {
    let values = args.values();
    Plan {
        contestants: args.contestants(),
        frames: values.frames,
        loops: values.loops,
        rebuild_every: values.rebuild_interval(triangles),
        size: values.size,
        threads: settings.threads,
        check_frames: values.check_frames,
        check_rays: values.check_rays,
        seed: settings.seed,
    }
}

fn facts(stage: &Stage, plan: &Plan, label: String, slug: String) -> SceneFacts {
    let scene = &stage.scene;
    let stats = bvh_core::stats(&stage.first_tree);
    SceneFacts {
        label,
        slug,
        about: scene.about.to_owned(),
        triangles: stats.primitives,
        moving: scene.animation.topology().moves.iter().filter(|&&moves| moves).count(),
        plan: stage.plan.stages().iter().map(|s| s.name()).collect(),
        key_bytes: scene.key_bytes,
        measures: scene.measures.iter().map(|m| (m.name.clone(), m.value)).collect(),
        effects: scene.effects.row().into_iter().filter_map(|(name, on)| on.then_some(name)).collect(),
        frames: plan.frames,
        rebuild_every: plan.rebuild_every,
        build_ms: stage.build_ms,
        candidates: stats.candidates as f64 / (stats.inner + stats.leaves).max(1) as f64,
        notes: scene.notes.clone(),
    }
}

/// Figures 4 and 6: all strategies, side by side.
fn run_frames(
    run: &mut SceneRun,
    stage: &mut Stage,
    plan: &Plan,
    pictures: usize,
    records: &mut Records,
    out: &Output,
) -> Result<()> {
    let SceneRun { facts, pictures: taken, .. } = run;
    let (least, most) = PICTURE_SIZE;
    let size = plan.size.clamp(least, most);
    let take = |stage: &mut Stage, tree: &Bvh, step: usize| {
        if step < plan.frames && protocol::is_sampled(step, plan.frames, pictures) {
            let (file, path) = out.picture(&facts.slug, step);
            let png = picture(stage, tree, size, &path)?;
            taken.push(Picture { frame: step, file, png });
        }
        Ok(())
    };
    let (rows, checks) = protocol::measure(&facts.label, stage, plan, records, take)?;
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
    records: &mut Records,
) -> Result<()> {
    let contestants: Vec<_> = Contestant::all().into_iter().filter(|c| c.name == SPEED_STRATEGY).collect();
    for frames in SPEEDS {
        let plan = Plan { contestants: contestants.clone(), frames, loops, ..plan.clone() };
        let (rows, checks) = protocol::measure(&run.facts.label, stage, &plan, records, |_, _, _| Ok(()))?;
        run.speeds.push((frames, rows));
        run.checks.add(&checks);
    }
    Ok(())
}
