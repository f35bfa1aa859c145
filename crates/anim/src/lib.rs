//! Animated triangle meshes: triangles once, positions per time, and which of them can move at all.
//!
//! Every source (a glTF file, a directory of key frames, a simulation in the crate `scenes`) is an
//! [`Animation`]. Coordinates are right-handed with y up, lengths in the source's own unit (metres
//! in glTF), times in seconds from the start of the animation.
//!
//! [`load`] takes whatever can be loaded, [`parse`] the bytes of a single file. Files are not
//! trusted: what is malformed is a [`LoadError`] that says what, where, and what would be right,
//! and memory stays within a multiple of the size of the file. Positions that are not finite are
//! passed on as they are.
#![forbid(unsafe_code)]

mod aff;
mod animation;
mod budget;
mod error;
mod files;
mod gltf;
mod key_frames;
mod load;
mod mesh_file;
mod normals;
mod options;
mod pose;
mod rotation;
mod sequence;
mod texture;
mod work;

pub use animation::{Animation, Light, Material, Model, Motion, Part, Topology, View};
pub use error::{LoadError, Problem, printable};
pub use glam;
pub use key_frames::{DEFAULT_SECONDS_PER_FRAME, KeyFrames};
pub use load::{center, load, parse};
pub use mesh_file::is_mesh_file;
pub use normals::vertex_normals;
pub use options::LoadOptions;
pub use pose::Pose;
pub use texture::{Filter, Texture, Wrap};
pub use work::{PoseStats, Work};
