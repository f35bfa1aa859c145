//! What the blocks of a pass took, for those who measure.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// What one block of a pass took, in nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct BlockCost {
    /// Number of the block above. A block begins once the leaves of the block above are fitted; the
    /// boxes of the block above follow once all blocks below it have ended.
    pub parent: Option<usize>,
    /// Finding the block's nodes.
    pub list: u64,
    /// Fitting leaves.
    pub leaves: u64,
    /// Boxes of inner nodes.
    pub boxes: u64,
    /// Heights and rotations.
    pub rotations: u64,
}

/// The costs of blocks, in the order in which they began.
#[derive(Debug, Default)]
pub(crate) struct Costs(Mutex<Vec<BlockCost>>);

impl Costs {
    /// A number for a block that begins.
    pub(super) fn begin(&self, parent: Option<usize>) -> usize {
        let mut costs = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        costs.push(BlockCost { parent, ..BlockCost::default() });
        costs.len() - 1
    }

    pub(super) fn change(&self, block: usize, change: impl FnOnce(&mut BlockCost)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner)[block]);
    }

    pub(crate) fn take(&mut self) -> Vec<BlockCost> {
        std::mem::take(self.0.get_mut().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Measures the stages of one block, if anybody wants to know.
pub(super) struct Stopwatch<'a> {
    costs: Option<(&'a Costs, Instant)>,
    pub(super) block: Option<usize>,
}

impl<'a> Stopwatch<'a> {
    pub(super) fn start(costs: Option<&'a Costs>, parent: Option<usize>) -> Self {
        let block = costs.map(|costs| costs.begin(parent));
        Self { costs: costs.map(|costs| (costs, Instant::now())), block }
    }

    /// Adds the time since the last call to a stage.
    pub(super) fn lap(&mut self, stage: impl FnOnce(&mut BlockCost) -> &mut u64) {
        if let (Some((costs, since)), Some(block)) = (&mut self.costs, self.block) {
            let now = Instant::now();
            let elapsed = (now - *since).as_nanos() as u64;
            costs.change(block, |cost| *stage(cost) += elapsed);
            *since = Instant::now();
        }
    }

    /// Leaves out the time since the last call.
    pub(super) fn skip(&mut self) {
        if let Some((_, since)) = &mut self.costs {
            *since = Instant::now();
        }
    }
}
