//! Rebuilding in the background (Ize, Wald, Parker 2007; with a parallel builder: Wald, Ize, Parker 2008).
//!
//! A copy of all boxes goes to a thread of its own, which builds a tree over it while updates go on with the old tree.
//! The update that finds the new tree ready fits it to the present primitives, puts it in the place of the old one and
//! sends the next copy. No update waits. The price: 68 bytes a primitive for a second tree, 24 for the copy, and what the
//! builder takes (see [`rebuild`]; 64 binned); a core for the thread; and a tree whose structure is as old as its build
//! took.

use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;

use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, Primitives};

use crate::auto::Decision;
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::strategy::{Rotate, Update, UpdateError, note_moving};

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

/// A copy of the boxes, and a tree over them once it is built.
#[derive(Default)]
struct Job {
    boxes: Vec<Aabb>,
    bvh: Bvh,
    scratch: BuildScratch,
}

/// The build under way, if any, and the memory of the one before.
#[derive(Default)]
pub(crate) struct Builds {
    /// With the number that the tree it is for has noted.
    current: Option<(u64, JoinHandle<Job>)>,
    spare: Job,
}

impl Builds {
    /// Starts a build over a copy of the boxes; gives its number, unlike that of any other.
    fn start<P: Primitives + ?Sized>(&mut self, primitives: &P, builder: Builder) -> u64 {
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut job = std::mem::take(&mut self.spare);
        job.boxes.clear();
        job.boxes.extend((0..primitives.len()).map(|i| primitives.aabb(i)));
        let build = move || {
            let Job { boxes, bvh, scratch } = &mut job;
            let built = rebuild(bvh, boxes, builder, &BuildOptions::default(), scratch);
            built.expect("as many primitives as a tree holds");
            job
        };
        self.current = Some((number, std::thread::spawn(build)));
        number
    }

    /// The tree of build `number`, if it is ready; trees of other builds are of no use to who asks.
    fn take(&mut self, number: u64) -> Option<&mut Bvh> {
        let (current, thread) = self.current.take_if(|(_, thread)| thread.is_finished())?;
        // A panic there has been told already; the next build starts from nothing.
        self.spare = thread.join().unwrap_or_default();
        (current == number).then_some(&mut self.spare.bvh)
    }
}

impl Drop for Builds {
    /// Waits for the build under way, so that no thread outlives what started it.
    fn drop(&mut self) {
        if let Some((_, thread)) = self.current.take() {
            let _ = thread.join();
        }
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    background: &Background,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let mut decision = Decision::AsAlways;
    let number = bvh.history().background_job;
    // The memory may have served another tree in between.
    if let Some(new) = scratch.background.take(number).filter(|new| new.len() == primitives.len()) {
        if note_moving(bvh, &mut scratch.moving) {
            new.set_moving(|p| scratch.moving[p]);
        }
        std::mem::swap(bvh, new);
        decision = Decision::Swap;
    }
    let tally = pass(bvh, primitives, background.rotate, scratch);
    if scratch.background.current.is_none() {
        let number = scratch.background.start(primitives, background.builder);
        raw::parts(bvh).history.background_job = number;
    }
    Ok(Update { decision, rebuilt: decision == Decision::Swap, ..tally.update(bvh) })
}
