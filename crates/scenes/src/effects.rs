//! What a scene calls for: what is simulated, the kinds of motion, and those of light.

use std::fmt;

use anim::{Motion, Part, Topology};
use bitflags::{Flags, bitflags};

/// The effects a scene calls for; a stage of a frame whose effect is not named here need not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    /// What was simulated beforehand.
    pub simulated: Simulated,
    /// What moves the triangles in a frame.
    pub motion: Motion,
    /// What light does.
    pub light: LightEffects,
}

bitflags! {
    /// What is simulated beforehand, and plays back from key frames or rigid transforms.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct Simulated: u8 {
        /// Simulated cloth.
        const CLOTH = 1;
        /// Gravity, uniform or mutual.
        const GRAVITY = 1 << 1;
        /// Contact between bodies.
        const CONTACT = 1 << 2;
        /// Bodies that break.
        const FRACTURE = 1 << 3;
    }
}

bitflags! {
    /// The kinds of light transport in a scene; none at all beyond the first hit.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct LightEffects: u8 {
        /// Hard shadows of a point light.
        const SHADOWS = 1;
        /// Textured surfaces.
        const TEXTURES = 1 << 1;
        /// Surfaces with holes cut out by transparency.
        const ALPHA = 1 << 2;
        /// Mirror reflection.
        const MIRROR = 1 << 3;
        /// Ambient occlusion.
        const AMBIENT_OCCLUSION = 1 << 4;
        /// Indirect diffuse light.
        const DIFFUSE_BOUNCES = 1 << 5;
    }
}

impl LightEffects {
    /// Returns what the materials of a topology's parts call for.
    #[must_use]
    pub fn of(topology: &Topology) -> Self {
        topology.parts.iter().map(|part| Self::of_part(part, topology)).collect()
    }

    /// What the material of a part of a topology calls for.
    pub(crate) fn of_part(part: &Part, topology: &Topology) -> Self {
        let material = &topology.materials[part.material as usize];
        let mut effects = Self::empty();
        effects.set(Self::TEXTURES, material.texture.is_some());
        effects.set(Self::ALPHA, material.cutoff.is_some());
        effects.set(Self::MIRROR, material.mirror);
        effects
    }
}

impl Effects {
    /// Those of a scene of this crate: its motion, and hard shadows.
    pub(crate) const fn of_scene(simulated: Simulated, motion: Motion) -> Self {
        Self { simulated, motion, light: LightEffects::SHADOWS }
    }

    /// Returns the names of the effects called for.
    pub fn names(self) -> impl Iterator<Item = String> {
        names(self.simulated).chain(names(self.motion)).chain(names(self.light))
    }
}

/// The names of flags, for tables: in small letters, with spaces.
pub(crate) fn names<F: Flags>(flags: F) -> impl Iterator<Item = String> {
    flags.iter_names().map(|(name, _)| name.to_lowercase().replace('_', " ")).collect::<Vec<_>>().into_iter()
}

/// The names of the effects called for, separated by commas; "none" where there are none.
impl fmt::Display for Effects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.names().collect();
        f.pad(&if names.is_empty() { "none".to_owned() } else { names.join(", ") })
    }
}
