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
    /// Rounds in which contestants take turns.
    pub(super) rounds: usize,
    /// Pixels on a side of the images of the wall.
    pub(super) wall: u32,
    /// Part of the triangles of the cloth that is simulated again.
    pub(super) detail: f32,
    /// Simulation steps as multiples of the scene's own number, and how many times as many the
    /// reference has.
    pub(super) steps: &'static [f64],
    pub(super) finer: usize,
    /// Spaces between key frames, as multiples of the scene's own number; near ones are taken where
    /// they divide that of the reference.
    pub(super) spaces: &'static [f64],
    /// Spaces between key frames of the reference, as a multiple, and simulation steps in each.
    pub(super) fine: [usize; 2],
    /// Times at which motions of few and many key frames are compared.
    pub(super) moments: usize,
    /// Pixels on a side of the images that have a closed form, most samples of each pixel, and
    /// seeds.
    pub(super) noise_size: u32,
    pub(super) samples: usize,
    pub(super) seeds: u64,
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
            anneal_passes: &[],
            size: size.min(128),
            repeats: 2,
            rounds: 5,
            wall: 160,
            detail: 0.02,
            steps: &[0.0625, 0.125, 0.25],
            finer: 2,
            spaces: &[0.125, 0.25, 0.5],
            fine: [2, 2],
            moments: 60,
            noise_size: size.min(16),
            samples: 16,
            seeds: 4,
            seed,
        };
        match preset {
            Preset::Quick => quick,
            Preset::Standard => Self {
                anneal_passes: &[25],
                size: size.min(512),
                repeats: 3,
                rounds: 7,
                wall: 512,
                detail: 0.05,
                steps: &[0.0625, 0.125, 0.25, 0.5, 1.0, 4.0],
                finer: 64,
                spaces: &[0.125, 0.25, 0.5, 1.0, 2.0],
                fine: [16, 4],
                moments: 200,
                noise_size: size.min(32),
                samples: 256,
                seeds: 8,
                ..quick
            },
            Preset::Full => Self {
                compared: 20,
                size,
                anneal_passes: &[25, 100, 400, 1600],
                repeats: 5,
                rounds: 9,
                wall: 1024,
                detail: 0.05,
                steps: &[0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0],
                finer: 64,
                spaces: &[0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0],
                fine: [32, 4],
                moments: 500,
                noise_size: size.min(64),
                samples: 1024,
                seeds: 16,
                ..quick
            },
        }
    }
}
