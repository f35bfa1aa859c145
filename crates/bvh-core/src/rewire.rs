//! Exchanges the inner nodes of a part of a tree for others, over the same subtrees: what every
//! method that restructures a tree comes down to, in safe code.

use thiserror::Error;

use crate::{Bvh, MAX_HEIGHT, Node};

/// A node of the new part of a tree, for [`Bvh::rewire`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// The subtree in this node slot, as it is.
    Kept(usize),
    /// An inner node over two earlier branches of the list.
    Inner(usize, usize),
}

/// Why a part of a tree was not rewired. The tree is as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NotRewired {
    /// The path does not lead from the root downwards.
    #[error("step {0} of the path is not a child of the step before")]
    Path(usize),
    /// A branch that is not used exactly once, or that uses a later one.
    #[error("branch {0} is not used exactly once by a later branch")]
    Shape(usize),
    /// The kept subtrees are not those below the node at the end of the path.
    #[error("the kept subtrees are not what lies below node {0}")]
    Kept(usize),
    /// The tree would be too high.
    #[error("the tree would be {0} high; at most {MAX_HEIGHT} is allowed")]
    TooHigh(u32),
}

impl Bvh {
    /// Exchanges the inner nodes between the node at the end of `path` and the kept subtrees for
    /// those of `shape`; gives the slot of each branch.
    ///
    /// `path` lists node slots from the root, 0, to the root of the part. `shape` lists branches,
    /// each behind those it is made of, the root of the part last. The kept subtrees have to be all
    /// that lies below that root, each once. Boxes of new nodes are the unions of the boxes below
    /// them, and the same pairs of node slots are used. New nodes have the reference 0
    /// ([`Node::reference`]). O(k log k) for k branches.
    ///
    /// # Errors
    /// If path, shape or kept subtrees do not fit the tree, or if it would become too high. The
    /// tree is then as it was.
    ///
    /// ```
    /// use bvh_core::{Aabb, Branch, Bvh, Node, Vec3};
    ///
    /// let leaf = |x: f32, slot| Node::leaf(Aabb::new(Vec3::X * x, Vec3::X * x + 1.0), slot, 1);
    /// let (a, b, c) = (leaf(0.0, 0), leaf(9.0, 1), leaf(1.0, 2));
    /// let ab = Node::parent(&a, &b, 4);
    /// let mut bvh = Bvh::new(&[Node::parent(&ab, &c, 2), Node::NOTHING, ab, c, a, b], vec![0, 1, 2])?;
    /// // ((a, b), c) becomes ((a, c), b).
    /// let [a, b, c] = [4, 5, 3].map(Branch::Kept);
    /// bvh.rewire(&[0], &[a, c, Branch::Inner(0, 1), b, Branch::Inner(2, 3)])?;
    /// assert_eq!(bvh.nodes()[2].aabb().max.x, 2.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn rewire(&mut self, path: &[usize], shape: &[Branch]) -> Result<Vec<usize>, NotRewired> {
        let root = self.end_of(path)?;
        check_shape(shape)?;
        let mut pairs = self.pairs_above(root, shape)?;
        // Parents in front of their children, as builders number pairs.
        pairs.sort_unstable();
        let inner = |branch: &Branch| if let Branch::Inner(l, r) = *branch { Some([l, r]) } else { None };
        let mut slots = vec![root; shape.len()];
        for ([l, r], pair) in shape.iter().rev().filter_map(inner).zip(pairs) {
            (slots[l], slots[r]) = (pair, pair + 1);
        }
        let mut new: Vec<Node> = Vec::with_capacity(shape.len());
        for &branch in shape {
            let node = match branch {
                Branch::Kept(n) => self.nodes()[n],
                Branch::Inner(l, r) => Node::parent(&new[l], &new[r], slots[l] as u32),
            };
            // Deeper down a height would not fit a node.
            ensure_low(node.height())?;
            new.push(node);
        }
        let mut height = new[shape.len() - 1].height();
        for &n in path.iter().skip(1).rev() {
            height = 1 + height.max(self.nodes()[n ^ 1].height());
            ensure_low(height)?;
        }
        self.exchange(path, &slots, &new);
        Ok(slots)
    }

    /// Returns the last step of a path from the root.
    ///
    /// # Errors
    /// If the path does not lead from the root downwards.
    #[doc(hidden)]
    pub fn end_of(&self, path: &[usize]) -> Result<usize, NotRewired> {
        let (Some(&0), Some(&root)) = (path.first(), path.last()) else { return Err(NotRewired::Path(0)) };
        for (step, to) in path.windows(2).enumerate() {
            let from = &self.nodes()[to[0]];
            if from.is_leaf() || from.first() != to[1] & !1 {
                return Err(NotRewired::Path(step + 1));
            }
        }
        Ok(root)
    }

    /// The pairs of the inner nodes between `root` and the kept subtrees.
    fn pairs_above(&self, root: usize, shape: &[Branch]) -> Result<Vec<usize>, NotRewired> {
        let slot = |branch: &Branch| if let Branch::Kept(n) = *branch { Some(n) } else { None };
        let mut kept: Vec<usize> = shape.iter().filter_map(slot).collect();
        kept.sort_unstable();
        let (mut pairs, mut found, mut todo) = (Vec::new(), 0, vec![root]);
        while let Some(n) = todo.pop() {
            let node = &self.nodes()[n];
            if kept.binary_search(&n).is_ok() {
                found += 1;
            } else if node.is_leaf() || pairs.len() >= kept.len() {
                return Err(NotRewired::Kept(root));
            } else {
                pairs.push(node.first());
                todo.extend([node.first(), node.first() + 1]);
            }
        }
        if found == kept.len() && pairs.len() + 1 == found { Ok(pairs) } else { Err(NotRewired::Kept(root)) }
    }

    /// Writes what has been checked: each of the old nodes is replaced by one of the `new` ones.
    fn exchange(&mut self, path: &[usize], slots: &[usize], new: &[Node]) {
        let mut static_change = 0.0;
        for (&slot, node) in slots.iter().zip(new) {
            let old = std::mem::replace(&mut self.raw_nodes_mut()[slot], *node);
            static_change += node.static_term() - old.static_term();
        }
        for &n in path.iter().rev().skip(1) {
            let pair = self.nodes()[n].first();
            let [l, r] = [self.nodes()[pair], self.nodes()[pair + 1]];
            self.raw_nodes_mut()[n].refit_metadata(&l, &r);
        }
        if !self.all_dynamic {
            self.static_area += static_change;
        }
        if new.len() > 1 {
            let structure = &mut self.update_state.changes.structure;
            *structure = structure.wrapping_add(1);
        }
    }
}

/// Whether each branch but the last is used by one later branch.
fn check_shape(shape: &[Branch]) -> Result<(), NotRewired> {
    let mut used = vec![false; shape.len()];
    for (i, &branch) in shape.iter().enumerate() {
        let Branch::Inner(l, r) = branch else { continue };
        for child in [l, r] {
            if child >= i || std::mem::replace(&mut used[child], true) {
                return Err(NotRewired::Shape(child));
            }
        }
    }
    let unused = used.iter().position(|used| !used).unwrap_or(0);
    if unused + 1 == shape.len() { Ok(()) } else { Err(NotRewired::Shape(unused)) }
}

fn ensure_low(height: u32) -> Result<(), NotRewired> {
    if height <= MAX_HEIGHT { Ok(()) } else { Err(NotRewired::TooHigh(height)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Aabb, Vec3};
    use Branch::{Inner, Kept};

    fn boxes(n: usize) -> Vec<Aabb> {
        (0..n).map(|i| Vec3::splat(i as f32)).map(|p| Aabb::new(p, p + 1.0)).collect()
    }

    /// ((0, 1), (2, 3)), in slots 4, 5, 6, 7.
    fn four() -> Bvh {
        let boxes = boxes(4);
        let leaf = |i: usize| Node::leaf(boxes[i], i as u32, 1);
        let (l, r) = (Node::parent(&leaf(0), &leaf(1), 4), Node::parent(&leaf(2), &leaf(3), 6));
        let nodes = [Node::parent(&l, &r, 2), Node::NOTHING, l, r, leaf(0), leaf(1), leaf(2), leaf(3)];
        Bvh::new(&nodes, vec![0, 1, 2, 3]).expect("a tree")
    }

    #[test]
    fn a_part_takes_its_new_shape() {
        let mut bvh = four();
        bvh.set_dynamic(|p| p == 3);
        let changes = bvh.update_state().changes.structure;
        // (((0, 2), 1), 3)
        let shape = [Kept(4), Kept(6), Inner(0, 1), Kept(5), Inner(2, 3), Kept(7), Inner(4, 5)];
        let slots = bvh.rewire(&[0], &shape).expect("fits");
        assert_eq!((slots[6], bvh.height()), (0, 3));
        assert_eq!(bvh.nodes()[slots[2]].aabb().max, Vec3::splat(3.0));
        assert_ne!(bvh.update_state().changes.structure, changes);
        bvh.validate(&boxes(4)).expect("valid");
        let sum = bvh.static_area();
        bvh.sum_static_area();
        assert!((sum - bvh.static_area()).abs() < 1e-9);
    }

    #[test]
    fn nodes_outside_of_the_part_stay_as_they_are() {
        let mut bvh = four();
        let before = bvh.nodes().to_vec();
        bvh.rewire(&[0, 3], &[Kept(7), Kept(6), Inner(0, 1)]).expect("fits");
        assert_eq!([bvh.nodes()[6], bvh.nodes()[7]], [before[7], before[6]]);
        assert_eq!(bvh.nodes()[..6], before[..6]);
        bvh.validate(&boxes(4)).expect("valid");
    }

    #[test]
    fn what_does_not_fit_changes_nothing() {
        let mut bvh = four();
        let before = bvh.fingerprint();
        let whole = [Kept(2), Kept(3), Inner(0, 1)];
        for (path, shape, error) in [
            (&[][..], &whole[..], NotRewired::Path(0)),
            (&[3], &whole, NotRewired::Path(0)),
            (&[0, 6], &whole, NotRewired::Path(1)),
            (&[0, 2, 4, 6], &whole, NotRewired::Path(3)),
            (&[0], &[], NotRewired::Shape(0)),
            (&[0], &[Kept(2), Kept(3), Inner(0, 0)], NotRewired::Shape(0)),
            (&[0], &[Kept(2), Inner(0, 2), Kept(3)], NotRewired::Shape(2)),
            (&[0], &[Kept(2), Kept(3)], NotRewired::Shape(0)),
            (&[0], &[Kept(2), Kept(6), Inner(0, 1)], NotRewired::Kept(0)),
            (&[0], &[Kept(2), Kept(2), Inner(0, 1)], NotRewired::Kept(0)),
            (&[0], &[Kept(2), Kept(99), Inner(0, 1)], NotRewired::Kept(0)),
            (&[0, 2], &whole, NotRewired::Kept(2)),
            (&[0, 2], &[Kept(4)], NotRewired::Kept(2)),
        ] {
            assert_eq!(bvh.rewire(path, shape), Err(error), "{path:?} {shape:?}");
            assert_eq!(bvh.fingerprint(), before);
        }
    }

    #[test]
    fn no_tree_becomes_too_high() {
        let n = MAX_HEIGHT as usize + 2;
        let boxes = boxes(n);
        // A balanced tree: pair k holds the nodes 2k and 2k + 1 of a heap.
        let mut nodes = vec![Node::NOTHING; 2];
        let mut order = Vec::new();
        fn fill(
            nodes: &mut Vec<Node>,
            order: &mut Vec<u32>,
            boxes: &[Aabb],
            range: std::ops::Range<usize>,
        ) -> Node {
            if range.len() == 1 {
                order.push(range.start as u32);
                return Node::leaf(boxes[range.start], order.len() as u32 - 1, 1);
            }
            let (pair, middle) = (nodes.len(), range.start + range.len() / 2);
            nodes.extend([Node::NOTHING; 2]);
            nodes[pair] = fill(nodes, order, boxes, range.start..middle);
            nodes[pair + 1] = fill(nodes, order, boxes, middle..range.end);
            Node::parent(&nodes[pair], &nodes[pair + 1], pair as u32)
        }
        nodes[0] = fill(&mut nodes, &mut order, &boxes, 0..n);
        let mut bvh = Bvh::new(&nodes, order).expect("a tree");
        let before = bvh.fingerprint();
        let leaves = (2..bvh.nodes().len()).filter(|&n| bvh.nodes()[n].is_leaf());
        let mut chain: Vec<Branch> = Vec::new();
        for leaf in leaves {
            chain.push(Kept(leaf));
            if chain.len() > 1 {
                chain.push(Inner(chain.len() - 2, chain.len() - 1));
            }
        }
        assert_eq!(bvh.rewire(&[0], &chain), Err(NotRewired::TooHigh(MAX_HEIGHT + 1)));
        assert_eq!(bvh.fingerprint(), before);
    }
}
