//! The inner loops of the pass, each over a list of slots, at the SIMD level asked for.
//!
//! There is one for each kind of inner node: *twigs* with two leaves for children, *spurs* with one, and *forks* with
//! none. A leaf is fitted with its parent. What a kernel fits it adds to a sum of half areas, for the SAH cost.

use bvh_core::rotation::{area_changes_at, best, rotate};
use bvh_core::{Aabb, Node, Primitives};

use crate::block::{Next, Queue, Tally, Twigs};
use crate::raw::{Available, SharedNodes, dispatch};

/// A sum of half areas times weights, as sums of products: `xy`, `yz`, `zx`, and one without
/// meaning.
///
/// Kept apart, the products need no sum across a register; one addition each, in the order of the lists, and with
/// unusual nodes in sums of their own, gives every SIMD level the same bits.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Areas(pub(crate) [f64; 4]);

impl Areas {
    #[inline]
    fn add(&mut self, aabb: Aabb, weight: f64) {
        let e = aabb.extent();
        for (sum, product) in self.0.iter_mut().zip([e.x * e.y, e.y * e.z, e.z * e.x]) {
            *sum += f64::from(product) * weight;
        }
    }

    pub(crate) fn total(self) -> f64 {
        let [xy, yz, zx, _] = self.0;
        xy + yz + zx
    }
}

/// What a kernel has fitted.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Fitted {
    pub(crate) leaves: u64,
    /// Inner nodes, where the caller has not counted them.
    pub(crate) inner: u64,
    /// Primitives without a box.
    pub(crate) dropped: u64,
    pub(crate) leaf_areas: Areas,
    pub(crate) inner_areas: Areas,
}

impl Fitted {
    /// Both together.
    pub(crate) fn and(mut self, other: &Self) -> Self {
        self.leaves += other.leaves;
        self.inner += other.inner;
        self.dropped += other.dropped;
        for (sum, more) in
            [(&mut self.leaf_areas, other.leaf_areas), (&mut self.inner_areas, other.inner_areas)]
        {
            sum.0.iter_mut().zip(more.0).for_each(|(sum, more)| *sum += more);
        }
        self
    }
}

/// A node at which a rotation is a gain, and how the area would change under each, in the order of `Rotation::ALL`.
/// The last two are nothing.
pub(crate) struct Accepted {
    pub(crate) changes: [f32; 8],
    pub(crate) slot: u32,
}

/// Lists what is below the queued nodes up to `end`, in groups, while there is room: those with grandchildren in the
/// queue, twigs among the twigs. Nodes that are done are told apart as spurs and forks.
pub(crate) fn gather(
    level: Available,
    nodes: SharedNodes<'_>,
    queue: &mut Queue,
    twigs: &mut Twigs,
    end: usize,
) {
    dispatch!(level, gather(nodes, queue, twigs, end));
}

/// Fits twigs and their leaves to the primitives, which are numbered by slot in the tree's order; meanwhile fetches what
/// is next.
pub(crate) fn twigs<P: Primitives + ?Sized>(
    level: Available,
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &Twigs,
    next: Next<'_>,
) -> Fitted {
    dispatch!(level, twigs(nodes, primitives, list, next))
}

/// Fits spurs and their leaves; with `ROTATE`, appends those to `accepted` that gain by some rotation.
pub(crate) fn spurs<P: Primitives + ?Sized, const ROTATE: bool>(
    level: Available,
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Fitted {
    dispatch!(level, spurs::<P, ROTATE>(nodes, primitives, list, accepted))
}

/// Refits forks; with `ROTATE`, appends those to `accepted` that gain by some rotation.
pub(crate) fn forks<const ROTATE: bool>(
    level: Available,
    nodes: SharedNodes<'_>,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Areas {
    dispatch!(level, forks::<ROTATE>(nodes, list, accepted))
}

/// Whether a leaf is one that SIMD kernels fit: it moves, and its primitives' boxes are certainly not empty.
pub(crate) fn is_usual<P: Primitives + ?Sized>(leaf: &Node, primitives: &P) -> bool {
    let is_certain = |primitive| {
        let [_, _, doubt] = primitives.aabb_lanes(primitive);
        doubt.truncate().is_finite()
    };
    leaf.is_dynamic() && leaf.count() > 0 && (leaf.first()..leaf.first() + leaf.count()).all(is_certain)
}

/// Fits one leaf.
pub(crate) fn fit_leaf<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    slot: usize,
    fitted: &mut Fitted,
) {
    let mut node = nodes.get(slot);
    let mut aabb = Aabb::EMPTY;
    for primitive in node.first()..node.first() + node.count() {
        let next = primitives.aabb(primitive);
        // A sanitised box is empty only if it is `Aabb::EMPTY`.
        fitted.dropped += u64::from(next.min.x == f32::INFINITY);
        aabb = aabb.union(next);
    }
    fitted.leaves += 1;
    fitted.leaf_areas.add(aabb, node.weight());
    node.set_aabb(aabb);
    nodes.set(slot, node);
}

/// Fits one inner node, after those of its children that are leaves.
pub(crate) fn fit_inner<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    slot: usize,
    fitted: &mut Fitted,
) {
    let pair = nodes.get(slot).first();
    for child in pair..pair + 2 {
        let node = nodes.get(child);
        if node.is_leaf() && node.is_dynamic() {
            fit_leaf(nodes, primitives, child, fitted);
        }
    }
    refit(nodes, slot, &mut fitted.inner_areas);
}

/// Refits one inner node from its children.
pub(crate) fn refit(nodes: SharedNodes<'_>, slot: usize, areas: &mut Areas) {
    let mut node = nodes.get(slot);
    let [l, r] = nodes.pair(node.first());
    node.refit(&l, &r);
    areas.add(node.aabb(), 1.0);
    nodes.set(slot, node);
}

/// Appends a node to `accepted` if it gains by some rotation.
pub(crate) fn evaluate(nodes: SharedNodes<'_>, slot: u32, accepted: &mut Vec<Accepted>) {
    let changes = area_changes_at(&nodes, nodes.get(slot as usize).first());
    if best(changes).is_some() {
        let [c0, c1, c2, c3, c4, c5] = changes;
        accepted.push(Accepted { changes: [c0, c1, c2, c3, c4, c5, 0.0, 0.0], slot });
    }
}

/// Applies the best rotation of each, counted by kind in `tally`; `depth` is that of the nodes.
pub(crate) fn apply(mut nodes: SharedNodes<'_>, depth: u32, accepted: &[Accepted], tally: &mut Tally) {
    for a in accepted {
        let [c0, c1, c2, c3, c4, c5, ..] = a.changes;
        let mut node = nodes.get(a.slot as usize);
        if let Some(rotation) = best([c0, c1, c2, c3, c4, c5])
            && let Some(grown) = rotate(&mut nodes, node.first(), rotation, depth)
        {
            // The box is the same; the height may not be.
            let [l, r] = nodes.pair(node.first());
            node.refit(&l, &r);
            nodes.set(a.slot as usize, node);
            tally.rotations[rotation as usize] += 1;
            let change = f64::from(a.changes[rotation as usize]);
            tally.area += change - grown;
            tally.gain -= change;
            tally.static_area += grown;
        }
    }
}
