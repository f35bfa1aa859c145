//! What a frame runs: the stages that a scene's effects call for, in order, and no others.

use anim::{Motion, Part};

use crate::effects::names;
use crate::{Effects, LightEffects, Scene};

/// A stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameStage {
    /// Vertices are moved by one kind of motion.
    Motion(Motion),
    /// The tree is brought up to date.
    Update,
    /// Rays from the eye.
    Primary,
    /// What one effect of light asks for: rays, or looks at textures. For alpha these are rays that
    /// go on behind hits of what is cut out.
    Light(LightEffects),
}

impl FrameStage {
    /// All stages, in the order they run.
    pub const ALL: [Self; 12] = [
        Self::Motion(Motion::KEY_FRAMES),
        Self::Motion(Motion::MORPH),
        Self::Motion(Motion::SKIN),
        Self::Motion(Motion::RIGID),
        Self::Update,
        Self::Primary,
        Self::Light(LightEffects::ALPHA),
        Self::Light(LightEffects::TEXTURES),
        Self::Light(LightEffects::SHADOWS),
        Self::Light(LightEffects::MIRROR),
        Self::Light(LightEffects::AMBIENT_OCCLUSION),
        Self::Light(LightEffects::DIFFUSE_BOUNCES),
    ];

    /// Returns a short name for tables.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Motion(kind) => names(kind).collect(),
            Self::Update => "update".to_owned(),
            Self::Primary => "primary".to_owned(),
            Self::Light(LightEffects::SHADOWS) => "shadow".to_owned(),
            Self::Light(effect) => names(effect).collect(),
        }
    }
}

impl Effects {
    /// Returns the stages of a frame of a scene with these effects, in the order they run.
    pub fn stages(self) -> impl Iterator<Item = FrameStage> {
        FrameStage::ALL.into_iter().filter(move |&stage| self.calls_for(stage))
    }

    /// Returns whether a frame runs a stage.
    #[must_use]
    pub fn calls_for(self, stage: FrameStage) -> bool {
        match stage {
            FrameStage::Motion(kind) => self.motion.contains(kind),
            FrameStage::Update => !self.motion.is_empty(),
            FrameStage::Primary => true,
            FrameStage::Light(effect) => self.light.contains(effect),
        }
    }
}

impl Scene {
    /// Returns the stages of a frame, each with a line that says what of the scene calls for it.
    #[must_use]
    pub fn stage_reasons(&self) -> Vec<(FrameStage, String)> {
        let topology = self.animation.topology();
        let parts = |calls: &dyn Fn(&Part) -> bool, are: &str| {
            let count = topology.parts.iter().filter(|part| calls(part)).count();
            format!("{count} of {} parts {are}", topology.parts.len())
        };
        let moved = |kind, are| parts(&|part| part.motion.contains(kind), are);
        let lit = |effect, are| parts(&|part| LightEffects::of_part(part, topology).contains(effect), are);
        let reason = |stage| match stage {
            FrameStage::Motion(Motion::KEY_FRAMES) => moved(Motion::KEY_FRAMES, "have key frames"),
            FrameStage::Motion(Motion::MORPH) => moved(Motion::MORPH, "have morph weights that vary"),
            FrameStage::Motion(Motion::SKIN) => moved(Motion::SKIN, "have joints that move"),
            FrameStage::Motion(kind) => moved(kind, "are moved as a whole"),
            FrameStage::Update => {
                let moving = topology.moves.iter().filter(|&&moves| moves).count();
                format!("{moving} of {} triangles move", topology.moves.len())
            }
            FrameStage::Primary => "rays from the eye".to_owned(),
            FrameStage::Light(LightEffects::ALPHA) => lit(LightEffects::ALPHA, "have holes"),
            FrameStage::Light(LightEffects::TEXTURES) => lit(LightEffects::TEXTURES, "have textures"),
            FrameStage::Light(LightEffects::MIRROR) => lit(LightEffects::MIRROR, "are mirrors"),
            FrameStage::Light(LightEffects::SHADOWS) => {
                let source = if self.animation.light(0.0).is_some() { "file" } else { "scene" };
                format!("the {source} has a light")
            }
            FrameStage::Light(_) => "asked for".to_owned(),
        };
        self.effects.stages().map(|stage| (stage, reason(stage))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Simulated;

    #[test]
    fn a_frame_runs_what_is_called_for_and_nothing_else() {
        let plan = |motion, light| {
            let effects = Effects { simulated: Simulated::all(), motion, light };
            effects.stages().map(FrameStage::name).collect::<Vec<_>>().join(", ")
        };
        assert_eq!(plan(Motion::empty(), LightEffects::empty()), "primary");
        let both = Motion::SKIN | Motion::RIGID;
        assert_eq!(plan(both, LightEffects::SHADOWS), "skin, rigid, update, primary, shadow");
        let light = LightEffects::TEXTURES | LightEffects::MIRROR;
        assert_eq!(plan(Motion::KEY_FRAMES, light), "key frames, update, primary, textures, mirror");
        let all = "key frames, morph, skin, rigid, update, primary, alpha, textures, shadow, mirror, \
                   ambient occlusion, diffuse bounces";
        assert_eq!(plan(Motion::all(), LightEffects::all()), all);
    }
}
