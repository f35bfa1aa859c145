//! One ray at a time.

use bvh_core::{Bvh, MAX_HEIGHT, Ray, Triangles};

use crate::slab;
use crate::triangle::{Double, Hit, MollerTrumbore, Test, TriangleTest, Watertight, intersect};

/// What a walk through a tree did.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Work {
    /// Inner nodes whose children's boxes were tested.
    pub(crate) nodes: u64,
    /// Triangles tested.
    pub(crate) triangles: u64,
    /// Times that few rays were left of a packet and gathered.
    pub(crate) regrouped: u64,
}

/// Runs `$body` with the type `$test` standing for a [`TriangleTest`].
macro_rules! with_test {
    ($which:expr, $test:ident => $body:expr) => {
        match $which {
            TriangleTest::MollerTrumbore => {
                type $test = MollerTrumbore;
                $body
            }
            TriangleTest::Watertight => {
                type $test = Watertight;
                $body
            }
            TriangleTest::Double => {
                type $test = Double;
                $body
            }
        }
    };
}
pub(crate) use with_test;

/// The first triangle along a ray with `0 <= t <= t_max`; of equally near ones that with the lowest number.
///
/// `triangles` are the primitives of the tree, by its numbers; triangles that the tree has and `triangles` has
/// not are never hit. `t_max` may be infinite; if it is negative or NaN there is no hit. O(log n) for
/// scattered triangles.
#[must_use]
pub fn closest_hit(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
) -> Option<Hit> {
    with_test!(test, T => closest::<T>(bvh, triangles, ray, t_max, &mut Work::default()))
}

/// Whether any triangle lies along a ray with `0 <= t <= t_max`; otherwise as [`closest_hit`].
#[must_use]
pub fn any_hit(bvh: &Bvh, triangles: &Triangles<'_>, ray: &Ray, t_max: f32, test: TriangleTest) -> bool {
    with_test!(test, T => any::<T>(bvh, triangles, ray, t_max, &mut Work::default()).is_some())
}

/// As [`closest_hit`], by testing every triangle: the oracle for everything else. O(n).
#[must_use]
pub fn closest_hit_brute(
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
) -> Option<Hit> {
    let mut best = None::<Hit>;
    let n = triangles.indices.len() as u32;
    with_test!(test, T => {
        let test = T::new(ray);
        for p in (0..n).filter(|_| ray.is_valid()) {
            if let Some(hit) = intersect(ray, &test, &triangles.corners(p as usize), p, t_max)
                && best.is_none_or(|b| hit.before(b.t, b.primitive))
            {
                best = Some(hit);
            }
        }
    });
    best
}

/// As [`any_hit`], by testing every triangle. O(n).
#[must_use]
pub fn any_hit_brute(triangles: &Triangles<'_>, ray: &Ray, t_max: f32, test: TriangleTest) -> bool {
    closest_hit_brute(triangles, ray, t_max, test).is_some()
}

pub(crate) fn closest<T: Test>(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    work: &mut Work,
) -> Option<Hit> {
    let test = T::new(ray);
    let mut best = None::<Hit>;
    walk(bvh, triangles, ray, t_max, work, |p, t_max| {
        let hit = intersect(ray, &test, &triangles.corners(p), p as u32, t_max);
        if let Some(hit) = hit.filter(|h| best.is_none_or(|b| h.before(b.t, b.primitive))) {
            best = Some(hit);
            hit.t
        } else {
            t_max
        }
    });
    best
}

pub(crate) fn any<T: Test>(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    t_max: f32,
    work: &mut Work,
) -> Option<Hit> {
    let test = T::new(ray);
    let mut found = None;
    walk(bvh, triangles, ray, t_max, work, |p, t_max| {
        found = intersect(ray, &test, &triangles.corners(p), p as u32, t_max);
        if found.is_some() { -1.0 } else { t_max }
    });
    found
}

/// Calls `visit` with the number of every triangle in a leaf that the ray enters before `t_max`, nearest first
/// as far as boxes tell, until that is negative. `visit` gets the present `t_max` and returns the new one.
fn walk(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    ray: &Ray,
    mut t_max: f32,
    work: &mut Work,
    mut visit: impl FnMut(usize, f32) -> f32,
) {
    let nodes = bvh.nodes();
    let mut stack = [(0.0, 0u32); MAX_HEIGHT as usize + 1];
    let mut top = 0;
    if ray.is_valid() && slab::enters(ray, &bvh.root().aabb(), t_max).is_some() {
        top = 1;
    }
    while top > 0 {
        top -= 1;
        let (near, n) = stack[top];
        if near > t_max {
            continue;
        }
        let mut node = &nodes[n as usize];
        while !node.is_leaf() {
            work.nodes += 1;
            let first = node.first();
            let [l, r] = [&nodes[first], &nodes[first + 1]];
            match (slab::enters(ray, &l.aabb(), t_max), slab::enters(ray, &r.aabb(), t_max)) {
                (Some(tl), Some(tr)) if tr < tl => {
                    stack[top] = (tl, first as u32);
                    top += 1;
                    node = r;
                }
                (Some(_), Some(tr)) => {
                    stack[top] = (tr, first as u32 + 1);
                    top += 1;
                    node = l;
                }
                (Some(_), None) => node = l,
                (None, Some(_)) => node = r,
                (None, None) => break,
            }
        }
        for &p in bvh.primitives(node) {
            if (p as usize) < triangles.indices.len() {
                work.triangles += 1;
                t_max = visit(p as usize, t_max);
                if t_max < 0.0 {
                    return;
                }
            }
        }
    }
}
