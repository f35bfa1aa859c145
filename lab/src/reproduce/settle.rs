//! What rotations do once motion stops (Kopta et al. 2012, section 4), and the memory that they
//! keep.

use anyhow::Result;
use bvh_core::{Bvh, sah_cost};
use bvh_update::{Rotate, Strategy, Updater};

use crate::stage::{Stage, fresh_tree};

/// Updates after the stop.
const UPDATES: usize = 50;

/// Plays half of a loop of `frames` with rotations and stops. Gives the SAH cost there, after more
/// updates of the same geometry, and of a fresh sweep build over it; then the bytes that the
/// threads keep over those of the tree. All that may move is still marked as dynamic, so rotations
/// go on everywhere that they were before.
pub(super) fn measure(stage: &mut Stage, frames: usize) -> Result<([f64; 3], f64)> {
    let mut tree = Bvh::clone(&stage.first_tree);
    let mut updater = Updater::new(Strategy::RefitRotate(Rotate::default()));
    for frame in 0..=frames / 2 {
        stage.pose(stage.time_of(frame, frames));
        updater.update(&mut tree, &stage.triangles())?;
    }
    let stopped = sah_cost(&tree);
    for _ in 0..UPDATES {
        updater.update(&mut tree, &stage.triangles())?;
    }
    let fresh = fresh_tree(stage)?;
    let kept = Updater::THREAD_MEMORY * rayon::current_num_threads();
    let memory = kept as f64 / tree.memory_usage() as f64;
    Ok(([stopped, sah_cost(&tree), sah_cost(&fresh)], memory))
}
