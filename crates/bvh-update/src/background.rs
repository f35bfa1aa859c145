//! Rebuilding in the background (Ize, Wald, Parker 2007; with a parallel builder: Wald, Ize, Parker 2008).
//!
//! A copy of all boxes goes to a thread of its own, which builds a tree over it while updates go on with the old tree.
//! The update that finds the new tree ready fits it to the present primitives, puts it in the place of the old one and
//! sends the next copy. No update waits. The price, measured: [`BackgroundCost`].

use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bvh_build::{BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, History, Parts, Primitives};
use rayon::prelude::*;

use crate::decision::Decision;
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::strategy::{Rotate, Update, UpdateError, note_moving, options_like};
use crate::sweep::is_linear;

/// How trees are built in the background. One [`Scratch`] has one build under way, so each tree wants its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// The budget of rotations between one new tree and the next, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Who builds them. A parallel builder runs in the global rayon pool, where it may get in the way of the caller.
    pub builder: Builder,
}

impl Default for Background {
    fn default() -> Self {
        Self { rotate: None, builder: Builder::Binned }
    }
}

/// What the last tree that was built in the background cost, from [`Scratch::background_cost`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BackgroundCost {
    /// Memory beside the tree in use, in bytes: the second tree, the copy of all boxes, and what the builder keeps. With
    /// the default builder and one primitive a leaf 68, 24 and 64 or more a primitive, and one more where some stand still.
    pub bytes: usize,
    /// Updates from the copy of the boxes to the one that put the tree in place: how many frames older than the
    /// primitives its structure is by then. Until the next one comes it grows older.
    pub delay: u32,
    /// Time that its thread was busy, by the wall clock: what was taken from the cores, as far as there was one free; of a
    /// parallel builder the thread's own part.
    pub build_time: Duration,
}

/// A copy of the boxes, and a tree over them once it is built.
#[derive(Default)]
struct Job {
    /// Unlike that of any other, and noted in the history of the tree it is for; 0 if it is for none.
    number: u64,
    boxes: Vec<Aabb>,
    /// Which primitives move; empty if all do.
    moving: Vec<bool>,
    bvh: Bvh,
    scratch: BuildScratch,
    took: Duration,
}

impl Job {
    fn bytes(&self) -> usize {
        let Self { boxes, moving, bvh, scratch, .. } = self;
        boxes.capacity() * size_of::<Aabb>() + moving.capacity() + bvh.memory_usage() + scratch.memory_usage()
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
    cost: Option<BackgroundCost>,
}

impl Builds {
    /// Starts a build over a copy of the boxes, if the system has a thread to give.
    fn start<P: Primitives + ?Sized>(&mut self, bvh: &mut Bvh, primitives: &P, builder: Builder) {
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let mut job = std::mem::take(&mut self.spare);
        let options = options_like(bvh);
        let History { background_job, background_knows_moving, .. } = *bvh.history();
        let is_known = background_knows_moving && job.number > 0 && job.number == background_job;
        if !is_known && !note_moving(bvh, &mut job.moving) {
            job.moving.clear();
        }
        job.number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let number = job.number;
        // With all threads: the update that swaps trees does this, too.
        (0..primitives.len()).into_par_iter().map(|i| primitives.aabb(i)).collect_into_vec(&mut job.boxes);
        let build = move || {
            let start = Instant::now();
            let Job { boxes, moving, bvh, scratch, .. } = &mut job;
            let built = rebuild(bvh, boxes, builder, &options, scratch);
            built.expect("as many primitives as a tree holds");
            // What the update that finds it would otherwise have to do.
            if !moving.is_empty() {
                bvh.set_dynamic(|p| moving[p]);
            }
            let Parts { nodes, history, .. } = raw::parts(bvh);
            history.largest_leaf = options.max_leaf_size;
            is_linear(nodes, history);
            job.took = start.elapsed();
            job
        };
        self.age = 0;
        self.current = std::thread::Builder::new().spawn(build).ok();
        let history = raw::parts(bvh).history;
        history.background_job = if self.current.is_some() { number } else { 0 };
        history.background_knows_moving = true;
    }

    /// The tree of build `number`, if it is ready; trees of other builds are of no use to who asks.
    fn take(&mut self, number: u64) -> Option<&mut Bvh> {
        let thread = self.current.take_if(|thread| thread.is_finished())?;
        // A panic there has been told already; the next build starts from nothing.
        self.spare = thread.join().unwrap_or_default();
        (number > 0 && self.spare.number == number).then_some(&mut self.spare.bvh)
    }
}

impl Scratch {
    /// What the last tree cost that was built in the background with this memory and took over; `None` before there was
    /// one.
    #[must_use]
    pub fn background_cost(&self) -> Option<BackgroundCost> {
        self.background.cost
    }
}

impl Drop for Builds {
    /// Waits for the build under way, so that no thread outlives what started it.
    fn drop(&mut self) {
        let Some(thread) = self.current.take() else { return };
        // A parallel builder may be waiting for this very worker of the pool.
        while !thread.is_finished() && rayon::yield_now().is_some() {
            std::thread::yield_now();
        }
        let _ = thread.join();
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    background: &Background,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let mut decision = Decision::AsAlways;
    let History { background_job: number, background_knows_moving: knows_moving, .. } = *bvh.history();
    scratch.background.age = scratch.background.age.saturating_add(1);
    // The memory may have served another tree in between.
    if let Some(new) = scratch.background.take(number).filter(|new| new.len() == primitives.len()) {
        if !knows_moving {
            let any_still = note_moving(bvh, &mut scratch.moving);
            new.set_dynamic(|p| !any_still || scratch.moving[p]);
        }
        std::mem::swap(bvh, new);
        let history = raw::parts(bvh).history;
        (history.background_job, history.background_knows_moving) = (number, knows_moving);
        decision = Decision::Swap;
        let Builds { spare, age, cost, .. } = &mut scratch.background;
        *cost = Some(BackgroundCost { bytes: spare.bytes(), delay: *age, build_time: spare.took });
    }
    let tally = pass(bvh, primitives, background.rotate, scratch);
    if scratch.background.current.is_none() {
        scratch.background.start(bvh, primitives, background.builder);
    }
    Ok(Update { decision, rebuilt: decision == Decision::Swap, ..tally.update(bvh) })
}
