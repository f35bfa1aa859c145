//! Offline rotations (Kensler 2008, "Tree rotations for improving bounding volume hierarchies";
//! Kopta et al. 2012, section 1.1): passes over a whole static tree, by hill climbing or by
//! simulated annealing (Kirkpatrick, Gelatt, Vecchi 1983).
//!
//! ```text
//! pass(N):    pass(L), pass(R)
//!             d = change of cost by each rotation at N;  0 for none
//!             climbing:   take the least
//!             annealing:  take one at random, with odds exp(-d / T)
//!             refit N
//! anneal:     climb; passes with T falling; back to the best tree seen; climb
//! ```
//!
//! Departures: annealing draws from all rotations at a node at once (a heat bath: the odds of a
//! rotation that costs d against none are exp(-d / T) : 1). Its schedule is ours. It starts from
//! the climbed tree and keeps the best, so it is never worse than climbing.

use bvh_core::rotation::{area_changes_at, best, rotate};
use bvh_core::{Bvh, Node, Rotation, sah_cost};

use crate::layout::depth_first;
use crate::{Optimized, raw};

/// The budget of [`hill_climb`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct HillClimb {
    /// Largest number of passes over the tree, 200 by default. A pass without a gain is the last.
    pub passes: u32,
}

bvh_core::with_methods!(HillClimb: with_passes(passes: u32));

impl Default for HillClimb {
    fn default() -> Self {
        Self { passes: 200 }
    }
}

/// The schedule of [`anneal`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Anneal {
    /// Passes over the tree while it cools, besides those of the climbs. 400 by default.
    pub passes: u32,
    /// Temperature at the start, in half areas of an average inner node; 0.1 by default. The odds
    /// of a rotation that costs one temperature are 1 : e against none. The temperature falls
    /// geometrically to 1e-5 of its start, because areas spread over about as many scales. Hotter
    /// pays with more passes and on uneven scenes. With 0, less or NaN there is only the first
    /// climb.
    pub temperature: f64,
    /// Seed of the random numbers: equal seeds give equal trees.
    pub seed: u64,
    /// The budget of the climbs before and after.
    pub climb: HillClimb,
}

bvh_core::with_methods!(Anneal: with_passes(passes: u32), with_temperature(temperature: f64), with_seed(seed: u64),
    with_climb(climb: HillClimb));

impl Default for Anneal {
    fn default() -> Self {
        Self { passes: 400, temperature: 0.1, seed: 0, climb: HillClimb::default() }
    }
}

/// Applies the best rotation at each node, in passes over the whole tree, until none lowers the SAH
/// cost (Kensler 2008).
///
/// Boxes must be up to date. The order of primitives is kept, and nodes come to lie depth first. A
/// rotation that would make the tree higher than [`MAX_HEIGHT`](bvh_core::MAX_HEIGHT) is refused.
/// Changes between areas beyond the range of `f32` are no gain. Serial and deterministic. O(n) a
/// pass.
///
/// ```
/// use bvh_build::{Builder, HillClimb, build, hill_climb};
/// use bvh_core::{Aabb, Vec3};
///
/// let corner = |i: usize| Vec3::new((i * 37 % 100) as f32, (i * 61 % 100) as f32, 0.0);
/// let boxes: Vec<_> = (0..500).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect();
/// let mut bvh = build(&boxes, Builder::fast())?;
/// let done = hill_climb(&mut bvh, &HillClimb::default());
/// assert!(done.changes > 0 && done.after < done.before);
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn hill_climb(bvh: &mut Bvh, options: &HillClimb) -> Optimized {
    improve(bvh, |nodes| climb(nodes, 0, options))
}

/// Climbs as [`hill_climb`], then leaves local minima by random rotations, with fewer that raise
/// the cost as it gets colder (Kensler 2008).
///
/// The result is the best tree after any pass, climbed again: never worse than by [`hill_climb`]
/// alone. Serial and deterministic. O(n) a pass, with memory for three copies of the nodes.
///
/// ```
/// use bvh_build::{Anneal, Builder, anneal, build};
/// use bvh_core::{Aabb, Vec3};
///
/// let corner = |i: usize| Vec3::new((i * 37 % 100) as f32, (i * 61 % 100) as f32, 0.0);
/// let boxes: Vec<_> = (0..500).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect();
/// let mut bvh = build(&boxes, Builder::fast())?;
/// let done = anneal(&mut bvh, &Anneal::default().with_passes(20).with_seed(7));
/// assert!(done.after < done.before);
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn anneal(bvh: &mut Bvh, options: &Anneal) -> Optimized {
    improve(bvh, |nodes| cool(nodes, 0, options))
}

fn improve(bvh: &mut Bvh, f: impl FnOnce(&mut [Node]) -> (u32, u64)) -> Optimized {
    let before = sah_cost(bvh);
    let (passes, changes) = raw::edit(bvh, f);
    Optimized { passes, changes, before, after: sah_cost(bvh) }
}

/// Passes from one depth-first reordering of the nodes to the next: rotations scatter them.
const TIDY: u32 = 16;

/// Climbs below the node in slot `root`, which is 0 or a child of that; gives the numbers of passes
/// and rotations.
pub(crate) fn climb(nodes: &mut [Node], root: usize, options: &HillClimb) -> (u32, u64) {
    let mut spare = Vec::new();
    let (depth, mut rotations) = (u32::from(root != 0), 0);
    for i in 1..=options.passes {
        let applied = pass(nodes, root, depth, &mut |changes| best(changes));
        rotations += applied;
        if applied == 0 || i % TIDY == 0 || i == options.passes {
            depth_first(nodes, &mut spare);
        }
        if applied == 0 {
            return (i, rotations);
        }
    }
    (options.passes, rotations)
}

/// Climbs, anneals, climbs, as [`climb`].
pub(crate) fn cool(nodes: &mut [Node], root: usize, options: &Anneal) -> (u32, u64) {
    let first = climb(nodes, root, &options.climb);
    let (inner, mut least) = inner_nodes(nodes, root);
    let hottest = options.temperature * least / inner.max(1) as f64;
    if hottest.is_nan() || hottest <= 0.0 {
        return first;
    }
    let (mut best, mut spare) = (nodes.to_vec(), Vec::new());
    let mut random = Random(options.seed);
    let (depth, mut rotations) = (u32::from(root != 0), 0);
    for i in 1..=options.passes {
        let temperature = hottest * exp_minus(COOLING * f64::from(i) / f64::from(options.passes));
        rotations += pass(nodes, root, depth, &mut |changes| draw(changes, temperature, &mut random));
        let area = inner_nodes(nodes, root).1;
        if area < least {
            least = area;
            best.copy_from_slice(nodes);
        }
        if i % TIDY == 0 {
            depth_first(nodes, &mut spare);
        }
    }
    nodes.copy_from_slice(&best);
    // Not by climbing alone, which may be for no pass.
    depth_first(nodes, &mut spare);
    let last = climb(nodes, root, &options.climb);
    (first.0 + options.passes + last.0, first.1 + rotations + last.1)
}

/// Rotates at node `n`, which is `depth` below the root, and at all nodes below it, children first.
/// `choose` chooses by the changes of area. Gives the number of rotations. As deep as the tree is
/// high.
fn pass(
    nodes: &mut [Node],
    n: usize,
    depth: u32,
    choose: &mut impl FnMut([f32; 6]) -> Option<Rotation>,
) -> u64 {
    let node = nodes[n];
    // A node over two leaves has nothing to rotate.
    if node.height() < 2 {
        return 0;
    }
    let pair = node.first();
    let below = pass(nodes, pair, depth + 1, choose) + pass(nodes, pair + 1, depth + 1, choose);
    let rotated = choose(area_changes_at(nodes, pair)).and_then(|r| rotate(nodes, pair, r, depth)).is_some();
    let (l, r) = (nodes[pair], nodes[pair + 1]);
    nodes[n].refit(&l, &r);
    below + u64::from(rotated)
}

/// Draws a rotation, or none, with odds of exp(-change / temperature); 0 for a change of 0.
fn draw(changes: [f32; 6], temperature: f64, random: &mut Random) -> Option<Rotation> {
    if temperature <= 0.0 {
        return best(changes);
    }
    // Odds relative to the best keep the exponential in range. A NaN has the odds 0.
    let least = changes.iter().fold(0.0, |least: f32, &change| least.min(change));
    let odds = |change: f32| {
        let change = (f64::from(change) - f64::from(least)) / temperature;
        if change < COLD { exp_minus(change) } else { 0.0 }
    };
    let mut weights = changes.map(|change| if change == 0.0 { 0.0 } else { odds(change) });
    let sum = weights.iter_mut().fold(odds(0.0), |sum, weight| {
        *weight += sum;
        *weight
    });
    let place = random.next() * sum;
    let none = odds(0.0);
    if place < none {
        return None;
    }
    weights.iter().position(|&weight| place < weight).map(|i| Rotation::ALL[i])
}

/// A rotation that costs this number of temperatures more than the best is never taken.
const COLD: f64 = 30.0;

/// Natural logarithm of 1e5, the first temperature over the last.
const COOLING: f64 = 11.5;

/// exp(-x) for x in 0..[`COLD`] as (1 - x / 4096)^4096, exact to a few thousandths where it is not
/// near 0. Unlike that of mathematical libraries it has the same bits on every machine.
fn exp_minus(x: f64) -> f64 {
    (0..12).fold(1.0 - x / 4096.0, |power, _| power * power)
}

/// Number and half areas of all inner nodes.
fn inner_nodes(nodes: &[Node], root: usize) -> (usize, f64) {
    let (mut number, mut area) = (0, 0.0);
    let mut todo = vec![root];
    while let Some(n) = todo.pop() {
        let node: &Node = &nodes[n];
        if !node.is_leaf() {
            number += 1;
            area += node.sah_term();
            todo.extend([node.first() + 1, node.first()]);
        }
    }
    (number, area)
}

/// Random numbers: splitmix64 (Steele, Lea, Flood 2014). Not from a crate: trees depend on the
/// numbers, and must not change with a crate's version.
struct Random(u64);

impl Random {
    /// A number in 0..1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::tests::{options, streets};
    use crate::{BuildOptions, Builder, build, build_with};

    fn start(boxes: &Vec<Aabb>) -> Bvh {
        build(boxes, Builder::Lbvh).expect("few enough")
    }

    #[test]
    fn climbing_ends_where_no_rotation_gains() {
        let boxes = streets(3000);
        let mut bvh = start(&boxes);
        let done = hill_climb(&mut bvh, &HillClimb::default());
        bvh.validate(&boxes).expect("valid");
        assert!(done.passes < 100 && done.changes > 300, "{done:?}");
        assert!(done.after < 0.95 * done.before && done.after == sah_cost(&bvh), "{done:?}");
        let gains =
            |node: &Node| !node.is_leaf() && best(area_changes_at(bvh.nodes(), node.first())).is_some();
        bvh.visit(|n, node, _| assert!(!gains(node), "at {n}"));
        let again = hill_climb(&mut bvh, &HillClimb::default());
        assert_eq!((again.passes, again.changes), (1, 0));
    }

    #[test]
    fn annealing_beats_climbing_and_follows_its_seed() {
        let boxes = streets(2000);
        let mut climbed = start(&boxes);
        let climb = hill_climb(&mut climbed, &HillClimb::default());
        let annealed = |options: Anneal| {
            let mut bvh = start(&boxes);
            let done = anneal(&mut bvh, &options);
            bvh.validate(&boxes).expect("valid");
            assert_eq!(done.after, sah_cost(&bvh));
            (done, bvh.fingerprint())
        };
        let (first, hash) = annealed(Anneal::default());
        assert!(first.after < 0.998 * climb.after, "{first:?} {climb:?}");
        assert_eq!(annealed(Anneal::default()).1, hash);
        assert_ne!(annealed(Anneal::default().with_seed(1)).1, hash);
        for temperature in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let (done, hash) = annealed(Anneal::default().with_temperature(temperature));
            assert!(done.after <= climb.after);
            if !temperature.is_infinite() {
                assert_eq!(hash, climbed.fingerprint());
            }
        }
    }

    /// Rotations scatter nodes, and what follows needs them depth first.
    #[test]
    fn annealing_without_climbing_leaves_a_tree() {
        let mut boxes = streets(2000);
        for dropped in [false, true] {
            if dropped {
                boxes.iter_mut().step_by(100).for_each(|aabb| *aabb = Aabb::EMPTY);
            }
            // Greedy, from the first pass on.
            let climb = HillClimb::default().with_passes(0);
            let anneal = Anneal::default().with_passes(1).with_temperature(1e-9).with_climb(climb);
            let options = BuildOptions { anneal, ..options(4) };
            let bvh = build_with(&boxes, Builder::Annealed, &options).expect("few enough");
            bvh.validate(&boxes).expect("valid");
        }
    }

    #[test]
    fn odds_are_those_of_the_changes() {
        let changes = [1.0, f32::INFINITY, f32::NAN, 0.0, -1.0, 2.0];
        let mut random = Random(7);
        let mut taken = [0u32; 7];
        for _ in 0..100_000 {
            taken[draw(changes, 2.0, &mut random).map_or(6, |r| r as usize)] += 1;
        }
        assert_eq!([taken[1], taken[2], taken[3]], [0; 3]);
        for (i, change) in [(0, 1.0), (4, -1.0), (5, 2.0)] {
            let odds = f64::from(taken[i]) / f64::from(taken[6]);
            assert!((odds / (-change / 2.0f64).exp() - 1.0).abs() < 0.05, "{taken:?}");
        }
        assert_eq!(draw([f32::NEG_INFINITY; 6], 1.0, &mut random), None);
    }

    #[test]
    fn the_static_area_is_summed_again() {
        let boxes = streets(500);
        let mut bvh = start(&boxes);
        bvh.set_dynamic(|p| p % 16 == 0);
        hill_climb(&mut bvh, &HillClimb::default());
        bvh.validate(&boxes).expect("valid");
        let sum = bvh.static_area();
        bvh.set_dynamic(|p| p % 16 == 0);
        assert!(sum > 0.0 && (sum / bvh.static_area() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_height_bound_is_kept() {
        // A chain as high as allowed over boxes in an order that asks for other trees.
        let boxes: Vec<_> = (0..=bvh_core::MAX_HEIGHT)
            .map(|i| Vec3::splat((i * 37 % 97) as f32))
            .map(|p| Aabb::new(p, p + Vec3::ONE))
            .collect();
        let bvh = crate::tests::chain(&boxes);
        assert_eq!(bvh.height(), bvh_core::MAX_HEIGHT);
        let mut climbed = bvh.clone();
        hill_climb(&mut climbed, &HillClimb::default());
        climbed.validate(&boxes).expect("valid");
        let mut annealed = bvh.clone();
        anneal(&mut annealed, &Anneal::default().with_passes(50));
        annealed.validate(&boxes).expect("valid");
        assert!(sah_cost(&climbed) < sah_cost(&bvh) && sah_cost(&annealed) <= sah_cost(&climbed));
    }
}
