//! What updates keep with a tree from frame to frame, as the words that `bvh-core` stores unread.
//!
//! It is plain data, so a clone of a tree goes on as the original would. What the parts mean is
//! implemented where they are used: [`Baseline`] in `quality/`, [`Ledger`] in `auto/`.

use bvh_core::{Bvh, Changes, UpdateState};
use bytemuck::{Pod, Zeroable};

use crate::ski_rental::SkiRental;

/// Everything that updates keep with a tree.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct State {
    pub(crate) baseline: Baseline,
    pub(crate) ledger: Ledger,
    /// Number of the build in the background that is for this tree; 0 for none.
    pub(crate) background_job: u64,
    /// Updates since the tree was built.
    pub(crate) updates: u32,
    /// What `baseline` measures.
    pub(crate) measure: Measure,
    /// How the tree lies in its arena.
    pub(crate) layout: Layout,
    /// A new tree in the place of this one gets no larger leaves than this; 0 if no update has
    /// asked yet.
    pub(crate) largest_leaf: u32,
    /// The changes by others that updates have taken note of.
    seen: Changes,
    padding: u32,
}

/// What a tree's cost was when it was good.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Baseline {
    /// The cost in units of the scale, 0 until it is measured; or another measure of the strategy's
    /// own.
    pub(crate) cost: f64,
    /// `cost` as it was measured: `Auto` lowers `cost` where the tree gets better.
    pub(crate) measured: f64,
    /// Half area of the dynamic leaves and of the root when the tree was measured.
    pub(crate) sizes: [f64; 2],
    /// By how much these had grown after the last update.
    pub(crate) growth: [f64; 2],
    /// The scene's scale after the last update.
    pub(crate) scale: f64,
    /// What the scale that follows from `sizes` is multiplied by: other than 1 once `sizes` were
    /// taken again.
    pub(crate) scale_factor: f64,
    /// How alike leaves are in size: 1 if all are alike, near 0 if most of the area is in a few.
    pub(crate) leaf_uniformity: f64,
    /// Whether other primitives are dynamic since `sizes` were taken: 0 or 1.
    pub(crate) has_other_dynamic: u32,
    pub(crate) padding: u32,
}

/// What `Auto` keeps with a tree: what was lost, and what was done about it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Ledger {
    /// What queries lose to excess cost: for a new top, and for a new tree.
    pub(crate) repair: SkiRental,
    pub(crate) rebuild: SkiRental,
    /// The excess of the tree that queries see; 0 for a new tree or a new top, or if a new tree was
    /// hardly better.
    pub(crate) last_excess: f64,
    /// Updates since the last repair or rebuild, or the last new tree that was hardly better.
    pub(crate) frames: u32,
    /// Subtrees below the last new top; 0 if there was none.
    pub(crate) subtrees: u32,
    /// Rebuilds in a row, each soon after the one before.
    pub(crate) rebuilds_in_a_row: u32,
    /// 0 or 1: whether a repair would be too large, the builder was the fast one.
    pub(crate) is_beyond_repair: u32,
    pub(crate) is_fast_build: u32,
    pub(crate) padding: u32,
}

const _: () = assert!(size_of::<State>() <= size_of::<[u64; UpdateState::WORDS]>());

/// How a tree lies in its arena, in the state that updates have found.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Layout(u32);

impl Layout {
    /// Not looked at yet.
    pub(crate) const UNKNOWN: Self = Self(0);
    /// In depth-first order, left before right and without gaps, and at least half of the nodes are
    /// dynamic.
    pub(crate) const LINEAR: Self = Self(1);
    /// Otherwise.
    pub(crate) const OTHER: Self = Self(2);
}

/// What a baseline measures; 0 for nothing yet. A strategy that finds another's measure takes its
/// own.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Measure(u32);

impl Measure {
    /// Areas of nodes.
    pub(crate) const AREAS: Self = Self(1);
    /// The mean ratio of nodes' areas to their children's.
    pub(crate) const RATIO: Self = Self(2);
}

impl State {
    /// The state of a tree.
    pub(crate) fn of(bvh: &Bvh) -> &Self {
        bytemuck::from_bytes(&bytemuck::bytes_of(&bvh.update_state().words)[..size_of::<Self>()])
    }

    /// The state of a tree, to be changed.
    pub(crate) fn of_mut(state: &mut UpdateState) -> &mut Self {
        bytemuck::from_bytes_mut(&mut bytemuck::bytes_of_mut(&mut state.words)[..size_of::<Self>()])
    }

    /// Forgets what another strategy has measured.
    pub(crate) fn expect_measure(&mut self, measure: Measure) {
        if self.measure != measure {
            (self.baseline, self.ledger) = (Baseline::zeroed(), Ledger::zeroed());
            self.measure = measure;
        }
    }

    /// Counts a new tree as marked once more than the one before, so that `SleepDelay` learns of
    /// it, while updates have nothing to learn.
    pub(crate) fn count_rebuild(state: &mut UpdateState, marked_before: u32) {
        state.changes.dynamic = marked_before.wrapping_add(1);
        Self::of_mut(state).seen.dynamic = state.changes.dynamic;
    }

    /// Takes note of what others have changed since the last update; gives the state of the tree.
    pub(crate) fn note_changes(state: &mut UpdateState) -> &mut Self {
        let now = state.changes;
        let known = Self::of_mut(state);
        if known.seen.dynamic != now.dynamic {
            known.baseline.has_other_dynamic = 1;
            known.layout = Layout::UNKNOWN;
        }
        if known.seen.numbering != now.numbering {
            known.background_job = 0;
        }
        if known.seen.structure != now.structure {
            known.layout = Layout::UNKNOWN;
        }
        known.seen = now;
        known
    }
}
