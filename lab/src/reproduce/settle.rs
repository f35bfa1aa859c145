//! What rotations do once motion stops (Kopta et al. 2012, section 4).

use anyhow::Result;
use bvh_build::{Builder, build};
use bvh_core::sah_cost;
use bvh_update::{Strategy, Updater};

use crate::stage::Stage;

/// Updates after the stop.
const UPDATES: usize = 50;

/// Plays half of a loop of `frames` with rotations and stops. Gives the SAH cost there, after more
/// updates of the same geometry, and of a fresh sweep build over it. All that may move is still
/// marked as dynamic, so rotations go on everywhere that they were before.
pub(super) fn measure(stage: &mut Stage, frames: usize) -> Result<[f64; 3]> {
    let mut tree = stage.first_tree.clone();
    let mut updater = Updater::new(Strategy::RefitRotate(bvh_update::Rotate::default()));
    for frame in 0..=frames / 2 {
        stage.pose(stage.time_of(frame, frames));
        updater.update(&mut tree, &stage.triangles())?;
    }
    let stopped = sah_cost(&tree);
    for _ in 0..UPDATES {
        updater.update(&mut tree, &stage.triangles())?;
    }
    Ok([stopped, sah_cost(&tree), sah_cost(&build(&stage.triangles(), Builder::Sweep)?)])
}
