//! Refitting a tree that lies in depth-first order: a sweep through the arena from its end.
//!
//! Every pair lies behind its parent there, so a sweep from the end meets children before
//! parents and needs no walk. Subtrees are pieces of the arena, which are divided until they are
//! small enough for one thread. Builders leave trees in that order, and rotations end it.

use std::ops::Range;

use bvh_core::{MAX_HEIGHT, Node, Primitives};

use crate::state::{Layout, State};

use super::block::{Entry, Lister, Lists};
use super::memory::{SPARE_LISTS, lend};
use super::shared::dispatch;
use super::{Tally, Task, kernels};

/// Pairs that are looked at together: first which nodes are leaves, then these, then the others.
// Half and double: docs/TUNING.md.
const STRETCH: usize = 512;

/// Most pairs of a piece.
// Half and double: docs/TUNING.md.
const PIECE: usize = 4096;

/// Whether a tree is to be swept. Looks at it where that is not known.
pub(crate) fn detect_linear(nodes: &[Node], state: &mut State) -> bool {
    if state.layout == Layout::UNKNOWN {
        state.layout = if lies_in_order(nodes) { Layout::LINEAR } else { Layout::OTHER };
    }
    state.layout == Layout::LINEAR
}

/// Whether a tree is as [`Layout::LINEAR`] says. O(n).
fn lies_in_order(nodes: &[Node]) -> bool {
    // The nodes that are still to come, the next one last.
    let (mut todo, mut count) = ([0; MAX_HEIGHT as usize + 2], 1);
    let (mut next_pair, mut dynamic) = (2, 0);
    while count > 0 {
        count -= 1;
        let node = &nodes[todo[count]];
        dynamic += usize::from(node.is_dynamic());
        if node.is_leaf() {
            continue;
        }
        if node.first() != next_pair {
            return false;
        }
        todo[count..count + 2].copy_from_slice(&[next_pair + 1, next_pair]);
        count += 2;
        next_pair += 2;
    }
    next_pair == nodes.len() && 2 * dynamic >= nodes.len()
}

impl<P: Primitives + ?Sized> Task<'_, P> {
    /// Refits a piece of the arena of a linear tree: a pair and all below it.
    pub(super) fn sweep(&self, piece: Range<usize>) -> Tally {
        if piece.len() <= PIECE {
            let mut tally = Tally::default();
            lend(&SPARE_LISTS, |lists| {
                for start in piece.clone().step_by(STRETCH).rev() {
                    self.sweep_stretch(start..piece.end.min(start + STRETCH), lists, &mut tally);
                }
            });
            return tally;
        }
        let pair = 2 * piece.start;
        let [l, r] = self.nodes.pair(pair);
        let middle = if r.is_leaf() { piece.end } else { r.first() / 2 };
        let below = |node: Node, pairs: Range<usize>| {
            if node.is_dynamic() && !node.is_leaf() { self.sweep(pairs) } else { Tally::default() }
        };
        let (l_tally, r_tally) =
            rayon::join(|| below(l, piece.start + 1..middle), || below(r, middle..piece.end));
        let mut tally = l_tally.and(&r_tally);
        for (slot, node) in [(pair, l), (pair + 1, r)] {
            let entry = [Entry::new(slot, node.first() as u32)];
            if node.is_dynamic() && node.is_leaf() {
                kernels::fit_leaf(self.nodes, self.primitives, self.order, slot, &mut tally);
            } else if node.is_dynamic() {
                kernels::refit_boxes(self.nodes, &entry, self.options.with_sums, &mut tally);
            }
        }
        tally
    }

    fn sweep_stretch(&self, pairs: Range<usize>, lists: &mut Lists, tally: &mut Tally) {
        let Lists { leaves, inner, included, .. } = lists;
        let mut lister = Lister::new(&[], inner, included, leaves);
        dispatch!(self.options.level, sweep(self.nodes, pairs.clone(), &mut lister));
        lister.finish();
        // There are about as many leaves as pairs. The first stretch fetches what lies before the
        // arena, which faults nowhere.
        let fetch = |i: usize| self.nodes.prefetch((2 * (pairs.start + i)).wrapping_sub(2 * STRETCH));
        self.fit_leaves(leaves, fetch, tally);
        dispatch!(self.options.level, refit_boxes(self.nodes, inner.all(), self.options.with_sums, tally));
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build_with};
    use bvh_core::{Aabb, Bvh, Vec3};

    use super::super::Rotate;
    use super::*;
    use crate::{Strategy, Updater};

    fn boxes(n: usize, scale: f32) -> Vec<Aabb> {
        let place = |i: usize| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32) * scale;
        (0..n).map(place).map(|p| Aabb::new(p, p + 0.5)).collect()
    }

    fn tree(boxes: &[Aabb], builder: Builder, max_leaf_size: u32) -> Bvh {
        let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
        build_with(boxes, builder, &options).expect("few enough")
    }

    #[test]
    fn builders_leave_linear_trees_until_rotations_or_static_parts_end_that() {
        let (start, end) = (boxes(3000, 1.0), boxes(3000, -3.0));
        let mut updater = Updater::default();
        for (builder, max_leaf_size) in Builder::PER_FRAME.into_iter().flat_map(|b| [(b, 1), (b, 4)]) {
            let mut bvh = tree(&start, builder, max_leaf_size);
            let mut layout_after = |bvh: &mut Bvh, boxes: &[Aabb], strategy| {
                updater.set_strategy(strategy).update(bvh, boxes).expect("same count");
                State::of(bvh).layout
            };
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::LINEAR, "{}", builder.name());
            bvh.set_dynamic(|p| p < 1000);
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::OTHER, "most are static");
            bvh.set_dynamic(|p| p > 100);
            assert_eq!(layout_after(&mut bvh, &start, Strategy::Refit), Layout::LINEAR);
            let rotate = Strategy::RefitRotate(Rotate::default());
            assert_eq!(layout_after(&mut bvh, &end, rotate), Layout::OTHER, "rotated");
            assert_eq!(layout_after(&mut bvh, &end, Strategy::Refit), Layout::OTHER);
        }
    }
}
