//! Memory that updates keep from frame to frame.

use bvh_build::ReinsertScratch;

use crate::rebuild::RebuildScratch;
use crate::rebuild::background::Builds;
use crate::refit::RefitScratch;
use crate::repair::RepairScratch;

/// Memory that updates keep from frame to frame: below 1 MiB a thread for refits and rotations,
/// whatever the size of the tree; more for rebuilds and repairs, if any are made.
/// None but the build in the background has influence on results.
#[derive(Default)]
pub(crate) struct Workspace {
    pub(crate) refit: RefitScratch,
    pub(crate) repair: RepairScratch,
    pub(crate) rebuild: RebuildScratch,
    pub(crate) reinsert: ReinsertScratch,
    pub(crate) background: Builds,
}
