//! Memory that updates keep from frame to frame.

use bvh_build::ReinsertScratch;

use crate::rebuild::RebuildScratch;
use crate::rebuild::background::Builds;
use crate::refit::PassOptions;
use crate::repair::RepairScratch;

/// How passes are run, and memory that rebuilds and repairs keep from frame to frame, if any are
/// made; what passes keep belongs to threads (`refit/memory.rs`). Only the build in the background
/// influences results.
#[derive(Default)]
pub(crate) struct Workspace {
    pub(crate) passes: PassOptions,
    pub(crate) repair: RepairScratch,
    pub(crate) rebuild: RebuildScratch,
    pub(crate) reinsert: ReinsertScratch,
    pub(crate) background: Builds,
}
