//! The registry: names of scenes, their options, and how a name or a path becomes a [`Scene`].

use std::path::{Path, PathBuf};

use anim::{Animation, Light, View};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{
    Effects, LightEffects, Simulated, SimulationStats, bart_museum, cloth_ball, exploding_dragon,
    fairy_forest, file, lion, n_body,
};

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
    /// The name [`load`] takes.
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
}

/// How a scene is made. The same options give the same scene, bit for bit.
#[derive(Clone, Default)]
pub struct SceneOptions<'a> {
    /// Seed of everything random.
    pub seed: u64,
    /// Folder for key frames of simulations, made if it does not exist; `None` simulates every
    /// time.
    pub cache_dir: Option<PathBuf>,
    /// Content of a file of that folder. It is used if it is of the same scene, options and
    /// revision of this crate.
    pub record: Option<&'a [u8]>,
    /// Simulation steps per key frame, at least 1; more is more accurate. `None` is the scene's
    /// default.
    pub substeps: Option<usize>,
    /// Key frames per loop, at least 2. `None` is the scene's default.
    pub key_frames: Option<usize>,
    /// Fraction of the triangles to make, above 0 and at most 1, as near as a scene comes to it:
    /// the museum's sculpture has 4^-n of them, and the forest fewer trees. `None` is all.
    pub detail: Option<f32>,
    /// Effects that the simulation leaves out: their stages do not run.
    pub without: Simulated,
    /// What light is to do; `None` is what the scene calls for. Where this has neither textures nor
    /// alpha, the textures of a file are not read: surfaces keep the factors of their materials.
    pub light: Option<LightEffects>,
    /// Whether a file is loaded relative to the middle of the model ([`anim::center`]), which a
    /// note then names: a model at the earth's radius keeps its details. It is read twice for that.
    pub local_origin: bool,
    /// Called with the fraction done, 0 to 1, while a scene is simulated.
    pub progress: Option<&'a (dyn Fn(f32) + Sync)>,
}

impl SceneOptions<'_> {
    /// Options for a browser's page: of exploding-dragon 91,046 triangles and 48 key frames.
    #[must_use]
    pub fn for_page() -> Self {
        Self { detail: Some(0.36), key_frames: Some(48), ..Self::default() }
    }
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

/// Returns the scenes made by this crate.
#[must_use]
pub fn list() -> &'static [SceneInfo] {
    &[
        bart_museum::INFO,
        cloth_ball::INFO,
        exploding_dragon::INFO,
        fairy_forest::INFO,
        lion::INFO,
        n_body::INFO,
    ]
}

/// Makes the scene of a known name, or loads the file or folder of key frames at a path.
///
/// `bart-museum:3` is the museum started from its fourth shape of five.
/// `exploding-dragon:blended` is the dragon from 16 key frames, blended linearly.
///
/// `clip` picks one of a file's animations by name. A simulated scene takes up to two minutes when
/// it is not in the cache. Failing to write the cache is a note in [`Scene::notes`], not an error.
///
/// # Errors
/// If the name is neither a scene's nor a path that exists, an option is out of range, or the file
/// cannot be loaded.
pub fn load(name_or_path: &str, clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    check(options)?;
    let mut scene = make(name_or_path, clip, options)?;
    scene.effects.simulated -= options.without;
    scene.effects.light = options.light.unwrap_or(scene.effects.light);
    Ok(scene)
}

fn make(name_or_path: &str, clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let make: fn(&SceneOptions<'_>) -> Result<Scene, SceneError> = match name_or_path {
        "bart-museum" | "bart-museum:0" => |options| bart_museum::scene(options, 0),
        "bart-museum:1" => |options| bart_museum::scene(options, 1),
        "bart-museum:2" => |options| bart_museum::scene(options, 2),
        "bart-museum:3" => |options| bart_museum::scene(options, 3),
        "bart-museum:4" => |options| bart_museum::scene(options, 4),
        "cloth-ball" => cloth_ball::scene,
        "exploding-dragon" => |options| Ok(exploding_dragon::DRAGON.scene(options)),
        "exploding-dragon:blended" => exploding_dragon::blended,
        "fairy-forest" => return fairy_forest::scene(clip, options),
        "lion" => |options| Ok(lion::LION.scene(options)),
        "n-body" => |options| Ok(n_body::scene(options)),
        path if Path::new(path).exists() => return Ok(file::scene(Path::new(path), clip, options)?),
        name => {
            let known = list().iter().map(|info| info.name).collect::<Vec<_>>().join(", ");
            let mut message = format!("no scene or file named \"{name}\"; the scenes are {known}");
            if name.starts_with("bart-museum:") {
                message += "; bart-museum:1 to bart-museum:4 start from another shape";
            }
            return Err(SceneError::Request(message));
        }
    };
    if let Some(clip) = clip {
        return Err(SceneError::Request(format!(
            "scene {name_or_path} has no clips, so none named \"{clip}\"; leave the clip out"
        )));
    }
    Ok(Scene { name: name_or_path.to_owned(), ..make(options)? })
}

fn check(options: &SceneOptions<'_>) -> Result<(), SceneError> {
    let message = if let Some(n) = options.substeps.filter(|n| !(1..=100_000).contains(n)) {
        format!("substeps is {n} but must be between 1 and 100000")
    } else if let Some(n) = options.key_frames.filter(|n| !(2..=10_000).contains(n)) {
        format!("key_frames is {n} but must be between 2 and 10000")
    } else if let Some(x) = options.detail.filter(|&x| !(x > 0.0 && x <= 1.0)) {
        format!("detail is {x} but must be above 0 and at most 1")
    } else {
        return Ok(());
    };
    Err(SceneError::Request(message))
}
