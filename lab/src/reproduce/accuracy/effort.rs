//! How much is measured of each knob.

use crate::reproduce::preset::{MANY, Preset, Values};

/// What a preset means here.
#[derive(Clone, Debug)]
pub(crate) struct Effort {
    /// Frames in a loop, over which strategies update their trees.
    pub(super) frames: usize,
    /// How many of those are played, from the first on.
    pub(super) played: usize,
    /// Frames of the latter on which trees are compared with a fresh sweep build.
    pub(super) compared: usize,
    /// Passes of annealed builds.
    pub(super) anneal_passes: &'static [u32],
    /// Pixels on a side of the images that are timed.
    pub(super) size: u32,
    /// Runs of which the fastest counts, where one run is short.
    pub(super) repeats: usize,
    /// Rounds in which trees are traced beside a fresh one.
    pub(super) rounds: usize,
    /// Triangles of closed meshes.
    pub(super) solid_triangles: usize,
    /// Rays aimed at edges and vertices, and rays whose distance is compared.
    pub(super) rays: [usize; 2],
    /// Part of the triangles of cloth and statues that are simulated again.
    pub(super) detail: f32,
    /// Simulation steps between two key frames, beside the scene's own number.
    pub(super) substeps: &'static [usize],
    /// Spaces between key frames, as multiples of the scene's own number; near ones are taken where
    /// they divide that of the reference.
    pub(super) spaces: &'static [f64],
    /// Spaces between key frames of the reference, as a multiple, and simulation steps in each.
    pub(super) fine: [usize; 2],
    /// Times at which motions are compared.
    pub(super) moments: usize,
    /// Pixels on a side of the images whose error is measured.
    pub(super) noise_size: u32,
    /// Most samples per pixel of ambient occlusion and of diffuse bounces, and samples of their
    /// references.
    pub(super) samples: [(usize, usize); 2],
    pub(super) seed: u64,
}

impl Effort {
    /// For a scene of `triangles` triangles: of large ones [`Preset::Standard`] plays a fifth of
    /// the loop, and anneals none.
    pub(crate) fn new(preset: Preset, values: &Values, triangles: usize, seed: u64) -> Self {
        let effort = Self::of_small(preset, values, seed);
        if preset == Preset::Full || triangles <= MANY {
            return effort;
        }
        Self { played: effort.frames.div_ceil(5), compared: 1, anneal_passes: &[], ..effort }
    }

    fn of_small(preset: Preset, values: &Values, seed: u64) -> Self {
        let Values { frames, size, .. } = *values;
        let quick = Self {
            frames,
            played: frames,
            compared: 2,
            anneal_passes: &[20],
            size: size.min(128),
            repeats: 2,
            rounds: 3,
            solid_triangles: 2_000,
            rays: [20_000, 300],
            detail: 0.02,
            substeps: &[4, 16],
            spaces: &[0.125, 0.5, 1.0],
            fine: [4, 2],
            moments: 60,
            noise_size: size.min(24),
            samples: [(4, 32), (16, 128)],
            seed,
        };
        match preset {
            Preset::Quick => quick,
            Preset::Standard => Self {
                compared: 2,
                anneal_passes: &[25, 100],
                size: size.min(256),
                repeats: 3,
                rounds: 3,
                solid_triangles: 10_000,
                rays: [200_000, 1_000],
                detail: 0.05,
                substeps: &[2, 4, 8, 16, 32, 64],
                spaces: &[0.125, 0.25, 0.5, 1.0, 2.0],
                fine: [8, 4],
                moments: 200,
                noise_size: size.min(48),
                samples: [(16, 128), (64, 512)],
                ..quick
            },
            Preset::Full => Self {
                compared: 20,
                size,
                anneal_passes: &[25, 100, 400, 1600],
                repeats: 5,
                rounds: 9,
                solid_triangles: 20_000,
                rays: [2_000_000, 5_000],
                detail: 1.0,
                substeps: &[2, 4, 8, 16, 32, 64, 128, 256],
                spaces: &[0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0],
                fine: [16, 16],
                moments: 500,
                noise_size: size.min(256),
                samples: [(64, 1024), (256, 4096)],
                ..quick
            },
        }
    }
}
