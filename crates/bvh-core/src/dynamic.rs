//! Which primitives may move: marks in the tree that updates go by, and the cost of all that stands
//! still.

use std::ops::Range;

use crate::{Bvh, OnPanic};

impl Bvh {
    /// Sets which primitives are dynamic, that is, may move. At first all are.
    ///
    /// Updates do not visit static subtrees, and their boxes stay as they are. Mark what you add,
    /// remove or move elsewhere as dynamic for the next update, or queries find it where it was.
    /// But a rotation may exchange a child of a static subtree's root for another node: the root's
    /// box then changes, and it becomes dynamic if the new child is. A leaf is dynamic if any
    /// primitive in it is. The setting survives the rebuilds of an `Updater` at leaf granularity: a
    /// primitive that shares a leaf with a dynamic one counts as dynamic in the next tree. If
    /// `is_dynamic` panics, all primitives are dynamic. O(n), no allocation.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let (l, r) = (Node::leaf(unit, 0, 1), Node::leaf(unit, 1, 1));
    /// let mut bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![0, 1])?;
    /// let mask = [false, true];
    /// bvh.set_dynamic(|p| mask[p]);
    /// assert!(!bvh.nodes()[2].is_dynamic() && bvh.nodes()[3].is_dynamic());
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn set_dynamic(&mut self, is_dynamic: impl Fn(usize) -> bool) {
        let dynamic = &mut self.update_state.changes.dynamic;
        *dynamic = dynamic.wrapping_add(1);
        let guard = OnPanic(self, |bvh| bvh.mark_dynamic(&|_| true));
        guard.0.mark_dynamic(&is_dynamic);
        std::mem::forget(guard);
    }

    /// Makes the primitives in any of `ranges` dynamic and all others static; see
    /// [`set_dynamic`](Self::set_dynamic). Ranges may overlap and exceed the number of primitives.
    /// O(n log r) for r ranges.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Node, Vec3};
    ///
    /// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    /// let mut bvh = Bvh::new(&[Node::leaf(unit, 0, 1), Node::NOTHING], vec![0])?;
    /// bvh.set_dynamic_ranges(&[3..7]);
    /// assert!(!bvh.root().is_dynamic());
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn set_dynamic_ranges(&mut self, ranges: &[Range<usize>]) {
        let mut sorted: Vec<_> = ranges.iter().map(|r| (r.start, r.end)).collect();
        sorted.sort_unstable();
        // From here on each end is the greatest of all ranges up to there.
        let mut end = 0;
        for range in &mut sorted {
            end = end.max(range.1);
            range.1 = end;
        }
        self.set_dynamic(|p| {
            let begun = sorted.partition_point(|&(start, _)| start <= p);
            begun > 0 && p < sorted[begun - 1].1
        });
    }

    fn mark_dynamic(&mut self, is_dynamic: &impl Fn(usize) -> bool) {
        (self.all_dynamic, self.static_area) = (true, 0.0);
        self.mark(0, is_dynamic);
    }

    /// Sets the dynamic bits at and below node `n`, and adds up the static nodes there; gives that
    /// of `n`. As deep as the tree is high.
    fn mark(&mut self, n: usize, is_dynamic: &impl Fn(usize) -> bool) -> bool {
        let node = self.nodes()[n];
        let first = node.first();
        let dynamic = if node.is_leaf() {
            self.primitives(&node).iter().any(|&p| is_dynamic(p as usize))
        } else {
            // Both, whatever the first one gives.
            self.mark(first, is_dynamic) | self.mark(first + 1, is_dynamic)
        };
        self.raw_nodes_mut()[n].set_dynamic(dynamic);
        if !dynamic {
            self.all_dynamic &= node.count() == 0;
            self.static_area += node.sah_term();
        }
        dynamic
    }

    /// Returns whether every primitive is dynamic. That is so until
    /// [`set_dynamic`](Self::set_dynamic) makes some static.
    #[must_use]
    #[inline]
    pub fn all_dynamic(&self) -> bool {
        self.all_dynamic
    }

    /// Notes in `dynamic` which primitives are dynamic, at leaf granularity, and returns true;
    /// returns false at once if all are. O(n).
    #[doc(hidden)]
    pub fn note_dynamic(&self, dynamic: &mut Vec<bool>) -> bool {
        if self.all_dynamic {
            return false;
        }
        dynamic.clear();
        dynamic.resize(self.len(), false);
        for node in self.nodes().iter().filter(|node| node.count() > 0 && node.is_dynamic()) {
            self.primitives(node).iter().for_each(|&p| dynamic[p as usize] = true);
        }
        true
    }

    /// Returns the sum of [`Node::sah_term`] over all static nodes: their part of the SAH cost.
    #[doc(hidden)]
    #[must_use]
    pub fn static_area(&self) -> f64 {
        self.static_area
    }

    /// Recomputes [`static_area`](Self::static_area). O(n) if there are static primitives, else
    /// O(1).
    #[doc(hidden)]
    pub fn sum_static_area(&mut self) {
        let mut sum = 0.0;
        if !self.all_dynamic {
            self.visit(|_, node, _| sum += node.static_term());
        }
        self.static_area = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::{BOX, three};
    use crate::{Invalid, Node};

    #[test]
    fn all_dynamic_follows_the_leaves() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.all_dynamic() && Bvh::default().all_dynamic());
        for fixed in 0..3 {
            bvh.set_dynamic(|p| p != fixed);
            let again = Bvh::new(bvh.nodes(), bvh.order().to_vec()).expect("valid");
            assert!(!bvh.all_dynamic() && !again.all_dynamic());
        }
        let boxes = [BOX; 3].as_slice();
        bvh.all_dynamic = true;
        assert!(matches!(bvh.validate(&boxes), Err(Invalid::Dynamic { .. })));
        bvh.set_dynamic(|_| true);
        assert!(bvh.all_dynamic() && bvh.validate(&boxes).is_ok());
    }

    #[test]
    fn dynamic_bits_follow_the_primitives() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        assert!(bvh.root().is_dynamic());
        bvh.set_dynamic(|p| p == 1);
        let is_dynamic = |n: usize| bvh.nodes()[n].is_dynamic();
        assert!(is_dynamic(0) && !is_dynamic(2) && is_dynamic(3) && !is_dynamic(4) && !is_dynamic(5));
        bvh.set_dynamic(|_| false);
        assert!(!bvh.root().is_dynamic());
    }

    #[test]
    fn ranges_set_what_a_predicate_would() {
        let nodes: Vec<_> = (0..16).map(|i| Node::leaf(BOX, i, 1)).collect();
        let mut all = vec![Node::inner(BOX, 2), Node::NOTHING];
        (0..15).for_each(|i| {
            all.push(nodes[i as usize]);
            all.push(if i < 14 { Node::inner(BOX, 2 * i + 4) } else { nodes[15] });
        });
        let mut bvh = Bvh::new(&all, (0..16).collect()).expect("valid");
        for ranges in [vec![], vec![3..5, 0..1], vec![9..12, 2..11, 4..5, 15..99], vec![7..7, 12..20]] {
            bvh.set_dynamic(|p| ranges.iter().any(|r| r.contains(&p)));
            let (expected, area) = (bvh.fingerprint(), bvh.static_area());
            bvh.set_dynamic(|_| true);
            bvh.set_dynamic_ranges(&ranges);
            assert_eq!((bvh.fingerprint(), bvh.static_area()), (expected, area), "{ranges:?}");
        }
    }

    #[test]
    fn a_panic_in_a_predicate_makes_all_dynamic() {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
        bvh.set_dynamic(|_| false);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            bvh.set_dynamic(|p| p == 0 && panic!("half way"));
        }));
        assert!(caught.is_err() && bvh.all_dynamic() && bvh.static_area() == 0.0);
        bvh.validate(&[BOX; 3]).expect("valid");
    }
}
