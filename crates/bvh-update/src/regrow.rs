//! Regrow: refit, and when the tree has degraded build it anew above those subtrees that are still good.

use bvh_build::Builder;
use bvh_core::{Bvh, Primitives};

use crate::block::Tally;
use crate::cut::{Regrown, area, reference, size_now, take_references, take_references_of};
use crate::decision::Decision;
use crate::divergent::{self, divergence};
use crate::pass::{Scratch, pass};
use crate::strategy::{Rotate, Update, UpdateError, new_tree, options_like};
use crate::top::{NewTop, rebuild_top};
use crate::walk::open;
use crate::{raw, selective};

/// When to build the tree anew above subtrees that are still good.
///
/// A leaf that was merged ([`Strategy::Leaves`](crate::Strategy::Leaves)) and has come apart with the nodes above it is
/// kept in pieces, each of which counts as one of the subtrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regrow {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Growth of the sum of areas at which the tree is repaired, as part of that sum. 0.1 by default.
    pub growth: f64,
    /// What tells subtrees that are still good from the others.
    pub open: Open,
}

impl Default for Regrow {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), growth: 0.1, open: Open::Grown }
    }
}

/// Which nodes are opened, so that the tree above the others is built anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Open {
    /// Those that have grown, on the scale of the leaves, since they were last built.
    Grown,
    /// Those that overlap others (Yoon, Curtis, Manocha 2007).
    Overlapping,
    /// Those whose children have moved apart since they were last built (Garanzha 2008).
    Divergent,
}

/// A subtree is opened if its excess is more than this part of the share that an average primitive had in the sum of
/// areas when the tree was last built.
const OPENED: f64 = 1.0;

/// A cut of more than this part of the primitives is not worth while.
pub(crate) const LARGEST_CUT: f64 = 0.2;

/// Repairs so many updates apart, or fewer, are in a row.
pub(crate) const SOON: u32 = 2;

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &Regrow,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    match options.open {
        Open::Grown | Open::Overlapping => take_references(bvh),
        Open::Divergent => take_references_of(bvh, divergence),
    }
    let tally = pass(bvh, primitives, options.rotate, scratch);
    let sum = tally.area + bvh.static_area();
    let scale = size_now(bvh, tally.leaf_area);
    raw::parts(bvh).history.size = scale;
    if sum / scale <= bvh.history().reference * (1.0 + options.growth) {
        return Ok(tally.update(bvh));
    }
    let n = bvh.len() as f64;
    let most = (LARGEST_CUT * n) as usize;
    // An average primitive's, when the tree was last built.
    let share = bvh.history().reference * scale / n;
    let judge = |top: &NewTop| (sum + top.change) / top.size;
    let regrown = match options.open {
        Open::Grown => regrow(bvh, primitives, &tally, OPENED * share, most, scratch),
        Open::Overlapping if !selective::open(bvh.nodes(), share, most, &mut scratch.cut) => Regrown::TooMuch,
        Open::Overlapping => rebuild_top(bvh, primitives, area, tally.leaf_area, most, scratch, judge),
        Open::Divergent => {
            open(bvh, divergence, scale, divergent::OPENED * share, most, &mut scratch.cut);
            rebuild_top(bvh, primitives, divergence, tally.leaf_area, most, scratch, judge)
        }
    };
    match regrown {
        Regrown::Top { subtrees: 0, .. } => {
            // There is nothing to be had; wait until as much is lost again.
            raw::parts(bvh).history.reference = reference(sum, scale);
            Ok(tally.update(bvh))
        }
        Regrown::Top { subtrees, .. } => {
            // The cost is not known for free.
            let decision = Decision::Regrow { subtrees };
            Ok(Update { decision, sah_cost: None, ..tally.update(bvh) })
        }
        Regrown::TooMuch => rebuild_all(bvh, primitives, Builder::Ploc, scratch),
    }
}

/// Builds the tree anew above the subtrees whose excess of area is at most `threshold`, if there are at most `most` of
/// them, after a pass that has found this.
pub(crate) fn regrow<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    tally: &Tally,
    threshold: f64,
    most: usize,
    scratch: &mut Scratch,
) -> Regrown {
    let leaves = tally.leaf_area;
    let references = open(bvh, area, size_now(bvh, leaves), threshold, most, &mut scratch.cut);
    let still_leaves = bvh.history().sizes[2];
    rebuild_top(bvh, primitives, area, leaves, most, scratch, |top| {
        // Leaves have no references.
        references + top.references + (leaves + top.leaf_change + still_leaves) / top.size
    })
}

/// Builds a new tree instead of a repair.
pub(crate) fn rebuild_all<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let before = *bvh.history();
    let options = options_like(bvh);
    let update = new_tree(bvh, primitives, builder, &options, scratch)?;
    let history = raw::parts(bvh).history;
    let is_soon = before.since_repair <= SOON;
    history.rebuilds_in_a_row = if is_soon { before.rebuilds_in_a_row.saturating_add(1) } else { 1 };
    history.rotation_pause = before.rotation_pause;
    history.period = before.since_repair.max(1);
    Ok(Update { decision: Decision::Rebuild { builder }, ..update })
}
