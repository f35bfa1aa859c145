//! Rebuilding when the tree has degraded (Lauterbach, Yoon, Tuft, Manocha 2006, section 4).
//!
//! A node's box fits its children badly if they are far apart, or differ much from it: the ratio of
//! its area to the sum of theirs is then large. The measure is the mean of that ratio over all
//! inner nodes; the tree is rebuilt once it has grown by more than a threshold since the tree was
//! built, 40 per cent of one as published.

use bvh_build::Builder;
use bvh_core::{Bvh, Node, Primitives};

use super::{RebuildScratch, build_again};
use crate::quality::sum;
use crate::refit::{PassOptions, Rotate, parts, pass};
use crate::report::{Update, UpdateError};
use crate::state::{Measure, State};

/// When to build a new tree.
///
/// The measure is the mean, over the inner nodes, of the ratio of a node's area to the sum of its
/// children's.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Degraded {
    /// The budget of rotations in between, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Growth of the mean ratio of a node's area to its children's at which the tree is rebuilt.
    /// 0.4 by default, as published.
    pub threshold: f64,
    /// The builder used.
    pub builder: Builder,
}

bvh_core::with_methods!(Degraded: with_rotate(rotate: Option<Rotate>), with_threshold(threshold: f64),
    with_builder(builder: Builder));

impl Default for Degraded {
    fn default() -> Self {
        Self { rotate: None, threshold: 0.4, builder: Builder::BinnedParallel }
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    degraded: &Degraded,
    passes: &PassOptions,
    scratch: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    State::of_mut(parts(bvh).state).expect_measure(Measure::RATIO);
    if State::of(bvh).baseline.cost == 0.0 {
        let ratio = mean_ratio(bvh);
        State::of_mut(parts(bvh).state).baseline.cost = ratio;
    }
    let tally = pass(bvh, primitives, degraded.rotate, passes);
    if mean_ratio(bvh) - State::of(bvh).baseline.cost <= degraded.threshold {
        return Ok(tally.report(bvh));
    }
    build_again(bvh, primitives, degraded.builder, scratch)
}

/// Mean over the inner nodes of A(N) / (A(L) + A(R)); 0 for a tree without. A node whose children
/// have no area counts as 1. O(n).
pub(crate) fn mean_ratio(bvh: &Bvh) -> f64 {
    let [ratios, count] = sum(bvh.nodes(), &|node: &Node| {
        let Some([l, r]) = bvh.children(node) else { return [0.0; 2] };
        let below = l.aabb().half_area_f64() + r.aabb().half_area_f64();
        [if below > 0.0 { node.aabb().half_area_f64() / below } else { 1.0 }, 1.0]
    });
    if count > 0.0 { ratios / count } else { 0.0 }
}
