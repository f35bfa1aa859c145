//! Images on surfaces.

use std::sync::Arc;

/// Colours and opacities in rows from the top, each row from the left. Cheap to clone.
#[derive(Clone, PartialEq, Eq)]
pub struct Image {
    /// Texels in a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Red, green and blue in sRGB, and linear opacity: `width * height` of them.
    pub texels: Arc<[[u8; 4]]>,
}

/// Its size; the texels would fill the screen.
impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Image({} x {})", self.width, self.height)
    }
}

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

/// An image and how it is continued between and beyond its texels.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The image.
    pub image: Image,
    /// Continuation to the left and right, and above and below.
    pub wrap: [Wrap; 2],
    /// What is seen between texels.
    pub filter: Filter,
}
