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
        let Values { frames, size, .. } = *values;
        let is_cut = preset != Preset::Full && triangles > MANY;
        let steps: &[f64] = &[0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
        Self {
            frames,
            played: if is_cut { frames.div_ceil(5) } else { frames },
            compared: if is_cut { 1 } else { preset.pick([2, 2, 20]) },
            anneal_passes: if is_cut { &[] } else { preset.pick([&[], &[25], &[25, 100, 400, 1600]]) },
            size: size.min(preset.pick([128, 512, size])),
            repeats: preset.pick([2, 3, 5]),
            rounds: preset.pick([5, 7, 9]),
            wall: preset.pick([160, 512, 1024]),
            detail: preset.pick([0.02, 0.05, 0.05]),
            steps: preset.pick([&steps[..3], &[0.0625, 0.125, 0.25, 0.5, 1.0, 4.0], steps]),
            finer: preset.pick([2, 64, 64]),
            spaces: preset.pick([&steps[1..4], &steps[1..6], &steps[..7]]),
            fine: preset.pick([[2, 2], [16, 4], [32, 4]]),
            moments: preset.pick([60, 200, 500]),
            noise_size: size.min(preset.pick([16, 32, 64])),
            samples: preset.pick([16, 256, 1024]),
            seeds: preset.pick([4, 8, 16]),
            seed,
        }
    }
}
