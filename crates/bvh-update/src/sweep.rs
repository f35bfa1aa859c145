//! Refitting a tree that lies in depth-first order: a sweep through the arena from its end.
//!
//! Every pair lies behind its parent there, so whoever comes from behind meets children before parents, and needs
//! neither a walk nor lists of levels. Subtrees are pieces of the arena, which threads share out; the few nodes above
//! them are fitted last. Builders leave trees in that order, and rotations end it.

use std::ops::Range;

use bvh_core::{History, Layout, MAX_HEIGHT, Node, Primitives};

use crate::block::Tally;
use crate::kernels::{Fitted, fit_leaf, refit};
use crate::raw::{Available, SharedNodes, dispatch};

/// Pairs that are looked at together: first which nodes are leaves, then these, then the others.
pub(crate) const STRETCH: usize = 512;

/// Most pairs of a piece.
const PIECE: usize = 8192;

/// How many leaves ahead the corners of triangles are fetched, and twice as many the indices.
pub(crate) const AHEAD: usize = 24;

/// Whether a tree is to be swept. Looks at it where that is not known.
pub(crate) fn is_linear(nodes: &[Node], history: &mut History) -> bool {
    if history.layout == Layout::Unknown {
        history.layout = if lies_in_order(nodes) { Layout::Linear } else { Layout::Other };
    }
    history.layout == Layout::Linear
}

/// Whether a tree is as [`Layout::Linear`] says. O(n).
fn lies_in_order(nodes: &[Node]) -> bool {
    // Where the pairs are that are still to come, the next one last: right children on the way down, and one left.
    let (mut todo, mut count) = ([0; MAX_HEIGHT as usize + 1], 0);
    let mut moving = 0;
    for (pair, children) in nodes.chunks_exact(2).enumerate() {
        if pair > 0 {
            if count == 0 || todo[count - 1] != 2 * pair {
                return false;
            }
            count -= 1;
        }
        for node in children.iter().rev() {
            moving += usize::from(node.is_dynamic());
            if !node.is_leaf() {
                todo[count] = node.first();
                count += 1;
            }
        }
    }
    count == 0 && 2 * moving >= nodes.len()
}

/// How a linear tree is shared out.
#[derive(Default)]
pub(crate) struct Pieces {
    /// Pairs of whole subtrees that move somewhere.
    pub(crate) pieces: Vec<Range<usize>>,
    /// The pairs above them, parents first.
    tops: Vec<usize>,
    todo: Vec<(usize, usize)>,
}

impl Pieces {
    /// Cuts up a linear tree.
    pub(crate) fn cut(&mut self, nodes: SharedNodes<'_>) {
        let Self { pieces, tops, todo } = self;
        pieces.clear();
        tops.clear();
        // Pairs, and where what is below them ends.
        todo.push((0, nodes.pairs()));
        while let Some((pair, end)) = todo.pop() {
            if end - pair <= PIECE {
                pieces.push(pair..end);
                continue;
            }
            tops.push(pair);
            let [l, r] = nodes.pair(2 * pair);
            let l_end = if r.is_leaf() { end } else { r.first() / 2 };
            for (node, end) in [(l, l_end), (r, end)] {
                if !node.is_leaf() && node.is_dynamic() {
                    todo.push((node.first() / 2, end));
                }
            }
        }
    }

    /// Refits what is above the pieces.
    pub(crate) fn fit_tops<P: Primitives + ?Sized>(
        &self,
        nodes: SharedNodes<'_>,
        primitives: &P,
        tally: &mut Tally,
    ) {
        let mut fitted = Fitted::default();
        for slot in self.tops.iter().rev().flat_map(|&pair| [2 * pair, 2 * pair + 1]) {
            let node = nodes.get(slot);
            match (node.is_dynamic(), node.is_leaf()) {
                (false, _) => {}
                (true, true) => fit_leaf(nodes, primitives, slot, &mut fitted),
                (true, false) => {
                    refit(nodes, slot, &mut fitted.inner_areas);
                    fitted.inner += 1;
                }
            }
        }
        tally.add_fitted(fitted);
    }
}

/// What is in a stretch, of nodes that move.
#[derive(Default)]
pub(crate) struct Lists {
    /// Slots of leaves of one primitive, and these primitives.
    pub(crate) ones: List,
    pub(crate) primitives: List,
    /// Slots of other leaves.
    pub(crate) others: List,
    /// Slots of inner nodes.
    pub(crate) inner: List,
}

/// Numbers with room behind the last: for a register, and for what comes next.
pub(crate) struct List {
    pub(crate) numbers: [u32; 2 * STRETCH + 2 * AHEAD],
    pub(crate) count: usize,
}

impl List {
    pub(crate) fn all(&self) -> &[u32] {
        &self.numbers[..self.count]
    }

    /// Puts the first of the next numbers behind the last, as far as there are any, and then one of its own.
    pub(crate) fn look_ahead(&mut self, next: &Self) {
        let known = next.count.min(2 * AHEAD);
        let own = self.numbers[0];
        let ahead = &mut self.numbers[self.count..self.count + 2 * AHEAD];
        ahead.fill(own);
        ahead[..known].copy_from_slice(&next.numbers[..known]);
    }
}

impl Default for List {
    fn default() -> Self {
        Self { numbers: [0; 2 * STRETCH + 2 * AHEAD], count: 0 }
    }
}

/// The stretches of a piece, from its end.
pub(crate) fn stretches(piece: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let first = move |i| piece.start + i * STRETCH;
    (0..piece.len().div_ceil(STRETCH)).rev().map(move |i| first(i)..piece.end.min(first(i) + STRETCH))
}

/// Refits the nodes of a piece that move. In each stretch leaves of one primitive come first, then other leaves, in the
/// order of their slots, then inner nodes from the last to the first.
pub(crate) fn sweep<P: Primitives + ?Sized>(
    level: Available,
    nodes: SharedNodes<'_>,
    primitives: &P,
    piece: Range<usize>,
    lists: &mut [Lists; 2],
) -> Fitted {
    dispatch!(level, sweep(nodes, primitives, piece, lists))
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build_with};
    use bvh_core::{Aabb, Bvh, Vec3};

    use super::*;
    use crate::pass::Scratch;
    use crate::raw;
    use crate::strategy::{Rotate, Strategy, update};

    fn boxes(n: usize, scale: f32) -> Vec<Aabb> {
        let place = |i: usize| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32) * scale;
        (0..n).map(place).map(|p| Aabb::new(p, p + 0.5)).collect()
    }

    fn tree(boxes: &[Aabb], builder: Builder, max_leaf_size: u32) -> Bvh {
        let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
        build_with(boxes, builder, &options).expect("few enough")
    }

    #[test]
    fn builders_leave_linear_trees_and_updates_know_when_that_ends() {
        let (start, end) = (boxes(3000, 1.0), boxes(3000, -3.0));
        let mut scratch = Scratch::new();
        for (builder, max_leaf_size) in Builder::PER_FRAME.into_iter().flat_map(|b| [(b, 1), (b, 4)]) {
            let mut bvh = tree(&start, builder, max_leaf_size);
            let mut layout_after = |bvh: &mut Bvh, boxes: &[Aabb], strategy| {
                update(bvh, boxes, &strategy, &mut scratch).expect("same count");
                bvh.history().layout
            };
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::Linear, "{}", builder.name());
            bvh.set_dynamic(|p| p < 1000);
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::Other, "most stand still");
            bvh.set_dynamic(|p| p > 100);
            assert_eq!(layout_after(&mut bvh, &start, Strategy::Refit), Layout::Linear);
            let rotate = Strategy::RefitRotate(Rotate::default());
            assert_eq!(layout_after(&mut bvh, &end, rotate), Layout::Other, "rotated");
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::Other);
        }
    }

    /// What `raw::share` promises, for pieces: each node that moves is in one piece or above all, and what is below a
    /// piece's nodes is in it.
    #[test]
    fn pieces_are_whole_subtrees() {
        for n in [1, 2, 100, PIECE, PIECE + 1, 40_000] {
            let mut bvh = tree(&boxes(n, 1.0), Builder::Lbvh, 1);
            bvh.set_dynamic(|p| p % 9000 < 7000);
            let tree = bvh.clone();
            assert!(lies_in_order(tree.nodes()));
            let mut pieces = Pieces::default();
            pieces.cut(raw::share(raw::parts(&mut bvh).nodes));
            let mut seen = vec![0; tree.nodes().len()];
            for piece in &pieces.pieces {
                let slots = 2 * piece.start..2 * piece.end;
                seen[slots.clone()].iter_mut().for_each(|seen| *seen += 1);
                let below = tree.nodes()[slots].iter().filter(|node| !node.is_leaf());
                assert!(below.map(Node::first).all(|pair| piece.contains(&(pair / 2))), "{piece:?} of {n}");
            }
            pieces.tops.iter().for_each(|&pair| [2 * pair, 2 * pair + 1].iter().for_each(|&s| seen[s] += 1));
            tree.visit(|slot, node, _| {
                assert!(seen[slot] == 1 || seen[slot] == 0 && !node.is_dynamic(), "slot {slot} of {n}");
            });
            assert!(n < 40_000 || pieces.pieces.len() > 4 && !pieces.tops.is_empty());
        }
    }
}
