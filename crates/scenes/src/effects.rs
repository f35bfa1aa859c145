//! What a scene calls for: the kinds of motion and of light.

use std::fmt;

use anim::{Motion, Topology};

/// The effects a scene calls for; a stage of a frame whose effect is not named here need not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    /// What moves the triangles.
    pub motion: MotionEffects,
    /// What light does.
    pub light: LightEffects,
}

/// Declares a set of effects as a struct of switches, with the name of each for tables.
macro_rules! effects {
    ($(#[$about:meta])* $set:ident { $($(#[$doc:meta])* $effect:ident: $name:literal,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct $set {
            $($(#[$doc])* pub $effect: bool,)*
        }

        impl $set {
            /// None of them.
            pub const NONE: Self = Self { $($effect: false,)* };

            /// All of them.
            pub const ALL: Self = Self { $($effect: true,)* };

            /// These and `others`.
            #[must_use]
            pub const fn with(self, others: Self) -> Self {
                Self { $($effect: self.$effect || others.$effect,)* }
            }

            /// These but those that are also in `others`.
            #[must_use]
            pub const fn without(self, others: Self) -> Self {
                Self { $($effect: self.$effect && !others.$effect,)* }
            }

            /// Every effect's name and whether it is one of these, always in the same order.
            pub fn row(self) -> impl Iterator<Item = (&'static str, bool)> {
                [$(($name, self.$effect)),*].into_iter()
            }
        }
    };
}

effects! {
    /// The kinds of motion in a scene; none at all where nothing moves.
    ///
    /// Cloth, gravity, contact, and fracture are simulated beforehand and play back from key frames
    /// or rigid transforms; skin and morph are evaluated at every pose.
    MotionEffects {
        /// Simulated cloth.
        cloth: "cloth",
        /// Gravity, uniform or mutual.
        gravity: "gravity",
        /// Contact between bodies.
        contact: "contact",
        /// Bodies that break.
        fracture: "fracture",
        /// Linear blend skinning.
        skin: "skin",
        /// Morph targets.
        morph: "morph",
        /// Whole parts moved rigidly.
        rigid: "rigid",
        /// Vertex positions blended between key frames.
        key_frames: "key frames",
    }
}

effects! {
    /// The kinds of light transport in a scene; none at all beyond the first hit.
    LightEffects {
        /// Hard shadows of a point light.
        shadows: "shadows",
        /// Textured surfaces.
        textures: "textures",
        /// Surfaces with holes cut out by transparency.
        alpha: "alpha",
        /// Mirror reflection.
        mirror: "mirror",
        /// Ambient occlusion.
        ambient_occlusion: "ambient occlusion",
        /// Indirect diffuse light.
        diffuse_bounces: "diffuse bounces",
    }
}

impl MotionEffects {
    /// The effects that are simulated beforehand.
    pub const SIMULATED: Self =
        Self { cloth: true, gravity: true, contact: true, fracture: true, ..Self::NONE };

    /// The kinds of motion that a pose evaluates.
    #[must_use]
    pub fn playback(self) -> Motion {
        let Self { skin, morph, rigid, key_frames, .. } = self;
        Motion { skin, morph, rigid, key_frames }
    }

    /// The playback effects of a topology's parts.
    #[must_use]
    pub fn of(topology: &Topology) -> Self {
        let mut effects = Self::NONE;
        for part in &topology.parts {
            effects.skin |= part.motion.skin;
            effects.morph |= part.motion.morph;
            effects.rigid |= part.motion.rigid;
            effects.key_frames |= part.motion.key_frames;
        }
        effects
    }
}

impl LightEffects {
    /// Hard shadows and nothing else.
    pub const SHADOWS: Self = Self { shadows: true, ..Self::NONE };

    /// Hard shadows, and what the materials of a topology's parts call for.
    #[must_use]
    pub fn of(topology: &Topology) -> Self {
        let mut effects = Self::SHADOWS;
        for part in &topology.parts {
            let material = &topology.materials[part.material as usize];
            effects.textures |= material.texture.is_some();
            effects.alpha |= material.cutoff.is_some();
            effects.mirror |= material.mirror;
        }
        effects
    }
}

impl Effects {
    /// Those of a scene of this crate: its motion, and hard shadows.
    pub(crate) const fn of_scene(motion: MotionEffects) -> Self {
        Self { motion, light: LightEffects::SHADOWS }
    }

    /// The names of the effects called for.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.motion.row().chain(self.light.row()).filter_map(|(name, on)| on.then_some(name))
    }
}

/// The names of the effects called for, separated by commas; "none" where there are none.
impl fmt::Display for Effects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.names().collect();
        f.pad(&if names.is_empty() { "none".to_owned() } else { names.join(", ") })
    }
}
