//! `cargo xtask view`: the viewer in a window, or without one into files.
//!
//! This file is the command line and the exit codes: 0 for success, 2 for bad input, a display that
//! is missing, and files that cannot be written.
#![forbid(unsafe_code)]

mod film;
mod load;
mod timing;
mod window;

use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::OnceLock;
use std::time::Instant;

use anyhow::{Context, Result};
use bvh_update::Strategy;
use clap::Parser;
use viewer_core::{Clock, Settings};

/// Plays a scene with Pivot's own tracer and shows how its tree fares
#[derive(Parser)]
#[command(bin_name = "cargo xtask view", max_term_width = 100)]
struct Args {
    /// A scene's name, or a .glb, .gltf, .obj, .ply, .stl or .aff file, or a folder of .ply or .obj
    /// key frames
    #[arg(default_value = "exploding-dragon")]
    scene: String,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    clip: Option<String>,
    /// How the tree on the left is kept good
    #[arg(long, value_name = "NAME", default_value = "refit")]
    strategy: Strategy,
    /// How the tree on the right is kept good; none for one tree alone
    #[arg(long, value_name = "NAME", default_value = "refit+rotate")]
    beside: String,
    /// Show the nodes that rays visit
    #[arg(long)]
    heat: bool,
    /// Draw the boxes at this depth below the root
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=12))]
    boxes: Option<u32>,
    /// Flash the nodes that rotated
    #[arg(long)]
    flash: bool,
    /// What to draw over the picture: 0 nothing, 1 titles and graphs, 2 the panel as well
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=2))]
    overlay: u32,
    /// Size of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = size)]
    size: (u32, u32),
    /// Threads for drawing, and as many for updates beside it [default: the cores there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Folder for pictures that are saved from the window, and films
    #[arg(long, value_name = "DIR", default_value = "target/view")]
    folder: PathBuf,
    /// Frames of the animation in a 24th of a second
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Draw into a .png file, a .gif of all frames or a folder of PNG files, without a window
    #[arg(long, value_name = "FILE|DIR")]
    out: Option<PathBuf>,
    /// Frames to draw, from A up to but without B; every one before them is played [default: 0..1,
    /// of a .gif all]
    #[arg(long, value_name = "A..B", value_parser = range, requires = "out")]
    frames: Option<Range<usize>>,
    /// Draw one frame in this number
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), requires = "out")]
    every: u32,
    /// Play for this number of seconds with an eye that turns, change the strategy twice and the
    /// scene once on the way, and print the time to the first picture, pictures and frames a
    /// second, and the longest waits [default: 10 s]
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "10", value_parser = seconds, conflicts_with = "out")]
    timing: Option<f64>,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |n: &str| n.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some((parse(w)?, parse(h)?)));
    parts.ok_or_else(|| "expected WxH as in 960x540, each 1 to 16384".to_owned())
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.01..=100.0).contains(speed));
    speed.ok_or_else(|| "expected a number from 0.01 to 100".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "expected seconds from 0.1 to 3600".to_owned())
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let parse = |n: &str| n.trim().parse::<usize>().ok();
    match text.split_once("..").map(|(a, b)| (parse(a), parse(b))) {
        Some((Some(a), Some(b))) if a < b => Ok(a..b),
        _ => Err("expected two numbers as in 0..50, the second greater".to_owned()),
    }
}

/// Seconds since the first call.
const CLOCK: Clock = || {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
};

fn run(args: &Args) -> Result<()> {
    let right = match args.beside.as_str() {
        "none" => None,
        name => Some(name.parse::<Strategy>()?),
    };
    let settings = Settings {
        left: args.strategy,
        right,
        heat: args.heat,
        boxes: args.boxes,
        flash: args.flash,
        overlay: args.overlay,
        speed: args.speed,
        ..Settings::default()
    };
    // The pool that the tracer draws in; 0 stands for the cores there are.
    let threads = args.threads.unwrap_or(0) as usize;
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .context("threads cannot be started")?;
    match &args.out {
        Some(out) => film::draw(args, settings, out),
        None => window::run(args, settings),
    }
}

fn main() -> ExitCode {
    // The clock starts here.
    CLOCK();
    let args = Args::parse();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", anim::printable(&format!("{error:#}")));
            ExitCode::from(2)
        }
    }
}
