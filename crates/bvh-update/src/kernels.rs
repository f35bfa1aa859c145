//! The two inner loops of the pass, each over a list of child pairs, at the SIMD level asked for.

use bvh_core::rotation::{best, rotate};
use bvh_core::{Node, Rotation};

use crate::block::Tally;
use crate::raw::{Available, SharedNodes, dispatch};

/// A node at which a rotation is a gain.
#[derive(Clone, Copy, Default)]
pub(crate) struct Accepted {
    /// How the area would change under each rotation, in the order of `Rotation::ALL`.
    pub(crate) changes: [f32; 6],
    /// Which of the pairs it is.
    pub(crate) index: u32,
}

/// Refits the node in slot `parents[i]` from its children in `pairs[i]`, last first. Gives the sum of half area
/// times weight of all those children that move.
pub(crate) fn unions(level: Available, nodes: SharedNodes<'_>, pairs: &[u32], parents: &[u32]) -> f64 {
    dispatch!(level, unions(nodes, pairs, parents))
}

/// Writes to `accepted` those of the pairs numbered by `candidates` whose parent gains by some rotation, and
/// gives how many there are. Not both nodes of such a pair may be leaves.
pub(crate) fn evaluate(
    level: Available,
    nodes: SharedNodes<'_>,
    pairs: &[u32],
    candidates: &[u32],
    accepted: &mut [Accepted],
) -> usize {
    dispatch!(level, evaluate(nodes, pairs, candidates, accepted))
}

/// Applies the best rotation of each, counted by kind in `tally`.
pub(crate) fn apply(
    mut nodes: SharedNodes<'_>,
    pairs: &[u32],
    depths: &[u8],
    accepted: &[Accepted],
    tally: &mut Tally,
) {
    for a in accepted {
        let (pair, depth) = (pairs[a.index as usize] as usize, u32::from(depths[a.index as usize]));
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
