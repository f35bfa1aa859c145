//! Options of scenes.

use std::path::PathBuf;

use crate::{LightEffects, Simulated};

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
