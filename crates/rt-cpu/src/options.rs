//! How to render.

use bvh_core::SimdLevel;

use crate::TriangleTest;

/// How rays are grouped to go through the tree. Images do not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Traversal {
    /// One by one, all of them through the tree itself: [`render`](crate::render) makes no wider
    /// view of it.
    Single,
    /// In packets of 8 x 8 as Wald, Boulos and Shirley published them in 2007.
    Packet,
    /// In packets of 8 x 8 of a tile that share the way through the tree's top, and in smaller
    /// groups where rays drift apart; with SIMD.
    #[default]
    Tile,
}

bvh_core::named!(Traversal, "traversal", Single = "single", Packet = "packet", Tile = "tile");

/// What an image shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Output {
    /// The scene.
    #[default]
    Shaded,
    /// Inner nodes visited by the rays of each pixel, shadow rays included, traced one by one: from
    /// black over blue, red and yellow to white at `most` or more.
    NodesVisited {
        /// The number of nodes that is shown white.
        most: u32,
    },
}

/// What light does beyond being seen directly. What is off, or what nothing in the mesh calls for,
/// costs nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effects {
    /// Whether surfaces are textured.
    pub textures: bool,
    /// Whether surfaces have the holes that cutoffs of opacity cut. Rays of all kinds go on through
    /// them.
    pub alpha: bool,
    /// Whether mirrors reflect, up to four in a row; a fifth is black. Otherwise they are diffuse.
    pub mirror: bool,
    /// How the light from everywhere is kept from corners, if it is. Without meaning with diffuse
    /// bounces.
    pub ambient_occlusion: Option<AmbientOcclusion>,
    /// Light from diffuse surfaces and the sky, if any, in place of a constant light from
    /// everywhere.
    pub diffuse_bounces: Option<DiffuseBounces>,
}

/// Light from everywhere, dimmed by the part of the sky that nearby surfaces hide, weighted by the
/// cosine of its angle to the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmbientOcclusion {
    /// Rays for each hit; without any, nothing is hidden.
    pub samples: u32,
    /// What is farther away hides nothing; may be infinite.
    pub distance: f32,
}

/// Path tracing of diffuse surfaces (Kajiya, *The Rendering Equation*, 1986): one path for each
/// pixel and sample, with light from the point light and from the sky. From the third bounce on,
/// paths go on at random, as likely as they are bright, in such a way that the mean is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseBounces {
    /// Light that bounced more often is left out.
    pub most: u32,
    /// Linear radiance of the sky, all round, as diffuse surfaces see it; a white surface under it
    /// has this colour.
    pub sky: [f32; 3],
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// How rays are grouped.
    pub traversal: Traversal,
    /// How rays are tested against triangles.
    pub triangle_test: TriangleTest,
    /// Instruction set for [`Traversal::Tile`] and shading; the best of the machine if that has
    /// less. Images do not depend on it.
    pub simd: SimdLevel,
    /// Whether the light throws shadows; without, no shadow ray is cast.
    pub shadows: bool,
    /// Whether normals are interpolated where the mesh has them.
    pub smooth: bool,
    /// What the image shows.
    pub output: Output,
    /// What light does beyond being seen directly. Only [`Output::Shaded`] shows it.
    pub effects: Effects,
    /// Seed of everything random. The same seed gives the same image, bit for bit.
    pub seed: u64,
    /// Number of the sample: each is another image of the same scene, taken at another place in
    /// every pixel (sample 0 in its middle) and with other random numbers. Their mean is the image;
    /// see [`Image::add`](crate::Image::add).
    pub sample: u32,
    /// Whether to take [`RenderStats::times`](crate::RenderStats::times), at the price of some looks
    /// at the clock for each tile.
    pub timed: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            traversal: Traversal::default(),
            triangle_test: TriangleTest::default(),
            simd: SimdLevel::best(),
            shadows: true,
            smooth: true,
            output: Output::default(),
            effects: Effects::default(),
            seed: 0,
            sample: 0,
            timed: false,
        }
    }
}
