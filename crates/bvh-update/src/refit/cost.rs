//! What the stages of a pass took, for those who measure.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// What the stages of passes took, in nanoseconds, summed over all blocks and threads.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageCost {
    /// Finding the nodes of blocks.
    pub list: u64,
    /// Fitting leaves.
    pub leaves: u64,
    /// Boxes of inner nodes.
    pub boxes: u64,
    /// Heights and rotations.
    pub rotations: u64,
}

/// The costs so far.
#[derive(Debug, Default)]
pub(crate) struct Costs(Mutex<StageCost>);

impl Costs {
    pub(crate) fn take(&mut self) -> StageCost {
        std::mem::take(self.0.get_mut().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Measures the stages of one block, if anybody wants to know.
pub(super) struct Stopwatch<'a>(Option<(&'a Costs, Instant)>);

impl<'a> Stopwatch<'a> {
    pub(super) fn start(costs: Option<&'a Costs>) -> Self {
        Self(costs.map(|costs| (costs, Instant::now())))
    }

    /// Adds the time since the last call to a stage.
    pub(super) fn lap(&mut self, stage: impl FnOnce(&mut StageCost) -> &mut u64) {
        if let Some((costs, since)) = &mut self.0 {
            let elapsed = since.elapsed().as_nanos() as u64;
            *stage(&mut costs.0.lock().unwrap_or_else(PoisonError::into_inner)) += elapsed;
            *since = Instant::now();
        }
    }

    /// Leaves out the time since the last call.
    pub(super) fn skip(&mut self) {
        if let Some((_, since)) = &mut self.0 {
            *since = Instant::now();
        }
    }
}
