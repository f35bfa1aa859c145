//! Memory that updates keep from frame to frame.

use bvh_build::{BuildScratch, ReinsertScratch};
use bvh_core::SimdLevel;

use crate::background::Builds;
use crate::clock::Clock;
use crate::cut::CutScratch;
use crate::refit::{BlockCost, Costs, RefitScratch};
use crate::settle::SettleScratch;

/// Memory that updates keep from frame to frame: well below 1 MiB a thread, whatever the size of the tree; what rebuilds
/// and repairs take, if any are made, where the first repair reserves address space for the largest; and up to as much as the
/// tree where leaves are split and merged. It has no influence on results, but for [`Auto`](crate::Auto), which keeps here
/// what it has learned from [`visited`](Self::visited) and from the clock, and trees that are being built in the background.
pub struct Scratch {
    pub(crate) refit: RefitScratch,
    pub(crate) reports_cost: bool,
    pub(crate) build: BuildScratch,
    pub(crate) cut: CutScratch,
    pub(crate) reinsert: ReinsertScratch,
    pub(crate) settle: SettleScratch,
    pub(crate) background: Builds,
    pub(crate) clock: Clock,
    /// Which primitives move, while the tree that knows it is built anew.
    pub(crate) moving: Vec<bool>,
}

impl std::fmt::Debug for Scratch {
    /// The name alone: the rest is memory.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

impl Scratch {
    /// Scratch memory for the best SIMD level of this machine.
    #[must_use]
    pub fn new() -> Self {
        Self::with_level(SimdLevel::best())
    }

    /// Scratch memory for `level`, or the best below it that the machine has.
    #[must_use]
    pub fn with_level(level: SimdLevel) -> Self {
        Self {
            refit: RefitScratch::with_level(level),
            reports_cost: false,
            build: BuildScratch::new(),
            cut: CutScratch::default(),
            reinsert: ReinsertScratch::new(),
            settle: SettleScratch::default(),
            background: Builds::default(),
            clock: Clock::default(),
            moving: Vec::new(),
        }
    }

    /// Makes refits, with and without rotations, record what each of their blocks takes, for
    /// [`take_costs`](Self::take_costs). Sweeps over trees in built order have no blocks.
    pub fn record_costs(&mut self) {
        self.refit.costs = Some(Costs::default());
    }

    /// What the blocks of all passes since the last call took.
    pub fn take_costs(&mut self) -> Vec<BlockCost> {
        self.refit.costs.as_mut().map(Costs::take).unwrap_or_default()
    }

    /// Makes every update report the SAH cost ([`Update::sah_cost`](crate::Update::sah_cost)), where strategies that do not
    /// need it leave it out. `docs/UPDATE_COST.md` has what the sums take.
    pub fn report_cost(&mut self, report: bool) {
        self.reports_cost = report;
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl AsMut<RefitScratch> for Scratch {
    fn as_mut(&mut self) -> &mut RefitScratch {
        &mut self.refit
    }
}
