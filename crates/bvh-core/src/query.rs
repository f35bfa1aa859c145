//! Queries through closures: boxes that overlap, rays, pairs.

use crate::{Aabb, Bvh, MAX_HEIGHT, Node, Ray};

/// Enough for a walk that keeps one node a level.
type Stack = [u32; MAX_HEIGHT as usize + 1];

impl Bvh {
    /// Calls `found` with the number of every primitive in a leaf whose box overlaps `query` (touching counts).
    ///
    /// With one primitive a leaf these are the primitives whose boxes overlap; larger leaves may bring
    /// neighbours along. Each primitive is reported once, in no particular order. A query that is empty or has a NaN
    /// finds nothing. O(log n + found) for scattered primitives; O(n) at worst.
    pub fn overlaps(&self, query: &Aabb, mut found: impl FnMut(usize)) {
        let nodes = self.nodes();
        let mut stack: Stack = [0; MAX_HEIGHT as usize + 1];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &nodes[stack[top] as usize];
            if !node.aabb().overlaps(query) {
                continue;
            }
            if node.is_leaf() {
                self.primitives(node).iter().for_each(|&p| found(p as usize));
            } else {
                stack[top] = node.first() as u32 + 1;
                stack[top + 1] = node.first() as u32;
                top += 2;
            }
        }
    }

    /// Calls `found` once with every pair of different primitives that lie in one leaf or in two whose boxes
    /// overlap: the broad phase of a collision loop.
    ///
    /// O(n + pairs) for scattered primitives. Pairs come in no particular order, nor do the two of a pair. A dropped
    /// primitive is in pairs with those of its own leaf only.
    pub fn overlapping_pairs(&self, mut found: impl FnMut(usize, usize)) {
        let nodes = self.nodes();
        // A pair of equal numbers stands for "within this subtree".
        let mut todo = vec![(0, 0)];
        while let Some((a, b)) = todo.pop() {
            let (na, nb): (&Node, &Node) = (&nodes[a], &nodes[b]);
            if a == b {
                if na.is_leaf() {
                    let p = self.primitives(na);
                    for (i, &x) in p.iter().enumerate() {
                        p[i + 1..].iter().for_each(|&y| found(x as usize, y as usize));
                    }
                } else {
                    let (l, r) = (na.first(), na.first() + 1);
                    todo.extend([(l, l), (r, r), (l, r)]);
                }
            } else if na.aabb().overlaps(&nb.aabb()) {
                match (na.is_leaf(), nb.is_leaf()) {
                    (true, true) => {
                        for &x in self.primitives(na) {
                            self.primitives(nb).iter().for_each(|&y| found(x as usize, y as usize));
                        }
                    }
                    // Open the larger, so that the boxes compared stay alike in size.
                    (false, leaf) if leaf || na.aabb().half_area() >= nb.aabb().half_area() => {
                        todo.extend([(na.first(), b), (na.first() + 1, b)]);
                    }
                    _ => todo.extend([(a, nb.first()), (a, nb.first() + 1)]),
                }
            }
        }
    }

    /// Casts a ray: calls `test` with the number of each primitive in a leaf that the ray enters before
    /// `t_max`, nearest leaves first as far as boxes tell.
    ///
    /// `test` gets the present `t_max` and returns the new one: smaller after a hit (for the closest hit), negative or NaN to
    /// end the walk there (for any hit), unchanged otherwise. Returns the last `t_max`. An invalid ray, or a `t_max` that is
    /// negative or NaN, meets nothing. Rounding keeps no leaf from being tested, not even one at `t_max`
    /// ([`Ray::WIDEN`]), so a few may be that lie just behind it.
    ///
    /// O(log n) for a ray that meets little; O(n) at worst.
    pub fn cast_ray(&self, ray: &Ray, mut t_max: f32, mut test: impl FnMut(usize, f32) -> f32) -> f32 {
        let nodes = self.nodes();
        let mut stack: [(f32, u32); MAX_HEIGHT as usize + 1] = [(0.0, 0); MAX_HEIGHT as usize + 1];
        let mut top = 0;
        let Some(mut t) = ray.enters(&self.root().aabb(), t_max) else {
            return t_max;
        };
        let mut n = 0;
        loop {
            let node = &nodes[n];
            if t > t_max * Ray::WIDEN {
                // A nearer hit was found since.
            } else if node.is_leaf() {
                for &p in self.primitives(node) {
                    t_max = test(p as usize, t_max);
                    if t_max < 0.0 || t_max.is_nan() {
                        return t_max;
                    }
                }
            } else {
                let first = node.first();
                let l = ray.enters(&nodes[first].aabb(), t_max);
                let r = ray.enters(&nodes[first + 1].aabb(), t_max);
                match (l, r) {
                    (Some(tl), Some(tr)) => {
                        let right_first = tr < tl;
                        let (near, far) = if right_first { (tr, tl) } else { (tl, tr) };
                        stack[top] = (far, (first + usize::from(!right_first)) as u32);
                        top += 1;
                        (n, t) = (first + usize::from(right_first), near);
                        continue;
                    }
                    (Some(tl), None) => {
                        (n, t) = (first, tl);
                        continue;
                    }
                    (None, Some(tr)) => {
                        (n, t) = (first + 1, tr);
                        continue;
                    }
                    (None, None) => {}
                }
            }
            if top == 0 {
                return t_max;
            }
            top -= 1;
            (t, n) = (stack[top].0, stack[top].1 as usize);
        }
    }
}
