//! The one loop behind all simulated scenes: key frames made of steps, steps made of stages.
//!
//! A scene calls for the effects whose stages its world lists. So no scene can declare an effect
//! that it does not simulate, or simulate one that it does not declare.

use serde::{Deserialize, Serialize};

use crate::{MotionEffects, SceneOptions};

/// What a stage of a step serves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Positions follow velocities. Runs always.
    Drift,
    Cloth,
    Gravity,
    Contact,
    Fracture,
}

/// Number of a step, and its number since the last key frame.
#[derive(Clone, Copy)]
pub(crate) struct Step {
    pub(crate) index: usize,
    pub(crate) since_key: usize,
}

/// A part of a step. Gives how often it did what it does.
pub(crate) type Run<W> = fn(&mut W, Step) -> usize;

/// What is simulated.
pub(crate) trait World: Sized + 'static {
    /// The parts of a step, in the order they run.
    const STAGES: &'static [(Stage, Run<Self>)];

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
    /// Contacts resolved.
    pub contact: u64,
    /// Pieces broken off.
    pub fracture: u64,
}

impl SimulationStats {
    fn of(&mut self, stage: Stage) -> &mut u64 {
        match stage {
            Stage::Drift => &mut self.drift,
            Stage::Cloth => &mut self.cloth,
            Stage::Gravity => &mut self.gravity,
            Stage::Contact => &mut self.contact,
            Stage::Fracture => &mut self.fracture,
        }
    }
}

/// What a world calls for: the effects of its stages.
pub(crate) const fn effects<W: World>() -> MotionEffects {
    let mut effects = MotionEffects::NONE;
    let mut i = 0;
    while i < W::STAGES.len() {
        match W::STAGES[i].0 {
            Stage::Drift => {}
            Stage::Cloth => effects.cloth = true,
            Stage::Gravity => effects.gravity = true,
            Stage::Contact => effects.contact = true,
            Stage::Fracture => effects.fracture = true,
        }
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
    let without = options.without;
    let runs = |stage| match stage {
        Stage::Drift => true,
        Stage::Cloth => !without.cloth,
        Stage::Gravity => !without.gravity,
        Stage::Contact => !without.contact,
        Stage::Fracture => !without.fracture,
    };
    let stages: Vec<_> = W::STAGES.iter().filter(|&&(stage, _)| runs(stage)).collect();
    let mut stats = SimulationStats::default();
    for key in 0..keys {
        if let Some(progress) = options.progress {
            progress(key as f32 / (keys - 1) as f32);
        }
        world.record(key);
        let steps = if key + 1 < keys { substeps } else { 0 };
        for since_key in 0..steps {
            let step = Step { index: key * substeps + since_key, since_key };
            for &&(stage, run) in &stages {
                *stats.of(stage) += run(world, step) as u64;
            }
        }
    }
    stats
}
