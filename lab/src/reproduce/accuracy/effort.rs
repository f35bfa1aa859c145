//! How much is measured of each knob. What one knob alone has stands with that knob.

use crate::reproduce::preset::{MANY, Preset, Values};

/// What a preset means here.
#[derive(Clone, Debug)]
pub(crate) struct Effort {
    preset: Preset,
    /// Frames in a loop, over which strategies update their trees.
    pub(super) frames: usize,
    /// Whether the scene is so large that a fifth of the loop is played, and nothing annealed.
    pub(super) is_cut: bool,
    /// Pixels on a side of the images that are timed.
    pub(super) size: u32,
    /// Runs of which the fastest counts, where one run is short.
    pub(super) repeats: usize,
    /// Rounds in which contestants take turns.
    pub(super) rounds: usize,
    pub(super) seed: u64,
}

impl Effort {
    /// For a scene of `triangles` triangles.
    pub(crate) fn new(preset: Preset, values: &Values, triangles: usize, seed: u64) -> Self {
        let Values { frames, size, .. } = *values;
        let is_cut = preset != Preset::Full && triangles > MANY;
        let size = size.min(preset.pick([512, 512, size]));
        let (repeats, rounds) = (preset.pick([1, 3, 5]), preset.pick([3, 7, 9]));
        Self { preset, frames, is_cut, size, repeats, rounds, seed }
    }

    /// What belongs to the preset, of three.
    pub(super) fn pick<T>(&self, of: [T; 3]) -> T {
        self.preset.pick(of)
    }
}
