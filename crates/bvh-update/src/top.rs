//! A new top for a tree: a builder's over the boxes of the subtrees that are kept.
//!
//! The opened nodes form the top of the tree, k - 1 of them over k kept subtrees. The new top takes the pairs of the old
//! one, and spare ones where leaves were set apart. Where solids burst into pieces it is a few per cent of the tree.

use bvh_build::{BuildOptions, Builder, rebuild};
use bvh_core::{Bvh, History, Layout, LeafHistory, MAX_HEIGHT, Node, Primitives};

use crate::apart::keep;
use crate::best::LONGEST;
use crate::cut::{CutScratch, NodeMeasure, Regrown, reference};
use crate::pass::Scratch;
use crate::raw::{self, SharedNodes};

/// Subtrees of a new top that are higher than this are written by two tasks.
const FORKED: u32 = 8;

/// How many pairs ahead their places are fetched.
const AHEAD: usize = 16;

/// Sums of half areas times weights of inner nodes.
#[derive(Clone, Copy, Default)]
pub(crate) struct InnerAreas {
    pub(crate) all: f64,
    /// Of those that stand still.
    still: f64,
}

impl InnerAreas {
    /// Adds an inner node; no leaf.
    pub(crate) fn add(&mut self, node: &Node) {
        let area = node.aabb().half_area_f64() * node.weight();
        self.all += area;
        self.still += if node.is_dynamic() { 0.0 } else { area };
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self { all: self.all + other.all, still: self.still + other.still }
    }
}

/// What is known of a new top.
pub(crate) struct NewTop {
    /// The size of the scene, with leaves as they are now.
    pub(crate) size: f64,
    /// Sum of the references of its nodes.
    pub(crate) references: f64,
    /// By how much the sum of half areas times weights has changed, and the part of it that is due to leaves.
    pub(crate) change: f64,
    pub(crate) leaf_change: f64,
}

/// Builds the tree anew above the cut, if there are at most `most` subtrees to keep, after a pass that has found this
/// area of leaves; `judge` says how good it is.
pub(crate) fn rebuild_top<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    measure: impl NodeMeasure,
    leaf_area: f64,
    most: usize,
    scratch: &mut Scratch,
    judge: impl FnOnce(&NewTop) -> f64,
) -> Regrown {
    if (1..=most).contains(&scratch.cut.cut.len()) {
        reserve(most, scratch);
    }
    let apart = keep(bvh, primitives, most, &mut scratch.cut);
    let Scratch { cut: CutScratch { boxes, kept, cut, pairs, opened, top, .. }, build, .. } = scratch;
    if cut.len().max(kept.len()) > most {
        return Regrown::TooMuch;
    }
    if cut.is_empty() {
        return Regrown::NOTHING;
    }
    boxes.clear();
    boxes.extend(kept.iter().map(Node::aabb));
    let options = BuildOptions::default();
    if rebuild(top, boxes, Builder::BinnedParallel, &options, build).is_err()
        || top.height() + kept.iter().map(Node::height).max().unwrap_or(0) > MAX_HEIGHT
    {
        return Regrown::TooMuch;
    }
    let mut after = InnerAreas::default();
    top.nodes().iter().filter(|node| !node.is_leaf()).for_each(|node| after.add(node));
    if after.all - opened.all + apart.change >= 0.0 {
        return Regrown::NOTHING;
    }
    // A tree over k subtrees has k - 1 pairs below the root, each its own, as tasks write to them (`raw::share`). They may
    // be fewer in a tree that was given with inner boxes which do not hold what is in them.
    let has_places = pairs.first().is_none_or(|&pair| pair > 1) && pairs.is_sorted_by(|a, b| a < b);
    if !has_places || top.nodes().len() != 2 * pairs.len() + 2 {
        return Regrown::TooMuch;
    }
    let size = apart.size(bvh, leaf_area);
    let parts = raw::parts(bvh);
    let graft = Graft { nodes: raw::share(parts.nodes), measure, top, kept, pairs, size };
    let Grafted { root, areas, references } = graft.write(0);
    graft.nodes.set(0, root);
    *parts.static_area += areas.still - opened.still;
    let change = areas.all - opened.all + apart.change;
    let reference = reference(judge(&NewTop { size, references, change, leaf_change: apart.change }), 1.0);
    let history = parts.history;
    let left = apart.part_left(history);
    let LeafHistory { growth, cost, .. } = history.leaves;
    *history = History {
        reference,
        measured: reference,
        size,
        kept: kept.len() as u32,
        period: history.since_repair,
        regret: 0.0,
        since_repair: 0,
        looks_in_vain: 0,
        trees_in_vain: 0,
        is_beyond_repair: false,
        rebuilds_in_a_row: 0,
        layout: Layout::Other,
        spare_pair: apart.spare,
        spare_pair_count: history.spare_pair_count.saturating_sub(apart.count),
        leaves: LeafHistory { growth: growth * left, cost: cost * left, ..history.leaves },
        ..*history
    };
    Regrown::Top { subtrees: kept.len(), change, apart }
}

/// Makes room for the largest top at once: memory that grows with a burst is moved, and asked for anew, in the very updates
/// that take longest as it is.
fn reserve(most: usize, scratch: &mut Scratch) {
    let Scratch { cut: CutScratch { boxes, kept, cut, pairs, top, .. }, build, .. } = scratch;
    // One merged leaf more than there should be may have been set apart.
    let most = most + LONGEST;
    kept.reserve_exact(most.saturating_sub(kept.len()));
    boxes.reserve_exact(most.saturating_sub(boxes.len()));
    for slots in [cut, pairs] {
        slots.reserve_exact(most.saturating_sub(slots.len()));
    }
    top.reserve(most);
    build.reserve(most);
}

/// A new top, to be written to the place of the old one.
struct Graft<'a, M> {
    nodes: SharedNodes<'a>,
    measure: M,
    top: &'a Bvh,
    kept: &'a [Node],
    /// A place for each pair of the new top.
    pairs: &'a [u32],
    size: f64,
}

/// A node of the new top below which all is written, and sums over the inner nodes there.
struct Grafted {
    /// It has yet to be put in its place.
    root: Node,
    areas: InnerAreas,
    references: f64,
}

impl<M: NodeMeasure> Graft<'_, M> {
    /// Writes what is below node `n` of the new top. Which sums are added up does not depend on the number of threads.
    fn write(&self, n: usize) -> Grafted {
        let node = &self.top.nodes()[n];
        if let &[subtree] = self.top.primitives(node) {
            let root = self.kept[subtree as usize];
            return Grafted { root, areas: InnerAreas::default(), references: 0.0 };
        }
        let first = node.first();
        if let Some(&soon) = self.pairs.get(first / 2 + AHEAD) {
            self.nodes.prefetch::<false>(soon as usize);
        }
        let [l, r] = if node.height() > FORKED {
            rayon::join(|| self.write(first), || self.write(first + 1)).into()
        } else {
            [self.write(first), self.write(first + 1)]
        };
        let (place, pair) = (self.pairs[first / 2 - 1], [l.root, r.root]);
        self.nodes.set(place as usize, pair[0]);
        self.nodes.set(place as usize + 1, pair[1]);
        let mut root = Node::parent(&pair[0], &pair[1], place);
        // As if there were but this pair.
        let measured = (self.measure)(&pair, &Node::parent(&pair[0], &pair[1], 0));
        root.set_reference((measured / self.size) as f32);
        let mut areas = l.areas.and(r.areas);
        areas.add(&root);
        Grafted { root, areas, references: l.references + r.references + f64::from(root.reference()) }
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::build;
    use bvh_core::{Aabb, Vec3};

    use super::*;
    use crate::{Decision, Regrow, Strategy, update};

    #[test]
    fn tops_that_grow_with_a_burst_stay_where_they_are_in_memory() {
        // A sheet, of which ever more is scattered.
        let boxes = |scattered: usize| -> Vec<Aabb> {
            let corner = |i: usize| {
                let z = if i.wrapping_mul(7919) % 10_000 < scattered { (i % 89) as f32 + 9.0 } else { 0.0 };
                Vec3::new((i % 100) as f32, (i / 100) as f32, z)
            };
            (0..10_000).map(corner).map(|corner| Aabb::new(corner, corner + 1.1)).collect()
        };
        let mut bvh = build(&boxes(0), Builder::Sweep).expect("few");
        let (mut scratch, mut kept, mut memory) = (Scratch::new(), Vec::new(), Vec::new());
        for step in 0..10 {
            let strategy = Strategy::Regrow(Regrow { rotate: None, ..Regrow::default() });
            let told = update(&mut bvh, &boxes(1 << step), &strategy, &mut scratch).expect("same count");
            if let Decision::Regrow { subtrees } = told.decision {
                let CutScratch { boxes, kept: nodes, top, .. } = &scratch.cut;
                kept.push(subtrees);
                memory.push((
                    boxes.as_ptr(),
                    nodes.as_ptr(),
                    top.nodes().as_ptr(),
                    scratch.build.memory_usage(),
                ));
            }
        }
        assert!(kept.len() > 2 && kept[kept.len() - 1] > 2 * kept[0], "{kept:?}");
        memory.dedup();
        assert_eq!(memory.len(), 1, "{memory:?}");
    }
}
