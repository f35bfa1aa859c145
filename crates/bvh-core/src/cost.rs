//! The surface area heuristic (SAH) as the cost of a whole tree.

use crate::Bvh;

/// Computes the SAH cost of a tree, the expected cost of a ray that hits the root's box (Goldsmith
/// and Salmon 1987):
///
/// ```text
/// ( COST_TRAVERSE  * sum over inner nodes of A(n)
/// + COST_INTERSECT * sum over leaves of A(l) * |l| ) / A(root)
/// ```
///
/// `A` is the half area in double precision, so the cost is finite for every tree. It is 0 if the
/// root has no area. O(n).
///
/// ```
/// use bvh_core::{Aabb, Bvh, Node, Vec3, sah_cost};
///
/// let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
/// let (l, r) = (Node::leaf(unit, 0, 1), Node::leaf(unit, 1, 1));
/// let bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![0, 1])?;
/// assert_eq!(sah_cost(&bvh), 1.0 + 1.0 + 1.0);
/// # Ok::<(), bvh_core::Malformed>(())
/// ```
#[must_use]
pub fn sah_cost(bvh: &Bvh) -> f64 {
    let mut sum = 0.0;
    bvh.visit(|_, node, _| sum += node.sah_term());
    let root = bvh.root().aabb().half_area_f64();
    if root > 0.0 { sum / root } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Aabb, Node, Vec3};

    #[test]
    fn cost_is_the_formula() {
        let left = Aabb::new(Vec3::ZERO, Vec3::ONE);
        let right = Aabb::new(Vec3::new(3.0, 0.0, 0.0), Vec3::new(4.0, 1.0, 1.0));
        let nodes = [
            Node::inner(left.union(right), 2),
            Node::NOTHING,
            Node::leaf(left, 0, 1),
            Node::leaf(right, 1, 2),
        ];
        let bvh = Bvh::new(&nodes, vec![0, 1, 2]).expect("valid");
        // Half areas: root 4 + 1 + 4 = 9, each leaf 3.
        assert_eq!(sah_cost(&bvh), (9.0 + 3.0 * 1.0 + 3.0 * 2.0) / 9.0);
        assert_eq!(sah_cost(&Bvh::default()), 0.0);
    }
}
