//! Simulated motion: its time step against one many times finer, and how many key frames are kept
//! of it.

use anim::{Motion, Pose};
use anyhow::{Context, Result};
use rayon::prelude::*;
use scenes::{SceneInfo, SceneOptions, distance};

use super::Point;
use super::bench::{Log, in_turns};
use crate::{files, interrupt, stage};

/// The simulations: the steps between key frames that each has of its own, and the numbers of
/// spaces between key frames that are tried, by preset. These divide those of the reference, so
/// that all have the same steps, and lie near halves, quarters and so on of the scene's own number.
const SIMULATED: [(&str, usize, [&[usize]; 3]); 2] = [
    ("cloth-ball", 80, [&[6, 31, 62], &[12, 24, 48, 93, 186], &[6, 12, 24, 48, 93, 186, 372]]),
    ("n-body", 32, [&[11, 22, 66], &[12, 24, 48, 99, 198], &[6, 12, 24, 48, 99, 198, 396]]),
];

/// Part of the triangles of the cloth that is simulated again: 961 particles, so that the 476,160
/// steps of its reference take a minute. Those of the balls, 202,752, take as long.
const DETAIL: f32 = 0.02;

/// Simulation steps as multiples of the scene's own number.
const MULTIPLES: [f64; 8] = [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Spaces between key frames of the reference, as a multiple of the scene's own number, and
/// simulation steps in each; by preset.
const FINEST: [[usize; 2]; 3] = [[2, 2], [64, 1], [64, 2]];

/// Key frames at which motions are compared; the last one, too.
const COMPARED: [usize; 2] = [2, 10];

fn info(name: &str) -> Result<&'static SceneInfo> {
    scenes::list().iter().find(|info| info.name == name).with_context(|| format!("no scene {name}"))
}

/// A simulation with a number of key frames, and of steps between two of them.
fn options(log: &Log<'_>, key_frames: usize, steps: usize) -> SceneOptions<'static> {
    SceneOptions {
        seed: log.seed,
        key_frames: Some(key_frames),
        substeps: Some(steps),
        detail: Some(DETAIL),
        ..SceneOptions::default()
    }
}

/// The time step of both simulations, against a step many times finer; and what they should keep.
pub(super) fn steps(log: &mut Log<'_>) -> Result<()> {
    let multiples = log.pick([&MULTIPLES[..3], &[0.0625, 0.125, 0.25, 0.5, 1.0, 4.0], &MULTIPLES]);
    // How many times as many steps the references have.
    let finer = log.pick([2, 64, 64]);
    // They take long, and their times count for nothing, so they are made side by side.
    let reference = |(name, own, _)| {
        let options = options(log, info(name)?.frames, own * finer);
        let cached = SceneOptions { cache_dir: Some(files::scene_cache()), ..options };
        Ok((name, own, scenes::load(name, None, &cached)?.animation))
    };
    let references: Vec<_> = SIMULATED.into_par_iter().map(reference).collect::<Result<_>>()?;
    for (name, own, converged) in references {
        let keys = info(name)?.frames;
        let multiples = multiples.iter().filter(|&&multiple| multiple < 0.5 * finer as f64);
        for &multiple in multiples.take_while(|_| !interrupt::requested()) {
            let steps = (multiple * own as f64).round().max(1.0) as usize;
            let (scene, time_ms) = stage::simulated(name, options(log, keys, steps))?;
            let setting = format!("{steps} steps a key frame");
            let note = format!("time of simulating a loop, with the cloth at {DETAIL} of its triangles");
            let point =
                Point { note, ..Point::new(&format!("{name} step"), &setting, steps == own, time_ms) };
            for key in COMPARED.into_iter().chain([keys - 1]) {
                let time = key as f64 / (keys - 1) as f64;
                let far = distance(&*scene.animation, &*converged, [time])
                    .context("other vertices, or none that is finite")?;
                let error_name = format!("rms distance to steps {finer} times finer");
                let point = Point { knob: format!("{name} step at key frame {key}"), ..point.clone() };
                log.add(point.with(&error_name, far.rms, "of the extent"))?;
            }
            for measure in &scene.measures {
                log.add(point.with(&measure.name, measure.value, "fraction"))?;
            }
        }
    }
    Ok(())
}

/// The distance to the same simulation with many more key frames, all with the same steps.
pub(super) fn key_frames(log: &mut Log<'_>) -> Result<()> {
    let [multiple, steps] = log.pick(FINEST);
    let moments = log.pick([60, 200, 500]);
    for (name, _, spaces) in SIMULATED {
        let own = info(name)?.frames - 1;
        let finest = own * multiple;
        // Only posing is timed.
        let simulated = |spaces: usize| {
            let options = options(log, spaces + 1, steps * finest / spaces);
            Ok((spaces, stage::simulated(name, options)?.0))
        };
        let mut all = log.pick(spaces).to_vec();
        all.push(finest);
        let wanted = all.into_par_iter().take_any_while(|_| !interrupt::requested());
        let mut scenes: Vec<_> = wanted.map(simulated).collect::<Result<_>>()?;
        if interrupt::requested() {
            return Ok(());
        }
        let (_, fine) = scenes.pop().context("no reference")?;
        for (spaces, scene) in scenes {
            let times = (0..moments).map(|moment| f64::from(moment) / f64::from(moments - 1));
            let far = distance(&*scene.animation, &*fine.animation, times)
                .context("other vertices, or none that is finite")?;
            let mut pose = Pose::new(Motion::all(), &*scene.animation);
            let duration = scene.animation.duration();
            let mut moment = 0.0;
            let time_ms = in_turns(log.pick([10, 30, 50]), 1, |_| {
                moment = (moment + 0.377) % 1.0;
                Ok(stage::timed(|| pose.advance(&*scene.animation, moment * duration)).1)
            })?[0];
            let (keys, all) = (finest + 1, finest * steps);
            let note = format!("time of posing a frame; against {keys} key frames of the same {all} steps");
            let (knob, setting) = (format!("key frames at {name}"), format!("{spaces} a loop"));
            let bytes = Some(scene.key_bytes as u64);
            let point = Point { note, bytes, ..Point::new(&knob, &setting, spaces == own, time_ms) };
            log.add(point.with("rms distance to the finely sampled motion", far.rms, "of the extent"))?;
            log.add(point.with("greatest distance to the finely sampled motion", far.max, "of the extent"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_key_frames_divide_the_finest() {
        for (name, _, spaces) in SIMULATED {
            let own = info(name).expect("a scene").frames - 1;
            for (preset, (all, [multiple, _])) in spaces.into_iter().zip(FINEST).enumerate() {
                assert!(all.iter().all(|n| (own * multiple).is_multiple_of(*n)), "{name}: {all:?}");
                assert!(all.is_sorted_by(|a, b| a < b), "{name}: {all:?}");
                assert_eq!(all.contains(&own), preset > 0, "{name}: the default is one of {all:?}");
            }
        }
    }

    #[test]
    fn the_default_step_is_the_scenes_own() {
        for (name, own, _) in SIMULATED {
            let with = |substeps| {
                let options = SceneOptions {
                    key_frames: Some(3),
                    detail: Some(0.01),
                    substeps,
                    ..SceneOptions::default()
                };
                scenes::load(name, None, &options).unwrap().animation
            };
            let far = |substeps| distance(&*with(substeps), &*with(None), [1.0]).unwrap();
            assert_eq!(far(Some(own)).max, 0.0, "{name}");
            assert!(far(Some(own / 2)).rms > 0.0);
        }
    }
}
