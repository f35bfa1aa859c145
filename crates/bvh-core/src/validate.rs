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
    /// A moving bit that is not that of the children together, or a leaf that stands still where all primitives move.
    #[error("node {node} says moving = {found}; its children, or the tree, say otherwise")]
    Moves {
        /// The node.
        node: usize,
        /// What it says.
        found: bool,
    },
}

impl Bvh {
    /// Checks everything a tree promises: a valid structure, every primitive in one leaf, every box *tight*
    /// (equal to the union of what is below it, not merely containing it), heights and moving bits right.
    ///
    /// O(n). Boxes of primitives come from `primitives` as they are now.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn validate<P: Primitives + ?Sized>(&self, primitives: &P) -> Result<(), Invalid> {
        if primitives.len() != self.len() {
            return Err(Invalid::Count { tree: self.len(), given: primitives.len() });
        }
        Self::new(self.nodes(), self.order().to_vec())?;
        let mut wrong = Ok(());
        self.visit(|n, node, _| {
            let (expected, height, moves) = match self.children(node) {
                None => {
                    let boxes = self.primitives(node).iter().map(|&p| primitives.aabb(p as usize));
                    let moves = node.moves() || self.all_move() && node.count() > 0;
                    (boxes.fold(Aabb::EMPTY, Aabb::union), 0, moves)
                }
                Some([l, r]) => {
                    (l.aabb().union(r.aabb()), 1 + l.height().max(r.height()), l.moves() || r.moves())
                }
            };
            let found = node.aabb();
            if wrong.is_err() {
            } else if found != expected {
                wrong = Err(Invalid::NotTight { node: n, found, expected });
            } else if node.height() != height {
                wrong = Err(Invalid::Height { node: n, found: node.height(), expected: height });
            } else if node.moves() != moves {
                wrong = Err(Invalid::Moves { node: n, found: node.moves() });
            }
        });
        wrong
    }
}
