//! What a frame runs: the stages that a scene's effects call for, in order, and no others.

use std::fmt;

use anim::Motion;

use crate::{Effects, LightEffects, Scene};

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
///
/// Whatever plays a scene asks its plan what to do: [`motion`](Self::motion) is all that a pose moves
/// by, and [`light`](Self::light) all that a picture has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramePlan {
    effects: Effects,
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
}

impl FramePlan {
    /// The plan for a scene with these effects.
    #[must_use]
    pub fn new(effects: &Effects) -> Self {
        Self { effects: *effects }
    }

    /// The stages, in the order they run.
    pub fn stages(&self) -> impl Iterator<Item = FrameStage> {
        FrameStage::ALL.into_iter().filter(|&stage| self.contains(stage))
    }

    /// Whether a stage is to run.
    #[must_use]
    pub fn contains(&self, stage: FrameStage) -> bool {
        let (motion, light) = (self.motion(), self.light());
        match stage {
            FrameStage::KeyFrames => motion.key_frames,
            FrameStage::Morph => motion.morph,
            FrameStage::Skin => motion.skin,
            FrameStage::Rigid => motion.rigid,
            FrameStage::Update => !motion.is_still(),
            FrameStage::Primary => true,
            FrameStage::Alpha => light.alpha,
            FrameStage::Textures => light.textures,
            FrameStage::Shadow => light.shadows,
            FrameStage::Mirror => light.mirror,
            FrameStage::AmbientOcclusion => light.ambient_occlusion,
            FrameStage::DiffuseBounces => light.diffuse_bounces,
        }
    }

    /// The kinds of motion that are evaluated.
    #[must_use]
    pub fn motion(&self) -> Motion {
        let crate::MotionEffects { skin, morph, rigid, key_frames, .. } = self.effects.motion;
        Motion { skin, morph, rigid, key_frames }
    }

    /// What light does.
    #[must_use]
    pub fn light(&self) -> LightEffects {
        self.effects.light
    }

    /// One line for each stage of the plan that says what of the scene calls for it.
    #[must_use]
    pub fn reasons(&self, scene: &Scene) -> Vec<(FrameStage, String)> {
        let topology = scene.animation.topology();
        let parts = |calls: fn(Motion) -> bool| {
            let count = topology.parts.iter().filter(|part| calls(part.motion)).count();
            format!("{count} of {} parts", topology.parts.len())
        };
        let of_parts = |calls: fn(&anim::Material) -> bool| {
            let calls = |part: &&anim::Part| calls(&topology.materials[part.material as usize]);
            format!("{} of {} parts", topology.parts.iter().filter(calls).count(), topology.parts.len())
        };
        let reason = |stage| match stage {
            FrameStage::KeyFrames => parts(|motion| motion.key_frames) + " have key frames",
            FrameStage::Morph => parts(|motion| motion.morph) + " have morph weights that vary",
            FrameStage::Skin => parts(|motion| motion.skin) + " have joints that move",
            FrameStage::Rigid => parts(|motion| motion.rigid) + " are moved as a whole",
            FrameStage::Update => {
                let moving = topology.moves.iter().filter(|&&moves| moves).count();
                format!("{moving} of {} triangles move", topology.moves.len())
            }
            FrameStage::Primary => "the eye sees".to_owned(),
            FrameStage::Alpha => of_parts(|material| material.cutoff.is_some()) + " have holes",
            FrameStage::Textures => of_parts(|material| material.texture.is_some()) + " have textures",
            FrameStage::Shadow if scene.animation.light(0.0).is_some() => "the file has a light".to_owned(),
            FrameStage::Shadow => "the scene is lit".to_owned(),
            FrameStage::Mirror => of_parts(|material| material.mirror) + " are mirrors",
            FrameStage::AmbientOcclusion | FrameStage::DiffuseBounces => "asked for".to_owned(),
        };
        self.stages().map(|stage| (stage, reason(stage))).collect()
    }
}

/// The names of the stages, in order, separated by commas.
impl fmt::Display for FramePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.stages().map(FrameStage::name).collect();
        f.pad(&names.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MotionEffects;

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
