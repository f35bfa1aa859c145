//! Splitting and merging leaves while rotating (Kopta et al. 2012, section 2, proposed as future work).
//!
//! A *run* is a subtree that moves and covers a few slots without a gap. There are few trees over its primitives that
//! leave them in the order of their slots, and the best of these, with leaves of any size, takes the place of the
//! subtree if its SAH cost is lower:
//!
//! ```text
//! best(i..j) = min( COST_INTERSECT * A(i..j) * (j - i),
//!                   COST_TRAVERSE  * A(i..j) + min over k of best(i..k) + best(k..j) )
//! ```
//!
//! So leaves merge where triangles move together, and split where they do not any more, in one step. Both sides of the
//! comparison are sums of the same terms in the same order, so no tree is left for an equal one, and still scenes come
//! to rest.
//!
//! The order of primitives stays as it is, which keeps them streaming through memory; the price is that leaves that
//! rotations brought together from afar cannot merge. Nor can rotations take apart what has merged: a tree that
//! recovers from chaos may end a few per cent above one that has not. A tree that was built with larger leaves splits
//! them as far as it has pairs of nodes to spare; those that are not needed are kept in a list within the arena
//! (`History::spare_pair`).
//!
//! Meshes end with 1.2 to 1.4 nodes a triangle instead of 2, a cost some 2 % lower, and rays 2 to 8 % faster. Updates
//! take 1.0 to 1.4 times as long as with rotations alone (means of `cargo xtask compare frame`). Where nothing stays
//! together it only costs. O(n) for the n nodes above primitives that move, after the pass; `best.rs` finds
//! the trees, `settle.rs` goes through the nodes.

use bvh_core::{Bvh, History, Primitives};

use crate::best::LONGEST;
use crate::cut::scale;
use crate::refit::RotationSchedule as Turn;
use crate::refit::pass;
use crate::refit::shared as raw;
use crate::scratch::Scratch;
use crate::settle::settle;
use crate::strategy::{Rotate, Update, UpdateError};

/// How leaves are split and merged: subtrees of a few primitives that are neighbours in the tree's order, as they were
/// built, become the cheapest tree with leaves of any size, by the SAH.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leaves {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Most primitives in a leaf that is merged, and in one that is split; at most, and by default, 4.
    pub max_leaf_size: u32,
    /// Leaves are seen to in one of this many updates, different ones each time; a power of two, else the next one. 16
    /// by default. All are seen to when their areas have grown by a tenth.
    pub period: u32,
}

impl Default for Leaves {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), max_leaf_size: LONGEST as u32, period: 16 }
    }
}

/// Once the sum of the areas of leaves has grown by this part, it is the turn of all of them: what has merged is coming
/// apart.
pub(crate) const STRETCHED: f64 = 0.1;

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &Leaves,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let History { updates, reference, .. } = *bvh.history();
    let mut tally = pass(bvh, primitives, options.rotate, scratch);
    let stretched = reference > 0.0 && tally.leaf_area > reference * (1.0 + STRETCHED);
    let turn = Turn::new(Rotate { period: if stretched { 1 } else { options.period } }, updates);
    let unit = scale(tally.leaf_area);
    let change = settle(bvh, primitives, turn, true, options.max_leaf_size, unit, &mut scratch.settle);
    let leaf_area = tally.leaf_area + change.leaves;
    let is_first = stretched || reference == 0.0;
    let history = raw::parts(bvh).history;
    history.reference = if is_first { leaf_area } else { reference.min(leaf_area) };
    history.largest_leaf = 0;
    tally.area += change.all;
    Ok(tally.update(bvh))
}
