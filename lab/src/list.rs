//! `cargo xtask list`: what there is to choose from.

use anyhow::Result;
use bvh_build::Builder;
use bvh_core::SimdLevel;
use rt_cpu::{Traversal, TriangleTest};
use scenes::{FrameStage, SceneInfo};
use serde_json::{Value, json};

use crate::files;
use crate::reproduce::Contestant;

/// Arguments of `list`.
#[derive(clap::Args)]
pub struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    let listing = listing();
    files::print(&if args.json { serde_json::to_string_pretty(&listing)? } else { text(&listing) })
}

fn listing() -> Value {
    let scene = |info: &SceneInfo| {
        let effects: Vec<_> = info.effects.names().collect();
        let plan: Vec<_> = info.effects.stages().map(FrameStage::name).collect();
        let SceneInfo { name, about, triangles, frames, key_bytes, .. } = info;
        json!({
            "name": name, "about": about, "triangles": triangles, "frames": frames, "effects": effects, "plan": plan,
            "key_bytes": key_bytes,
        })
    };
    let level = |level: SimdLevel| {
        let best = level == SimdLevel::best();
        json!({ "name": level.name(), "available": level.is_available(), "best": best })
    };
    let strategy = |c: &Contestant| json!({ "name": c.name, "accounting": c.accounting() });
    json!({
        "scenes": scenes::list().iter().map(scene).collect::<Vec<_>>(),
        "strategies": Contestant::all().iter().map(strategy).collect::<Vec<_>>(),
        "builders": Builder::ALL.map(Builder::name),
        "simd_levels": SimdLevel::ALL.map(level),
        "traversals": Traversal::ALL.map(Traversal::name),
        "triangle_tests": TriangleTest::ALL.map(TriangleTest::name),
    })
}

/// A heading for each list; an entry a line, its name first.
fn text(listing: &Value) -> String {
    let mut out = String::from(
        "A scene is also any .glb, .gltf, .obj, .ply, .stl or .aff file, or a folder of key frames; bart-museum:1 to \
         bart-museum:4 start from another shape; exploding-dragon:blended has 16 key frames blended linearly.\n",
    );
    for (heading, entries) in listing.as_object().into_iter().flatten() {
        out += &format!("\n{}\n", heading.replace('_', " "));
        for entry in entries.as_array().into_iter().flatten() {
            let words = |value: &Value| match value.as_array() {
                Some(list) => list.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", "),
                None => value.as_str().map_or_else(|| value.to_string(), str::to_owned),
            };
            let name = entry.as_str().or(entry["name"].as_str()).unwrap_or_default();
            let fact = |(key, value): (&String, &Value)| {
                // The plan follows from the effects; how many bytes a scene takes is for programs.
                let is_shown = !["name", "plan", "key_bytes"].contains(&key.as_str()) && !value.is_null();
                is_shown.then(|| format!("{}: {}", key.replace('_', " "), words(value)))
            };
            let facts: Vec<_> = entry.as_object().into_iter().flatten().filter_map(fact).collect();
            out += format!("  {name:<24}{}", facts.join("; ")).trim_end();
            out.push('\n');
        }
    }
    out.trim_end().to_owned()
}
