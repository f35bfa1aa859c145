//! Checks that the boxes of a tree fit its primitives exactly.

use thiserror::Error;

use crate::{Aabb, Bvh, Malformed, Primitives};

/// What is wrong with a tree.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Invalid {
    /// The structure is broken.
    #[error(transparent)]
    Structure(#[from] Malformed),
    /// The tree is over another number of primitives.
    #[error("the tree holds {tree} primitives, but {given} were given")]
    Count {
        /// Primitives of the tree.
        tree: usize,
        /// Primitives given.
        given: usize,
    },
    /// A box that is not the smallest one around what is below it.
    #[error("node {node} has the box {found:?}; its primitives need {expected:?}")]
    NotTight {
        /// The node.
        node: usize,
        /// Its box.
        found: Aabb,
        /// The smallest box around its children or primitives.
        expected: Aabb,
    },
    /// A height that is not 1 + the greater of the children's, or not 0 in a leaf.
    #[error("node {node} says its height is {found}; it is {expected}")]
    Height {
        /// The node.
        node: usize,
        /// What it says.
        found: u32,
        /// What it is.
        expected: u32,
    },
    /// A dynamic bit that is not the union of the children's, or a static leaf in a tree of dynamic
    /// primitives only.
    #[error("node {node} says dynamic = {found}; its children, or the tree, say otherwise")]
    Dynamic {
        /// The node.
        node: usize,
        /// What it says.
        found: bool,
    },
    /// A node that is not in use and is no leaf, or has primitives.
    #[error("node {0} is not in use, but no empty leaf")]
    Unused(usize),
}

impl Bvh {
    /// Checks everything a tree promises: a valid structure, every primitive in one leaf, every box
    /// *tight* (equal to the union of the boxes below it), heights and dynamic bits right, and
    /// nothing in nodes that are not in use.
    ///
    /// Boxes of primitives come from `primitives` as they are now. O(n).
    ///
    /// # Errors
    /// The first fault found.
    ///
    /// ```
    /// use bvh_core::{Aabb, Bvh, Invalid, Node, Vec3};
    ///
    /// let mut boxes = [Aabb::new(Vec3::ZERO, Vec3::ONE)];
    /// let bvh = Bvh::new(&[Node::leaf(boxes[0], 0, 1), Node::NOTHING], vec![0])?;
    /// assert_eq!(bvh.validate(&boxes), Ok(()));
    /// boxes[0] = boxes[0].grown(1.0);
    /// assert!(matches!(bvh.validate(&boxes), Err(Invalid::NotTight { node: 0, .. })));
    /// # Ok::<(), bvh_core::Malformed>(())
    /// ```
    pub fn validate<P: Primitives + ?Sized>(&self, primitives: &P) -> Result<(), Invalid> {
        if primitives.len() != self.len() {
            return Err(Invalid::Count { tree: self.len(), given: primitives.len() });
        }
        self.check_order()?;
        let (_, used) = self.check_structure()?;
        for (n, node) in self.nodes().iter().enumerate() {
            if n == 1 || n > 1 && !used[n / 2] {
                if !node.is_leaf() || node.count() > 0 {
                    return Err(Invalid::Unused(n));
                }
                continue;
            }
            let (expected, height, dynamic) = match self.children(node) {
                None => {
                    let boxes = self.primitives(node).iter().map(|&p| primitives.aabb(p as usize));
                    let dynamic = node.is_dynamic() || self.all_dynamic() && node.count() > 0;
                    (boxes.fold(Aabb::EMPTY, Aabb::union), 0, dynamic)
                }
                Some([l, r]) => (
                    l.aabb().union(r.aabb()),
                    1 + l.height().max(r.height()),
                    l.is_dynamic() || r.is_dynamic(),
                ),
            };
            let found = node.aabb();
            if found != expected {
                return Err(Invalid::NotTight { node: n, found, expected });
            } else if node.height() != height {
                return Err(Invalid::Height { node: n, found: node.height(), expected: height });
            } else if node.is_dynamic() != dynamic {
                return Err(Invalid::Dynamic { node: n, found: node.is_dynamic() });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::{BOX, three};
    use crate::{Node, Vec3};

    fn broken(break_it: impl Fn(&mut Bvh)) -> Invalid {
        let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("a tree");
        assert_eq!(bvh.validate(&[BOX; 3]), Ok(()));
        break_it(&mut bvh);
        bvh.validate(&[BOX; 3]).expect_err("broken")
    }

    /// A box one step of `f32` too small is found at its node, a larger one at the parent, which
    /// does not hold it.
    #[test]
    fn a_box_that_is_off_by_one_bit_is_found() {
        for (n, parent) in [(0, 0), (2, 0), (3, 0), (4, 2), (5, 2)] {
            for axis in 0..3 {
                let fault = |min: fn(f32) -> f32, max: fn(f32) -> f32| {
                    let mut found = BOX;
                    (found.min[axis], found.max[axis]) = (min(found.min[axis]), max(found.max[axis]));
                    match broken(|bvh| bvh.raw_nodes_mut()[n].set_aabb(found)) {
                        Invalid::NotTight { node, .. } => node,
                        fault => panic!("{fault}"),
                    }
                };
                let same = |x: f32| x;
                assert_eq!([fault(f32::next_up, same), fault(same, f32::next_down)], [n; 2]);
                assert_eq!([fault(f32::next_down, same), fault(same, f32::next_up)], [parent; 2]);
            }
        }
    }

    #[test]
    fn a_wrong_height_is_found() {
        // The height is the low byte of the last word.
        let fault = |n: usize, was: u32, is: u32| {
            broken(|bvh| bytemuck::cast_mut::<Node, [u32; 8]>(&mut bvh.raw_nodes_mut()[n])[7] ^= was ^ is)
        };
        let height = |node, found, expected| Invalid::Height { node, found, expected };
        assert_eq!([fault(0, 2, 1), fault(0, 2, 3)], [height(0, 1, 2), height(0, 3, 2)]);
        assert_eq!([fault(2, 1, 0), fault(2, 1, 2)], [height(0, 2, 1), height(0, 2, 3)]);
        assert_eq!(fault(3, 0, 1), height(3, 1, 0));
    }

    #[test]
    fn an_inner_node_over_dynamic_leaves_that_says_it_is_static_is_found() {
        for n in [0, 2] {
            let fault = broken(|bvh| bvh.raw_nodes_mut()[n].set_dynamic(false));
            assert_eq!(fault, Invalid::Dynamic { node: n, found: false });
        }
    }

    #[test]
    fn a_broken_structure_and_another_number_of_primitives_are_found() {
        assert_eq!(broken(|bvh| bvh.order[2] = 2), Malformed::Order(2).into());
        assert_eq!(
            broken(|bvh| bvh.raw_nodes_mut()[2] = Node::inner(BOX, 2)),
            Malformed::SharedChild(2).into()
        );
        let bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("a tree");
        assert_eq!(bvh.validate(&[BOX; 2]), Err(Invalid::Count { tree: 3, given: 2 }));
    }

    #[test]
    fn nodes_that_are_not_in_use_are_empty_leaves() {
        let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
        let (l, r) = (Node::leaf(unit, 0, 1), Node::leaf(unit, 1, 1));
        let nodes = [Node::parent(&l, &r, 2), l, l, r, l, Node::parent(&l, &r, 2)];
        let bvh = Bvh::new(&nodes, vec![0, 1]).expect("a tree");
        assert_eq!(bvh.validate(&[unit; 2]), Ok(()), "what is not in use is emptied");
        for (n, node) in [(1, l), (4, r), (5, Node::parent(&l, &r, 2))] {
            let mut broken = bvh.clone();
            broken.raw_nodes_mut()[n] = node;
            assert_eq!(broken.validate(&[unit; 2]), Err(Invalid::Unused(n)));
        }
    }
}
