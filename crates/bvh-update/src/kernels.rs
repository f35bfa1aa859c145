//! The inner loops of the pass, each over a list of nodes, at the SIMD level asked for.

use bvh_core::rotation::{best, rotate};
use bvh_core::{Aabb, Node, Primitives, Rotation};

use crate::block::{Tally, Visit};
use crate::raw::{Available, SharedNodes, dispatch};

/// A node at which a rotation is a gain.
#[derive(Clone, Copy, Default)]
pub(crate) struct Accepted {
    /// How the area would change under each rotation, in the order of `Rotation::ALL`.
    pub(crate) changes: [f32; 6],
    /// Which of the inner nodes it is.
    pub(crate) index: u32,
}

/// How far ahead of its use a primitive's index is fetched, and its data.
const INDEX_AHEAD: usize = 64;
const DATA_AHEAD: usize = 32;

/// Fits leaves to their primitives, which are numbered by slot; gives how many primitives have no box.
pub(crate) fn fit<P: Primitives + ?Sized>(
    level: Available,
    nodes: SharedNodes<'_>,
    primitives: &P,
    leaves: &[Visit],
) -> u64 {
    dispatch!(level, fit(nodes, primitives, leaves))
}

/// The same, to be compiled at each level: the loop's arithmetic is in `P`, and follows the level it is inlined at.
#[inline(always)]
pub(crate) fn fit_at_this_level<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    leaves: &[Visit],
) -> u64 {
    for leaf in leaves.iter().take(INDEX_AHEAD) {
        primitives.prefetch_index(leaf.first());
    }
    for leaf in leaves.iter().take(DATA_AHEAD) {
        primitives.prefetch_data(leaf.first());
    }
    // A sanitised box is empty only if it is `Aabb::EMPTY`.
    let dropped = |aabb: Aabb| u64::from(aabb.min.x == f32::INFINITY);
    let mut total = 0;
    for (i, leaf) in leaves.iter().enumerate() {
        if let Some(ahead) = leaves.get(i + INDEX_AHEAD) {
            primitives.prefetch_index(ahead.first());
        }
        if let Some(ahead) = leaves.get(i + DATA_AHEAD) {
            primitives.prefetch_data(ahead.first());
        }
        let first = leaf.first();
        let mut aabb = primitives.aabb(first);
        total += dropped(aabb);
        let mut node = nodes.get(leaf.slot());
        if node.count() > 1 {
            for slot in first + 1..first + node.count() {
                let next = primitives.aabb(slot);
                total += dropped(next);
                aabb = aabb.union(next);
            }
        }
        node.set_aabb(aabb);
        nodes.set(leaf.slot(), node);
    }
    total
}

/// Refits each of `inner` from its children, last first. Gives the sum of half area times weight of all those children
/// that move.
pub(crate) fn unions(level: Available, nodes: SharedNodes<'_>, inner: &[Visit]) -> f64 {
    dispatch!(level, unions(nodes, inner))
}

/// Writes to `accepted` those of the nodes numbered by `candidates` that gain by some rotation, and gives how many there
/// are. Not both children of such a node may be leaves.
pub(crate) fn evaluate(
    level: Available,
    nodes: SharedNodes<'_>,
    inner: &[Visit],
    candidates: &[u32],
    accepted: &mut [Accepted],
) -> usize {
    dispatch!(level, evaluate(nodes, inner, candidates, accepted))
}

/// Applies the best rotation of each, counted by kind in `tally`; `depth` is that of the nodes.
pub(crate) fn apply(
    mut nodes: SharedNodes<'_>,
    inner: &[Visit],
    depth: u32,
    accepted: &[Accepted],
    tally: &mut Tally,
) {
    for a in accepted {
        let pair = inner[a.index as usize].first();
        if let Some(rotation) = best(a.changes)
            && let Some(grown) = rotate(&mut nodes, pair, rotation, depth)
        {
            tally.rotations[rotation as usize] += 1;
            tally.still_area += grown;
            tally.area += swapped_area(nodes, pair, rotation);
        }
    }
}

/// What a rotation just applied owes to the sum of areas: the grandchild that came up was counted with its old pair
/// and will be again with its new one, while the child that went down would not be counted at all.
fn swapped_area(nodes: SharedNodes<'_>, pair: usize, rotation: Rotation) -> f64 {
    let (up, down) = match rotation {
        Rotation::LForRl => (pair, nodes.get(pair + 1).first()),
        Rotation::LForRr => (pair, nodes.get(pair + 1).first() + 1),
        Rotation::RForLl => (pair + 1, nodes.get(pair).first()),
        Rotation::RForLr => (pair + 1, nodes.get(pair).first() + 1),
        Rotation::LlForRl | Rotation::LlForRr => return 0.0,
    };
    moving_area(&nodes.get(down)) - moving_area(&nodes.get(up))
}

/// Half area times weight of a node that moves, 0 for one that stands still.
#[inline]
pub(crate) fn moving_area(node: &Node) -> f64 {
    if node.moves() { f64::from(node.aabb().half_area()) * node.weight() } else { 0.0 }
}
