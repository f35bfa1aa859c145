//! Packets of 8 x 8 rays from one origin, as published: Wald, Boulos and Shirley, *Ray Tracing
//! Deformable Scenes Using Dynamic Bounding Volume Hierarchies*, 2007, section 4. The reference,
//! kept plain.
//!
//! ```text
//! at a node, with `first` the first ray that entered its parent:
//!   ray `first` enters the box                 -> go down at once
//!   interval arithmetic: no ray can enter      -> next from the stack
//!   otherwise the next ray that enters, if any -> go down with that as `first`
//! at a leaf, test all rays from `first` on
//! ```
//!
//! One departure: the paper orders children by the axis of their split. Rotations change that axis,
//! and nodes here do not keep it. Here the child whose centre comes first along ray `first` goes
//! first.

use arrayvec::ArrayVec;
use bvh_core::triangle::{Test, intersect};
use bvh_core::{Aabb, MAX_HEIGHT, Ray, Vec3, slab};

use crate::Hit;
use crate::scene::{Scene, Work};
use crate::wave::{PACKET, Wave};

/// Traces a wave.
pub(crate) fn trace_all<T: Test, const ANY: bool>(scene: Scene<'_>, wave: &mut Wave, work: &mut Work) {
    for at in (0..wave.count).step_by(PACKET) {
        let n = PACKET.min(wave.count - at);
        let packet = std::array::from_fn(|i| wave.ray(at + i.min(n - 1)));
        let t_max = std::array::from_fn(|i| if i < n { wave.t_max } else { -1.0 });
        let found = trace::<T, ANY>(scene, &packet, t_max, work);
        found[..n].iter().enumerate().for_each(|(i, &hit)| wave.set_hit(at + i, hit));
    }
}

/// Traces rays that share their origin; those with a negative `t_max` are absent. For
/// `ANY` the hits are any, not the closest.
pub(crate) fn trace<T: Test, const ANY: bool>(
    scene: Scene<'_>,
    rays: &[Ray; PACKET],
    mut t_max: [f32; PACKET],
    work: &mut Work,
) -> [Option<Hit>; PACKET] {
    let mut best = [None::<Hit>; PACKET];
    let present = |&i: &usize| rays[i].is_valid() && t_max[i] >= 0.0;
    let Some(first) = (0..PACKET).find(present) else {
        return best;
    };
    let bounds =
        RayBounds::around(rays[first].origin(), (first..PACKET).filter(present).map(|i| rays[i].inverse()));
    let tests = rays.each_ref().map(T::new);

    let Scene { bvh, triangles, .. } = scene;
    let nodes = bvh.nodes();
    let mut stack = ArrayVec::<_, { MAX_HEIGHT as usize + 2 }>::from_iter([(0, first)]);
    while let Some((n, mut first)) = stack.pop() {
        let node = &nodes[n];
        let aabb = node.aabb();
        let enters =
            |i: usize| rays[i].is_valid() && slab::enters(&rays[i], &aabb, t_max[i], Ray::WIDEN).is_some();
        if !enters(first) {
            if bounds.misses(&aabb) {
                continue;
            }
            match (first + 1..PACKET).find(|&i| enters(i)) {
                Some(i) => first = i,
                None => continue,
            }
        }
        if !node.is_leaf() {
            work.nodes += 1;
            let pair = node.first();
            let step = nodes[pair + 1].aabb().center() - nodes[pair].aabb().center();
            // False for the NaN that an empty child gives: any order will do.
            let near = pair + usize::from(step.dot(rays[first].direction()) < 0.0);
            stack.extend([(2 * pair + 1 - near, first), (near, first)]);
            continue;
        }
        for &p in bvh.primitives(node).iter().filter(|&&p| (p as usize) < triangles.indices.len()) {
            let corners = triangles.corners(p as usize);
            for i in (first..PACKET).filter(|&i| rays[i].is_valid()) {
                let hit = intersect(&rays[i], &tests[i], &corners, p, t_max[i]);
                if let Some(hit) = hit.filter(|h| best[i].is_none_or(|b| h.is_before(b.t, b.primitive))) {
                    best[i] = Some(hit);
                    t_max[i] = if ANY { -1.0 } else { hit.t };
                }
            }
        }
    }
    best
}

/// Bounds on the reciprocal directions of rays from one origin.
struct RayBounds {
    origin: Vec3,
    least: Vec3,
    greatest: Vec3,
    /// Axes along which all rays go the same way, so that the bounds say something.
    usable: [bool; 3],
}

impl RayBounds {
    fn around(origin: Vec3, inverses: impl Iterator<Item = Vec3>) -> Self {
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (least, greatest) = inverses.fold(start, |(a, b), i| (a.min(i), b.max(i)));
        let usable = [0, 1, 2].map(|k| {
            least[k].is_finite() && greatest[k].is_finite() && (least[k] > 0.0 || greatest[k] < 0.0)
        });
        Self { origin, least, greatest, usable }
    }

    /// True only if no ray enters. Rounding is monotonic, so the bounds hold for what each ray
    /// computes by itself.
    fn misses(&self, aabb: &Aabb) -> bool {
        let (mut near, mut far) = (0.0, f32::INFINITY);
        for axis in (0..3).filter(|&k| self.usable[k]) {
            let (mut first, mut last) = (aabb.min[axis], aabb.max[axis]);
            if self.greatest[axis] < 0.0 {
                (first, last) = (last, first);
            }
            let (first, last) = (first - self.origin[axis], last - self.origin[axis]);
            let (least, greatest) = (self.least[axis], self.greatest[axis]);
            near = slab::max(first * if first < 0.0 { greatest } else { least }, near);
            far = slab::min(last * if last < 0.0 { least } else { greatest } * Ray::WIDEN, far);
        }
        near > far
    }
}
