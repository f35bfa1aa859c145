//! One pass over a whole tree: a block at the top, and below it subtrees that threads share out.

use std::sync::atomic::{AtomicUsize, Ordering};

use bvh_build::{BuildScratch, ReinsertScratch};
use bvh_core::{Bvh, InOrder, Primitives, SimdLevel};
use rayon::prelude::*;

use crate::background::Builds;
use crate::block::{Block, Lists, NESTED, Next, Roots, Tally, Task, process};
use crate::clock::Clock;
use crate::cut::CutScratch;
use crate::kernels::{Fitted, fit_leaf};
use crate::raw::{self, Available};

use crate::strategy::{Rotate, Turn};

/// Subtrees that a thread takes at a time.
const TOP_ROOTS: usize = 16;

/// Memory that updates keep from frame to frame: well below 1 MiB a thread, whatever the size of the tree, and what
/// rebuilds take, if any are made. It has no influence on results, but for [`Auto`](crate::Auto) by the clock.
pub struct Scratch {
    pub(crate) build: BuildScratch,
    pub(crate) cut: CutScratch,
    pub(crate) reinsert: ReinsertScratch,
    pub(crate) background: Builds,
    pub(crate) clock: Clock,
    /// Which primitives move, while the tree that knows it is built anew.
    pub(crate) moving: Vec<bool>,
    level: Available,
    top: Block,
    top_lists: Box<Lists>,
    workers: Vec<Worker>,
    tallies: Vec<Tally>,
}

struct Worker {
    blocks: Vec<Block>,
    lists: Box<Lists>,
    done: Vec<(usize, Tally)>,
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
            background: Builds::default(),
            clock: Clock::default(),
            moving: Vec::new(),
            level,
            top: Block::new(),
            top_lists: Lists::new(),
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
    let parts = raw::parts(bvh);
    let nodes = raw::share(parts.nodes);
    let level = scratch.level;
    let rotations = rotate.map(|rotate| Turn::new(rotate, parts.history.updates));
    parts.history.updates = parts.history.updates.wrapping_add(1);
    let tally = if in_order {
        run(&Task { nodes, primitives, rotations, level }, scratch)
    } else {
        let primitives = &InOrder { primitives, order: parts.order };
        run(&Task { nodes, primitives, rotations, level }, scratch)
    };
    *parts.still_area += tally.still_area;
    tally
}

fn run<P: Primitives + ?Sized>(task: &Task<'_, P>, scratch: &mut Scratch) -> Tally {
    let mut tally = Tally::default();
    let root = task.nodes.get(0);
    if !root.moves() {
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
    let chunks = || top.frontier().into_iter().flat_map(|roots| roots.chunks(TOP_ROOTS));
    tallies.clear();
    tallies.resize(chunks().count(), Tally::default());
    subtrees(task, chunks, workers, tallies);
    // In the order of the subtrees, whoever worked on them: sums of floats depend on it.
    tallies.iter().for_each(|t| tally.add(t));
    top.ascend(task, top_lists, &mut tally);
    tally
}

/// Processes the subtrees of all chunks; each thread of the pool takes one chunk after the other.
fn subtrees<'a, P: Primitives + ?Sized, C: Iterator<Item = Roots<'a>>>(
    task: &Task<'_, P>,
    chunks: impl Fn() -> C + Sync,
    workers: &mut Vec<Worker>,
    tallies: &mut [Tally],
) {
    let threads = rayon::current_num_threads().min(tallies.len());
    while workers.len() < threads {
        let blocks = std::iter::repeat_with(Block::new).take(NESTED).collect();
        workers.push(Worker { blocks, lists: Lists::new(), done: Vec::new() });
    }
    let next = AtomicUsize::new(0);
    let count = tallies.len();
    let work = |worker: &mut Worker| {
        worker.done.clear();
        worker.done.reserve(count);
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(chunk) = chunks().nth(i) else { break };
            let mut tally = Tally::default();
            process(task, chunk, Next::default(), &mut worker.blocks, &mut worker.lists, &mut tally);
            worker.done.push((i, tally));
        }
    };
    match threads {
        0 => {}
        1 => work(&mut workers[0]),
        _ => workers[..threads].par_iter_mut().with_max_len(1).for_each(work),
    }
    for worker in &workers[..threads] {
        worker.done.iter().for_each(|&(i, tally)| tallies[i] = tally);
    }
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Vec3};

    use super::*;

    /// What `raw::share` promises: no two tasks touch a node, and none touches what the top block reads or writes
    /// while they run. Tasks touch the slots of their roots and everything below, and read the first pair.
    #[test]
    fn tasks_touch_disjoint_nodes() {
        for n in [100, 5000, 40_000] {
            let boxes: Vec<Aabb> = (0..n)
                .map(|i| Vec3::new((i % 61) as f32, (i % 53) as f32, (i % 47) as f32))
                .map(|p| Aabb::new(p, p + 0.5))
                .collect();
            let options = bvh_build::BuildOptions::default();
            let mut bvh =
                bvh_build::build(&boxes, bvh_build::Builder::Lbvh, &options, None).expect("few enough");
            bvh.set_moving(|p| p % 5 != 0);
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

            let mut owner = vec![None; tree.nodes().len()];
            let roots = top.frontier().into_iter().flat_map(|roots| roots.slots.to_vec());
            for root in roots {
                let mut below = vec![root as usize];
                while let Some(slot) = below.pop() {
                    assert_eq!(owner[slot].replace(root), None, "slot {slot} of {n}");
                    let node = &tree.nodes()[slot];
                    if !node.is_leaf() {
                        below.extend([node.first(), node.first() + 1]);
                    }
                }
            }
            assert!(n < 5000 || owner.iter().flatten().count() > n / 2, "most nodes belong to tasks");
        }
    }
}
