//! Images on surfaces.

use std::fmt;
use std::sync::Arc;

/// What continues an image beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image, mirrored every other time.
    MirroredRepeat,
    /// The texels at the edge.
    ClampToEdge,
}

/// How a colour between texels is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel's.
    Nearest,
    /// A bilinear blend of the nearest four.
    #[default]
    Linear,
}

/// An image and how it is continued between and beyond its texels. Cheap to clone.
#[derive(Clone, PartialEq, Eq)]
pub struct Texture {
    /// Texels in a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Red, green and blue in sRGB, and linear opacity: `width * height` of them, in rows from the
    /// top, each row from the left.
    pub texels: Arc<[[u8; 4]]>,
    /// The least opacity of a texel.
    pub least_opacity: u8,
    /// Continuation to the left and right, and above and below.
    pub wrap: [Wrap; 2],
    /// What is seen between texels.
    pub filter: Filter,
}

/// Its size in place of its texels.
impl fmt::Debug for Texture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, wrap, filter, .. } = self;
        write!(f, "Texture of {width} x {height} texels, {wrap:?}, {filter:?}")
    }
}
