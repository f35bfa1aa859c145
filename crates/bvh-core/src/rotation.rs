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
//! A rotation leaves N's box and everything below the swapped nodes as they are, so the change of
//! the tree's SAH cost is the change of half area of the one or two inner children whose boxes are
//! new (times [`COST_TRAVERSE`](crate::COST_TRAVERSE), over the root's area). *That* is what is
//! compared here, not the areas of N's two new children. Nothing is divided, and a change `x - y`
//! of two `f32` is negative only if `x < y` exactly, so each rotation lowers the exact sum of the
//! rounded areas: on a still scene rotations come to an end.

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

/// A place among a node's children and grandchildren: whose child it is (N's, L's or R's: 0, 1, 2),
/// and on which side (0, 1).
type Place = (usize, usize);

const L: Place = (0, 0);
const R: Place = (0, 1);
const LL: Place = (1, 0);
const LR: Place = (1, 1);
const RL: Place = (2, 0);
const RR: Place = (2, 1);

impl Rotation {
    /// All six, in the order in which ties are decided: the first of equals is taken.
    pub const ALL: [Self; 6] =
        [Self::LForRl, Self::LForRr, Self::RForLl, Self::RForLr, Self::LlForRl, Self::LlForRr];

    /// Returns the two places that change nodes.
    #[doc(hidden)]
    #[must_use]
    #[inline]
    pub const fn places(self) -> [Place; 2] {
        const PLACES: &[[Place; 2]; 6] = &[[L, RL], [L, RR], [R, LL], [R, LR], [LL, RL], [LL, RR]];
        PLACES[self as usize]
    }

    /// Returns the children of N that get a new child: one of them twice if the other gets none.
    #[doc(hidden)]
    #[must_use]
    #[inline]
    pub const fn touched(self) -> [usize; 2] {
        const TOUCHED: &[[usize; 2]; 6] = &[[1, 1], [1, 1], [0, 0], [0, 0], [0, 1], [0, 1]];
        TOUCHED[self as usize]
    }
}

/// Computes the change of the half areas of N's inner children under each rotation, in the order of
/// [`Rotation::ALL`]; infinite where the swapped nodes do not exist.
///
/// `l` and `r` are the boxes of N's children. `below_l` and `below_r` are those of the
/// grandchildren, `None` below a leaf. An area beyond the range of `f32` makes a change infinite or
/// NaN; such a change is below zero only where the rotation is certain to gain, or where an extent
/// is beyond that range as well. Areas below 1e-38 have few digits in `f32`; where all are, a
/// change may have the wrong sign, so [`best`] takes none that small.
///
/// ```
/// use bvh_core::rotation::{Rotation, area_changes, best};
/// use bvh_core::{Aabb, Vec3};
///
/// let at = |x: f32| Aabb::new(Vec3::X * x, Vec3::X * x + Vec3::ONE);
/// // L is a leaf at 0; R has one leaf beside it and one far away.
/// let changes = area_changes(at(0.0), at(1.0).union(at(9.0)), None, Some([at(1.0), at(9.0)]));
/// assert_eq!(best(changes), Some(Rotation::LForRr));
/// ```
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

/// A change of area that is no gain. Below the smallest normal `f32`, 1.2e-38, a change may be
/// nothing but rounding, and where all areas are that small, rotations would make trees worse.
#[doc(hidden)]
pub const NO_GAIN: f32 = -f32::MIN_POSITIVE;

/// Chooses the rotation of the smallest change, if that saves more than the smallest normal `f32`,
/// 1.2e-38; the first in order on a tie. A NaN is no gain.
#[must_use]
#[inline]
pub fn best(changes: [f32; 6]) -> Option<Rotation> {
    let mut least = (NO_GAIN, None);
    for (change, rotation) in changes.into_iter().zip(Rotation::ALL) {
        if change < least.0 {
            least = (change, Some(rotation));
        }
    }
    least.1
}

/// Computes the changes of all rotations at the inner node whose children are in slots `pair` and
/// `pair + 1`.
#[must_use]
#[inline]
pub fn area_changes_at(nodes: &[Node], pair: usize) -> [f32; 6] {
    let (l, r) = (nodes[pair], nodes[pair + 1]);
    let below = |n: Node| (!n.is_leaf()).then(|| [0, 1].map(|i| nodes[n.first() + i].aabb()));
    area_changes(l.aabb(), r.aabb(), below(l), below(r))
}

/// Rotates at the inner node N whose children are in slots `pair` and `pair + 1`: swaps two slots
/// and refits the children that got a new child. The caller refits N, whose height may have
/// changed.
///
/// `depth` is N's own depth. Gives the change of [`Bvh::static_area`](crate::Bvh::static_area).
/// Gives `None` and changes nothing if the tree would become higher than [`MAX_HEIGHT`], or if L or
/// R is a leaf where a grandchild is to be swapped.
pub fn rotate(nodes: &mut [Node], pair: usize, rotation: Rotation, depth: u32) -> Option<f64> {
    let children = [nodes[pair], nodes[pair + 1]];
    let slot = |(family, side): Place| match family {
        0 => Some(pair + side),
        _ => (!children[family - 1].is_leaf()).then(|| children[family - 1].first() + side),
    };
    let [a, b] = rotation.places();
    let (a, b) = (slot(a)?, slot(b)?);
    let [first, last] = rotation.touched();
    let touched = first..=last;
    nodes.swap(a, b);
    let mut static_change = 0.0;
    for i in touched.clone() {
        let mut child = nodes[pair + i];
        child.refit(&nodes[child.first()], &nodes[child.first() + 1]);
        nodes[pair + i] = child;
        static_change += child.static_term() - children[i].static_term();
    }
    let height = 1 + nodes[pair].height().max(nodes[pair + 1].height());
    if height > MAX_HEIGHT.saturating_sub(depth) {
        for i in touched {
            nodes[pair + i] = children[i];
        }
        nodes.swap(a, b);
        return None;
    }
    Some(static_change)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bvh, Vec3, sah_cost};
    use proptest::prelude::*;

    /// N with four grandchildren around the given points.
    fn four(points: [[f32; 3]; 4]) -> Bvh {
        let boxes = points.map(|p| Aabb::new(Vec3::from(p), Vec3::from(p) + 1.0));
        let inner = |i: usize, left| Node::inner(boxes[i].union(boxes[i + 1]), left);
        let leaf = |i: usize| Node::leaf(boxes[i], i as u32, 1);
        let (l, r) = (inner(0, 4), inner(2, 6));
        let root = Node::inner(l.aabb().union(r.aabb()), 2);
        let nodes = [root, Node::NOTHING, l, r, leaf(0), leaf(1), leaf(2), leaf(3)];
        Bvh::new(&nodes, (0..4).collect()).expect("valid")
    }

    fn rotated(bvh: &Bvh, rotation: Rotation) -> Bvh {
        let mut nodes = bvh.nodes().to_vec();
        assert_eq!(rotate(nodes.as_mut_slice(), 2, rotation, 0), Some(0.0));
        let (l, r) = (nodes[2], nodes[3]);
        nodes[0].refit(&l, &r);
        Bvh::new(&nodes, bvh.order().to_vec()).expect("still a tree")
    }

    fn leaves_below(bvh: &Bvh, n: usize) -> Vec<u32> {
        let mut all = Vec::new();
        let mut todo = vec![n];
        while let Some(n) = todo.pop() {
            let node = &bvh.nodes()[n];
            all.extend(bvh.primitives(node));
            if !node.is_leaf() {
                todo.extend([node.first(), node.first() + 1]);
            }
        }
        all.sort_unstable();
        all
    }

    #[test]
    fn each_rotation_swaps_what_its_name_says() {
        let bvh = four([[0.0; 3], [2.0; 3], [4.0; 3], [6.0; 3]]);
        let after = |r| {
            let t = rotated(&bvh, r);
            [leaves_below(&t, 2), leaves_below(&t, 3)]
        };
        assert_eq!(after(Rotation::LForRl), [vec![2], vec![0, 1, 3]]);
        assert_eq!(after(Rotation::LForRr), [vec![3], vec![0, 1, 2]]);
        assert_eq!(after(Rotation::RForLl), [vec![1, 2, 3], vec![0]]);
        assert_eq!(after(Rotation::RForLr), [vec![0, 2, 3], vec![1]]);
        assert_eq!(after(Rotation::LlForRl), [vec![1, 2], vec![0, 3]]);
        assert_eq!(after(Rotation::LlForRr), [vec![1, 3], vec![0, 2]]);
    }

    #[test]
    fn the_first_of_equal_gains_is_taken_and_nan_never() {
        assert_eq!(best([0.0; 6]), None);
        assert_eq!(best([-1e-39; 6]), None);
        assert_eq!(best([f32::NAN; 6]), None);
        assert_eq!(best([1.0, -1.0, f32::NAN, -1.0, -0.5, -0.0]), Some(Rotation::LForRr));
    }

    #[test]
    fn a_rotation_beyond_the_height_bound_or_into_a_leaf_changes_nothing() {
        let bvh = four([[0.0; 3], [2.0; 3], [4.0; 3], [6.0; 3]]);
        let mut nodes = bvh.nodes().to_vec();
        for rotation in Rotation::ALL {
            let refused = rotate(nodes.as_mut_slice(), 2, rotation, MAX_HEIGHT - 1);
            assert_eq!(refused, None);
            assert_eq!(nodes, bvh.nodes());
        }
        assert_eq!(rotate(nodes.as_mut_slice(), 2, Rotation::LForRl, MAX_HEIGHT - 2), None);
        assert_eq!(rotate(nodes.as_mut_slice(), 4, Rotation::LForRl, 1), None);
        assert_eq!(nodes, bvh.nodes());
        assert_eq!(rotate(nodes.as_mut_slice(), 2, Rotation::LForRl, MAX_HEIGHT - 3), Some(0.0));
    }

    #[test]
    fn static_area_follows_a_rotation() {
        let mut bvh = four([[0.0; 3], [2.0; 3], [4.0; 3], [6.0; 3]]);
        bvh.set_dynamic(|p| p == 0);
        let mut nodes = bvh.nodes().to_vec();
        // R = (2, 3) is static and becomes (0, 3), dynamic; L = (0, 1) becomes (2, 1), static.
        let before = nodes[3].aabb().half_area_f64();
        let static_change = rotate(nodes.as_mut_slice(), 2, Rotation::LlForRl, 0);
        assert_eq!(static_change, Some(nodes[2].aabb().half_area_f64() - before));
        assert!(!nodes[2].is_dynamic() && nodes[3].is_dynamic());
    }

    proptest! {
        #[test]
        fn the_claimed_change_is_that_of_the_recomputed_cost(
            points in prop::array::uniform4(prop::array::uniform3(-10.0f32..10.0))
        ) {
            let bvh = four(points);
            let root = bvh.root().aabb().half_area_f64();
            let claimed = area_changes_at(bvh.nodes(), 2);
            for (claimed, rotation) in claimed.into_iter().zip(Rotation::ALL) {
                let real = (sah_cost(&rotated(&bvh, rotation)) - sah_cost(&bvh)) * root;
                prop_assert!((real - f64::from(claimed)).abs() <= 1e-5 * root, "{claimed} for {real}");
            }
        }

        #[test]
        fn going_there_and_back_cancels_exactly(
            points in prop::array::uniform4(prop::array::uniform3(-10.0f32..10.0))
        ) {
            // LL <-> RL and LL <-> RR undo themselves, so no still scene can flip-flop.
            let bvh = four(points);
            for rotation in [Rotation::LlForRl, Rotation::LlForRr] {
                let there = area_changes_at(bvh.nodes(), 2)[rotation as usize];
                let back = area_changes_at(rotated(&bvh, rotation).nodes(), 2)[rotation as usize];
                prop_assert_eq!(there, -back);
            }
        }
    }
}
