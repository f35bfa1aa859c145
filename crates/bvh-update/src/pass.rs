//! One pass over a whole tree: a block at the top, and below it subtrees that threads share out.

use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_build::{BuildScratch, ReinsertScratch};
use bvh_core::{Bvh, InOrder, Layout, Primitives, SimdLevel};
use rayon::prelude::*;

use crate::background::Builds;
use crate::block::{Block, Lists, NESTED, Next, Roots, Tally, Task, process};
use crate::clock::Clock;
use crate::cut::CutScratch;
use crate::kernels::{Fitted, fit_leaf};
use crate::raw::{self, Available};
use crate::settle::SettleScratch;
use crate::strategy::{Rotate, Turn};
use crate::sweep::{self, Pieces, is_linear, sweep};

/// Subtrees that a thread takes at a time.
const TOP_ROOTS: usize = 16;

/// Memory that updates keep from frame to frame: well below 1 MiB a thread, whatever the size of the tree; what rebuilds
/// and repairs take, if any are made, where the first repair reserves address space for the largest; and up to as much as the
/// tree where leaves are split and merged. It has no influence on results, but for [`Auto`](crate::Auto), which keeps here
/// what it has learned from [`visited`](Self::visited) and from the clock, and trees that are being built in the background.
pub struct Scratch {
    pub(crate) build: BuildScratch,
    pub(crate) cut: CutScratch,
    pub(crate) reinsert: ReinsertScratch,
    pub(crate) settle: SettleScratch,
    pub(crate) background: Builds,
    pub(crate) clock: Clock,
    /// Which primitives move, while the tree that knows it is built anew.
    pub(crate) moving: Vec<bool>,
    level: Available,
    top: Block,
    top_lists: Box<Lists>,
    pieces: Pieces,
    workers: Vec<Worker>,
    tallies: Vec<Tally>,
}

impl std::fmt::Debug for Scratch {
    /// The name alone: the rest is memory.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

struct Worker {
    blocks: Vec<Block>,
    lists: Box<Lists>,
    sweep: Box<[sweep::Lists; 2]>,
    done: Vec<(usize, Tally)>,
}

impl Worker {
    fn new() -> Self {
        let blocks = std::iter::repeat_with(Block::new).take(NESTED).collect();
        Self { blocks, lists: Lists::new(), sweep: Box::default(), done: Vec::new() }
    }
}

impl Scratch {
    /// Scratch memory for the best SIMD level of this machine.
    #[must_use]
    pub fn new() -> Self {
        Self::with_level(SimdLevel::best())
    }

    /// Scratch memory for `level`, or the best below it that the machine has.
    #[must_use]
    pub fn with_level(level: SimdLevel) -> Self {
        let level = Available::at_most(level);
        Self {
            build: BuildScratch::new(),
            cut: CutScratch::default(),
            reinsert: ReinsertScratch::new(),
            settle: SettleScratch::default(),
            background: Builds::default(),
            clock: Clock::default(),
            moving: Vec::new(),
            level,
            top: Block::new(),
            top_lists: Lists::new(),
            pieces: Pieces::default(),
            workers: Vec::new(),
            tallies: Vec::new(),
        }
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// Refits what moves; with `rotate`, rotates on the way up. The caller has checked that there are
/// as many primitives as the tree holds.
pub(crate) fn pass<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    rotate: Option<Rotate>,
    scratch: &mut Scratch,
) -> Tally {
    let in_order = bvh.is_in_order();
    let mut unfinished = raw::Unfinished::new(bvh);
    let parts = raw::parts(unfinished.bvh);
    let linear = rotate.is_none() && is_linear(parts.nodes, parts.history);
    if rotate.is_some() {
        // Rotations end it: beforehand, as primitives may panic half-way.
        parts.history.layout = Layout::Other;
    }
    let nodes = raw::share(parts.nodes);
    let level = scratch.level;
    let rotations = rotate.map(|rotate| Turn::new(rotate, parts.history.updates));
    parts.history.updates = parts.history.updates.wrapping_add(1);
    let tally = if in_order {
        run(&Task { nodes, primitives, rotations, level }, linear, scratch)
    } else {
        let primitives = &InOrder { primitives, order: parts.order };
        run(&Task { nodes, primitives, rotations, level }, linear, scratch)
    };
    *parts.static_area += tally.static_area;
    unfinished.done = true;
    tally
}

fn run<P: Primitives + ?Sized>(task: &Task<'_, P>, linear: bool, scratch: &mut Scratch) -> Tally {
    if linear { by_sweep(task, scratch) } else { by_blocks(task, scratch) }
}

/// Refits a linear tree, piece by piece and then what is above.
fn by_sweep<P: Primitives + ?Sized>(task: &Task<'_, P>, scratch: &mut Scratch) -> Tally {
    let Task { nodes, primitives, level, .. } = *task;
    let Scratch { pieces, workers, tallies, .. } = scratch;
    pieces.cut(nodes);
    share_out(pieces.pieces.len(), workers, tallies, |i, worker| {
        let mut tally = Tally::default();
        tally.add_fitted(sweep(level, nodes, primitives, pieces.pieces[i].clone(), &mut worker.sweep));
        tally
    });
    let mut tally = Tally::default();
    tallies.iter().for_each(|t| tally.add(t));
    pieces.fit_tops(nodes, primitives, &mut tally);
    tally
}

fn by_blocks<P: Primitives + ?Sized>(task: &Task<'_, P>, scratch: &mut Scratch) -> Tally {
    let mut tally = Tally::default();
    let root = task.nodes.get(0);
    if !root.is_dynamic() {
        return tally;
    }
    let Scratch { top, top_lists, workers, tallies, .. } = scratch;
    match root.height() {
        0 => {
            let mut fitted = Fitted::default();
            fit_leaf(task.nodes, task.primitives, 0, &mut fitted);
            tally.add_fitted(fitted);
            return tally;
        }
        1 => {
            top_lists.list_root(&root);
            top_lists.fit_twigs(task, Next::default(), &mut tally);
            return tally;
        }
        _ => top.gather(task, Roots { slots: &[0], pairs: &[root.first() as u32], depth: 0 }, top_lists),
    }
    top_lists.fit_twigs(task, Next::default(), &mut tally);
    share_out(chunks(top).count(), workers, tallies, |i, worker| {
        let mut tally = Tally::default();
        if let Some(chunk) = chunks(top).nth(i) {
            process(task, chunk, Next::default(), &mut worker.blocks, &mut worker.lists, &mut tally);
        }
        tally
    });
    tallies.iter().for_each(|t| tally.add(t));
    top.ascend(task, top_lists, &mut tally);
    tally
}

/// The subtrees below the top block, as threads take them.
fn chunks(top: &Block) -> impl Iterator<Item = Roots<'_>> {
    top.frontier().into_iter().flat_map(|roots| roots.chunks(TOP_ROOTS))
}

/// Does `work` for all numbers below `count`; each thread of the pool takes one after the other. Tallies are in the order
/// of the numbers, whoever worked on them, as sums of floats depend on it.
fn share_out(
    count: usize,
    workers: &mut Vec<Worker>,
    tallies: &mut Vec<Tally>,
    work: impl Fn(usize, &mut Worker) -> Tally + Sync,
) {
    let threads = rayon::current_num_threads().min(count);
    while workers.len() < threads {
        workers.push(Worker::new());
    }
    let next = AtomicUsize::new(0);
    let take_turns = |worker: &mut Worker| {
        worker.done.clear();
        worker.done.reserve(count);
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= count {
                break;
            }
            let tally = work(i, worker);
            worker.done.push((i, tally));
        }
    };
    match threads {
        0 => {}
        1 => take_turns(&mut workers[0]),
        _ => workers[..threads].par_iter_mut().with_max_len(1).for_each(take_turns),
    }
    tallies.clear();
    tallies.resize(count, Tally::default());
    for worker in &workers[..threads] {
        worker.done.iter().for_each(|&(i, tally)| tallies[i] = tally);
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};

    use super::*;

    /// A slot that two of the tasks touch, if there is one, and how many slots are touched at all. A task touches the
    /// slots of its roots and everything below.
    fn shared(tree: &Bvh, tasks: &[Vec<u32>]) -> (Option<usize>, usize) {
        let mut owner = vec![None; tree.nodes().len()];
        let (mut shared, mut touched) = (None, 0);
        for (number, roots) in tasks.iter().enumerate() {
            let mut below: Vec<usize> = roots.iter().map(|&root| root as usize).collect();
            while let Some(slot) = below.pop() {
                match owner[slot].replace(number) {
                    None => touched += 1,
                    Some(_) => shared = Some(slot),
                }
                let node = &tree.nodes()[slot];
                if !node.is_leaf() {
                    below.extend([node.first(), node.first() + 1]);
                }
            }
        }
        (shared, touched)
    }

    /// What `raw::share` promises: no two tasks touch a node, so that in whatever order threads take them, and however
    /// they interleave, each sees what it would see alone. That is every schedule at once.
    #[test]
    fn tasks_touch_disjoint_nodes() {
        for n in [100, 5000, 40_000] {
            let boxes: Vec<Aabb> = (0..n)
                .map(|i| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32))
                .map(|p| Aabb::new(p, p + 0.5))
                .collect();
            let options = bvh_build::BuildOptions::default();
            let mut bvh =
                bvh_build::build_with(&boxes, bvh_build::Builder::Lbvh, &options).expect("few enough");
            bvh.set_dynamic(|p| p % 5 != 0);
            // Rotations scatter nodes over the arena.
            for _ in 0..3 {
                pass(&mut bvh, &boxes, Some(Rotate::default()), &mut Scratch::new());
            }
            let tree = bvh.clone();
            let nodes = raw::share(raw::parts(&mut bvh).nodes);
            let level = Available::at_most(SimdLevel::best());
            let task = Task { nodes, primitives: &boxes, rotations: None, level };
            let (mut top, mut lists) = (Block::new(), Lists::new());
            let pairs = [tree.root().first() as u32];
            top.gather(&task, Roots { slots: &[0], pairs: &pairs, depth: 0 }, &mut lists);

            let mut tasks: Vec<Vec<u32>> = chunks(&top).map(|roots| roots.slots.to_vec()).collect();
            let (twice, touched) = shared(&tree, &tasks);
            assert_eq!(twice, None, "of {n}");
            if n < 5000 {
                continue;
            }
            assert!(tasks.len() > 10 && touched > n / 2, "most nodes belong to tasks");
            // The check finds a root in two tasks, and a task within another's.
            let inner = |&&slot: &&u32| !tree.nodes()[slot as usize].is_leaf();
            let root = *tasks[3].iter().find(inner).expect("larger than a leaf");
            for within in [root, tree.nodes()[root as usize].first() as u32] {
                tasks[7].push(within);
                assert!(shared(&tree, &tasks).0.is_some());
                tasks[7].pop();
            }
        }
    }
}
