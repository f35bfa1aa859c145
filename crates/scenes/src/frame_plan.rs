//! What a frame runs: the stages that a scene's effects call for, in order, and no others.

use std::fmt;

use crate::Effects;

/// A stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameStage {
    /// Vertices are blended between key frames.
    KeyFrames,
    /// Vertices are displaced towards morph targets.
    Morph,
    /// Vertices are skinned.
    Skin,
    /// Whole parts are moved.
    Rigid,
    /// The tree is brought up to date.
    Update,
    /// Rays from the eye.
    Primary,
    /// Hits on what is cut out by transparency are passed over.
    Alpha,
    /// Colours are read from textures.
    Textures,
    /// Rays between hits and lights.
    Shadow,
    /// Rays that mirrors send on.
    Mirror,
    /// Short rays that ask how open a place is.
    AmbientOcclusion,
    /// Rays that gather light from other surfaces.
    DiffuseBounces,
}

/// The stages of a scene's frame, in the order they run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FramePlan {
    stages: Vec<FrameStage>,
}

impl FrameStage {
    /// All stages, in the order they run.
    pub const ALL: [Self; 12] = [
        Self::KeyFrames,
        Self::Morph,
        Self::Skin,
        Self::Rigid,
        Self::Update,
        Self::Primary,
        Self::Alpha,
        Self::Textures,
        Self::Shadow,
        Self::Mirror,
        Self::AmbientOcclusion,
        Self::DiffuseBounces,
    ];

    /// A short name for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::KeyFrames => "key frames",
            Self::Morph => "morph",
            Self::Skin => "skin",
            Self::Rigid => "rigid",
            Self::Update => "update",
            Self::Primary => "primary",
            Self::Alpha => "alpha",
            Self::Textures => "textures",
            Self::Shadow => "shadow",
            Self::Mirror => "mirror",
            Self::AmbientOcclusion => "ambient occlusion",
            Self::DiffuseBounces => "diffuse bounces",
        }
    }

    /// Whether a scene with these effects needs the stage.
    fn is_called_for(self, Effects { motion, light }: &Effects) -> bool {
        match self {
            Self::KeyFrames => motion.key_frames,
            Self::Morph => motion.morph,
            Self::Skin => motion.skin,
            Self::Rigid => motion.rigid,
            Self::Update => motion.key_frames || motion.morph || motion.skin || motion.rigid,
            Self::Primary => true,
            Self::Alpha => light.alpha,
            Self::Textures => light.textures,
            Self::Shadow => light.shadows,
            Self::Mirror => light.mirror,
            Self::AmbientOcclusion => light.ambient_occlusion,
            Self::DiffuseBounces => light.diffuse_bounces,
        }
    }
}

impl FramePlan {
    /// The plan for a scene with these effects.
    #[must_use]
    pub fn new(effects: &Effects) -> Self {
        Self { stages: FrameStage::ALL.into_iter().filter(|s| s.is_called_for(effects)).collect() }
    }

    /// The stages, in the order they run.
    #[must_use]
    pub fn stages(&self) -> &[FrameStage] {
        &self.stages
    }

    /// Whether a stage is to run.
    #[must_use]
    pub fn contains(&self, stage: FrameStage) -> bool {
        self.stages.contains(&stage)
    }
}

/// The names of the stages, in order, separated by commas.
impl fmt::Display for FramePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.stages.iter().map(|stage| stage.name()).collect();
        f.pad(&names.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LightEffects, MotionEffects};

    #[test]
    fn a_plan_holds_what_is_called_for_and_nothing_else() {
        let plan = |motion, light| FramePlan::new(&Effects { motion, light }).to_string();
        assert_eq!(plan(MotionEffects::NONE, LightEffects::NONE), "primary");
        let all_motion = MotionEffects { skin: true, rigid: true, gravity: true, ..MotionEffects::NONE };
        assert_eq!(plan(all_motion, LightEffects::SHADOWS), "skin, rigid, update, primary, shadow");
        let light = LightEffects { textures: true, mirror: true, ..LightEffects::NONE };
        let cloth = MotionEffects { cloth: true, key_frames: true, ..MotionEffects::NONE };
        assert_eq!(plan(cloth, light), "key frames, update, primary, textures, mirror");
    }
}
