//! Options of loading.

use glam::DVec3;

/// What of a file is loaded, and relative to which point; by default all of it, as it stands there.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadOptions<'a> {
    /// A clip of a glTF file by name, or else by number, counted from 0; nothing else has clips.
    /// `None` is the first.
    pub clip: Option<&'a str>,
    /// Whether textures are left out; without them surfaces keep the factors of their materials.
    pub without_textures: bool,
    /// The point of the file that becomes the origin, in the file's unit.
    ///
    /// An `f32` at the earth's radius knows half a metre. A model there keeps details of a
    /// millimetre relative to an origin nearby, such as [`center`](crate::center) gives: it is
    /// subtracted from coordinates in text and in PLY files, and from composed transforms, before
    /// they are rounded from `f64` to `f32`. Positions inside a mesh of a glTF file, in STL files,
    /// and inside the animated transforms of BART files are read as `f32`.
    pub origin: DVec3,
}
