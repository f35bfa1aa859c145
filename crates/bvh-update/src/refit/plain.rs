//! The paper's update as a recursion, straight from section 2: what the fast pass is checked
//! against.
//!
//! ```text
//! update(N):                                 if N is a leaf: fit its box to its primitives
//!     update(L); update(R)                   otherwise, in post-order
//!     rotate at N with the best of the six   if that lowers the SAH cost (and rotations are wanted)
//!     refit N from L and R
//! ```
//!
//! The paper refits N first and then rotates; N's box is the same either way, and its height is
//! known last.

use bvh_core::rotation::{self, area_changes_at, best};
use bvh_core::{Aabb, Bvh, Node, OnPanic, Primitives};

use super::{Rotate, Schedule, parts};
use crate::state::{Layout, State};

/// Refits every box above primitives that move; with `rotate`, also rotates at such nodes. Gives
/// the rotations applied, by kind in the order of [`Rotation::ALL`](bvh_core::Rotation::ALL).
///
/// One thread, O(n).
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3};
/// use bvh_update::{Rotate, plain, refit_and_rotate};
///
/// let at = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 1.0, 1.0));
/// let mut bvh = build(&[at(0.0), at(1.0), at(10.0)], Builder::Sweep)?;
/// let mut same = bvh.clone();
/// let moved = [at(0.0), at(9.0), at(10.0)];
/// let rotations = plain::update(&mut bvh, &moved, Some(Rotate::default()));
/// assert_eq!(rotations, refit_and_rotate(&mut same, &moved)?.rotations);
/// assert_eq!(bvh.nodes(), same.nodes());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Panics
/// If there are not as many primitives as the tree holds.
pub fn update<P: Primitives + ?Sized>(bvh: &mut Bvh, primitives: &P, rotate: Option<Rotate>) -> [u64; 6] {
    update_below(bvh, primitives, rotate, 0)
}

/// Does what [`update`] does, as if the root lay `depth` levels below that of a higher tree:
/// rotations keep the tree that much lower.
#[doc(hidden)]
pub fn update_below<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    rotate: Option<Rotate>,
    depth: u32,
) -> [u64; 6] {
    assert!(
        primitives.len() == bvh.len(),
        "the tree holds {} primitives, not {}",
        bvh.len(),
        primitives.len()
    );
    let unfinished = OnPanic(bvh, Bvh::recompute_metadata);
    let parts = parts(unfinished.0);
    let state = State::of_mut(parts.state);
    let rotations = rotate.map(|rotate| Schedule::new(rotate.period, state.updates));
    state.updates = state.updates.wrapping_add(1);
    if rotate.is_some() {
        state.layout = Layout::OTHER;
    }
    let (nodes, order) = (parts.nodes, parts.order);
    let mut walk = Walk { nodes, order, primitives, rotations, applied: [0; 6], static_area: 0.0 };
    walk.node(0, depth);
    *parts.static_area += walk.static_area;
    let applied = walk.applied;
    std::mem::forget(unfinished);
    applied
}

struct Walk<'a, P: ?Sized> {
    nodes: &'a mut [Node],
    order: &'a [u32],
    primitives: &'a P,
    rotations: Option<Schedule>,
    applied: [u64; 6],
    static_area: f64,
}

impl<P: Primitives + ?Sized> Walk<'_, P> {
    fn node(&mut self, n: usize, depth: u32) {
        let node = self.nodes[n];
        if !node.is_dynamic() {
            return;
        }
        let first = node.first();
        if node.is_leaf() {
            let slots = &self.order[first..first + node.count()];
            let boxes = slots.iter().map(|&p| self.primitives.aabb(p as usize).sanitized());
            self.nodes[n].set_aabb(boxes.fold(Aabb::EMPTY, Aabb::union));
            return;
        }
        self.node(first, depth + 1);
        self.node(first + 1, depth + 1);
        if self.rotations.is_some_and(|schedule| schedule.includes(n))
            && let Some(rotation) = best(area_changes_at(self.nodes, first))
            && let Some(static_area) = rotation::rotate(self.nodes, first, rotation, depth)
        {
            self.applied[rotation as usize] += 1;
            self.static_area += static_area;
        }
        let (l, r) = (self.nodes[first], self.nodes[first + 1]);
        self.nodes[n].refit(&l, &r);
    }
}
