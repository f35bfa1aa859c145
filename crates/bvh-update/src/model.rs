//! The model of a frame's time that `auto.rs` decides by: what is lost to a tree with excess cost, and what mending it costs.

use bvh_build::Builder;
use bvh_core::{Bvh, History};

use crate::block::Tally;
use crate::clock::Weights;
use crate::cut::{excess, size_now};

/// Who builds in haste.
pub(crate) const HASTY: Builder = Builder::Lbvh;
/// How many more nodes rays visit in a tree built so, as a part.
const HASTY_WORK: f64 = 0.1;

/// What a cut is expected to be, as part of the primitives, before there was one.
const SMALL_CUT: f64 = 0.02;
/// For how many frames the gain of a rotation, or of leaves that were split, is taken to last at most.
pub(crate) const GAIN_LASTS: f64 = 8.0;
/// What fitting takes less for a leaf that was merged, and the node above it: primitives are looked at as before.
const FIT_SAVED: f64 = 0.2;
/// Rotations are tried at one node in 2 to the power of this at least.
const LONGEST_PAUSE: u32 = 3;

/// What a pass has found, for the choices after it. Costs are parts of the SAH cost of the tree when it was good.
pub(crate) struct Found {
    pub(crate) primitives: f64,
    /// Nodes visited.
    pub(crate) nodes: f64,
    /// What the rotations of this pass have saved.
    pub(crate) gain: f64,
    /// What there is above the cost after the last repair.
    pub(crate) excess: f64,
}

/// How good a tree is after a pass.
pub(crate) struct Standing {
    pub(crate) size: f64,
    /// Sum of half areas times weights.
    pub(crate) sum: f64,
    /// What that is above the sum of a tree as good as this was when it was good, in units of that.
    pub(crate) excess: f64,
}

impl Standing {
    pub(crate) fn of(bvh: &Bvh, tally: &Tally) -> Self {
        let (size, sum) = (size_now(bvh, tally.leaf_area), tally.area + bvh.still_area());
        Self { size, sum, excess: excess(bvh.history(), sum, size) }
    }
}

/// How many times as long as at first one waits after so many attempts in vain.
pub(crate) fn doubled(attempts: u32) -> f64 {
    if crate::ablation::is_off(10) { 1.0 } else { f64::from(1u32 << attempts.min(16)) }
}

/// What time is expected to be lost and saved.
#[derive(Clone, Copy)]
pub(crate) struct Model {
    pub(crate) rays: u64,
    pub(crate) weights: Weights,
    /// By what part rays take longer in a tree of twice the cost.
    pub(crate) slope: f64,
}

impl Model {
    /// Time that the rays take longer for this much excess.
    pub(crate) fn lost(self, excess: f64) -> f64 {
        // Beyond numbers nothing is known.
        if excess.is_finite() {
            self.rays as f64 * self.weights.ray * self.slope * excess.max(0.0)
        } else {
            0.0
        }
    }

    /// Time saved in each update by rays that take less by this part, and so many fewer nodes.
    pub(crate) fn saved(self, rays: f64, nodes: f64, one_in: u32) -> f64 {
        let Weights { ray, fit_node, rotate_node, .. } = self.weights;
        self.rays as f64 * ray * rays + nodes * (FIT_SAVED * fit_node + rotate_node / f64::from(one_in))
    }

    /// What there is above the cost after the last repair.
    pub(crate) fn excess(self, standing: &Standing, history: &History) -> f64 {
        let hasty = if history.is_hasty { self.hasty_excess() } else { 0.0 };
        standing.excess + hasty
    }

    /// The excess of a tree built in haste.
    pub(crate) fn hasty_excess(self) -> f64 {
        HASTY_WORK / self.slope
    }

    /// Chooses how often to try rotations from now on, by what they have saved.
    pub(crate) fn choose_pause(self, history: &mut History, found: &Found) {
        if crate::ablation::is_off(9) { history.rotation_pause = 0; return; }
        // What a rotation gains is lost again in the next repair, on average half a period from here.
        let period = history.period.max(history.since_repair);
        let lasts = if history.period > 0 { (f64::from(period) - 1.0) / 2.0 } else { GAIN_LASTS };
        let saved = self.lost(found.gain) * lasts.min(GAIN_LASTS);
        let tried = found.nodes * self.weights.rotate_node / f64::from(1u32 << history.rotation_pause);
        // More to come back than to go: no swinging to and fro.
        if saved < tried && history.rotation_pause < LONGEST_PAUSE {
            history.rotation_pause += 1;
        } else if saved > 4.0 * tried && history.rotation_pause > 0 {
            history.rotation_pause -= 1;
        }
    }

    /// The excess above which opening a subtree pays for itself once: what its rebuild costs must come back in as many
    /// frames as have passed since the last repair, or in longer where looks have been in vain.
    pub(crate) fn threshold(self, history: &History) -> f64 {
        let frames = f64::from(history.since_repair.clamp(1, 8)) * doubled(history.looks_in_vain);
        self.weights.graft_subtree / (self.rays.max(1) as f64 * self.weights.ray * self.slope * frames)
    }

    /// What is to be lost until the next repair: what that is expected to cost, as much as the last one; and after each look
    /// in vain twice as much as before.
    pub(crate) fn price_of_repair(self, history: &History, nodes: f64, primitives: f64) -> f64 {
        let cut = if history.kept > 0 { f64::from(history.kept) } else { SMALL_CUT * primitives };
        (nodes * self.weights.cut_node + cut * self.weights.graft_subtree) * doubled(history.looks_in_vain)
    }

    /// Who builds a new tree of so many primitives that will serve for so many frames, and for how much.
    pub(crate) fn builder(self, primitives: f64, frames: u32) -> (Builder, f64) {
        let Weights { rebuild_primitive, hasty_primitive, .. } = self.weights;
        let worse = self.lost(self.hasty_excess()) * f64::from(frames);
        if crate::ablation::is_off(8) || !crate::ablation::is_off(7) && worse < primitives * (rebuild_primitive - hasty_primitive) {
            (HASTY, primitives * hasty_primitive)
        } else {
            (Builder::Ploc, primitives * rebuild_primitive)
        }
    }
}
