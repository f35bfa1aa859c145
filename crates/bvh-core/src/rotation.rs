//! The six tree rotations (Kensler 2008; Kopta et al. 2012, section 1.1 and figure 1).
//!
//! ```text
//!            N                 child for grandchild     grandchild for grandchild
//!          /   \
//!        L       R               L <-> RL                 LL <-> RL
//!       / \     / \              L <-> RR                 LL <-> RR
//!     LL   LR RL   RR            R <-> LL
//!                                R <-> LR
//! ```
//!
//! `LR <-> RL` and `LR <-> RR` would give mirror images of the last two, which cost the same.
//!
//! A rotation leaves N's box and everything below the swapped nodes as they are, so the change of the tree's
//! SAH cost is the change of half area of the one or two inner children whose boxes are new (times
//! [`COST_TRAVERSE`](crate::COST_TRAVERSE), over the root's area). *That* is what is compared here, not the
//! areas of N's two new children. Nothing is divided, and a change `x - y` of two `f32` is negative only if
//! `x < y` exactly, so each rotation lowers the exact sum of the rounded areas: on a still scene rotations
//! come to an end.

use crate::{Aabb, MAX_HEIGHT, Node};

/// A rotation at a node, named by the nodes that change places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Rotation {
    /// L with RL.
    LForRl,
    /// L with RR.
    LForRr,
    /// R with LL.
    RForLl,
    /// R with LR.
    RForLr,
    /// LL with RL.
    LlForRl,
    /// LL with RR.
    LlForRr,
}

/// A place among a node's children and grandchildren.
#[derive(Clone, Copy)]
enum Place {
    L,
    R,
    Ll,
    Lr,
    Rl,
    Rr,
}

use Place::{L, Ll, Lr, R, Rl, Rr};

/// The two places that each rotation swaps.
const SWAPS: [(Place, Place); 6] = [(L, Rl), (L, Rr), (R, Ll), (R, Lr), (Ll, Rl), (Ll, Rr)];

impl Rotation {
    /// All six, in the order in which ties are decided: the first of equals is taken.
    pub const ALL: [Self; 6] =
        [Self::LForRl, Self::LForRr, Self::RForLl, Self::RForLr, Self::LlForRl, Self::LlForRr];

    /// Short name, as `L<->RL`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["L<->RL", "L<->RR", "R<->LL", "R<->LR", "LL<->RL", "LL<->RR"][self as usize]
    }
}

/// How the half areas of N's inner children would change under each rotation, in the order of
/// [`Rotation::ALL`]; infinite where the swapped nodes do not exist.
///
/// `l` and `r` are the boxes of N's children; `below_l` and `below_r` those of their children, `None` for a
/// leaf. An area beyond the range of `f32` makes a change infinite or NaN; neither is ever below zero but
/// where the change is a gain beyond doubt.
#[must_use]
#[inline]
pub fn area_changes(l: Aabb, r: Aabb, below_l: Option<[Aabb; 2]>, below_r: Option<[Aabb; 2]>) -> [f32; 6] {
    let mut change = [f32::INFINITY; 6];
    let area = |a: Aabb, b: Aabb| a.union(b).half_area();
    if let Some([rl, rr]) = below_r {
        change[0] = area(l, rr) - r.half_area();
        change[1] = area(rl, l) - r.half_area();
    }
    if let Some([ll, lr]) = below_l {
        change[2] = area(r, lr) - l.half_area();
        change[3] = area(ll, r) - l.half_area();
    }
    if let (Some([ll, lr]), Some([rl, rr])) = (below_l, below_r) {
        let now = l.half_area() + r.half_area();
        change[4] = (area(rl, lr) + area(ll, rr)) - now;
        change[5] = (area(rr, lr) + area(rl, ll)) - now;
    }
    change
}

/// The rotation with the smallest change, if that is a gain; the first in order on a tie. A NaN is no gain.
#[must_use]
#[inline]
pub fn best(changes: [f32; 6]) -> Option<Rotation> {
    let mut least = (0.0, None);
    for (change, rotation) in changes.into_iter().zip(Rotation::ALL) {
        if change < least.0 {
            least = (change, Some(rotation));
        }
    }
    least.1
}

/// The changes of all rotations at the inner node whose children are `nodes[pair]` and `nodes[pair + 1]`.
#[must_use]
pub fn area_changes_at(nodes: &[Node], pair: usize) -> [f32; 6] {
    let (l, r) = (nodes[pair], nodes[pair + 1]);
    let below = |n: Node| (!n.is_leaf()).then(|| [nodes[n.first()].aabb(), nodes[n.first() + 1].aabb()]);
    area_changes(l.aabb(), r.aabb(), below(l), below(r))
}

/// Rotates at the inner node N whose children are `nodes[pair]` and `nodes[pair + 1]`: one swap of two node
/// slots, and new boxes, heights and moving bits for the children that got a new child. The caller refits N
/// itself, whose height may have changed.
///
/// `depth` is N's own depth. Refuses, changes nothing and returns `false` if the tree would become higher
/// than [`MAX_HEIGHT`], or if a swapped node does not exist because L or R is a leaf.
pub fn rotate(nodes: &mut [Node], pair: usize, rotation: Rotation, depth: u32) -> bool {
    let swap = SWAPS[rotation as usize];
    let slot = |place| match place {
        L => Some(pair),
        R => Some(pair + 1),
        Ll | Lr | Rl | Rr => {
            let parent = nodes[pair + usize::from(matches!(place, Rl | Rr))];
            let second = usize::from(matches!(place, Lr | Rr));
            (!parent.is_leaf()).then(|| parent.first() + second)
        }
    };
    let (Some(a), Some(b)) = (slot(swap.0), slot(swap.1)) else {
        return false;
    };
    // Refitting a child needs its slot after the swap: a child that changes places takes no part in it.
    let touched: &[usize] = match rotation {
        Rotation::LForRl | Rotation::LForRr => &[1],
        Rotation::RForLl | Rotation::RForLr => &[0],
        Rotation::LlForRl | Rotation::LlForRr => &[0, 1],
    };
    nodes.swap(a, b);
    let refit = |nodes: &mut [Node]| {
        for &child in touched {
            let first = nodes[pair + child].first();
            let (l, r) = (nodes[first], nodes[first + 1]);
            nodes[pair + child].refit(&l, &r);
        }
    };
    refit(nodes);
    let height = 1 + nodes[pair].height().max(nodes[pair + 1].height());
    let fits = depth + height <= MAX_HEIGHT;
    if !fits {
        nodes.swap(a, b);
        refit(nodes);
    }
    fits
}
