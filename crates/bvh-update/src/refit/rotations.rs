//! Rotations: judges the nodes of one level, several at a time, and applies the best rotation
//! wherever some rotation is a gain.
//!
//! Of each node six boxes are read: its children's, and those of either child. With one node in
//! each lane of a vector, a union or an area is a few instructions for all of them.

use bvh_core::rotation::Rotation;
use bvh_core::{MAX_HEIGHT, Node};
use bytemuck::Zeroable;

use super::Tally;
use super::block::{Entry, LISTED};
use super::kernels::refit_height;
use super::shared::{PairAt, SharedNodes};

/// Boxes of nodes that are judged together, coordinate by coordinate.
pub(super) struct Boxes<V> {
    pub(super) min: [V; 3],
    pub(super) max: [V; 3],
}

/// Defines `rotate`, which is [`rotate_with`] for `WIDTH` nodes at a time. A macro, as code for a
/// SIMD level cannot be generic over its vectors without `unsafe`.
///
/// The arguments are the arithmetic of the module's vectors. The module gives their `WIDTH`, the
/// `boxes` of the nodes on one side, 0 or 1, of all pairs, and the `best` rotation of each node.
/// Areas are computed in the order of [`Aabb::half_area`](bvh_core::Aabb::half_area), and changes
/// in that of [`area_changes`](bvh_core::rotation::area_changes), so the bits are the same
/// everywhere.
macro_rules! define_rotate {
    (
        $(#[$attribute:meta])*
        zero: $zero:expr, min: $min:path, max: $max:path, add: $add:path, sub: $sub:path, mul: $mul:path
    ) => {
        $(#[$attribute])*
        pub(super) fn rotate(
            nodes: SharedNodes<'_>,
            level: &[Entry],
            at: (u32, bool),
            accepted: &mut Accepted,
            tally: &mut Tally,
        ) {
            // An empty box has negative extents.
            let area_of = |x, y, z| {
                let (x, y, z) = ($max(x, $zero), $max(y, $zero), $max(z, $zero));
                $add($add($mul(x, y), $mul(y, z)), $mul(z, x))
            };
            let own_area = |a: &Boxes<_>| {
                let extent = |i: usize| $sub(a.max[i], a.min[i]);
                area_of(extent(0), extent(1), extent(2))
            };
            let area = |a: &Boxes<_>, b: &Boxes<_>| {
                let extent = |i: usize| $sub($max(a.max[i], b.max[i]), $min(a.min[i], b.min[i]));
                area_of(extent(0), extent(1), extent(2))
            };
            rotations::rotate_with(nodes, level, at, accepted, tally, |[own, below_l, below_r]| {
                let (l, r) = (boxes(own, 0), boxes(own, 1));
                let (ll, lr) = (boxes(below_l, 0), boxes(below_l, 1));
                let (rl, rr) = (boxes(below_r, 0), boxes(below_r, 1));
                let (area_l, area_r) = (own_area(&l), own_area(&r));
                let now = $add(area_l, area_r);
                let changes = [
                    $sub(area(&l, &rr), area_r),
                    $sub(area(&rl, &l), area_r),
                    $sub(area(&r, &lr), area_l),
                    $sub(area(&ll, &r), area_l),
                    $sub($add(area(&rl, &lr), area(&ll, &rr)), now),
                    $sub($add(area(&rr, &lr), area(&rl, &ll)), now),
                ];
                best(changes)
            });
        }
    };
}
pub(super) use define_rotate;

/// Refits the heights of the nodes of one level, judges `N` of them at a time, and applies what is
/// a gain. `at` is their depth, and whether something is static.
///
/// `judge` is given three pairs of each node, its children and those of either child, and gives the
/// best rotation of each.
#[inline(always)]
pub(super) fn rotate_with<const N: usize>(
    nodes: SharedNodes<'_>,
    level: &[Entry],
    at: (u32, bool),
    accepted: &mut Accepted,
    tally: &mut Tally,
    judge: impl Fn(&[[PairAt<'_>; N]; 3]) -> BestRotations<N>,
) {
    let all = u32::MAX >> (32 - N);
    let (groups, rest) = level.as_chunks::<N>();
    // The last node takes the place of those that are missing. `Entry::default` must not: it names
    // the root, whose height would be written below while other tasks read it.
    let mut padded = [rest.last().copied().unwrap_or_default(); N];
    padded.iter_mut().zip(rest).for_each(|(to, &from)| *to = from);
    let last = (!rest.is_empty()).then(|| (&padded, all >> (N - rest.len())));
    let mut count = 0;
    for (entries, included) in groups.iter().map(|group| (group, all)).chain(last) {
        // All are replaced.
        let (mut pairs, mut links) = ([[nodes.pair_at(0); N]; 3], [[0; 2]; N]);
        for (i, &entry) in entries.iter().enumerate() {
            links[i] = refit_height(nodes, entry);
            pairs[0][i] = nodes.pair_at(entry.first());
            pairs[1][i] = nodes.children_at(links[i][0]);
            pairs[2][i] = nodes.children_at(links[i][1]);
        }
        let best = judge(&pairs);
        let mut gains = best.gains & included;
        while gains != 0 {
            // `% N` spares checks of the index.
            let i = gains.trailing_zeros() as usize % N;
            let (change, rotation) = (best.changes[i], best.rotations[i]);
            accepted.0[count % (2 * LISTED)] = Gain { entry: entries[i], links: links[i], rotation, change };
            count += 1;
            gains &= gains - 1;
        }
    }
    accepted.apply(count, nodes, at, tally);
}

/// The best rotations of `N` nodes.
pub(super) struct BestRotations<const N: usize> {
    /// Bits of the nodes at which a rotation is a gain.
    pub(super) gains: u32,
    /// The change of area under the best.
    pub(super) changes: [f32; N],
    /// The best, as an index into `Rotation::ALL`.
    pub(super) rotations: [u32; N],
}

/// A node at which a rotation is a gain.
#[derive(Clone, Copy, Zeroable)]
struct Gain {
    entry: Entry,
    /// Link words of its children.
    links: [u32; 2],
    /// The best rotation, as an index into `Rotation::ALL`.
    rotation: u32,
    /// The change of area under it.
    change: f32,
}

/// Where rotations are gains among the nodes of one level.
#[derive(Zeroable)]
pub(crate) struct Accepted([Gain; 2 * LISTED]);

impl Accepted {
    /// Applies the first `count` rotations; given the nodes' depth, and whether something is
    /// static.
    #[inline(always)]
    fn apply(
        &self,
        count: usize,
        nodes: SharedNodes<'_>,
        (depth, is_partly_static): (u32, bool),
        tally: &mut Tally,
    ) {
        for &Gain { entry, links, rotation, change } in self.0.iter().take(count) {
            let rotation = Rotation::ALL[rotation as usize % Rotation::ALL.len()];
            let pair = entry.first();
            // A rotation makes a tree higher by one at most.
            let is_cautious = is_partly_static || nodes.get(entry.slot()).height() + depth >= MAX_HEIGHT;
            let before = is_cautious.then(|| nodes.pair(pair));
            let height = swap(nodes, pair, links, rotation);
            let mut static_change = 0.0;
            if let Some(before) = before {
                if depth + height > MAX_HEIGHT {
                    // Back again. A static child may have had a box that was not tight.
                    swap(nodes, pair, links, rotation);
                    (0..2).for_each(|i| nodes.set(pair + i, before[i]));
                    continue;
                }
                let (after, [first, last]) = (nodes.pair(pair), rotation.touched());
                let change = |i: usize| after[i].static_term() - before[i].static_term();
                static_change = (first..=last).map(change).sum();
            }
            nodes.set_height(entry.slot(), height);
            tally.rotations[rotation as usize] += 1;
            tally.area += f64::from(change) - static_change;
            tally.static_area += static_change;
        }
    }
}

/// Rotates at the parent of a pair, given the pair's link words: swaps two nodes and refits the
/// children that got another child. Gives the parent's height.
///
/// Reads nothing that it has stored: a node that was just stored by halves is slow to read as a
/// whole. The second of a rotation's places is a grandchild.
#[inline(always)]
fn swap(nodes: SharedNodes<'_>, pair: usize, links: [u32; 2], rotation: Rotation) -> u32 {
    let [first_l, first_r] = links.map(|link| (link & Node::INDEX) as usize);
    let firsts = [pair, first_l, first_r];
    let [(of_a, side_a), (of_b, side_b)] = rotation.places();
    let (a, b) = (firsts[of_a] + side_a, firsts[of_b] + side_b);
    let (at_a, at_b, beside_b) = (nodes.get(a), nodes.get(b), nodes.get(b ^ 1));
    // Of a child of N, given its new children.
    let refit = |family: usize, l: Node, r: Node| {
        let mut child = nodes.get(pair + family - 1);
        child.refit(&l, &r);
        nodes.set(pair + family - 1, child);
        child.height()
    };
    let height_a = if of_a == 0 { at_b.height() } else { refit(of_a, at_b, nodes.get(a ^ 1)) };
    let height_b = refit(of_b, at_a, beside_b);
    nodes.set(a, at_b);
    nodes.set(b, at_a);
    1 + height_a.max(height_b)
}

#[cfg(test)]
mod tests {
    use bvh_core::glam::Vec4;
    use bvh_core::rotation;

    use super::super::scalar;
    use super::*;

    #[test]
    fn the_best_rotation_is_that_of_the_definition() {
        let values = [f32::NAN, f32::NEG_INFINITY, f32::INFINITY, -2.0, -1.0, 0.0];
        let changes =
            |case: u32| [1, 6, 36, 216, 1296, 7776].map(|place| values[(case / place % 6) as usize]);
        for first in (0..6_u32.pow(6)).step_by(4) {
            let cases = [0, 1, 2, 3].map(|lane| changes(first + lane));
            let best = scalar::best(std::array::from_fn(|i| Vec4::from_array(cases.map(|case| case[i]))));
            for (lane, case) in cases.into_iter().enumerate() {
                let rotation = Rotation::ALL[best.rotations[lane] as usize];
                let found = (best.gains >> lane & 1 != 0).then_some(rotation);
                assert_eq!(found, rotation::best(case), "{case:?}");
                assert!(found.is_none() || best.changes[lane] == case[rotation as usize], "{case:?}");
            }
        }
    }
}
