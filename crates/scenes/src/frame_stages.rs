//! What a frame runs: the stages that a scene's effects call for, in order, and no others.

use anim::{Motion, Part};

use crate::{Effects, LightEffects, Scene};

/// Declares the stages in the order they run: the name of each for tables, and what calls for it.
macro_rules! stages {
    ($($(#[$doc:meta])* $stage:ident: $name:literal, $calls:expr;)*) => {
        /// A stage of a frame.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum FrameStage {
            $($(#[$doc])* $stage,)*
        }

        impl FrameStage {
            /// All stages, in the order they run.
            pub const ALL: [Self; 12] = [$(Self::$stage),*];

            /// A short name for tables.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$stage => $name,)*
                }
            }

            fn is_called_for(self, motion: Motion, light: LightEffects) -> bool {
                let calls: fn(Motion, LightEffects) -> bool = match self {
                    $(Self::$stage => $calls,)*
                };
                calls(motion, light)
            }
        }
    };
}

stages! {
    /// Vertices are blended between key frames.
    KeyFrames: "key frames", |motion, _| motion.key_frames;
    /// Vertices are displaced towards morph targets.
    Morph: "morph", |motion, _| motion.morph;
    /// Vertices are skinned.
    Skin: "skin", |motion, _| motion.skin;
    /// Whole parts are moved.
    Rigid: "rigid", |motion, _| motion.rigid;
    /// The tree is brought up to date.
    Update: "update", |motion, _| !motion.is_still();
    /// Rays from the eye.
    Primary: "primary", |_, _| true;
    /// Hits on what is cut out by transparency are passed over.
    Alpha: "alpha", |_, light| light.alpha;
    /// Colours are read from textures.
    Textures: "textures", |_, light| light.textures;
    /// Rays between hits and lights.
    Shadow: "shadow", |_, light| light.shadows;
    /// Rays that mirrors send on.
    Mirror: "mirror", |_, light| light.mirror;
    /// Short rays that ask how open a place is.
    AmbientOcclusion: "ambient occlusion", |_, light| light.ambient_occlusion;
    /// Rays that gather light from other surfaces.
    DiffuseBounces: "diffuse bounces", |_, light| light.diffuse_bounces;
}

impl Effects {
    /// The stages of a frame of a scene with these effects, in the order they run.
    pub fn stages(self) -> impl Iterator<Item = FrameStage> {
        FrameStage::ALL.into_iter().filter(move |&stage| self.calls_for(stage))
    }

    /// Whether a frame runs a stage.
    #[must_use]
    pub fn calls_for(self, stage: FrameStage) -> bool {
        stage.is_called_for(self.motion.playback(), self.light)
    }
}

impl Scene {
    /// The stages of a frame, each with a line that says what of the scene calls for it.
    #[must_use]
    pub fn stage_reasons(&self) -> Vec<(FrameStage, String)> {
        let topology = self.animation.topology();
        let parts = |calls: &dyn Fn(&Part) -> bool, are: &str| {
            let count = topology.parts.iter().filter(|part| calls(part)).count();
            format!("{count} of {} parts {are}", topology.parts.len())
        };
        let material = |part: &Part| topology.materials[part.material as usize];
        let reason = |stage| match stage {
            FrameStage::KeyFrames => parts(&|part| part.motion.key_frames, "have key frames"),
            FrameStage::Morph => parts(&|part| part.motion.morph, "have morph weights that vary"),
            FrameStage::Skin => parts(&|part| part.motion.skin, "have joints that move"),
            FrameStage::Rigid => parts(&|part| part.motion.rigid, "are moved as a whole"),
            FrameStage::Update => {
                let moving = topology.moves.iter().filter(|&&moves| moves).count();
                format!("{moving} of {} triangles move", topology.moves.len())
            }
            FrameStage::Primary => "the eye sees".to_owned(),
            FrameStage::Alpha => parts(&|part| material(part).cutoff.is_some(), "have holes"),
            FrameStage::Textures => parts(&|part| material(part).texture.is_some(), "have textures"),
            FrameStage::Shadow if self.animation.light(0.0).is_some() => "the file has a light".to_owned(),
            FrameStage::Shadow => "the scene is lit".to_owned(),
            FrameStage::Mirror => parts(&|part| material(part).mirror, "are mirrors"),
            FrameStage::AmbientOcclusion | FrameStage::DiffuseBounces => "asked for".to_owned(),
        };
        self.effects.stages().map(|stage| (stage, reason(stage))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MotionEffects;

    #[test]
    fn a_frame_runs_what_is_called_for_and_nothing_else() {
        let names = |effects: Effects| effects.stages().map(FrameStage::name).collect::<Vec<_>>().join(", ");
        let plan = |motion, light| names(Effects { motion, light });
        assert_eq!(plan(MotionEffects::NONE, LightEffects::NONE), "primary");
        let all_motion = MotionEffects { skin: true, rigid: true, gravity: true, ..MotionEffects::NONE };
        assert_eq!(plan(all_motion, LightEffects::SHADOWS), "skin, rigid, update, primary, shadow");
        let light = LightEffects { textures: true, mirror: true, ..LightEffects::NONE };
        let cloth = MotionEffects { cloth: true, key_frames: true, ..MotionEffects::NONE };
        assert_eq!(plan(cloth, light), "key frames, update, primary, textures, mirror");
    }
}
