//! Regrow: refit, and when the tree has degraded build it anew above those subtrees that are still good.

use bvh_build::{BuildOptions, Builder};
use bvh_core::{Bvh, Primitives};

use crate::auto::Decision;
use crate::cut::{Regrown, regrow, scale, take_references};
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::strategy::{Rotate, Update, UpdateError, new_tree};

/// When to build the tree anew above subtrees whose nodes have not grown, on the scale of its leaves, since they were
/// last built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regrow {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Growth of the sum of areas at which the tree is repaired, as part of that sum. 0.1 by default.
    pub growth: f64,
}

impl Default for Regrow {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), growth: 0.1 }
    }
}

/// A subtree is opened if its excess is more than this part of an average primitive's share in the sum of areas.
const OPENED: f64 = 1.0;

/// A cut of more than this part of the primitives is not worth while.
pub(crate) const LARGEST_CUT: f64 = 0.2;

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &Regrow,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    take_references(bvh);
    let tally = pass(bvh, primitives, options.rotate, scratch);
    let sum = tally.area + bvh.still_area();
    if sum / scale(tally.leaf_area) <= bvh.history().reference * (1.0 + options.growth) {
        return Ok(tally.update(bvh));
    }
    let n = bvh.len() as f64;
    match regrow(bvh, tally.leaf_area, OPENED * sum / n, (LARGEST_CUT * n) as usize, scratch) {
        Regrown::Top(0) => Ok(tally.update(bvh)),
        Regrown::Top(subtrees) => {
            // The cost is not known for free.
            let decision = Decision::Regrow { subtrees };
            Ok(Update { decision, sah_cost: None, ..tally.update(bvh) })
        }
        Regrown::TooMuch => rebuild_all(bvh, primitives, tally.dropped, scratch),
    }
}

/// Builds a new tree instead of a repair.
pub(crate) fn rebuild_all<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    dropped: u64,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let in_a_row = bvh.history().rebuilds_in_a_row + 1;
    let update = new_tree(bvh, primitives, Builder::Ploc, &BuildOptions::default(), scratch)?;
    raw::parts(bvh).history.rebuilds_in_a_row = in_a_row;
    Ok(Update { decision: Decision::Rebuild, dropped, ..update })
}
