//! What a repair keeps: the subtrees below its cut, and merged leaves that have come apart, in pieces.
//!
//! A merged leaf whose primitives part grows with the nodes above it, so it ends at the cut. There it is set apart, if that
//! is better by the SAH, and the new top joins each of its primitives with what that moves with now. So a repair mends what
//! else takes a look at all leaves (`merge.rs`).

use bvh_core::{Bvh, History, Node, Primitives, prefetch};
use rayon::prelude::*;

use crate::best::{LONGEST, set_apart};
use crate::cut::{CutScratch, size_since};

/// Leaves at a cut that were set apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Apart {
    /// How many leaves more there are.
    pub(crate) count: u32,
    /// By how much the sum of their half areas times weights has changed.
    pub(crate) change: f64,
    /// The first of the pairs that are then kept for later.
    pub(crate) spare: u32,
}

impl Apart {
    /// The part of what had merged that still is.
    pub(crate) fn part_left(&self, history: &History) -> f64 {
        let merged = f64::from(history.spare_pair_count);
        if self.count == 0 { 1.0 } else { (1.0 - f64::from(self.count) / merged).clamp(0.0, 1.0) }
    }

    /// The size of the scene once these leaves are apart, after a pass that has found this area of leaves.
    pub(crate) fn size(&self, bvh: &Bvh, leaf_area: f64) -> f64 {
        let growth = bvh.history().leaves.growth * self.part_left(bvh.history());
        size_since(bvh.history(), (leaf_area + self.change) / (1.0 + growth), bvh)
    }
}

/// How many leaves ahead the corners of triangles are fetched, and twice as many the indices.
const AHEAD: usize = 8;

/// Kept subtrees that a task looks at.
const PER_TASK: usize = 2048;

/// What is better apart of the leaves that a task has looked at.
#[derive(Default)]
pub(crate) struct Pieces {
    leaves: Vec<Parted>,
    /// The pieces of these, one after the other.
    pieces: Vec<Node>,
}

struct Parted {
    /// Which of the subtrees of the cut.
    kept: u32,
    /// How many pieces it falls into, and how much less these cost.
    pieces: u32,
    gain: f64,
}

/// Collects the subtrees of a cut, or more than `most`. What is better apart of a merged leaf is kept apart, with
/// spare pairs above: the leaf has come apart with the nodes above it.
pub(crate) fn keep<P: Primitives + ?Sized>(
    bvh: &Bvh,
    primitives: &P,
    most: usize,
    scratch: &mut CutScratch,
) -> Apart {
    let CutScratch { cut, pairs, kept, pieces: tasks, .. } = scratch;
    let mut apart = Apart { spare: bvh.history().spare_pair, ..Apart::default() };
    if cut.len() > most {
        kept.clear();
        return apart;
    }
    // In memory order, as builders number pairs.
    cut.par_sort_unstable();
    let (nodes, order) = (bvh.nodes(), bvh.order());
    kept.resize(cut.len(), Node::NOTHING);
    let count = cut.len().div_ceil(PER_TASK);
    tasks.resize_with(count.max(tasks.len()), Pieces::default);
    let tasks = &mut tasks[..count];
    let (subtrees, slots) = (kept.par_chunks_mut(PER_TASK), cut.par_chunks(PER_TASK));
    let may_part = apart.spare > 0;
    subtrees.zip(slots).zip(&mut *tasks).enumerate().for_each(|(i, ((kept, cut), pieces))| {
        kept.iter_mut().zip(cut).for_each(|(kept, &n)| *kept = nodes[n as usize]);
        pieces.clear();
        if may_part {
            pieces.look_at(kept, i * PER_TASK, order, primitives);
        }
    });
    // Spare pairs come off a list, one after the other.
    'all: for Pieces { leaves, pieces } in tasks {
        let mut rest = &pieces[..];
        for leaf in leaves {
            if apart.spare == 0 || kept.len() > most {
                break 'all;
            }
            let (pieces, others) = rest.split_at(leaf.pieces as usize);
            rest = others;
            let (pairs_before, spare_before) = (pairs.len(), apart.spare);
            while apart.spare > 0 && pairs.len() - pairs_before < pieces.len() - 1 {
                pairs.push(apart.spare);
                apart.spare = nodes[apart.spare as usize].first() as u32;
            }
            if pairs.len() - pairs_before < pieces.len() - 1 {
                pairs.truncate(pairs_before);
                apart.spare = spare_before;
                continue;
            }
            kept[leaf.kept as usize] = pieces[0];
            kept.extend_from_slice(&pieces[1..]);
            apart.count += leaf.pieces - 1;
            apart.change -= leaf.gain;
        }
    }
    pairs.par_sort_unstable();
    apart
}

impl Pieces {
    fn clear(&mut self) {
        self.leaves.clear();
        self.pieces.clear();
    }

    /// Looks at these subtrees of a cut, the first of which has that number.
    fn look_at<P: Primitives + ?Sized>(
        &mut self,
        kept: &[Node],
        first: usize,
        order: &[u32],
        primitives: &P,
    ) {
        let is_merged = |leaf: &&Node| leaf.moves() && (2..=LONGEST).contains(&leaf.count());
        for (i, leaf) in kept.iter().enumerate() {
            let soon = |ahead| {
                let leaf = kept.get(i + ahead).filter(is_merged);
                leaf.map_or(&[][..], |leaf| &order[leaf.first()..][..leaf.count()])
            };
            if let Some(leaf) = kept.get(i + 3 * AHEAD).filter(is_merged) {
                prefetch(order, leaf.first());
            }
            soon(2 * AHEAD).iter().for_each(|&p| primitives.prefetch_index(p as usize));
            soon(AHEAD).iter().for_each(|&p| primitives.prefetch_data(p as usize));
            if !is_merged(&leaf) {
                continue;
            }
            let before = self.pieces.len();
            let gain = set_apart(order, primitives, leaf, &mut self.pieces);
            let pieces = (self.pieces.len() - before) as u32;
            if pieces > 0 {
                self.leaves.push(Parted { kept: (first + i) as u32, pieces, gain });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build};
    use bvh_core::{Aabb, Vec3, sah_cost};

    use super::*;
    use crate::refit::shared as raw;
    use crate::scratch::Scratch;
    use crate::{Decision, Leaves, Open, Regrow, Strategy, update};

    /// So many that those that part are more than one task has to look at.
    const N: usize = 120_000;

    /// Quadruplets in rows; in one row of ten they move away from each other, by rows.
    fn quadruplets(apart: f32) -> Vec<Aabb> {
        let place = |i: usize| {
            let (place, row) = (i / 4 % 100, i / 4 / 100);
            let away = if row.is_multiple_of(10) { apart * (i % 4) as f32 } else { 0.0 };
            Vec3::new(place as f32, row as f32 + away, 0.0)
        };
        (0..N).map(place).map(|corner| Aabb::new(corner, corner + 0.5)).collect()
    }

    /// How many primitives fewer there were if all leaves had one, and how many spare pairs there are.
    fn merged(bvh: &Bvh) -> (usize, usize) {
        let (mut merged, mut spare, mut next) = (0, 0, bvh.history().spare_pair as usize);
        bvh.visit(|_, node, _| merged += node.count().saturating_sub(1));
        while next > 0 {
            (spare, next) = (spare + 1, bvh.nodes()[next].first());
        }
        (merged, spare)
    }

    /// A tree whose quadruplets have merged, measured by this strategy.
    fn merged_tree(strategy: &Strategy, scratch: &mut Scratch) -> Bvh {
        let boxes = quadruplets(0.0);
        let mut bvh = build(&boxes, Builder::Sweep, &BuildOptions::default(), None).expect("few");
        let merge = Strategy::Leaves(Leaves { rotate: None, period: 1, ..Leaves::default() });
        update(&mut bvh, &boxes, &merge, scratch).expect("same count");
        update(&mut bvh, &boxes, strategy, scratch).expect("same count");
        assert_eq!(merged(&bvh), (N * 3 / 4, N * 3 / 4));
        assert_eq!(bvh.history().spare_pair_count as usize, N * 3 / 4);
        bvh
    }

    fn regrow(open: Open) -> Strategy {
        Strategy::Regrow(Regrow { rotate: None, growth: 0.05, open })
    }

    #[test]
    fn leaves_that_came_apart_are_set_apart_by_repairs() {
        for strategy in [Open::Grown, Open::Divergent].map(regrow) {
            let mut hashes = Vec::new();
            for threads in [1, 2, 4] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| {
                    let (apart, mut scratch) = (quadruplets(200.0), Scratch::new());
                    let mut bvh = merged_tree(&strategy, &mut scratch);
                    let told = update(&mut bvh, &apart, &strategy, &mut scratch).expect("same count");
                    assert!(matches!(told.decision, Decision::Regrow { .. }), "{}", told.decision);
                    bvh.validate(&apart).expect("valid");
                    let left = N * 3 / 4 * 9 / 10;
                    assert_eq!((merged(&bvh), bvh.history().spare_pair_count as usize), ((left, left), left));
                    let fresh = build(&apart, Builder::Sweep, &BuildOptions::default(), None).expect("few");
                    assert!(sah_cost(&bvh) < 1.05 * sah_cost(&fresh));
                    // It is what the tree is held to.
                    let told = update(&mut bvh, &apart, &strategy, &mut scratch).expect("same count");
                    assert_eq!(told.decision, Decision::AsAlways);
                    hashes.push(bvh.hash());
                });
            }
            assert!(hashes.iter().all(|&hash| hash == hashes[0]));
        }
    }

    #[test]
    fn leaves_stay_together_where_there_are_too_few_spare_pairs() {
        let (strategy, apart, mut scratch) = (regrow(Open::Grown), quadruplets(200.0), Scratch::new());
        let mut bvh = merged_tree(&strategy, &mut scratch);
        let before = merged(&bvh).0;
        let mut last = bvh.history().spare_pair as usize;
        (1..101).for_each(|_| last = bvh.nodes()[last].first());
        raw::parts(&mut bvh).nodes[last] = Node::leaf(Aabb::EMPTY, 0, 0);
        let told = update(&mut bvh, &apart, &strategy, &mut scratch).expect("same count");
        assert!(matches!(told.decision, Decision::Regrow { .. }), "{}", told.decision);
        bvh.validate(&apart).expect("valid");
        // Three each; two are left.
        assert_eq!(merged(&bvh), (before - 99, 2));
    }
}
