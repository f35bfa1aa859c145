//! `cargo xtask list`: what there is to choose from.

use std::fmt::Write;

use anyhow::Result;
use bvh_build::Builder;
use bvh_core::SimdLevel;
use rt_cpu::{Traversal, TriangleTest};
use scenes::FramePlan;
use serde::Serialize;

use crate::files;
use crate::reproduce::Contestant;

/// Arguments of `list`.
#[derive(clap::Args)]
pub struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Listing {
    scenes: Vec<SceneEntry>,
    strategies: Vec<StrategyEntry>,
    builders: Vec<&'static str>,
    simd_levels: Vec<SimdEntry>,
    traversals: Vec<&'static str>,
    triangle_tests: Vec<&'static str>,
}

#[derive(Serialize)]
struct SceneEntry {
    name: &'static str,
    about: &'static str,
    triangles: usize,
    frames: usize,
    effects: Vec<&'static str>,
    /// The stages of a frame, in order.
    plan: Vec<&'static str>,
    /// Bytes of key frames in memory.
    key_bytes: usize,
}

#[derive(Serialize)]
struct StrategyEntry {
    name: &'static str,
    /// How its time comes about, if it is not simply measured.
    accounting: Option<String>,
}

#[derive(Serialize)]
struct SimdEntry {
    name: &'static str,
    available: bool,
    /// The one that is used.
    best: bool,
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    let listing = listing();
    if args.json {
        files::print(&serde_json::to_string_pretty(&listing)?)
    } else {
        files::print(text(&listing).trim_end())
    }
}

fn listing() -> Listing {
    Listing {
        scenes: scenes::list()
            .iter()
            .map(|info| SceneEntry {
                name: info.name,
                about: info.about,
                triangles: info.triangles,
                frames: info.frames,
                effects: info.effects.row().into_iter().filter_map(|(name, on)| on.then_some(name)).collect(),
                plan: FramePlan::new(&info.effects).stages().iter().map(|stage| stage.name()).collect(),
                key_bytes: info.key_bytes,
            })
            .collect(),
        strategies: Contestant::all()
            .iter()
            .map(|c| StrategyEntry { name: c.name, accounting: c.accounting() })
            .collect(),
        builders: Builder::ALL.map(Builder::name).to_vec(),
        simd_levels: SimdLevel::ALL
            .map(|level| SimdEntry {
                name: level.name(),
                available: level.is_available(),
                best: level == SimdLevel::best(),
            })
            .into(),
        traversals: Traversal::ALL.map(Traversal::name).to_vec(),
        triangle_tests: TriangleTest::ALL.map(TriangleTest::name).to_vec(),
    }
}

fn text(listing: &Listing) -> String {
    let mut out = String::from(
        "scenes (any .glb, .gltf, .obj, .ply or .aff file, or a folder of key frames, will do; bart-museum:1 to \
         bart-museum:4 start from another shape)\n",
    );
    // Writing to a string does not fail.
    for s in &listing.scenes {
        let _ =
            writeln!(out, "  {:18}{:>9} triangles, {} frames: {}", s.name, s.triangles, s.frames, s.about);
        let _ = writeln!(out, "  {:18}calls for {}", "", s.effects.join(", "));
        let _ = writeln!(out, "  {:18}a frame runs {}", "", s.plan.join(", "));
        let _ = match s.key_bytes {
            0 => writeln!(out, "  {:18}no key frames but the tracks of a glTF file", ""),
            bytes => writeln!(out, "  {:18}{:.1} MiB of key frames", "", bytes as f64 / f64::from(1 << 20)),
        };
    }
    out += "\nstrategies\n";
    for s in &listing.strategies {
        let _ = match &s.accounting {
            Some(accounting) => writeln!(out, "  {:24}{accounting}", s.name),
            None => writeln!(out, "  {}", s.name),
        };
    }
    let simd: Vec<_> = listing
        .simd_levels
        .iter()
        .map(|level| match (level.available, level.best) {
            (_, true) => format!("{} (used)", level.name),
            (true, _) => level.name.to_owned(),
            (false, _) => format!("{} (not on this machine)", level.name),
        })
        .collect();
    for (what, names) in [
        ("builders", listing.builders.join(", ")),
        ("SIMD levels", simd.join(", ")),
        ("traversals", listing.traversals.join(", ")),
        ("triangle tests", listing.triangle_tests.join(", ")),
    ] {
        let _ = writeln!(out, "\n{what}\n  {names}");
    }
    out
}
