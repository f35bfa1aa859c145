//! The two inner loops of the pass, each over a list of child pairs, at the SIMD level asked for.

use bvh_core::rotation::{best, rotate};

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

/// Applies the best rotation of each; counts them by kind and gives by how much the area that stands still grew.
pub(crate) fn apply(
    mut nodes: SharedNodes<'_>,
    pairs: &[u32],
    depths: &[u8],
    accepted: &[Accepted],
    applied: &mut [u64; 6],
) -> f64 {
    let mut still_area = 0.0;
    for a in accepted {
        let i = a.index as usize;
        if let Some(rotation) = best(a.changes)
            && let Some(grown) = rotate(&mut nodes, pairs[i] as usize, rotation, u32::from(depths[i]))
        {
            applied[rotation as usize] += 1;
            still_area += grown;
        }
    }
    still_area
}
