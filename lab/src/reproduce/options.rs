//! What is asked for on the command line.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::ValueEnum;
use rt_cpu::Traversal;
use scenes::{Scene, SceneOptions};

use super::SPEED_STRATEGY;
use super::contestants::Contestant;
use super::preset::{Preset, Values};
use super::results::Settings;
use crate::pool::Threads;
use crate::{files, stage};

/// The experiments there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Experiment {
    /// Time to update, by scene and strategy.
    Fig4,
    /// Refitting with rotations at 20, 100 and 500 frames a loop.
    Fig5,
    /// Frame time and SAH cost over frames, by scene and strategy.
    Fig6,
    /// The paper's claims, judged from all of these.
    Claims,
    /// What every knob that buys accuracy costs in time.
    Accuracy,
    /// What each effect of a scene costs: with all others, without it, alone.
    Effects,
    /// Updates and frames beside other libraries; only if named.
    Peers,
}

/// The name of a choice on the command line.
fn name(choice: &impl ValueEnum) -> String {
    choice.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// The scene of figure 5, and of accuracy where time is short.
const SPEED_SCENE: &str = "exploding-dragon";
/// Scenes of accuracy, unless others are named: gentle motion, many bodies, pieces that fly apart.
const ACCURACY_SCENES: [&str; 3] = ["cloth-ball", "n-body", SPEED_SCENE];

/// Arguments of `reproduce`.
#[derive(clap::Args)]
pub struct Args {
    /// What to rerun [default: everything but `peers`, and for `quick` but `fig5` and `effects`]
    #[arg(value_name = "EXPERIMENT")]
    experiments: Vec<Experiment>,
    /// How much: quick takes half a minute, standard about six minutes, full is the paper's
    /// protocol
    #[arg(long, value_enum, default_value_t = Preset::Standard)]
    pub(super) preset: Preset,
    /// A scene's name, a .glb, .gltf, .obj, .ply, .stl or .aff file, or a folder of .ply or .obj
    /// key frames; repeatable [default: all]
    #[arg(long = "scene", value_name = "NAME|FILE|DIR")]
    pub(super) scenes: Vec<String>,
    /// A strategy's name, as `list` gives them; repeatable [default: those of the paper, and the
    /// best]
    #[arg(long = "strategy", value_name = "NAME", value_parser = Contestant::from_name)]
    strategies: Vec<Contestant>,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    pub(super) clip: Option<String>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Frames in a loop [default: by preset]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Loops, for example 1.5 [default: by preset]
    #[arg(long, value_name = "X", value_parser = loops)]
    loops: Option<f64>,
    /// Pixels on each side of the image; `accuracy` takes 512 at most without --preset full
    /// [default: by preset]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Option<u32>,
    #[command(flatten)]
    threads: Threads,
    /// How rays are grouped: tile, packet (8 x 8, as published in 2007) or single [default: tile;
    /// packet with --preset full]
    #[arg(long, value_name = "NAME")]
    traversal: Option<Traversal>,
    /// Folder for the results [default: target/reproduce]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on where an interrupted run with the same settings has stopped: what its folder holds is
    /// not measured again
    #[arg(long)]
    pub(super) resume: bool,
    /// Measure nothing: draw figures and report again from what a folder holds, into it or into
    /// --out
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = [
            "experiments", "preset", "scenes", "strategies", "clip", "seed", "frames", "loops", "size", "threads",
            "traversal", "resume", "embree",
        ]
    )]
    pub(super) from: Option<PathBuf>,
    /// Embree's library for `peers`, version 3 or 4, or a folder with it [default: PIVOT_EMBREE,
    /// else the system's]
    #[arg(long, value_name = "PATH")]
    pub(super) embree: Option<PathBuf>,
}

impl Args {
    /// Whether every option given is for something that is to run.
    pub(super) fn ensure_used(&self) -> Result<()> {
        let (frames, speeds) = (self.runs_frames(), self.may_run_speeds());
        let [accuracy, peers] = [Experiment::Accuracy, Experiment::Peers].map(|e| self.runs(e));
        for (option, given, used, by) in [
            ("--strategy", !self.strategies.is_empty(), frames, "fig4, fig6 and claims"),
            ("--frames", self.frames.is_some(), frames || accuracy, "fig4, fig6, claims and accuracy"),
            ("--loops", self.loops.is_some(), frames || speeds, "fig4, fig5, fig6 and claims"),
            ("--size", self.size.is_some(), frames || speeds || accuracy || peers, "all but effects"),
            ("--traversal", self.traversal.is_some(), frames || speeds, "fig4, fig5, fig6 and claims"),
            ("--embree", self.embree.is_some(), peers, "peers, which runs only if named"),
            ("--clip", self.clip.is_some(), !self.scenes.is_empty(), "a glTF file, named with --scene"),
        ] {
            ensure!(!given || used, "{option}: nothing that is to run heeds it; it is for {by}");
        }
        Ok(())
    }

    /// The preset's settings with those given in their place.
    pub(super) fn values(&self) -> Values {
        let preset = self.preset.values();
        Values {
            frames: self.frames.map_or(preset.frames, |n| n as usize),
            loops: self.loops.unwrap_or(preset.loops),
            speed_loops: self.loops.unwrap_or(preset.speed_loops),
            size: self.size.unwrap_or(preset.size),
            traversal: self.traversal.unwrap_or(preset.traversal),
            ..preset
        }
    }

    /// Every strategy asked for, once.
    pub(super) fn contestants(&self) -> Vec<Contestant> {
        if self.strategies.is_empty() {
            return Contestant::default_ones();
        }
        let is_chosen = |c: &Contestant| self.strategies.iter().any(|s| s.name == c.name);
        Contestant::all().into_iter().filter(is_chosen).collect()
    }

    pub(super) fn load(&self, source: &str) -> Result<Scene> {
        let (seed, detail) = (self.seed, self.preset.values().detail);
        let options = SceneOptions { seed, detail, ..SceneOptions::default() };
        stage::load_with(source, self.clip.as_deref(), options)
    }

    pub(super) fn out(&self) -> PathBuf {
        let named = self.out.as_ref().or(self.from.as_ref());
        named.cloned().unwrap_or_else(|| files::workspace().join("target/reproduce"))
    }

    pub(super) fn settings(&self) -> Settings {
        let all = Experiment::value_variants();
        let values = self.values();
        let speeds = self.may_run_speeds();
        let threads = self.threads.count();
        let strategies: Vec<&str> = if self.runs_frames() {
            self.contestants().iter().map(|c| c.name).collect()
        } else {
            speeds.then_some(SPEED_STRATEGY).into_iter().collect()
        };
        Settings {
            preset: name(&self.preset),
            experiments: all.iter().filter(|e| self.runs(**e)).map(name).collect(),
            scenes: self.sources(),
            strategies: strategies.into_iter().map(str::to_owned).collect(),
            frames: values.frames,
            loops: values.loops,
            speed_loops: speeds.then_some(values.speed_loops),
            size: values.size,
            threads,
            traversal: values.traversal.name().to_owned(),
            seed: self.seed,
            clip: self.clip.clone(),
            reductions: values.departures(speeds, threads),
            command: command(),
        }
    }

    /// Whether an experiment runs: as it is named, or as part of everything, which other libraries
    /// never are, and figure 5 and effects are not where time is short.
    pub(super) fn runs(&self, experiment: Experiment) -> bool {
        if !self.experiments.is_empty() {
            return self.experiments.contains(&experiment);
        }
        match experiment {
            Experiment::Fig4 | Experiment::Fig6 | Experiment::Claims | Experiment::Accuracy => true,
            Experiment::Fig5 => self.preset.values().speeds && self.has_speed_scene(),
            Experiment::Effects => self.preset != Preset::Quick,
            Experiment::Peers => false,
        }
    }

    /// Whether every strategy runs frame by frame.
    pub(super) fn runs_frames(&self) -> bool {
        [Experiment::Fig4, Experiment::Fig6, Experiment::Claims].into_iter().any(|e| self.runs(e))
    }

    /// Whether those of the scene are: of all that are named.
    pub(super) fn measures_accuracy_of(&self, label: &str) -> bool {
        match self.preset {
            _ if !self.scenes.is_empty() => true,
            Preset::Quick => label == SPEED_SCENE,
            _ => ACCURACY_SCENES.contains(&label),
        }
    }

    /// The scenes to run. If none is named all, unless only accuracy is asked for.
    pub(super) fn sources(&self) -> Vec<String> {
        if !self.scenes.is_empty() {
            return self.scenes.clone();
        }
        let all = scenes::list().iter().map(|info| info.name.to_owned());
        let is_accuracy = |&e: &Experiment| e == Experiment::Accuracy;
        let only_accuracy = !self.experiments.is_empty() && self.experiments.iter().all(is_accuracy);
        all.filter(|name| !only_accuracy || self.measures_accuracy_of(name)).collect()
    }

    /// Whether figure 5 is to be run on that scene: on its own, and on any other if it is asked for
    /// by name.
    pub(super) fn runs_speeds(&self, label: &str) -> bool {
        let named = self.experiments.contains(&Experiment::Fig5);
        self.may_run_speeds() && (label == SPEED_SCENE || named && !self.scenes.is_empty())
    }

    /// Whether figure 5 is to be run on some scene: if it is asked for, or claims that rest on it
    /// are.
    fn may_run_speeds(&self) -> bool {
        let for_claims = self.experiments.contains(&Experiment::Claims) && self.has_speed_scene();
        self.runs(Experiment::Fig5) || for_claims
    }

    fn has_speed_scene(&self) -> bool {
        self.scenes.is_empty() || self.scenes.iter().any(|scene| scene == SPEED_SCENE)
    }
}

fn loops(text: &str) -> Result<f64, String> {
    let loops: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let is_fine = loops > 0.0 && loops <= 1000.0;
    is_fine.then_some(loops).ok_or_else(|| "must be above 0 and at most 1000".to_owned())
}

/// The command line as it was given, but for what is about an earlier run.
fn command() -> String {
    let words = std::env::args().skip(1).filter(|word| word != "--resume");
    let quoted = words.map(|word| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=,:".contains(c);
        if !word.is_empty() && word.chars().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    });
    format!("cargo xtask {}", quoted.collect::<Vec<_>>().join(" "))
}
