//! A contestant's own copy of the triangles.

use bvh_core::{Aabb, Primitives, Triangles, Vec3};
use rayon::prelude::*;
use rt_cpu::Hit;

/// Triangles that share vertices, owned.
#[derive(Clone)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) indices: Vec<[u32; 3]>,
}

impl Mesh {
    pub(crate) fn new(triangles: &Triangles<'_>) -> Self {
        Self { positions: triangles.positions.to_vec(), indices: triangles.indices.to_vec() }
    }

    pub(crate) fn pose(&mut self, positions: &[Vec3]) {
        self.positions.copy_from_slice(positions);
    }

    pub(crate) fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.indices }
    }

    /// Fills `boxes` with what `make` makes of each triangle's box and number.
    pub(crate) fn boxes_into<T: Send>(&self, boxes: &mut Vec<T>, make: impl Fn(Aabb, u32) -> T + Sync) {
        let count = self.indices.len();
        // Rayon counts what it collects, which a rival on one thread should not pay for.
        if rayon::current_num_threads() == 1 {
            boxes.clear();
            boxes.extend((0..count).map(|i| make(self.aabb(i), i as u32)));
        } else {
            let all = (0..count).into_par_iter().with_min_len(4096);
            all.map(|i| make(self.aabb(i), i as u32)).collect_into_vec(boxes);
        }
    }

    /// Box of a triangle as users of these libraries would make it at best: with SIMD, and without
    /// a look at what is not finite.
    #[inline(always)]
    pub(crate) fn aabb(&self, i: usize) -> Aabb {
        let [min, max, _] = self.triangles().aabb_lanes(i);
        Aabb::new(min.truncate(), max.truncate())
    }
}

/// A ray against a triangle (Möller and Trumbore 1997), two-sided, for libraries that leave the
/// test to their users. `t` from 0 to `t_max`, both included.
#[inline]
pub(crate) fn intersect(
    [a, b, c]: [Vec3; 3],
    origin: Vec3,
    direction: Vec3,
    t_max: f32,
    primitive: u32,
) -> Option<Hit> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let scale = 1.0 / ab.dot(p);
    let from_a = origin - a;
    let u = from_a.dot(p) * scale;
    let q = from_a.cross(ab);
    let v = direction.dot(q) * scale;
    let t = ac.dot(q) * scale;
    // All comparisons are false for the NaN that a triangle without area gives.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0 && t <= t_max).then_some(Hit { t, u, v, primitive })
}
