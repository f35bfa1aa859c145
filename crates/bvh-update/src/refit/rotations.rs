//! Rotations: judges the nodes of one level, several at a time, and applies the best rotation
//! wherever some rotation is a gain.
//!
//! Of each node six boxes are read: its children's, and those of either child. With one node in
//! each lane of a vector, a union or an area is a few instructions for all of them.

use bvh_core::MAX_HEIGHT;
use bvh_core::glam::Vec4;
use bvh_core::rotation::Rotation;
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
/// `boxes` of the nodes on one side, 0 or 1, of all pairs, and `gains`, the bits of nodes with a
/// change below zero. Areas are computed in the order of
/// [`Aabb::half_area`](bvh_core::Aabb::half_area), and changes in that of
/// [`area_changes`](bvh_core::rotation::area_changes), so the bits are the same everywhere.
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
                (bytemuck::cast(changes), gains(changes))
            });
        }
    };
}
pub(super) use define_rotate;

/// Refits the heights of the nodes of one level, judges `N` of them at a time, and applies what is
/// a gain. `at` is their depth, and whether something is static.
///
/// `judge` is given three pairs of each node, its children and those of either child. It gives the
/// change of area under each rotation in the order of `Rotation::ALL`, and a bit for each node at
/// which some rotation is a gain.
#[inline(always)]
pub(super) fn rotate_with<const N: usize>(
    nodes: SharedNodes<'_>,
    level: &[Entry],
    at: (u32, bool),
    accepted: &mut Accepted,
    tally: &mut Tally,
    judge: impl Fn(&[[PairAt<'_>; N]; 3]) -> ([[f32; N]; 6], u32),
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
        let mut pairs = [[nodes.pair_at(0); N]; 3];
        for (i, &entry) in entries.iter().enumerate() {
            let [link_l, link_r] = refit_height(nodes, entry);
            pairs[0][i] = nodes.pair_at(entry.first());
            pairs[1][i] = nodes.children_at(link_l);
            pairs[2][i] = nodes.children_at(link_r);
        }
        let (changes, gains) = judge(&pairs);
        let mut gains = gains & included;
        while gains != 0 {
            // `% N` spares checks of the index.
            let i = gains.trailing_zeros() as usize % N;
            let [a, b, c, d, e, f] = &changes;
            accepted.set(count, entries[i], [a[i], b[i], c[i], d[i], e[i], f[i], 0.0, 0.0]);
            count += 1;
            gains &= gains - 1;
        }
    }
    accepted.apply(count, nodes, at, tally);
}

/// Nodes at which some rotation is a gain, and how the area would change under each, in the order
/// of `Rotation::ALL`, and two zeros.
#[derive(Zeroable)]
pub(crate) struct Accepted {
    entries: [Entry; 2 * LISTED],
    changes: [[f32; 8]; 2 * LISTED],
}

impl Accepted {
    /// Replaces number `i`.
    #[inline(always)]
    fn set(&mut self, i: usize, entry: Entry, changes: [f32; 8]) {
        let i = i % (2 * LISTED);
        (self.entries[i], self.changes[i]) = (entry, changes);
    }

    /// Applies the best rotation of each of the first `count` nodes; given the nodes' depth, and
    /// whether something is static.
    #[inline(always)]
    fn apply(
        &self,
        count: usize,
        nodes: SharedNodes<'_>,
        (depth, is_partly_static): (u32, bool),
        tally: &mut Tally,
    ) {
        for (&entry, &changes) in self.entries.iter().zip(&self.changes).take(count) {
            let (rotation, pair) = (best(changes), entry.first());
            // A rotation makes a tree higher by one at most.
            let is_cautious = is_partly_static || nodes.get(entry.slot()).height() + depth >= MAX_HEIGHT;
            let before = is_cautious.then(|| nodes.pair(pair));
            swap(nodes, pair, rotation);
            let mut static_change = 0.0;
            if let Some(before) = before {
                let after = nodes.pair(pair);
                if depth + 1 + after[0].height().max(after[1].height()) > MAX_HEIGHT {
                    // Back again. A static child may have had a box that was not tight.
                    swap(nodes, pair, rotation);
                    (0..2).for_each(|i| nodes.set(pair + i, before[i]));
                    continue;
                }
                let [first, last] = rotation.touched();
                let change = |i: usize| after[i].static_term() - before[i].static_term();
                static_change = (first..=last).map(change).sum();
            }
            refit_height(nodes, entry);
            let change = f64::from(changes[rotation as usize]);
            tally.rotations[rotation as usize] += 1;
            tally.area += change - static_change;
            tally.static_area += static_change;
        }
    }
}

/// What is no gain becomes 0, NaN among it: a comparison with NaN is false on every target, while
/// its minimum with a number is either of them.
#[inline(always)]
fn gain(changes: Vec4) -> Vec4 {
    Vec4::select(changes.cmplt(Vec4::ZERO), changes, Vec4::ZERO)
}

/// As [`rotation::best`](bvh_core::rotation::best), where some change is below zero, without
/// branches.
#[inline(always)]
fn best(changes: [f32; 8]) -> Rotation {
    let [a, b]: [Vec4; 2] = bytemuck::cast(changes);
    let [a, b] = [gain(a), gain(b)];
    let least = Vec4::splat(a.min(b).min_element());
    let is_least = a.cmpeq(least).bitmask() | b.cmpeq(least).bitmask() << 4;
    Rotation::ALL[is_least.trailing_zeros() as usize % Rotation::ALL.len()]
}

/// Rotates at the parent of a pair: swaps two nodes and refits the children that got another child.
#[inline(always)]
fn swap(nodes: SharedNodes<'_>, pair: usize, rotation: Rotation) {
    let [l, r] = nodes.pair(pair);
    let families = [pair, l.first(), r.first()];
    let [a, b] = rotation.places().map(|(family, side)| families[family] + side);
    let (at_a, at_b) = (nodes.get(a), nodes.get(b));
    nodes.set(a, at_b);
    nodes.set(b, at_a);
    // One child twice, where the other gets none: without a branch.
    for child in rotation.touched() {
        let mut node = nodes.get(pair + child);
        let [l, r] = nodes.pair(node.first());
        node.refit(&l, &r);
        nodes.set(pair + child, node);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_rotation_is_that_of_the_definition() {
        let values = [f32::NAN, f32::NEG_INFINITY, f32::INFINITY, -2.0, -1.0, 0.0];
        for case in 0..6_u32.pow(6) {
            let changes: [f32; 6] =
                std::array::from_fn(|i| values[(case / 6_u32.pow(i as u32) % 6) as usize]);
            let Some(expected) = bvh_core::rotation::best(changes) else { continue };
            let lanes = std::array::from_fn(|i| changes.get(i).copied().unwrap_or_default());
            assert_eq!(best(lanes), expected, "{changes:?}");
        }
    }
}
