//! The bound on the height of trees: what a lower one would keep rotations from.
//!
//! The bound is a constant of the library. Here the plain update runs from a depth that makes the
//! bound lower.

use anyhow::Result;
use bvh_core::{Bvh, MAX_HEIGHT, Triangles};
use bvh_update::{Rotate, plain};

use super::bench::Bench;
use super::trees::{Entrant, play};
use crate::stage::timed;

/// Bounds from the height of the first tree up to the library's.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let first = Bvh::clone(&bench.stage.first_tree);
    let lowest = first.height();
    let higher = [32, 40, 48, 64, MAX_HEIGHT].into_iter().filter(|&bound| bound > lowest);
    let entrant = |bound: u32| {
        let setting = match bound == lowest {
            true => "height of the first tree".to_owned(),
            false => format!("{bound} levels"),
        };
        let run = move |tree: &mut Bvh, triangles: &Triangles<'_>| {
            let rotate = Some(Rotate::default());
            let (_, time_ms) = timed(|| plain::update_below(tree, triangles, rotate, MAX_HEIGHT - bound));
            Ok((time_ms, tree.height()))
        };
        Entrant::new(setting, bound == MAX_HEIGHT, first.clone(), Box::new(run))
    };
    let entrants = std::iter::once(lowest).chain(higher).map(entrant).collect();
    play(bench, "height bound", "the plain update", entrants)
}
