//! `cargo xtask reproduce`: the paper's experiments, rerun and judged.

mod chart;
mod check;
mod claims;
mod contestants;
mod figures;
mod preset;
mod protocol;
mod record;
mod report;
mod results;
mod summary;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use rayon::ThreadPool;
use scenes::Scene;

use self::check::Checks;
use self::figures::Figure;
use self::preset::{Preset, Values};
use self::protocol::Plan;
use self::record::Records;
use self::results::{Picture, Results, SceneFacts, SceneRun, Settings};
use crate::machine::{Machine, Revision};
use crate::stage::{self, Stage};
use crate::{CheckFailed, files, interrupt, pool};

pub(crate) use self::contestants::Contestant;

/// The experiments there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Experiment {
    /// Time to update, by scene and strategy.
    Fig4,
    /// Refitting with rotations at 20, 100 and 500 frames a loop.
    Fig5,
    /// Frame time and SAH cost over frames, by scene and strategy.
    Fig6,
    /// The paper's claims, judged from all of these.
    Claims,
}

impl Experiment {
    fn name(self) -> &'static str {
        match self {
            Self::Fig4 => "fig4",
            Self::Fig5 => "fig5",
            Self::Fig6 => "fig6",
            Self::Claims => "claims",
        }
    }
}

/// Frames in a loop in figure 5.
const SPEEDS: [usize; 3] = [20, 100, 500];
/// The scene of figure 5.
const SPEED_SCENE: &str = "exploding-dragon";
/// The strategy of figure 5.
const SPEED_STRATEGY: &str = "refit+rotate";
/// Most pixels on a side of the report's pictures.
const PICTURE_SIZE: u32 = 400;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// What to rerun; everything if nothing is named
    #[arg(value_name = "EXPERIMENT")]
    experiments: Vec<Experiment>,
    /// How much: quick takes under a minute, standard under ten, full is the paper's protocol
    #[arg(long, value_enum, default_value_t = Preset::Standard)]
    preset: Preset,
    /// A scene's name, a .glb, .gltf, .obj or .ply file, or a folder of key frames; repeatable [default: all]
    #[arg(long = "scene", value_name = "NAME|FILE|DIR")]
    scenes: Vec<String>,
    /// A strategy's name, as `list` gives them; repeatable [default: all]
    #[arg(long = "strategy", value_name = "NAME", value_parser = Contestant::from_name)]
    strategies: Vec<Contestant>,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    clip: Option<String>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Frames in a loop [default: by preset]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Loops, not necessarily whole [default: by preset]
    #[arg(long, value_name = "X", value_parser = loops)]
    loops: Option<f64>,
    /// Pixels on each side of the image [default: by preset]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Option<u32>,
    /// Threads for updates and rendering [default: the paper's 8, or the cores there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Folder for the results [default: target/reproduce]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Args {
    /// The preset's settings with those given in their place.
    fn values(&self) -> Values {
        let preset = self.preset.values();
        Values {
            frames: self.frames.map_or(preset.frames, |n| n as usize),
            loops: self.loops.unwrap_or(preset.loops),
            speed_loops: self.loops.unwrap_or(preset.speed_loops),
            size: self.size.unwrap_or(preset.size),
            ..preset
        }
    }

    fn load(&self, source: &str) -> Result<Scene> {
        stage::load_at(source, self.clip.as_deref(), self.seed, self.preset.values().detail)
    }
}

fn loops(text: &str) -> Result<f64, String> {
    let loops: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if loops > 0.0 && loops <= 1000.0 {
        Ok(loops)
    } else {
        Err("must be above 0 and at most 1000".to_owned())
    }
}

/// A scene to run: not loaded until its turn comes, unless it is a file, which may be broken.
struct Entry {
    source: String,
    label: String,
    slug: String,
    loaded: Option<Scene>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let entries = entries(args)?;
    let out = args.out.clone().unwrap_or_else(|| files::workspace().join("target/reproduce"));
    let out = Output::prepare(out)?;
    let mut results = Results {
        machine: Machine::read(),
        revision: Revision::read(),
        settings: settings(args),
        scenes: Vec::new(),
        interrupted: false,
    };
    let pool = pool::pool(results.settings.threads)?;
    let mut records = Records::create(&out.file("frames.csv"))?;
    let mut speed_records =
        runs_speeds(args, &entries).then(|| Records::create(&out.file("fig5.csv"))).transpose()?;
    for entry in entries {
        if interrupt::requested() {
            break;
        }
        let speeds = speed_records.as_mut().filter(|_| is_speed_scene(args, &entry.label));
        let scene = run_scene(args, entry, &results.settings, &pool, &out, &mut records, speeds)?;
        results.scenes.push(scene);
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
        let is_built_in = all.contains(source);
        let loaded = (!is_built_in || args.clip.is_some()).then(|| args.load(source)).transpose()?;
        // Two files may share a name, but not a row or a picture.
        let taken = |label: &str| entries.iter().any(|e| e.label == label || e.slug == stage::slug(label));
        let mut names = (1..).map(|n| if n == 1 { label.clone() } else { format!("{label}-{n}") });
        let label = names.find(|name| !taken(name)).unwrap_or(label);
        entries.push(Entry { source: source.clone(), slug: stage::slug(&label), label, loaded });
    }
    Ok(entries)
}

fn settings(args: &Args) -> Settings {
    let experiments =
        if args.experiments.is_empty() { Experiment::value_variants() } else { &args.experiments };
    let strategies = if args.strategies.is_empty() { Contestant::all() } else { args.strategies.clone() };
    let values = args.values();
    Settings {
        preset: args.preset.name(),
        experiments: experiments.iter().map(|e| e.name()).collect(),
        strategies: strategies.iter().map(|c| c.name).collect(),
        loops: values.loops,
        size: values.size,
        threads: args.threads.map_or_else(pool::default_threads, |n| n as usize),
        seed: args.seed,
        reductions: values.reductions(),
        command: command(),
    }
}

/// The command line as it was given.
fn command() -> String {
    let quoted = std::env::args().skip(1).map(|word| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=,:".contains(c);
        if !word.is_empty() && word.chars().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    });
    format!("cargo xtask {}", quoted.collect::<Vec<_>>().join(" "))
}

/// Whether figure 5 is to be run on that scene: on its own, and on any other if it is asked for by name.
fn is_speed_scene(args: &Args, label: &str) -> bool {
    let wanted = |e| args.experiments.contains(&e);
    if wanted(Experiment::Fig5) {
        return label == SPEED_SCENE || !args.scenes.is_empty();
    }
    let by_default = wanted(Experiment::Claims) || args.experiments.is_empty() && args.preset.values().speeds;
    by_default && label == SPEED_SCENE
}

fn runs_speeds(args: &Args, entries: &[Entry]) -> bool {
    entries.iter().any(|entry| is_speed_scene(args, &entry.label))
}

/// Whether anything but figure 5 is asked for.
fn runs_frames(args: &Args) -> bool {
    args.experiments.is_empty() || args.experiments.iter().any(|&e| e != Experiment::Fig5)
}

fn run_scene(
    args: &Args,
    entry: Entry,
    settings: &Settings,
    pool: &ThreadPool,
    out: &Output,
    records: &mut Records,
    speed_records: Option<&mut Records>,
) -> Result<SceneRun> {
    let Entry { source, label, slug, loaded } = entry;
    eprintln!("{label}");
    let scene = loaded.map_or_else(|| args.load(&source), Ok)?;
    let values = args.values();
    pool.install(|| {
        let mut stage = Stage::new(scene)?;
        let triangles = stage.triangles().indices.len();
        let mut plan = Plan {
            contestants: settings.strategies.iter().filter_map(|s| Contestant::from_name(s).ok()).collect(),
            frames: values.frames,
            loops: settings.loops,
            rebuild_every: values.rebuild_interval(triangles),
            size: settings.size,
            threads: settings.threads,
            check_frames: values.check_frames,
            check_rays: values.check_rays,
            seed: settings.seed,
        };
        let facts = facts(&stage, &plan, label, slug);
        let mut run = SceneRun {
            facts,
            pictures: Vec::new(),
            rows: Vec::new(),
            speeds: Vec::new(),
            checks: Checks::default(),
        };
        if runs_frames(args) {
            let (pictures, slug) = (&mut run.pictures, &run.facts.slug);
            let take = |stage: &mut Stage, tree: &bvh_core::Bvh, step: usize| {
                if step < plan.frames && protocol::is_sampled(step, plan.frames, values.pictures) {
                    pictures.push(take_picture(stage, tree, &plan, step, slug, out)?);
                }
                Ok(())
            };
            let (rows, checks) = protocol::measure(&run.facts.label, &mut stage, &plan, records, take)?;
            run.rows = rows;
            run.checks.add(&checks);
        }
        if let Some(records) = speed_records {
            plan.contestants.retain(|c| c.name == SPEED_STRATEGY);
            plan.contestants.extend(
                plan.contestants.is_empty().then(|| Contestant::from_name(SPEED_STRATEGY).ok()).flatten(),
            );
            plan.loops = values.speed_loops;
            for frames in SPEEDS {
                plan.frames = frames;
                let label = &run.facts.label;
                let (rows, checks) = protocol::measure(label, &mut stage, &plan, records, |_, _, _| Ok(()))?;
                run.speeds.push((frames, rows));
                run.checks.add(&checks);
            }
        }
        Ok(run)
    })
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
        effects: scene.effects.row().into_iter().filter_map(|(name, on)| on.then_some(name)).collect(),
        frames: plan.frames,
        rebuild_every: plan.rebuild_every,
        build_ms: stage.build_ms,
        candidates: stats.candidates as f64 / (stats.inner + stats.leaves).max(1) as f64,
        notes: scene.notes.clone(),
    }
}

fn take_picture(
    stage: &mut Stage,
    tree: &bvh_core::Bvh,
    plan: &Plan,
    frame: usize,
    slug: &str,
    out: &Output,
) -> Result<Picture> {
    let file = format!("{slug}-{frame:04}.png");
    let size = plan.size.clamp(PICTURE_SIZE.min(240), PICTURE_SIZE);
    let png = protocol::picture(stage, tree, size, &out.file("images").join(&file))?;
    Ok(Picture { frame, file, png })
}

/// Whether a file's name is one that [`take_picture`] gives.
fn is_picture(name: &str) -> bool {
    let number = name.strip_suffix(".png").and_then(|stem| stem.rsplit_once('-'));
    number.is_some_and(|(_, n)| n.len() >= 4 && n.bytes().all(|b| b.is_ascii_digit()))
}

/// The folder of results.
struct Output {
    folder: PathBuf,
}

impl Output {
    /// Makes the folder, and removes what would be mistaken for this run's results if it were interrupted.
    fn prepare(folder: PathBuf) -> Result<Self> {
        let out = Self { folder };
        for folder in [out.folder.clone(), out.file("figures"), out.file("images")] {
            files::make_folder(&folder)?;
        }
        for name in ["report.html", "summary.json", "fig5.csv"] {
            files::remove_old(&out.file(name))?;
        }
        files::remove_all(&out.file("figures"), |name| name.starts_with("fig") && name.ends_with(".svg"))?;
        files::remove_all(&out.file("images"), is_picture)?;
        Ok(out)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes figures, summary and report, and says what came out.
    fn write(&self, results: &Results) -> Result<()> {
        let claims = claims::judge(results);
        let figures = figures::files(results);
        for Figure { name, svg } in &figures {
            files::write_whole(&self.file("figures").join(format!("{name}.svg")), svg.as_bytes())?;
        }
        let summary = summary::json(results, &claims).context("the summary cannot be written as JSON")?;
        files::write_whole(&self.file("summary.json"), summary.as_bytes())?;
        let report = self.file("report.html");
        files::write_whole(&report, report::html(results, &claims).as_bytes())?;

        let checks = results.checks();
        let text = format!(
            "{}\n{}\n{}",
            summary::claims_in_lines(&claims),
            summary::checks_in_words(&checks),
            files::shown(&report)
        );
        files::print(&text)?;
        match checks.first_difference {
            Some(first) => {
                let count = checks.differences;
                Err(CheckFailed(format!("strategies disagree, {count} times, first {first}")).into())
            }
            None => Ok(()),
        }
    }
}
