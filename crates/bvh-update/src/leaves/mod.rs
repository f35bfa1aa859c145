//! Splitting and merging leaves while rotating (Kopta et al. 2012, section 2, proposed as future
//! work).
//!
//! A *run* is a subtree that moves and covers a few slots without a gap. There are few trees over
//! its primitives that leave them in the order of their slots, and the best of these, with leaves
//! of any size, takes the place of the subtree if its SAH cost is lower:
//!
//! ```text
//! cost(i..j) = min( COST_INTERSECT * A(i..j) * (j - i),
//!                   COST_TRAVERSE  * A(i..j) + min over k of cost(i..k) + cost(k..j) )
//! ```
//!
//! So leaves merge where triangles move together, and split where they do not any more, in one
//! step. Both sides of the comparison are sums of the same terms in the same order, so no tree is
//! left for an equal one, and still scenes come to rest.
//!
//! The order of primitives stays as it is, which keeps them streaming through memory; the price is
//! that leaves that rotations brought together from afar cannot merge. Nor can rotations take apart
//! what has merged: a tree that recovers from chaos may end a few per cent above one that has not.
//! A tree that was built with larger leaves splits them while it has pairs of nodes to spare. Pairs
//! that are not needed are kept in a list within the arena (`State::spare_pair`).
//!
//! Meshes end with 1.2 to 1.4 nodes a triangle instead of 2, a cost some 2 % lower, and rays 2 to 8
//! % faster. Updates take 1.0 to 1.4 times as long as with rotations alone (means of
//! `cargo xtask compare frame`). Where nothing stays together it only costs. O(n) for the n nodes
//! above primitives that move, after the pass; `small_tree.rs` finds the trees, `collapse.rs` goes
//! through the nodes.

use bvh_core::{Bvh, Primitives};

use crate::quality::or_one;
use crate::refit::{self, RefitScratch, Rotate, Schedule, pass};
use crate::report::Update;
use crate::state::{Measure, State};

mod collapse;
mod small_tree;

pub(crate) use collapse::{LeafScratch, change_leaves};
pub(crate) use small_tree::LONGEST;

/// How leaves are split and merged: subtrees of a few primitives that are neighbours in the tree's
/// order, as they were built, become the cheapest tree with leaves of any size, by the SAH.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leaves {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Most primitives in a leaf that is merged, and in one that is split; at most, and by default,
    /// 4.
    pub max_leaf_size: u32,
    /// Leaves are looked at in one of this many updates, different ones each time; a power of two,
    /// else the next one. 16 by default. All are looked at when their areas have grown by a tenth.
    pub period: u32,
}

impl Default for Leaves {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), max_leaf_size: LONGEST as u32, period: 16 }
    }
}

/// Once the areas of leaves have grown by this part, all of them are looked at: what has merged is
/// tearing open.
const STRETCHED: f64 = 0.1;

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    options: &Leaves,
    refit: &mut RefitScratch,
    scratch: &mut LeafScratch,
) -> Update {
    State::of_mut(refit::parts(bvh).state).expect_measure(Measure::LEAVES);
    refit.with_sums = true;
    let State { updates, baseline, .. } = *State::of(bvh);
    // Leaves are of one measure whichever primitives are dynamic.
    let reference = if baseline.has_other_dynamic != 0 { 0.0 } else { baseline.cost };
    let mut tally = pass(bvh, primitives, options.rotate, refit);
    let is_stretched = reference > 0.0 && tally.leaf_area > reference * (1.0 + STRETCHED);
    let period = if is_stretched { 1 } else { options.period };
    let scale = or_one(tally.leaf_area);
    let change =
        change_leaves(bvh, primitives, Schedule::new(period, updates), options.max_leaf_size, scale, scratch);
    let leaf_area = tally.leaf_area + change.leaves;
    let is_first = is_stretched || reference == 0.0;
    let state = State::of_mut(refit::parts(bvh).state);
    state.baseline.cost = if is_first { leaf_area } else { reference.min(leaf_area) };
    state.baseline.has_other_dynamic = 0;
    state.largest_leaf = 0;
    tally.area += change.all;
    tally.report(bvh)
}
