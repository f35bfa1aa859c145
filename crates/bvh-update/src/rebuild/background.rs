//! Rebuilding in the background (Ize, Wald, Parker 2007; with a parallel builder: Wald, Ize, Parker
//! 2008).
//!
//! A copy of all boxes goes to a thread of its own, which builds a tree over it while updates go on
//! with the old tree. The update that finds the new tree ready fits it to the present primitives,
//! puts it in the place of the old one and sends the next copy. No update waits. The price,
//! measured: [`BackgroundCost`].

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bvh_build::{BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, Parts, Primitives};
use rayon::prelude::*;

use super::{RebuildScratch, options_like};
use crate::refit::{PassOptions, Rotate, SMALL, detect_linear, parts, pass};
use crate::report::{Decision, Update};
use crate::state::State;

/// How trees are built in the background. An [`Updater`](crate::Updater) has one build under way.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Background {
    /// The budget of rotations between one new tree and the next, if any are wanted.
    pub rotate: Option<Rotate>,
    /// The builder used. A parallel builder gets a rayon pool of its own, of as many threads as the
    /// caller's pool; of several such builds in one process each waits for the one before.
    pub builder: Builder,
}

bvh_core::with_methods!(Background: with_rotate(rotate: Option<Rotate>), with_builder(builder: Builder));

impl Default for Background {
    fn default() -> Self {
        Self { rotate: None, builder: Builder::Binned }
    }
}

/// What the last tree that was built in the background cost, from
/// [`Updater::background_cost`](crate::Updater::background_cost).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BackgroundCost {
    /// Memory beside the tree in use, in bytes: the second tree, the copy of all boxes, and what
    /// the builder keeps. With the default builder and one primitive a leaf 68, 24 and 64 or more a
    /// primitive. Where some are static, the updater has one byte a primitive more, which is not
    /// counted here.
    pub bytes: usize,
    /// Updates of [`Background`] by this updater, of any tree, from the copy of the boxes to the
    /// one that put the tree in place: with one tree, the age of its structure in frames when it
    /// takes over.
    pub delay: u32,
    /// Time that its thread was busy, by the wall clock; where a core was free, this is the time
    /// taken from the cores. Of a parallel builder it is the thread's own part.
    pub build_time: Duration,
}

/// A copy of the boxes, and a tree over them once it is built.
#[derive(Default)]
struct Job {
    /// Unlike that of any other, and kept in the state of the tree it is for; 0 if it is for none.
    number: u64,
    boxes: Vec<Aabb>,
    bvh: Bvh,
    scratch: BuildScratch,
    took: Duration,
}

impl Job {
    fn bytes(&self) -> usize {
        let Self { boxes, bvh, scratch, .. } = self;
        boxes.capacity() * size_of::<Aabb>() + bvh.memory_usage() + scratch.memory_usage()
    }
}

/// The build under way, if any, and the memory of the one before.
#[derive(Default)]
pub(crate) struct Builds {
    current: Option<JoinHandle<Job>>,
    spare: Job,
    /// Updates since it was started.
    age: u32,
    /// Of the last tree that took over.
    pub(crate) cost: Option<BackgroundCost>,
}

impl Builds {
    /// Starts a build over a copy of the boxes, if the system has a thread to give.
    fn start<P: Primitives + ?Sized>(&mut self, bvh: &mut Bvh, primitives: &P, builder: Builder) {
        if cfg!(all(target_arch = "wasm32", target_os = "unknown")) {
            // No thread can be had, and each update would copy all boxes to find that out.
            return;
        }
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let mut job = std::mem::take(&mut self.spare);
        let options = options_like(bvh);
        job.number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let number = job.number;
        // With all threads: the update that swaps trees does this, too.
        let numbers = (0..primitives.len()).into_par_iter().with_min_len(SMALL);
        numbers.map(|i| primitives.aabb(i)).collect_into_vec(&mut job.boxes);
        let build = move || {
            let start = Instant::now();
            let Job { boxes, bvh, scratch, .. } = &mut job;
            rebuild(bvh, boxes, builder, &options, scratch).expect("as many primitives as a tree holds");
            // What the update that finds it would otherwise have to do.
            let Parts { nodes, state, .. } = parts(bvh);
            let state = State::of_mut(state);
            state.largest_leaf = options.max_leaf_size;
            detect_linear(nodes, state);
            job.took = start.elapsed();
            job
        };
        let threads = rayon::current_num_threads();
        let run = move || if is_serial(builder) { build() } else { in_own_pool(threads, build) };
        self.age = 0;
        self.current = std::thread::Builder::new().spawn(run).ok();
        let is_begun = self.current.is_some();
        State::of_mut(parts(bvh).state).background_job = if is_begun { number } else { 0 };
    }

    /// The tree of build `number`, if it is ready; trees of other builds are of no use to who asks.
    fn take(&mut self, number: u64) -> Option<&mut Bvh> {
        let thread = self.current.take_if(|thread| thread.is_finished())?;
        // A panic there has been reported already; the next build starts from nothing.
        self.spare = thread.join().unwrap_or_default();
        (number > 0 && self.spare.number == number).then_some(&mut self.spare.bvh)
    }
}

/// Builders that start no task of a rayon pool when a plain thread calls them.
fn is_serial(builder: Builder) -> bool {
    matches!(builder, Builder::Sweep | Builder::Binned | Builder::HillClimbed | Builder::Annealed)
}

/// Runs a build in a new rayon pool. If the system has no threads to give, the build panics, and
/// the next update starts another one.
///
/// One build at a time: workers that wait for a part of one build would otherwise begin others on
/// the same stack.
fn in_own_pool<T: Send>(threads: usize, build: impl FnOnce() -> T + Send) -> T {
    static TURN: Mutex<()> = Mutex::new(());
    // A build that panicked leaves nothing behind.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads for a pool");
    pool.install(build)
}

impl Drop for Builds {
    /// Waits for the build under way, so that no thread outlives what started it.
    ///
    /// The wait blocks. It runs no other task of the caller's pool, since such a task could drop
    /// another `Updater` on the same stack, or ask for a lock that the caller holds. It ends, since
    /// a build needs no thread of any other pool.
    fn drop(&mut self) {
        if let Some(thread) = self.current.take() {
            let _ = thread.join();
        }
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    background: &Background,
    passes: &PassOptions,
    rebuild: &mut RebuildScratch,
    builds: &mut Builds,
) -> Update {
    let (mut decision, mut has_static) = (Decision::AsAlways, false);
    let number = State::of(bvh).background_job;
    builds.age = builds.age.saturating_add(1);
    // `builds` is of the updater, which may have updated another tree in between.
    if let Some(new) = builds.take(number).filter(|new| new.len() == bvh.len()) {
        has_static = bvh.note_dynamic(&mut rebuild.dynamic);
        let marked = bvh.update_state().changes.dynamic;
        std::mem::swap(bvh, new);
        State::count_rebuild(parts(bvh).state, marked);
        decision = Decision::Swap;
        let Builds { spare, age, cost, .. } = builds;
        *cost = Some(BackgroundCost { bytes: spare.bytes(), delay: *age, build_time: spare.took });
    }
    let tally = pass(bvh, primitives, background.rotate, passes);
    let update = Update { decision, rebuilt: decision == Decision::Swap, ..tally.report(bvh) };
    if has_static {
        // Not before the pass: what moved and came to rest during the build has yet to be fitted.
        bvh.set_dynamic(|p| rebuild.dynamic[p]);
        State::note_changes(parts(bvh).state);
    }
    if builds.current.is_none() {
        builds.start(bvh, primitives, background.builder);
    }
    update
}
