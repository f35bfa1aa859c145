//! What is asked for on the command line.

use std::path::PathBuf;

use anyhow::Result;
use clap::ValueEnum;
use scenes::Scene;

use super::accuracy::Effort;
use super::contestants::Contestant;
use super::peers::Terms;
use super::preset::{Preset, Values};
use super::protocol::Plan;
use super::results::Settings;
use crate::{files, pool, stage};

/// The experiments there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Experiment {
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
    /// Updates and frames beside other libraries; only if named.
    Peers,
}

impl Experiment {
    fn name(self) -> &'static str {
        match self {
            Self::Fig4 => "fig4",
            Self::Fig5 => "fig5",
            Self::Fig6 => "fig6",
            Self::Claims => "claims",
            Self::Accuracy => "accuracy",
            Self::Peers => "peers",
        }
    }
}

/// The scene of figure 5.
const SPEED_SCENE: &str = "exploding-dragon";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// What to rerun; everything but `peers` if nothing is named
    #[arg(value_name = "EXPERIMENT")]
    experiments: Vec<Experiment>,
    /// How much: quick takes under a minute, standard under ten, full is the paper's protocol
    #[arg(long, value_enum, default_value_t = Preset::Standard)]
    preset: Preset,
    /// A scene's name, a .glb, .gltf, .obj or .ply file, or a folder of key frames; repeatable [default: all]
    #[arg(long = "scene", value_name = "NAME|FILE|DIR")]
    pub(super) scenes: Vec<String>,
    /// A strategy's name, as `list` gives them, or `all`; repeatable [default: those of the paper, and the best]
    #[arg(long = "strategy", value_name = "NAME", value_parser = strategy)]
    strategies: Vec<Choice>,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    pub(super) clip: Option<String>,
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
    /// Go on where an interrupted run with the same settings has stopped: what its folder holds is not measured again
    #[arg(long)]
    pub(super) resume: bool,
    /// Measure nothing: draw figures and report again from what a folder holds, into it or into --out
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = ["experiments", "scenes", "strategies", "clip", "frames", "loops", "size", "threads", "resume"]
    )]
    pub(super) from: Option<PathBuf>,
    /// Embree's library for `peers`, version 3 or 4, or a folder with it [default: PIVOT_EMBREE, else the system's]
    #[arg(long, value_name = "PATH")]
    embree: Option<PathBuf>,
    /// Compare with the results in another folder, and name what got worse
    #[arg(long, value_name = "DIR")]
    pub(super) baseline: Option<PathBuf>,
}

/// A strategy, or all there are.
#[derive(Clone, Copy, Debug)]
enum Choice {
    All,
    One(Contestant),
}

fn strategy(name: &str) -> Result<Choice, String> {
    if name == "all" { Ok(Choice::All) } else { Contestant::from_name(name).map(Choice::One) }
}

impl Args {
    /// The preset's settings with those given in their place.
    pub(super) fn values(&self) -> Values {
        let preset = self.preset.values();
        Values {
            frames: self.frames.map_or(preset.frames, |n| n as usize),
            loops: self.loops.unwrap_or(preset.loops),
            speed_loops: self.loops.unwrap_or(preset.speed_loops),
            size: self.size.unwrap_or(preset.size),
            ..preset
        }
    }

    /// Every strategy asked for, once.
    pub(super) fn contestants(&self) -> Vec<Contestant> {
        if self.strategies.is_empty() {
            return Contestant::default_ones();
        }
        let mut once: Vec<Contestant> = Vec::new();
        for choice in &self.strategies {
            let chosen = match choice {
                Choice::All => Contestant::all(),
                Choice::One(contestant) => vec![*contestant],
            };
            for contestant in chosen {
                if once.iter().all(|c| c.name != contestant.name) {
                    once.push(contestant);
                }
            }
        }
        once
    }

    pub(super) fn load(&self, source: &str) -> Result<Scene> {
        stage::load_at(source, self.clip.as_deref(), self.seed, self.preset.values().detail)
    }

    pub(super) fn out(&self) -> PathBuf {
        let named = self.out.as_ref().or(self.from.as_ref());
        named.cloned().unwrap_or_else(|| files::workspace().join("target/reproduce"))
    }

    pub(super) fn settings(&self) -> Settings {
        let all = Experiment::value_variants();
        let wanted = |e: &&Experiment| self.experiments.is_empty() || self.experiments.contains(e);
        let values = self.values();
        Settings {
            preset: self.preset.name().to_owned(),
            experiments: all.iter().filter(wanted).map(|e| e.name().to_owned()).collect(),
            strategies: self.contestants().iter().map(|c| c.name.to_owned()).collect(),
            frames: values.frames,
            loops: values.loops,
            size: values.size,
            threads: self.threads.map_or_else(pool::default_threads, |n| n as usize),
            seed: self.seed,
            clip: self.clip.clone(),
            reductions: values.reductions(),
            command: command(),
        }
    }

    /// Whether an experiment that runs every strategy frame by frame is asked for.
    pub(super) fn runs_frames(&self) -> bool {
        let other = [Experiment::Fig5, Experiment::Accuracy];
        self.experiments.is_empty() || self.experiments.iter().any(|e| !other.contains(e))
    }

    /// Whether knobs are to be measured: like figure 5 only if named where time is short.
    pub(super) fn runs_accuracy(&self) -> bool {
        let everything = self.experiments.is_empty() && self.preset.values().speeds;
        everything || self.experiments.contains(&Experiment::Accuracy)
    }

    /// Whether other libraries are to be measured, which takes as long as all the rest.
    pub(super) fn runs_peers(&self) -> bool {
        self.experiments.contains(&Experiment::Peers)
    }

    /// How they are.
    pub(super) fn terms(&self, plan: &Plan) -> Terms<'_> {
        let Plan { threads, size, .. } = *plan;
        Terms { threads, size, frames: self.values().peer_frames, embree: self.embree.as_deref() }
    }

    /// How much is measured of each knob on a scene of so many triangles.
    pub(super) fn effort(&self, triangles: usize) -> Effort {
        Effort::new(self.preset, &self.values(), triangles, self.seed)
    }

    /// Whether what only the claims need is asked for.
    pub(super) fn runs_claims(&self) -> bool {
        self.experiments.is_empty() || self.experiments.contains(&Experiment::Claims)
    }

    /// Whether figure 5 is to be run on that scene: on its own, and on any other if it is asked for by name.
    pub(super) fn runs_speeds(&self, label: &str) -> bool {
        let wanted = |e| self.experiments.contains(&e);
        if wanted(Experiment::Fig5) {
            return label == SPEED_SCENE || !self.scenes.is_empty();
        }
        let all = self.experiments.is_empty() && self.preset.values().speeds;
        label == SPEED_SCENE && (all || wanted(Experiment::Claims))
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
