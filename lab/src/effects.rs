//! `cargo xtask effects`: what a frame of each scene runs and why, and what each effect costs: with
//! all others, without it, and alone.

use std::fmt::Write;
use std::sync::Arc;

use anim::Motion;
use anyhow::{Context, Result};
use bitflags::Flags;
use bvh_core::Bvh;
use bvh_update::{Rotate, Strategy, Updater};
use rt_cpu::RenderOptions;
use scenes::{Effects, FrameStage, LightEffects, Scene, SceneOptions, Simulated, SimulationStats};
use serde::{Deserialize, Serialize};

use crate::machine::{Machine, Revision};
use crate::pool::Threads;
use crate::reproduce::record::Row;
use crate::reproduce::stages::stages;
use crate::stage::{self, Renderer, timed};
use crate::{files, interrupt};

/// Arguments of `effects`.
#[derive(clap::Args)]
pub struct Args {
    /// A scene's name, or an animation file; repeatable [default: the six scenes]
    #[arg(long = "scene", value_name = "NAME|FILE")]
    scenes: Vec<String>,
    #[command(flatten)]
    threads: Threads,
}

/// What `docs/EFFECTS.md` has.
const PLAYED: Played = Played { detail: 0.05, frames: 24, size: 256, seed: 0 };
/// Times that everything is measured; the fastest counts.
const REPEATS: usize = 3;

/// The effects in the order of their rows.
const SIMULATED: [Simulated; 4] =
    [Simulated::FRACTURE, Simulated::GRAVITY, Simulated::CLOTH, Simulated::CONTACT];
const MOTION: [Motion; 4] = [Motion::KEY_FRAMES, Motion::MORPH, Motion::SKIN, Motion::RIGID];
const LIGHT: [LightEffects; 4] =
    [LightEffects::ALPHA, LightEffects::TEXTURES, LightEffects::SHADOWS, LightEffects::MIRROR];

/// The effects of light that materials call for.
const LOOKS: LightEffects = LightEffects::ALPHA.union(LightEffects::TEXTURES).union(LightEffects::MIRROR);

/// Runs the command.
///
/// # Errors
///
/// Bad input.
pub fn run(args: &Args) -> Result<()> {
    let mut sources: Vec<&str> = args.scenes.iter().map(String::as_str).collect();
    if sources.is_empty() {
        sources.extend(scenes::list().iter().map(|info| info.name));
    }
    let scenes: Vec<_> = sources.iter().copied().zip(stage::labels(&sources)).collect();
    let plans = scenes.iter().map(|(source, label)| plan_row(source, label)).collect::<Result<String>>()?;
    let (costs, absences) = args.threads.pool()?.install(|| tables(&scenes))?;
    if interrupt::requested() {
        files::remark("interrupted; the tables are not complete, so nothing is written");
        return Ok(());
    }
    let chosen: String =
        args.scenes.iter().map(|source| format!(" --scene {}", stage::label(source))).collect();
    let machine = Machine::read();
    let text = format!(
        include_str!("effects.md"),
        chosen = chosen,
        cpu = machine.cpu,
        simd = machine.simd,
        threads = args.threads.count(),
        started = machine.started,
        revision = Revision::read().short(),
        percent = 100.0 * PLAYED.detail,
        frames = PLAYED.frames,
        size = PLAYED.size,
        repeats = REPEATS,
        plans = plans,
        costs = costs,
        absences = absences,
    );
    files::print(text.trim_end())
}

/// The row of a scene in the table of what runs.
fn plan_row(source: &str, label: &str) -> Result<String> {
    // Made for its effects alone: with as few steps as there can be.
    let options = SceneOptions { key_frames: Some(2), substeps: Some(1), ..PLAYED.options() };
    let scene = scenes::load(source, None, &options)?;
    let simulated = Effects { simulated: scene.effects.simulated, ..Effects::default() };
    let reasons = scene.stage_reasons();
    let stages: Vec<_> = reasons.iter().map(|(stage, why)| format!("{} ({why})", stage.name())).collect();
    Ok(format!("| {label} | {simulated} | {} |\n", stages.join(", ")))
}

/// Plays a scene with these effects. Gives the rows of the frames, and the fastest of several times
/// of a frame: pose and update of the tree, and light, in milliseconds.
fn play(played: Played, scene: &mut Option<Scene>, effects: Effects) -> Result<(Vec<Row>, [f64; 2])> {
    let taken = scene.take().context("the scene before failed")?;
    let mut stage = stage::ready(Scene { effects, ..taken })?;
    let (Played { frames: count, size, .. }, mut tree) = (played, Bvh::clone(&stage.first_tree));
    let mut updater = Updater::new(Strategy::RefitRotate(Rotate::default()));
    let mut flat = Renderer::new(RenderOptions { smooth: false, ..stage.render_options() }, size);
    let (mut rows, mut best) = (Vec::new(), [f64::INFINITY; 2]);
    for _ in 0..REPEATS {
        rows.clear();
        let mut sums = [0.0; 2];
        for frame in 0..count {
            let (posed, motion_ms) = timed(|| {
                let posed = stage.pose(stage.time_of(frame, count));
                stage.update(&mut tree, &mut updater).map(|_| posed)
            });
            let (traced, light_ms) = flat.draw(&stage, &tree);
            rows.push(Row::default().posed(&posed?).traced(&traced, light_ms));
            sums = [sums[0] + motion_ms, sums[1] + light_ms];
        }
        best = [0, 1].map(|part| best[part].min(sums[part] / count as f64));
    }
    *scene = Arc::into_inner(stage.scene);
    Ok((rows, best))
}

/// What a stage counted in all rows.
fn count(rows: &[Row], stage: FrameStage) -> u64 {
    let of_stages = stages(&[], &rows.iter().collect::<Vec<_>>());
    of_stages.iter().find(|summary| summary.stage == stage.name()).map_or(0, |summary| summary.count)
}

/// What one effect of a scene costs: counts and milliseconds with all effects of its kind, without
/// this one, and with it alone; the last milliseconds are without any.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Cost {
    kind: String,
    effect: String,
    counts: [u64; 3],
    ms: [f64; 4],
}

/// Measures each of the scene's own effects of a kind: with all others, left out, and alone. A
/// measurement gives what each of `effects` counted, and milliseconds.
fn costs<E: Flags + Copy>(
    kind: &str,
    effects: [E; 4],
    own: E,
    name: impl Fn(E) -> String,
    mut measure: impl FnMut(E) -> Result<([u64; 4], f64)>,
) -> Result<Vec<Cost>> {
    let called_for: Vec<usize> = (0..effects.len()).filter(|&i| own.contains(effects[i])).collect();
    if called_for.is_empty() {
        return Ok(Vec::new());
    }
    let (everything, nothing) = (measure(own)?, measure(E::empty())?);
    let cost = |i: usize| {
        // Without the only effect there is none, and alone it is everything.
        let [without, alone] = match called_for.len() {
            1 => [nothing, everything],
            _ => [measure(own.difference(effects[i]))?, measure(effects[i])?],
        };
        let counts = [everything, without, alone].map(|(counts, _)| counts[i]);
        let ms = [everything.1, without.1, alone.1, nothing.1];
        Ok(Cost { kind: kind.to_owned(), effect: name(effects[i]), counts, ms })
    };
    called_for.iter().copied().map(cost).collect()
}

/// How much of a scene is played, and how large its pictures are.
#[derive(Clone, Copy)]
pub(crate) struct Played {
    /// Part of the triangles, where the scene can be made coarser.
    pub(crate) detail: f32,
    pub(crate) frames: usize,
    pub(crate) size: u32,
    pub(crate) seed: u64,
}

impl Played {
    fn options(&self) -> SceneOptions<'static> {
        SceneOptions { detail: Some(self.detail), seed: self.seed, ..SceneOptions::default() }
    }
}

/// What each effect of a scene costs.
pub(crate) fn measure(source: &str, clip: Option<&str>, played: Played) -> Result<Vec<Cost>> {
    let options = played.options();
    let scene = stage::load_with(source, clip, options.clone())?;
    let own = scene.effects;
    let mut scene = Some(scene);
    let mut play = |effects| play(played, &mut scene, effects);

    let name = |simulated| Effects { simulated, ..Effects::default() }.to_string();
    let mut found = costs("simulation", SIMULATED, own.simulated, name, |simulated| {
        let without = Simulated::all() - simulated;
        let (scene, ms) = stage::simulated(source, SceneOptions { without, ..options.clone() })?;
        let SimulationStats { fracture, gravity, cloth, contact, .. } = scene.simulated;
        Ok(([fracture, gravity, cloth, contact], ms))
    })?;
    let name = |kind| FrameStage::Motion(kind).name();
    found.extend(costs("motion", MOTION, own.motion, name, |motion| {
        let (rows, [motion_ms, _]) = play(Effects { motion, ..own })?;
        Ok((MOTION.map(|kind| count(&rows, FrameStage::Motion(kind))), motion_ms))
    })?);
    let name = |effect| FrameStage::Light(effect).name();
    found.extend(costs("light", LIGHT, own.light, name, |light| {
        let (rows, [_, light_ms]) = play(Effects { light, ..own })?;
        Ok((LIGHT.map(|effect| count(&rows, FrameStage::Light(effect))), light_ms))
    })?);
    Ok(found)
}

/// The counts of effects that nothing in a scene calls for, planned all the same, and the
/// milliseconds of a frame without them, once more without them, and with them.
fn absent(source: &str) -> Result<String> {
    let scene = stage::load_with(source, None, PLAYED.options())?;
    let own = scene.effects;
    let mut scene = Some(scene);
    let mut play = |effects| play(PLAYED, &mut scene, effects);
    let planned = Effects { motion: Motion::all(), light: own.light | LOOKS, ..own };
    let (mut rows, mut times) = (Vec::new(), [[f64::INFINITY; 2]; 3]);
    // In turn, so that other work on the machine disturbs all.
    for _ in 0..=REPEATS {
        for (best, effects) in times.iter_mut().zip([own, own, planned]) {
            let ms;
            (rows, ms) = play(effects)?;
            *best = [0, 1].map(|part| best[part].min(ms[part]));
        }
    }
    let absent = planned.stages().filter(|&stage| !own.calls_for(stage) && stage != FrameStage::Update);
    let counts: Vec<_> = absent.map(|stage| format!("{} {}", stage.name(), count(&rows, stage))).collect();
    let times = times.map(|[motion_ms, light_ms]| format!("{:.3}", motion_ms + light_ms));
    Ok(format!("{} | {}", counts.join(", "), times.join(" | ")))
}

/// The rows of the table of costs, and those of the table of effects which are planned though
/// nothing calls for them.
fn tables(scenes: &[(&str, String)]) -> Result<(String, String)> {
    let (mut rows, mut absences) = (String::new(), String::new());
    for (source, label) in scenes.iter().take_while(|_| !interrupt::requested()) {
        files::remark(source);
        for Cost { kind, effect, counts, ms } in measure(source, None, PLAYED)? {
            let (counts, ms) = (counts.map(|n| n.to_string()), ms.map(|ms| format!("{ms:.3}")));
            writeln!(rows, "| {label} | {kind} | {effect} | {} | {} |", counts.join(" | "), ms.join(" | "))?;
        }
        writeln!(absences, "| {label} | {} |", absent(source)?)?;
    }
    Ok((rows, absences))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn the_plans_in_the_document_are_those_of_the_scenes() {
        let document =
            std::fs::read_to_string(files::workspace().join("docs/EFFECTS.md")).expect("a document");
        let has = |source: &str| {
            let row = plan_row(source, &stage::label(source)).expect("a scene");
            assert!(document.contains(&row), "docs/EFFECTS.md lacks: {row}");
        };
        scenes::list().iter().for_each(|info| has(info.name));
        has(files::workspace().join("assets/toys.glb").to_str().expect("text"));
        let Some(data) = std::env::var_os("PIVOT_DATA").map(PathBuf::from) else {
            println!("real files are skipped: PIVOT_DATA names no folder");
            return;
        };
        for file in REAL {
            has(data.join(file).to_str().expect("text"));
        }
    }

    /// Real models in the document.
    const REAL: [&str; 6] = [
        "gltf/BrainStem.glb",
        "gltf/CesiumMan.glb",
        "gltf/Fox.glb",
        "gltf/MorphStressTest.gltf",
        "static/sponza_dabrovic.obj",
        "bart/museum/museum5.aff",
    ];
}
