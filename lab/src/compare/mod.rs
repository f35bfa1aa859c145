//! `cargo xtask compare`: this project beside other libraries, in one run, on the same work, with
//! the same hits.
//!
//! All contestants of a scene live at the same time and take turns, frame by frame and in an order
//! that rotates, so that whatever else the machine does hits all of them alike. Poses are computed
//! outside of what is timed.

mod contests;
mod hard;
mod lane;
mod row;
mod table;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::slice;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use pivot_benches::embree::{Device, Embree, NotFound};
use pivot_benches::{Contest, Entry, field};
use scenes::SceneOptions;

pub(crate) use self::lane::turns;
use self::row::Report;
pub(crate) use self::row::Row;
pub(crate) use self::table::unique;
use crate::progress::left;
use crate::stage::{self, Stage};
use crate::{CheckFailed, files, interrupt, pool};

/// What to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum What {
    /// Keeping a tree up to date: refits, rotations, rebuilds
    Update,
    /// Tracing primary and shadow rays through fresh trees
    Trace,
    /// Tracing a diffuse bounce: rays that have little in common
    Incoherent,
    /// Building a tree from nothing
    Build,
    /// Updating and tracing: this project beside every dynamic configuration of Embree
    Frame,
    /// Not times but hard cases: triangles that are not finite, all alike, or exponentially spaced
    Hard,
    /// All of these but the hard cases
    All,
}

/// Scenes compared unless others are named: the motions and sizes that the update was made for.
/// Whole frames are compared on every scene: what a strategy must not do is fail on one of them.
const SCENES: [&str; 4] = ["cloth-ball", "n-body", "exploding-dragon", "lion"];
/// What each measurement is a contest of, and how many frames of a loop are measured unless a
/// number is given: more of updates and of whole frames, whose worst ones count, too.
const CONTESTS: [(What, Contest, usize); 5] = [
    (What::Update, Contest::Update, 20),
    (What::Build, Contest::Build, 5),
    (What::Trace, Contest::Trace, 5),
    (What::Incoherent, Contest::Incoherent, 5),
    (What::Frame, Contest::Frame, 20),
];
/// Pixels on each side of the traced image.
const SIZE: u32 = 1024;

/// Arguments of `compare`.
#[derive(clap::Args)]
pub struct Args {
    /// What to compare
    #[arg(value_enum, default_value_t = What::All)]
    what: What,
    /// A scene's name, a .glb, .gltf, .obj, .ply, .stl or .aff file, or a folder of .ply or .obj
    /// key frames; repeatable [default: cloth-ball, n-body, exploding-dragon, lion; all for whole
    /// frames]
    #[arg(long = "scene", value_name = "NAME|FILE|DIR")]
    scenes: Vec<String>,
    /// Only contestants whose names contain this, or with `=NAME` only that one; repeatable
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Threads; repeatable [default: 1 and as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Vec<u32>,
    /// Embree's library, version 3 or 4, or a folder with it [default: PIVOT_EMBREE, else the
    /// system's]
    #[arg(long, value_name = "PATH")]
    embree: Option<PathBuf>,
    /// File for the results
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Measure nothing: print the tables of such a file again
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scenes", "threads", "embree", "json", "frames", "runs", "size"])]
    from: Option<PathBuf>,
    /// With --from: in place of the tables, the times of both files side by side
    #[arg(long, value_name = "FILE", requires = "from")]
    beside: Option<PathBuf>,
    /// File for a chart (SVG) of the times per triangle, of the first measurement if none is named
    #[arg(long, value_name = "FILE")]
    chart: Option<PathBuf>,
    /// Frames to measure, spread over a loop that is played in full [default: 20 updates, 20 whole
    /// frames, 5 of the rest]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Times to play a loop of whole frames; each frame then counts by its median
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    runs: u32,
    /// Of the hard cases only this one, for one contestant, in this process
    #[arg(long, hide = true, requires = "contestant")]
    case: Option<String>,
    #[arg(long, hide = true, requires = "case")]
    contestant: Option<String>,
    /// Pixels on each side of the image that is traced [default: 1024]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Option<u32>,
}

/// What one measurement runs on.
#[derive(Default)]
pub(crate) struct Setting {
    /// The scene's name in tables, and its size.
    pub(crate) scene: String,
    pub(crate) triangles: usize,
    pub(crate) threads: usize,
    pub(crate) embree: Option<Device>,
    /// As [`is_named`] takes them.
    pub(crate) only: Vec<String>,
    /// Frames to measure.
    pub(crate) frames: usize,
    /// How many times a loop of whole frames is played.
    pub(crate) runs: u32,
    /// Pixels on each side of the traced image.
    pub(crate) size: u32,
}

impl Setting {
    /// Who takes part.
    fn field(&self, contest: Contest) -> Vec<Entry> {
        let mut entries = field(contest, self.embree.as_ref());
        entries.retain(|entry| is_named(&self.only, &entry.name));
        entries
    }

    /// The rows of all contestants; none of those that an interrupt has left without a frame.
    fn measure(&self, contest: Contest, stage: &mut Stage) -> Result<Vec<Row>> {
        let mut rows = match contest {
            Contest::Update | Contest::Build => contests::updates(contest, stage, self)?,
            Contest::Trace => contests::primary(stage, self)?,
            Contest::Incoherent => contests::incoherent(stage, self)?,
            Contest::Frame => contests::frames(stage, self)?,
        };
        rows.retain(|row| row.frames > 0);
        Ok(rows)
    }
}

impl What {
    /// The contests, each with how many frames are measured.
    fn contests(self) -> impl Iterator<Item = (Contest, usize)> {
        let named = CONTESTS.into_iter().filter(move |(what, ..)| [*what, Self::All].contains(&self));
        named.map(|(_, contest, frames)| (contest, frames))
    }
}

/// An error if an option is given that nothing heeds.
fn ensure_used(args: &Args) -> Result<()> {
    let what = args.what;
    let name = what.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    let (is_timed, plays) = (what != What::Hard, [What::Frame, What::All].contains(&what));
    let traces = is_timed && ![What::Update, What::Build].contains(&what);
    let timed = "update, build, trace, incoherent or frame";
    for (option, given, used, by) in [
        ("--scene", !args.scenes.is_empty(), is_timed, timed),
        ("--only", !args.only.is_empty(), is_timed, timed),
        ("--threads", !args.threads.is_empty(), is_timed, timed),
        ("--frames", args.frames.is_some(), is_timed, timed),
        ("--json", args.json.is_some(), is_timed, timed),
        ("--chart", args.chart.is_some(), is_timed, timed),
        ("--runs", args.runs > 1, plays, "frame, which plays loops"),
        ("--size", args.size.is_some(), traces, "trace, incoherent or frame, which trace an image"),
    ] {
        ensure!(!given || used, "{option}: compare {name} does not heed it; leave it out, or compare {by}");
    }
    Ok(())
}

/// Whether `--only` names a contestant: by a part of its name, or behind `=` by all of it, since
/// many names begin with another one. Without names everybody is named.
fn is_named(only: &[String], contestant: &str) -> bool {
    let is_meant = |name: &String| match name.strip_prefix('=') {
        Some(whole) => contestant == whole,
        None => contestant.contains(name.as_str()),
    };
    only.is_empty() || only.iter().any(is_meant)
}

/// An error if one of the names is nobody's.
fn ensure_known(only: &[String], contestants: &[&str]) -> Result<()> {
    for wanted in only {
        let is_known = contestants.iter().any(|name| is_named(slice::from_ref(wanted), name));
        let names = contestants.join("; ");
        ensure!(is_known, "--only {wanted}: no contestant of this name; there are {names}");
    }
    Ok(())
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    if let Some(path) = &args.from {
        return print_saved(args, path);
    }
    ensure_used(args)?;
    if args.what == What::Hard {
        return match (&args.case, &args.contestant) {
            (Some(case), Some(contestant)) => hard::run_one(case, contestant, args.embree.as_deref()),
            _ => hard::run(args.embree.as_deref()),
        };
    }
    let sources: Vec<&str> = match args.what {
        _ if !args.scenes.is_empty() => args.scenes.iter().map(String::as_str).collect(),
        What::Frame => scenes::list().iter().map(|info| info.name).collect(),
        _ => SCENES.to_vec(),
    };
    let load = |source: &str| stage::load_with(source, None, SceneOptions::default());
    let mut loaded = Vec::new();
    for (source, label) in sources.iter().zip(stage::labels(&sources)) {
        let scene = stage::load_first(source, || load(source))?;
        let is_empty = scene.as_ref().is_some_and(|scene| scene.animation.topology().triangles.is_empty());
        ensure!(!is_empty, "{source}: no triangles, so nothing to compare");
        loaded.push((source, label, scene));
    }
    let embree = find_embree(args.embree.as_deref())?;
    let device = embree.as_ref().map(|embree| embree.device(1)).transpose()?;
    let entries = args.what.contests().flat_map(|(contest, _)| field(contest, device.as_ref()));
    let entries: Vec<_> = entries.collect();
    ensure_known(&args.only, &unique(entries.iter().map(|entry| entry.name.as_str())))?;
    let mut report = Report::new(device.map(|device| device.version()));
    args.json.iter().chain(&args.chart).try_for_each(|path| files::ensure_writable(path))?;
    files::print(&report.heading())?;

    let (start, count) = (Instant::now(), loaded.len());
    let mut rest = String::new();
    for (i, (source, label, scene)) in loaded.into_iter().enumerate() {
        if !interrupt::requested() {
            let left = left(start.elapsed(), i as f64, count as f64);
            files::remark(&format!("{label}: scene {} of {count}{left}", i + 1));
            let stage = stage::ready(scene.map_or_else(|| load(source), Ok)?)?;
            run_scene(args, &label, stage, embree.as_ref(), &mut report)?;
        }
        if interrupt::requested() {
            rest += &format!(" --scene {source}");
        }
    }
    files::print(&table::ratios(&report.rows))?;
    let elsewhere = if args.json.is_some() { ", and another file for --json" } else { "" };
    interrupt::say_how_to_go_on(&format!("the same command for the other scenes,{rest}{elsewhere}"));
    let wrong: Vec<_> = report.rows.iter().filter(|row| !row.agrees).map(Row::place).collect();
    ensure!(
        wrong.is_empty(),
        CheckFailed(format!("not the same hits as the reference: {}", wrong.join("; ")))
    );
    if report.rows.is_empty() { Ok(()) } else { draw(args, &report) }
}

/// Prints the tables of a file of results again.
fn print_saved(args: &Args, path: &Path) -> Result<()> {
    ensure!(
        args.what == What::All || args.chart.is_some(),
        "--from prints all tables of the file; leave the measurement out, or name a --chart of it"
    );
    args.chart.iter().try_for_each(|chart| files::ensure_writable(chart))?;
    let mut report = Report::read(path)?;
    ensure_known(&args.only, &unique(report.rows.iter().map(|row| row.contestant.as_str())))?;
    report.rows.retain(|row| is_named(&args.only, &row.contestant));
    files::print(&report.heading())?;
    if let Some(path) = &args.beside {
        let other = Report::read(path)?;
        files::print(&format!("{}\n{}", other.heading(), table::side_by_side(&report.rows, &other.rows)))?;
    } else {
        files::print(&format!("{}\n{}", table::tables(&report.rows), table::ratios(&report.rows)))?;
    }
    draw(args, &report)
}

/// Draws the chart that was asked for: of the measurement named, or else of the first.
fn draw(args: &Args, report: &Report) -> Result<()> {
    let Some(path) = &args.chart else { return Ok(()) };
    let named = args.what.to_possible_value().filter(|_| args.what != What::All);
    let is_meant = |what: &str| match &named {
        Some(named) => what == named.get_name(),
        None => !["limit", "view"].contains(&what),
    };
    let what = report.rows.iter().map(|row| row.what.as_str()).find(|what| is_meant(what));
    let what = what.context("--chart: no rows of what it is to show")?;
    files::write_and_name(path, report.chart(what).as_bytes())
}

/// Updates and whole frames of every contestant on one scene, for those who keep the rows
/// themselves.
pub(crate) fn beside(stage: &mut Stage, setting: &Setting) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for contest in [Contest::Update, Contest::Frame].into_iter().take_while(|_| !interrupt::requested()) {
        rows.extend(setting.measure(contest, stage)?);
    }
    Ok(rows)
}

/// Embree on that number of threads, for [`beside`]; nothing, and a note, if there is none.
pub(crate) fn embree(path: Option<&Path>, threads: usize) -> Result<Option<Device>> {
    Ok(find_embree(path)?.map(|embree| embree.device(threads)).transpose()?)
}

/// The library, or a note that there is none; an error if it is not where it was said to be.
fn find_embree(path: Option<&Path>) -> Result<Option<Embree>> {
    match Embree::load(path) {
        Ok(embree) => Ok(Some(embree)),
        Err(reason @ NotFound::Nowhere) => {
            files::remark(&format!("note: {reason}"));
            Ok(None)
        }
        Err(reason) => Err(reason.into()),
    }
}

fn run_scene(
    args: &Args,
    label: &str,
    mut stage: Stage,
    embree: Option<&Embree>,
    report: &mut Report,
) -> Result<()> {
    let mut counts: BTreeSet<usize> = args.threads.iter().map(|&n| n as usize).collect();
    if counts.is_empty() {
        counts.extend([1, pool::cores()]);
    }
    for threads in counts {
        let mut setting = Setting {
            scene: label.to_owned(),
            triangles: stage.triangles().indices.len(),
            threads,
            embree: embree.map(|e| e.device(threads)).transpose()?,
            only: args.only.clone(),
            frames: 0,
            runs: args.runs,
            size: args.size.unwrap_or(SIZE),
        };
        let pool = pool::pool(threads)?;
        for (contest, frames) in args.what.contests() {
            if setting.field(contest).is_empty() || interrupt::requested() {
                continue;
            }
            setting.frames = args.frames.map_or(frames, |n| n as usize);
            let rows = pool.install(|| setting.measure(contest, &mut stage))?;
            let tables = table::tables(&rows);
            report.rows.extend(rows);
            if let Some(path) = &args.json {
                files::write_whole(path, &serde_json::to_vec_pretty(report)?)?;
            }
            files::print(&tables)?;
        }
    }
    Ok(())
}
