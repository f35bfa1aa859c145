//! Animated triangle meshes: triangles once, positions per time, and which of them can move at all.
//!
//! Every source (a glTF file, a directory of key frames, a simulation in the crate `scenes`) is an
//! [`Animation`]. Coordinates are right-handed with y up, lengths in the source's own unit (metres in
//! glTF), times in seconds from the start of the animation.
#![forbid(unsafe_code)]

mod animation;

pub use animation::{Animation, Light, Material, Motion, Part, Topology, View};
pub use glam;
