//! Simulated motion: its time step, and how many key frames are kept of it.

use anim::Pose;
use anyhow::Result;
use scenes::{Scene, SceneInfo, SceneOptions, distance};

use super::bench::{Bench, fastest};
use super::point::Point;
use crate::{interrupt, stage};

/// What the registry knows of the scene, if it is one that is simulated.
fn simulated(source: &str) -> Option<&'static SceneInfo> {
    scenes::list().iter().find(|info| info.name == source && info.effects.motion.gravity)
}

/// Simulates it with a number of key frames, and of steps between two of them. Gives the scene and
/// the milliseconds that took.
fn simulate(bench: &Bench<'_>, key_frames: usize, substeps: Option<usize>) -> Result<(Scene, f64)> {
    let options = SceneOptions {
        seed: bench.effort.seed,
        key_frames: Some(key_frames),
        substeps,
        detail: Some(bench.effort.detail),
        ..SceneOptions::default()
    };
    stage::simulated(bench.source, options)
}

/// The time step: what the simulation should keep and does not.
pub(super) fn substeps(bench: &mut Bench<'_>) -> Result<()> {
    let Some(info) = simulated(bench.source) else { return Ok(()) };
    let settings: Vec<_> = bench.effort.substeps.iter().map(|&n| Some(n)).chain([None]).collect();
    for (i, &substeps) in settings.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        let (scene, time_ms) = simulate(bench, info.frames, substeps)?;
        for measure in &scene.measures {
            let name = measure.name.split(", a ").collect::<Vec<_>>();
            bench.add(Point {
                knob: "simulation substeps".to_owned(),
                setting: substeps.map_or("the scene's own".to_owned(), |n| format!("{n} substeps")),
                is_default: substeps.is_none(),
                error_name: name[0].to_owned(),
                error: measure.value,
                unit: name.get(1).map_or("fraction", |unit| unit).to_owned(),
                time_ms,
                note: format!("time of simulating a loop, at {}", detail(bench, info)),
                ..Point::default()
            })?;
        }
        bench.done(i + 1, settings.len());
    }
    Ok(())
}

/// How much of the scene is simulated.
fn detail(bench: &Bench<'_>, info: &SceneInfo) -> String {
    if info.name == "n-body" || bench.effort.detail == 1.0 {
        return "full detail".to_owned();
    }
    format!("{} % of the triangles", 100.0 * bench.effort.detail)
}

/// The distance to the same simulation with many more key frames.
pub(super) fn key_frames(bench: &mut Bench<'_>) -> Result<()> {
    let Some(info) = simulated(bench.source) else { return Ok(()) };
    let own = info.frames - 1;
    let [multiple, steps] = bench.effort.fine;
    let finest = own * multiple;
    let (fine, _) = simulate(bench, finest + 1, Some(steps))?;
    let settings = spaces(own, finest, bench.effort.spaces);
    for (i, &spaces) in settings.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        let (scene, _) = simulate(bench, spaces + 1, Some(steps * finest / spaces))?;
        let Some(distance) = distance(&*scene.animation, &*fine.animation, bench.effort.moments) else {
            return Ok(());
        };
        let mut pose = Pose::new(&*scene.animation);
        let duration = scene.animation.duration();
        let mut moment = 0.0;
        let time_ms = fastest(10 * bench.effort.repeats, || {
            moment = (moment + 0.377) % 1.0;
            pose.advance(&*scene.animation, moment * duration);
        });
        for (error_name, error) in [
            ("rms distance to the finely sampled motion", distance.rms),
            ("greatest distance to the finely sampled motion", distance.max),
        ] {
            bench.add(Point {
                knob: "key frames".to_owned(),
                setting: format!("{} a loop", spaces + 1),
                is_default: spaces == own,
                error_name: error_name.to_owned(),
                error,
                unit: "fraction of the extent".to_owned(),
                time_ms,
                note: format!(
                    "time of posing a frame; against {} key frames, {} simulation steps in all, at {}",
                    finest + 1,
                    finest * steps,
                    detail(bench, info)
                ),
                bytes: Some(scene.key_bytes as u64),
                ..Point::default()
            })?;
        }
        bench.done(i + 1, settings.len());
    }
    Ok(())
}

/// Numbers of spaces near the multiples of `own` that divide `finest`, so that all can have the
/// same steps; ascending.
fn spaces(own: usize, finest: usize, multiples: &[f64]) -> Vec<usize> {
    let off = |spaces: usize, wanted: f64| (spaces as f64 / wanted).ln().abs();
    let mut all: Vec<usize> = multiples
        .iter()
        .filter_map(|multiple| {
            let wanted = multiple * own as f64;
            let divisors = (1..finest).filter(|n| finest.is_multiple_of(*n));
            divisors.min_by(|&a, &b| off(a, wanted).total_cmp(&off(b, wanted)))
        })
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_key_frames_divide_the_finest() {
        assert_eq!(spaces(99, 792, &[0.125, 0.25, 0.5, 1.0, 2.0]), [12, 24, 44, 99, 198]);
        for own in [93, 99, 119] {
            let all = spaces(own, 8 * own, &[0.125, 0.5, 1.0]);
            assert!(all.contains(&own) && all.iter().all(|n| (8 * own) % n == 0), "{all:?}");
        }
    }
}
