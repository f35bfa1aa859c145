//! The animated scenes of Pivot's experiments, and animations from files, behind one call:
//! [`load`].
//!
//! The animations that papers on dynamic geometry use cannot be shipped. This crate makes stand-ins
//! with the same triangle counts and the same kind of motion. Every scene is a pure function of its
//! options and of time: the same on any number of threads, seekable, and loopable. Scenes that need
//! a simulation run it once, with small fixed steps, and keep it as key frames in a cache folder.
//!
//! Coordinates are right-handed with y up. Units are each scene's own; times are in seconds.
#![forbid(unsafe_code)]

mod accuracy;
mod bart_museum;
mod cache;
mod cloth;
mod cloth_ball;
mod decimate;
mod dragon;
mod effects;
mod exploding_dragon;
mod fairy;
mod fairy_forest;
mod file;
mod forest;
mod fracture;
mod frame_stages;
mod glb;
mod implicit;
mod lion;
mod lion_solid;
mod meshing;
mod n_body;
mod near;
mod options;
mod registry;
mod rigid;
mod room;
mod scene;
mod shape;
mod shatter;
mod simulation;
mod statue;
mod toys;
mod whole_file;

pub use accuracy::{Distance, distance};
pub use effects::{Effects, LightEffects, Simulated};
pub use fairy_forest::fairy_forest_glb;
pub use file::{NARROWEST, scene_of};
pub use frame_stages::FrameStage;
pub use options::SceneOptions;
pub use registry::{list, load};
pub use scene::{Measure, Scene, SceneError, SceneInfo};
pub use simulation::SimulationStats;
pub use toys::toys_glb;
pub use whole_file::{PARTIAL, write_whole};

use scene::Make;
