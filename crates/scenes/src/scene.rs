//! What a scene is, what the registry knows of it, and why it could not be loaded.

use anim::{Animation, Light, View};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{Effects, SceneOptions, SimulationStats};

/// An animation with what is needed to show it.
pub struct Scene {
    /// The scene's name, or the path it was loaded from.
    pub name: String,
    /// One line on what is seen.
    pub about: &'static str,
    /// The triangles and their motion.
    pub animation: Box<dyn Animation>,
    /// The view to use where `animation.view(time)` is `None`.
    pub view: View,
    /// The light to use where `animation.light(time)` is `None`.
    pub light: Light,
    /// What the scene calls for.
    pub effects: Effects,
    /// Number of frames that sample one loop well, evenly spaced over the animation's duration.
    pub frames: usize,
    /// How well the simulation kept what it should keep; empty where nothing is simulated.
    pub measures: Vec<Measure>,
    /// What simulating it did.
    pub simulated: SimulationStats,
    /// Bytes of key frames held in memory: positions or placements, but neither still geometry nor
    /// topology, and not what was loaded from a file.
    pub key_bytes: usize,
    /// Remarks for the user, one line each, such as that the light is a default.
    pub notes: Vec<String>,
}

impl Scene {
    /// What the registry knows as `info`, seen from an eye towards a point, lit from a place.
    pub(crate) fn new(
        info: &SceneInfo,
        animation: Box<dyn Animation>,
        (eye, target): (Vec3, Vec3),
        fov_y: f32,
        light: Vec3,
    ) -> Self {
        Self {
            name: info.name.to_owned(),
            about: info.about,
            animation,
            view: View { eye, target, up: Vec3::Y, fov_y },
            light: Light { position: light, color: [1.0; 3] },
            effects: info.effects,
            frames: info.frames,
            measures: Vec::new(),
            simulated: SimulationStats::default(),
            key_bytes: info.key_bytes,
            notes: Vec::new(),
        }
    }
}

/// An error of a simulation against a quantity that it should keep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// What is measured, such as "energy drift".
    pub name: String,
    /// The measured value, a fraction of the exact quantity unless the name says otherwise.
    pub value: f64,
}

/// What the registry knows of a scene without making it.
#[derive(Clone, Copy, Debug)]
pub struct SceneInfo {
    /// The name [`load`](crate::load) takes.
    pub name: &'static str,
    /// One line on what is seen.
    pub about: &'static str,
    /// Number of triangles with default options.
    pub triangles: usize,
    /// Number of frames in one loop.
    pub frames: usize,
    /// What the scene calls for.
    pub effects: Effects,
    /// Bytes of key frames that playback keeps in memory with default options, to within 2 %; 0
    /// where everything is evaluated from the tracks of a file. See [`Scene::key_bytes`].
    pub key_bytes: usize,
    /// What makes the scene, and its variants: each with what its name adds to the scene's.
    pub(crate) make: &'static [(&'static str, Make)],
}

/// A function that makes a scene.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Make {
    /// Of a scene without clips.
    Whole(fn(&SceneOptions<'_>) -> Result<Scene, SceneError>),
    /// Of a clip, by name, or of the scene's default.
    Clip(fn(Option<&str>, &SceneOptions<'_>) -> Result<Scene, SceneError>),
}

/// Why a scene could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// What was asked for is not there or out of range; one line that says what would be right.
    #[error("{0}")]
    Request(String),
    /// A file could not be loaded.
    #[error(transparent)]
    Load(#[from] anim::LoadError),
    /// A simulation gave key frames that do not fit together.
    #[error(transparent)]
    KeyFrames(#[from] anim::Problem),
}
