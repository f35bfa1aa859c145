//! A new tree in the place of the old one: at once, when the old one has degraded, or from the
//! background.

use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Bvh, Node, Primitives};

use crate::refit::parts;
use crate::report::{Decision, Update, UpdateError};
use crate::state::{Measure, State};

pub(crate) mod background;
pub(crate) mod degraded;

pub use background::{Background, BackgroundCost};
pub use degraded::Degraded;

/// Memory that rebuilds keep.
#[derive(Default)]
pub(crate) struct RebuildScratch {
    build: BuildScratch,
    /// Which primitives are dynamic, while the tree that knows it is built again.
    dynamic: Vec<bool>,
    /// A tree that may take the place of another; after that, the other.
    pub(crate) beside: Bvh,
}

/// Options for a tree in the place of `bvh`, whose builder is not known: with leaves as large as
/// its largest. O(n) if that is not known.
pub(crate) fn options_like(bvh: &mut Bvh) -> BuildOptions {
    let parts = parts(bvh);
    let state = State::of_mut(parts.state);
    if state.largest_leaf == 0 {
        state.largest_leaf = parts.nodes.iter().map(Node::count).max().unwrap_or(1).max(1) as u32;
    }
    BuildOptions::default().with_max_leaf_size(state.largest_leaf)
}

/// Builds a new tree in which the same primitives are dynamic; where their number changed, all are.
pub(crate) fn new_tree<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    scratch: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    let heritage = Heritage::of(bvh, &mut scratch.dynamic);
    heritage.pass_on(bvh, primitives, builder, options, scratch)
}

/// What a new tree takes over from the one before, together with [`RebuildScratch::dynamic`].
struct Heritage {
    measure: Measure,
    has_static: bool,
    /// How often primitives were marked as dynamic or static.
    marked: u32,
}

impl Heritage {
    fn of(bvh: &Bvh, dynamic: &mut Vec<bool>) -> Self {
        let has_static = bvh.note_dynamic(dynamic);
        Self { measure: State::of(bvh).measure, has_static, marked: bvh.update_state().changes.dynamic }
    }

    /// Builds the new tree in the place of `bvh`.
    fn pass_on<P: Primitives + ?Sized>(
        self,
        bvh: &mut Bvh,
        primitives: &P,
        builder: Builder,
        options: &BuildOptions,
        scratch: &mut RebuildScratch,
    ) -> Result<Update, UpdateError> {
        rebuild(bvh, primitives, builder, options, &mut scratch.build)?;
        State::count_rebuild(parts(bvh).state, self.marked);
        if self.has_static && bvh.len() == scratch.dynamic.len() {
            bvh.set_dynamic(|p| scratch.dynamic[p]);
        }
        let state = State::note_changes(parts(bvh).state);
        state.measure = self.measure;
        state.largest_leaf = options.max_leaf_size;
        let (nodes_visited, dropped) = (bvh.nodes().len() as u64 - 1, scratch.build.dropped() as u64);
        Ok(Update { rebuilt: true, height: bvh.height(), nodes_visited, dropped, ..Update::default() })
    }
}

/// Builds a new tree with leaves as large as the old one's; that it was built again is the
/// decision.
pub(crate) fn build_again<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    scratch: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    let options = options_like(bvh);
    let update = new_tree(bvh, primitives, builder, &options, scratch)?;
    Ok(Update { decision: Decision::Rebuild { builder }, ..update })
}

/// Builds the tree of [`build_again`] beside the old one, as [`RebuildScratch::beside`].
pub(crate) fn build_beside<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    scratch: &mut RebuildScratch,
) -> Result<Update, UpdateError> {
    let options = options_like(bvh);
    let heritage = Heritage::of(bvh, &mut scratch.dynamic);
    let mut new = std::mem::take(&mut scratch.beside);
    let update = heritage.pass_on(&mut new, primitives, builder, &options, scratch)?;
    scratch.beside = new;
    Ok(Update { decision: Decision::Rebuild { builder }, ..update })
}
