//! What an update did and why, and why it may fail.

use std::fmt;

use bvh_build::{BuildError, Builder};
use thiserror::Error;

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Update {
    /// Whether the whole tree is a new one. Primitives sorted by the old tree's leaves are then in
    /// another order; [`reorder_primitives`](bvh_core::Bvh::reorder_primitives) sorts them again.
    pub rebuilt: bool,
    /// What was decided, where the strategy decides.
    pub decision: Decision,
    /// The figures that [`Auto`](crate::Auto) decided by after a pass. `None` of other strategies,
    /// and if it built a new tree without a pass.
    pub reason: Option<Reason>,
    /// Rotations applied, by kind in the order of [`Rotation::ALL`](bvh_core::Rotation::ALL); none
    /// in a new tree.
    pub rotations: [u64; 6],
    /// SAH cost of the tree as it is now, where the strategy needs it or
    /// [`Updater::report_cost`](crate::Updater::report_cost) asks for it:
    /// [`sah_cost`](bvh_core::sah_cost), but from `f32` areas unless some may leave the range of
    /// `f32`. After rotations that remove most of the cost in one update it is less exact, since
    /// rounded changes are added to the cost before. `None` after a rebuild or a partial rebuild; a
    /// tree from the background is refitted, so it can have one.
    pub sah_cost: Option<f64>,
    /// Height of the tree as it is now.
    pub height: u32,
    /// Nodes whose boxes the update recomputed: all of a new tree, none of one that was given up.
    /// No measure of an update's work, since a pass and a build of the same tree count alike.
    /// [`Load`](crate::Load) asks for another number, the nodes that queries visit.
    pub nodes_visited: u64,
    /// Primitives without finite coordinates, which are dropped at present: of those visited, or
    /// after a rebuild of all.
    pub dropped: u64,
}

impl Update {
    /// Rotations applied, of all kinds.
    #[must_use]
    pub fn rotations_applied(&self) -> u64 {
        self.rotations.iter().sum()
    }
}

/// What an update decided to do about the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Decision {
    /// What the strategy does every time; of [`Auto`](crate::Auto), to refit and rotate.
    #[default]
    AsAlways,
    /// Refitted, and the tree built again above subtrees that are still good.
    PartialRebuild {
        /// How many of them there are.
        subtrees: usize,
    },
    /// The whole tree was built again.
    Rebuild {
        /// The builder used.
        builder: Builder,
    },
    /// A new tree was built, and costs less by 2 % at most: the old one stays, refitted and
    /// rotated.
    Kept {
        /// The builder used.
        builder: Builder,
    },
    /// A repair was due, but not made: no subtree was worth opening, the new top cost no less, or
    /// it would have stood above too many subtrees or made the tree too high. The old tree stays:
    /// refitted, and rotated if the strategy rotates.
    Unrepaired,
    /// A tree from the background took the place of this one.
    Swap,
}

/// What [`Auto`](crate::Auto) compared. Once `lost_ms` exceeds `price_ms`, it tries a new top. If a
/// new top was too large before, it tries a new tree instead. If no subtree is worth opening, or
/// the new top costs no less, the old tree stays ([`Unrepaired`](Decision::Unrepaired)), unless a
/// new tree is due as well. Where the baseline of a tree says nothing, a new tree is tried in any
/// case. The old tree may stay then, too ([`Kept`](Decision::Kept)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Reason {
    /// Milliseconds of one core that queries have lost to the excess cost of the tree since it was
    /// last repaired, built or [kept](Decision::Kept). A repair that found no better top sets the
    /// sum to 0, too. Where a good build is to replace a fast one, the sum includes the time that
    /// queries lose to the fast one.
    pub lost_ms: f64,
    /// Milliseconds of one core that the repair or the rebuild takes, doubled after one that
    /// failed.
    pub price_ms: f64,
    /// How far the SAH cost is above that of the tree when it was good: 1 for twice the cost, and
    /// more where a few large leaves hold most of the cost, which rays meet seldom.
    pub excess: f64,
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AsAlways => f.write_str("as always"),
            Self::PartialRebuild { subtrees } => write!(f, "built again above {subtrees} subtrees"),
            Self::Unrepaired => f.write_str("kept: a new top is no better or too large"),
            Self::Swap => f.write_str("a tree built in the background took over"),
            Self::Kept { builder } => write!(f, "kept: a new tree by {} is hardly better", builder.name()),
            Self::Rebuild { builder } => write!(f, "built again by {}", builder.name()),
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { lost_ms, price_ms, excess } = self;
        write!(f, "lost {lost_ms:.3} ms, the price is {price_ms:.3} ms, excess {:.1} %", 100.0 * excess)
    }
}

/// Why a tree was not updated. It is as it was, or has had its pass if a rebuild was to follow.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// Another number of primitives than the tree holds, for a strategy that cannot build a new
    /// tree.
    #[error("the tree holds {tree} primitives, but {given} were given: build a new tree")]
    Count {
        /// Primitives of the tree.
        tree: usize,
        /// Primitives given.
        given: usize,
    },
    /// A rebuild failed.
    #[error(transparent)]
    Build(#[from] BuildError),
}
