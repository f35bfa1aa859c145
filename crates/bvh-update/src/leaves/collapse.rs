//! One step of merging and splitting leaves.
//!
//! Parts of the tree are looked at by many threads, breadth-first, so that memory is fetched ahead.
//! They change nothing but write down what is to become of it; then the changes are made one after
//! the other, as pairs of nodes are taken from one list. So the tree is the same for every number
//! of threads, and as it was should the primitives panic.

use bvh_core::rotation::LEAST_SAVED;
use bvh_core::{Aabb, Bvh, MAX_HEIGHT, Node, Parts, Primitives, prefetch};
use rayon::prelude::*;

use super::small_tree::{LONGEST, OptimalTree, are_best_as_leaf};
use crate::refit::{Schedule, parts};
use crate::state::{Layout, State};

/// Subtrees of this height or less are parts, which take turns; what is above them is walked
/// through each time.
const SMALL: u32 = 8;
/// Parts that are looked at together, so that there is something to do while memory answers.
const GROUP: usize = 32;
/// Most tasks that parts are dealt out to.
const TASKS: usize = 64;
/// How many runs ahead their primitives are asked for, and twice as many where these are to be
/// found.
const AHEAD: usize = 8;

/// Memory that this keeps.
#[derive(Default)]
pub(crate) struct LeafScratch {
    /// Nodes above the parts, each before those below it.
    top: Vec<u32>,
    /// The roots of the parts.
    parts: Vec<Seen>,
    plans: Vec<Plans>,
}

/// By how much the cost of the tree has changed.
#[derive(Clone, Copy, Default)]
pub(crate) struct LeafChange {
    pub(crate) all: f64,
    /// The part of it that is due to leaves.
    pub(crate) leaves: f64,
}

/// Merges or splits the leaves that have their turn, whichever costs less, in a tree that has been
/// fitted; references are in units of `scale`.
pub(crate) fn change_leaves<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    schedule: Schedule,
    max_leaf_size: u32,
    scale: f64,
    scratch: &mut LeafScratch,
) -> LeafChange {
    let LeafScratch { top, parts: small, plans } = scratch;
    top.clear();
    small.clear();
    find_parts(bvh.nodes(), 0, 0, schedule, top, small);
    let per_task = small.len().div_ceil(TASKS).next_multiple_of(GROUP).max(1);
    plans.resize_with(TASKS, Plans::default);
    let Parts { nodes, order, state, .. } = parts(bvh);
    let state = State::of_mut(state);
    let longest = max_leaf_size.min(LONGEST as u32);
    let view = View { nodes, order, primitives, longest };
    for Plans { runs, above, .. } in &mut *plans {
        runs.clear();
        above.clear();
    }
    plans.par_iter_mut().zip(small.par_chunks(per_task)).for_each(|(plans, parts)| {
        parts.chunks(GROUP).for_each(|group| view.look(group, plans));
    });
    let mut writer = Writer { nodes, scale, spare: state.spare_pair, change: LeafChange::default() };
    if plans.iter().any(|plans| !plans.runs.is_empty()) {
        state.layout = Layout::OTHER;
    }
    let is_changed = plans.iter().map(|plans| writer.carry_out(plans)).fold(false, |any, is| any | is);
    if is_changed {
        top.iter().rev().for_each(|&n| writer.refit(n as usize));
    }
    state.spare_pair = writer.spare;
    writer.change
}

/// Finds the parts at and below node `n` that have their turn, from left to right.
fn find_parts(
    nodes: &[Node],
    n: usize,
    depth: u32,
    schedule: Schedule,
    top: &mut Vec<u32>,
    parts: &mut Vec<Seen>,
) {
    let node = &nodes[n];
    if !node.is_dynamic() {
        return;
    }
    if node.height() <= SMALL {
        if node.is_leaf() || schedule.includes(n) {
            parts.push(Seen::new(n, depth));
        }
        return;
    }
    top.push(n as u32);
    for child in [node.first(), node.first() + 1] {
        find_parts(nodes, child, depth + 1, schedule, top, parts);
    }
}

/// What is to become of some parts.
#[derive(Default)]
struct Plans {
    /// The nodes of the present group, breadth first.
    group: Vec<Seen>,
    /// The longest runs in it, as numbers of their roots there.
    longest: Vec<u32>,
    runs: Vec<NewRun>,
    /// The nodes above new runs, each after those below it.
    above: Vec<u32>,
}

/// A node that was looked at.
#[derive(Clone, Copy)]
struct Seen {
    n: u32,
    depth: u32,
    /// Where its children are, if any.
    children: u32,
    /// Whether it is the root of a new run, or above one.
    changes: bool,
    /// The run that it is the root of, if any; else one of no slots.
    run: Run,
    /// Pairs below the root of a run.
    pairs: u32,
}

impl Seen {
    fn new(n: usize, depth: u32) -> Self {
        Self { n: n as u32, depth, children: 0, changes: false, run: Run::default(), pairs: 0 }
    }

    /// Where its children are.
    fn children(&self) -> Option<[usize; 2]> {
        let first = self.children as usize;
        (first > 0).then_some([first, first + 1])
    }
}

/// A subtree that is to take the place of another.
struct NewRun {
    /// The root of both.
    n: u32,
    run: Run,
    /// The boxes of the primitives in the slots.
    boxes: [Aabb; LONGEST],
    /// As in [`OptimalTree`].
    split: [[u8; LONGEST]; LONGEST],
    /// Pairs that it takes beyond those of the old subtree.
    more_pairs: u32,
    change: LeafChange,
}

/// The tree, to look at.
struct View<'a, P: ?Sized> {
    nodes: &'a [Node],
    order: &'a [u32],
    primitives: &'a P,
    longest: u32,
}

/// The slots of a subtree, and the sum of half areas times weights over its nodes.
#[derive(Clone, Copy, Default)]
struct Run {
    first: u32,
    count: u32,
    cost: f64,
    /// The part of it that is due to leaves.
    leaves: f64,
}

impl Run {
    /// The primitives in its slots.
    fn slots(self, order: &[u32]) -> &[u32] {
        &order[self.first as usize..][..self.count as usize]
    }
}

impl<P: Primitives + ?Sized> View<'_, P> {
    /// Plans for a group of parts. Whatever is needed is asked for well before.
    fn look(&self, parts: &[Seen], plans: &mut Plans) {
        let Plans { group, longest, runs, above } = plans;
        group.clear();
        longest.clear();
        group.extend_from_slice(parts);
        self.walk(group);
        self.find_longest(group, parts.len(), longest);
        for i in 0..longest.len() {
            self.prefetch_slots(group, longest.get(i + 2 * AHEAD), |p| self.primitives.prefetch_index(p));
            self.prefetch_slots(group, longest.get(i + AHEAD), |p| self.primitives.prefetch_data(p));
            let root = &mut group[longest[i] as usize];
            let (n, run) = (root.n, root.run);
            let slots = run.slots(self.order);
            let mut room = [Aabb::EMPTY; LONGEST];
            let boxes = &mut room[..slots.len()];
            boxes.iter_mut().zip(slots).for_each(|(aabb, &p)| *aabb = self.primitives.aabb(p as usize));
            if root.children == 0 && are_best_as_leaf(boxes, run.cost) {
                continue;
            }
            let best = OptimalTree::new(boxes);
            let cost = best.cost[0][slots.len() - 1];
            if cost < run.cost * (1.0 - LEAST_SAVED) {
                root.changes = true;
                let (leaves, number) = best.add_leaves((0.0, 0), 0, slots.len());
                let more_pairs = (number - 1).saturating_sub(root.pairs);
                let change = LeafChange { all: cost - run.cost, leaves: leaves - run.leaves };
                runs.push(NewRun { n, run, boxes: room, split: best.split, more_pairs, change });
            }
        }
        for i in (0..group.len()).rev() {
            if let Some(children) = group[i].children()
                && children.iter().any(|&child| group[child].changes)
            {
                group[i].changes = true;
                above.push(group[i].n);
            }
        }
    }

    /// Adds the nodes below those seen, and the runs of leaves.
    fn walk(&self, seen: &mut Vec<Seen>) {
        let mut i = 0;
        while i < seen.len() {
            let node = &self.nodes[seen[i].n as usize];
            if node.is_dynamic() && node.is_leaf() {
                let cost = node.sah_term();
                prefetch(self.order, node.first());
                if (1..=self.longest as usize).contains(&node.count()) {
                    let (first, count) = (node.first() as u32, node.count() as u32);
                    seen[i].run = Run { first, count, cost, leaves: cost };
                }
            } else if node.is_dynamic() {
                let pair = node.first();
                prefetch(self.nodes, pair);
                seen[i].children = seen.len() as u32;
                let depth = seen[i].depth + 1;
                seen.extend([pair, pair + 1].map(|child| Seen::new(child, depth)));
            }
            i += 1;
        }
    }

    /// Finds the longest runs below the first `roots` of the nodes seen, and these.
    fn find_longest(&self, seen: &mut [Seen], roots: usize, longest: &mut Vec<u32>) {
        let mut found = |seen: &Seen, i: usize| {
            if seen.run.count > 1 && seen.depth + seen.run.count - 1 <= MAX_HEIGHT {
                longest.push(i as u32);
            }
        };
        for i in (0..seen.len()).rev() {
            if let Some(children) = seen[i].children() {
                let [l, r] = children.map(|child| seen[child].run);
                let are_runs = l.count > 0 && r.count > 0;
                let meet = l.first + l.count == r.first || r.first + r.count == l.first;
                if are_runs && meet && l.count + r.count <= self.longest {
                    let node = &self.nodes[seen[i].n as usize];
                    let own = node.sah_term();
                    let (first, count) = (l.first.min(r.first), l.count + r.count);
                    let (cost, leaves) = (own + (l.cost + r.cost), l.leaves + r.leaves);
                    seen[i].run = Run { first, count, cost, leaves };
                    seen[i].pairs = 1 + children.iter().map(|&child| seen[child].pairs).sum::<u32>();
                } else {
                    children.into_iter().for_each(|child| found(&seen[child], child));
                }
            }
            if i < roots {
                found(&seen[i], i);
            }
        }
    }

    /// Asks for the primitives of a run, if there is one.
    fn prefetch_slots(&self, seen: &[Seen], root: Option<&u32>, ask_for: impl Fn(usize)) {
        if let Some(&root) = root {
            seen[root as usize].run.slots(self.order).iter().for_each(|&p| ask_for(p as usize));
        }
    }
}

/// The tree, to be changed.
struct Writer<'a> {
    nodes: &'a mut [Node],
    /// The scene's scale.
    scale: f64,
    /// The first of the pairs that are kept for later (`State::spare_pair`).
    spare: u32,
    change: LeafChange,
}

impl Writer<'_> {
    /// Whether anything has changed.
    fn carry_out(&mut self, plans: &Plans) -> bool {
        let mut is_changed = false;
        for (i, new) in plans.runs.iter().enumerate() {
            if let Some(soon) = plans.runs.get(i + 2 * AHEAD) {
                prefetch(self.nodes, soon.n as usize);
            }
            if let Some(sooner) = plans.runs.get(i + AHEAD).map(|run| &self.nodes[run.n as usize])
                && !sooner.is_leaf()
            {
                prefetch(self.nodes, sooner.first());
            }
            let n = new.n as usize;
            if self.has_spare(new.more_pairs) {
                self.release(n);
                self.nodes[n] = self.write(new, 0, new.run.count as usize);
                self.change.all += new.change.all;
                self.change.leaves += new.change.leaves;
                is_changed = true;
            }
        }
        if is_changed {
            plans.above.iter().for_each(|&n| self.refit(n as usize));
        }
        is_changed
    }

    /// Whether there are `count` spare pairs.
    fn has_spare(&self, count: u32) -> bool {
        let mut spare = self.spare;
        for _ in 0..count {
            if spare == 0 {
                return false;
            }
            spare = self.nodes[spare as usize].first() as u32;
        }
        true
    }

    /// Keeps the pairs below node `n` for later.
    fn release(&mut self, n: usize) {
        if !self.nodes[n].is_leaf() {
            let pair = self.nodes[n].first();
            self.release(pair);
            self.release(pair + 1);
            self.nodes[pair] = Node::leaf(Aabb::EMPTY, self.spare, 0);
            self.nodes[pair + 1] = Node::NOTHING;
            self.spare = pair as u32;
        }
    }

    /// The root of a new subtree over the primitives `from..to` of a run, with the nodes below it
    /// in spare pairs.
    fn write(&mut self, new: &NewRun, from: usize, to: usize) -> Node {
        let split = usize::from(new.split[from][to - 1]);
        if split == 0 {
            let aabb = new.boxes[from..to].iter().copied().fold(Aabb::EMPTY, Aabb::union);
            return Node::leaf(aabb, new.run.first + from as u32, (to - from) as u32);
        }
        let pair = self.spare as usize;
        self.spare = self.nodes[pair].first() as u32;
        self.nodes[pair] = self.write(new, from, split);
        self.nodes[pair + 1] = self.write(new, split, to);
        let mut node = Node::parent(&self.nodes[pair], &self.nodes[pair + 1], pair as u32);
        node.set_reference((node.aabb().half_area_f64() / self.scale) as f32);
        node
    }

    /// Fits a node to its children. The box is the same; the height may not be.
    fn refit(&mut self, n: usize) {
        let pair = self.nodes[n].first();
        let (l, r) = (self.nodes[pair], self.nodes[pair + 1]);
        self.nodes[n].refit(&l, &r);
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicUsize, Ordering};

    use bvh_build::{Builder, build};
    use bvh_core::{Vec3, sah_cost};

    use super::*;
    use crate::refit::{RefitScratch, pass};

    const N: usize = 20_000;

    /// Whether a box moves: a fifth stand still.
    fn moves(i: usize) -> bool {
        i % 10 > 1
    }

    /// Boxes by twos, so far apart if they move.
    fn boxes(apart: f32) -> Vec<Aabb> {
        let apart = |i: usize| if moves(i) { (i % 2) as f32 * apart } else { 0.0 };
        let place = |i: usize, k: usize| (i / 2 * k % 101) as f32 + apart(i);
        (0..N)
            .map(|i| Vec3::new(place(i, 1), place(i, 7), (i / 2 / 101) as f32))
            .map(|corner| Aabb::new(corner, corner + 0.5))
            .collect()
    }

    fn step<P: Primitives>(bvh: &mut Bvh, primitives: &P) -> LeafChange {
        let always = Schedule::new(1, 0);
        change_leaves(bvh, primitives, always, LONGEST as u32, 1.0, &mut LeafScratch::default())
    }

    fn in_use(bvh: &Bvh) -> usize {
        let mut count = 0;
        bvh.visit(|_, _, _| count += 1);
        count
    }

    #[test]
    fn leaves_merge_and_split_to_the_same_tree_on_all_numbers_of_threads() {
        let (together, apart) = (boxes(0.0), boxes(30.0));
        let start = build(&together, Builder::Sweep).expect("few");
        let mut trees = Vec::new();
        for threads in [1, 2, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut bvh = start.clone();
                bvh.set_dynamic(moves);
                for (boxes, merge) in [(&together, true), (&apart, false)] {
                    pass(&mut bvh, boxes, None, &mut RefitScratch::default());
                    let (cost, nodes) = (sah_cost(&bvh), in_use(&bvh));
                    let root = bvh.root().aabb().half_area_f64();
                    let change = step(&mut bvh, boxes);
                    bvh.validate(boxes).expect("valid");
                    assert!(((cost + change.all / root) / sah_cost(&bvh) - 1.0).abs() < 1e-9);
                    let pairs = 2 * (N / 2 * 4 / 5);
                    let expected = if merge { nodes - pairs } else { nodes + pairs };
                    assert_eq!(in_use(&bvh), expected);
                }
                trees.push(bvh.fingerprint());
            });
        }
        assert!(trees.iter().all(|&tree| tree == trees[0]));
    }

    /// Boxes that panic once they have been asked for a given number of times.
    struct Fragile(Vec<Aabb>, AtomicUsize);

    impl Primitives for Fragile {
        fn len(&self) -> usize {
            self.0.len()
        }

        fn bounds(&self, i: usize) -> Aabb {
            let left = self.1.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
            assert!(left.is_ok(), "asked once too often");
            self.0[i]
        }
    }

    #[test]
    fn nothing_has_changed_if_primitives_panic() {
        let together = boxes(0.0);
        let mut bvh = build(&together, Builder::Sweep).expect("few");
        let (hash, state) = (bvh.fingerprint(), *bvh.update_state());
        for calls in [0, 10, N / 2, N - 1] {
            let fragile = Fragile(together.clone(), calls.into());
            let panics = AssertUnwindSafe(|| step(&mut bvh, &fragile));
            assert!(catch_unwind(panics).is_err());
            assert_eq!((bvh.fingerprint(), *bvh.update_state()), (hash, state));
        }
        step(&mut bvh, &Fragile(together.clone(), N.into()));
        assert_ne!(bvh.fingerprint(), hash);
    }
}
