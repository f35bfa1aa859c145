//! What a scene calls for: the kinds of motion and of light, from which a frame plan is made.

use std::fmt;

use anim::Topology;

/// The effects a scene calls for; a stage of a frame whose effect is not named here need not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    /// What moves the triangles.
    pub motion: MotionEffects,
    /// What light does.
    pub light: LightEffects,
}

/// The kinds of motion in a scene; none at all where nothing moves.
///
/// Cloth, gravity, contact, and fracture are simulated beforehand and play back from key frames or
/// rigid transforms; skin and morph are evaluated at every pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotionEffects {
    /// Simulated cloth.
    pub cloth: bool,
    /// Gravity, uniform or mutual.
    pub gravity: bool,
    /// Contact between bodies.
    pub contact: bool,
    /// Bodies that break.
    pub fracture: bool,
    /// Linear blend skinning.
    pub skin: bool,
    /// Morph targets.
    pub morph: bool,
    /// Whole parts moved rigidly.
    pub rigid: bool,
    /// Vertex positions blended between key frames.
    pub key_frames: bool,
}

/// The kinds of light transport in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightEffects {
    /// Hard shadows of a point light.
    pub shadows: bool,
    /// Textured surfaces.
    pub textures: bool,
    /// Surfaces with holes cut out by transparency.
    pub alpha: bool,
    /// Mirror reflection.
    pub mirror: bool,
    /// Ambient occlusion.
    pub ambient_occlusion: bool,
    /// Indirect diffuse light.
    pub diffuse_bounces: bool,
}

impl MotionEffects {
    /// No motion at all.
    pub const NONE: Self = Self {
        cloth: false,
        gravity: false,
        contact: false,
        fracture: false,
        skin: false,
        morph: false,
        rigid: false,
        key_frames: false,
    };

    /// All kinds of motion.
    pub const ALL: Self = Self {
        cloth: true,
        gravity: true,
        contact: true,
        fracture: true,
        skin: true,
        morph: true,
        rigid: true,
        key_frames: true,
    };

    /// These and `others`.
    #[must_use]
    pub const fn with(self, others: Self) -> Self {
        Self::ALL.without(Self::ALL.without(self).without(others))
    }

    /// These but those that are also in `others`.
    #[must_use]
    pub const fn without(self, others: Self) -> Self {
        Self {
            cloth: self.cloth && !others.cloth,
            gravity: self.gravity && !others.gravity,
            contact: self.contact && !others.contact,
            fracture: self.fracture && !others.fracture,
            skin: self.skin && !others.skin,
            morph: self.morph && !others.morph,
            rigid: self.rigid && !others.rigid,
            key_frames: self.key_frames && !others.key_frames,
        }
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
    /// No light transport beyond the first hit.
    pub const NONE: Self = Self {
        shadows: false,
        textures: false,
        alpha: false,
        mirror: false,
        ambient_occlusion: false,
        diffuse_bounces: false,
    };

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
    /// Every effect's name and whether the scene calls for it, always in the same order: one row of
    /// a table.
    #[must_use]
    pub fn row(&self) -> [(&'static str, bool); 14] {
        let (m, l) = (self.motion, self.light);
        [
            ("cloth", m.cloth),
            ("gravity", m.gravity),
            ("contact", m.contact),
            ("fracture", m.fracture),
            ("skin", m.skin),
            ("morph", m.morph),
            ("rigid", m.rigid),
            ("key frames", m.key_frames),
            ("shadows", l.shadows),
            ("textures", l.textures),
            ("alpha", l.alpha),
            ("mirror", l.mirror),
            ("ambient occlusion", l.ambient_occlusion),
            ("diffuse bounces", l.diffuse_bounces),
        ]
    }
}

/// The names of the effects called for, separated by commas; "none" where there are none.
impl fmt::Display for Effects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.row().into_iter().filter_map(|(name, on)| on.then_some(name)).collect();
        f.pad(&if names.is_empty() { "none".to_owned() } else { names.join(", ") })
    }
}
