//! What a repair keeps: the subtrees below its cut, and merged leaves that have come apart, in pieces.
//!
//! A merged leaf whose primitives part grows with the nodes above it, so it ends at the cut. There it is set apart, if that
//! is better by the SAH, and the new top joins each of its primitives with what that moves with now. So a repair mends what
//! else takes a look at all leaves (`merge.rs`).

use bvh_core::{Bvh, Node, Primitives};
use rayon::prelude::*;

use crate::best::{LONGEST, set_apart};
use crate::block::Tally;
use crate::cut::CutScratch;

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
    /// What is left of the growth of leaves by merging, after a pass that has found this.
    pub(crate) fn growth_left(&self, bvh: &Bvh, tally: &Tally) -> f64 {
        bvh.history().leaves.growth * self.part_left(bvh, tally)
    }

    /// The part of what had merged that still is.
    pub(crate) fn part_left(&self, bvh: &Bvh, tally: &Tally) -> f64 {
        let merged = bvh.len() as f64 - tally.leaves as f64;
        if self.count == 0 { 1.0 } else { (1.0 - f64::from(self.count) / merged).clamp(0.0, 1.0) }
    }
}

/// How many leaves ahead their primitives are fetched.
const AHEAD: usize = 8;

/// Collects the subtrees of a cut, if there are at most `most`. What is better apart of a merged leaf is kept apart, with
/// spare pairs above: the leaf has come apart with the nodes above it.
pub(crate) fn keep<P: Primitives + ?Sized>(
    bvh: &Bvh,
    primitives: &P,
    most: usize,
    scratch: &mut CutScratch,
) -> Apart {
    let CutScratch { cut, pairs, kept, pieces, .. } = scratch;
    let mut apart = Apart { spare: bvh.history().spare_pair, ..Apart::default() };
    kept.clear();
    if cut.len() > most {
        return apart;
    }
    // In memory order, as builders number pairs.
    cut.par_sort_unstable();
    let (nodes, order) = (bvh.nodes(), bvh.order());
    kept.resize(cut.len(), Node::NOTHING);
    kept.par_iter_mut().zip(&*cut).for_each(|(kept, &n)| *kept = nodes[n as usize]);
    let is_merged = |leaf: &Node| leaf.moves() && (2..=LONGEST).contains(&leaf.count());
    for i in 0..if apart.spare > 0 { cut.len() } else { 0 } {
        if let Some(soon) = kept.get(i + AHEAD).filter(|leaf| is_merged(leaf)) {
            order[soon.first()..][..soon.count()].iter().for_each(|&p| primitives.prefetch_data(p as usize));
        }
        if !is_merged(&kept[i]) {
            continue;
        }
        pieces.clear();
        let gain = set_apart(order, primitives, &kept[i], pieces);
        let (pairs_before, spare_before) = (pairs.len(), apart.spare);
        for _ in 1..pieces.len() {
            if apart.spare > 0 {
                pairs.push(apart.spare);
                apart.spare = nodes[apart.spare as usize].first() as u32;
            }
        }
        if let [first, others @ ..] = &pieces[..] {
            if pairs.len() - pairs_before == others.len() {
                kept[i] = *first;
                kept.extend_from_slice(others);
                apart.count += others.len() as u32;
                apart.change -= gain;
            } else {
                pairs.truncate(pairs_before);
                apart.spare = spare_before;
            }
        }
    }
    pairs.par_sort_unstable();
    apart
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build};
    use bvh_core::{Aabb, Vec3, sah_cost};

    use super::*;
    use crate::pass::Scratch;
    use crate::{Leaves, Open, Regrow, Strategy, raw, update};

    /// Twins in rows; those of one row in ten move away from each other, by rows.
    fn twins(apart: f32) -> Vec<Aabb> {
        let place = |i: usize| {
            let (twin, row) = (i / 2, i / 2 / 100);
            let away = if i % 2 == 1 && row.is_multiple_of(10) { apart } else { 0.0 };
            Vec3::new((twin % 100) as f32, row as f32 + away, 0.0)
        };
        (0..12_000).map(place).map(|corner| Aabb::new(corner, corner + 0.5)).collect()
    }

    #[test]
    fn leaves_that_came_apart_are_set_apart_by_repairs() {
        let strategies = [Open::Grown, Open::Divergent]
            .map(|open| Strategy::Regrow(Regrow { rotate: None, growth: 0.05, open }));
        for strategy in strategies {
            let mut hashes = Vec::new();
            for threads in [1, 2, 4] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| {
                    let (together, apart) = (twins(0.0), twins(200.0));
                    let mut bvh =
                        build(&together, Builder::Sweep, &BuildOptions::default(), None).expect("few");
                    let mut scratch = Scratch::new();
                    let merge = Strategy::Leaves(Leaves { rotate: None, period: 1, ..Leaves::default() });
                    let merged = |bvh: &Bvh| {
                        let mut merged = 0;
                        bvh.visit(|_, node, _| merged += node.count().saturating_sub(1));
                        merged
                    };
                    update(&mut bvh, &together, &merge, &mut scratch).expect("same count");
                    assert_eq!(merged(&bvh), 6000);
                    update(&mut bvh, &together, &strategy, &mut scratch).expect("same count");
                    // With too few spare pairs, some stay together.
                    let few = |bvh: &mut Bvh| {
                        let spare = bvh.history().spare_pair;
                        let (mut last, mut left) = (spare as usize, 100);
                        while left > 0 {
                            (last, left) = (bvh.nodes()[last].first(), left - 1);
                        }
                        raw::parts(bvh).nodes[last] = Node::leaf(Aabb::EMPTY, 0, 0);
                    };
                    let mut poor = bvh.clone();
                    few(&mut poor);
                    let before = merged(&poor);
                    update(&mut poor, &apart, &strategy, &mut scratch).expect("same count");
                    poor.validate(&apart).expect("valid");
                    assert_eq!((before - merged(&poor), poor.history().spare_pair), (101, 0));
                    let told = update(&mut bvh, &apart, &strategy, &mut scratch).expect("same count");
                    assert!(matches!(told.decision, crate::Decision::Regrow { .. }), "{}", told.decision);
                    bvh.validate(&apart).expect("valid");
                    assert_eq!(merged(&bvh), 6000 - 600);
                    let fresh = build(&apart, Builder::Sweep, &BuildOptions::default(), None).expect("few");
                    assert!(sah_cost(&bvh) < 1.05 * sah_cost(&fresh));
                    hashes.push(bvh.hash());
                });
            }
            assert!(hashes.iter().all(|&hash| hash == hashes[0]));
        }
    }
}
