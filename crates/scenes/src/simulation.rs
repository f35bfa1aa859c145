//! The one loop behind all simulated scenes: key frames made of steps, steps made of stages.
//!
//! A scene calls for the effects whose stages its world lists. So no scene can declare an effect
//! that it does not simulate, or simulate one that it does not declare.

use serde::{Deserialize, Serialize};

use crate::{SceneOptions, Simulated};

/// A part of a step, which gets the number of the step. Gives how often it did what it does.
pub(crate) type Run<W> = fn(&mut W, usize) -> usize;

/// What is simulated.
pub(crate) trait World: Sized + 'static {
    /// The parts of a step, in the order they run, each with the effect that it serves: none where
    /// positions follow velocities.
    const STAGES: &'static [(Simulated, Run<Self>)];

    /// Keeps a key frame.
    fn record(&mut self, key: usize);
}

/// What simulating a scene did, by effect: zero for each that the scene does not call for or that
/// was left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SimulationStats {
    /// Bodies or particles moved, in all steps.
    pub drift: u64,
    /// Constraints between particles of cloth satisfied.
    pub cloth: u64,
    /// Bodies, particles or pairs pulled.
    pub gravity: u64,
    /// Particles and bodies moved by contact, each time; corners of bodies below the ground; pairs
    /// of balls that meet.
    pub contact: u64,
    /// Pieces broken off.
    pub fracture: u64,
}

/// What a world calls for: the effects of its stages.
pub(crate) const fn effects<W: World>() -> Simulated {
    let (mut effects, mut i) = (Simulated::empty(), 0);
    while i < W::STAGES.len() {
        effects = effects.union(W::STAGES[i].0);
        i += 1;
    }
    effects
}

/// Simulates `substeps` steps between each two of `keys` key frames, by the stages that the options
/// do not leave out.
pub(crate) fn simulate<W: World>(
    world: &mut W,
    keys: usize,
    substeps: usize,
    options: &SceneOptions<'_>,
) -> SimulationStats {
    let stages: Vec<_> = W::STAGES.iter().filter(|stage| !stage.0.intersects(options.without)).collect();
    let mut stats = SimulationStats::default();
    for key in 0..keys {
        if let Some(progress) = options.progress {
            progress(key as f32 / (keys - 1) as f32);
        }
        world.record(key);
        let steps = if key + 1 < keys { substeps } else { 0 };
        for step in (key * substeps..).take(steps) {
            for &&(effect, run) in &stages {
                let count = match effect {
                    Simulated::CLOTH => &mut stats.cloth,
                    Simulated::GRAVITY => &mut stats.gravity,
                    Simulated::CONTACT => &mut stats.contact,
                    Simulated::FRACTURE => &mut stats.fracture,
                    _ => &mut stats.drift,
                };
                *count += run(world, step) as u64;
            }
        }
    }
    stats
}
