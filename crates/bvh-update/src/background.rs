//! Rebuilding in the background (Ize, Wald, Parker 2007; with a parallel builder: Wald, Ize, Parker 2008).
//!
//! A copy of all boxes goes to a thread of its own, which builds a tree over it while updates go on with the old tree.
//! The update that finds the new tree ready fits it to the present primitives, puts it in the place of the old one and
//! sends the next copy. No update waits. The price: a second tree, 24 bytes a primitive for the copy, a core for the
//! thread, and a tree whose structure is as old as its build took.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, Primitives};

use crate::auto::Decision;
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::strategy::{Rotate, Update, UpdateError};

/// How trees are built in the background.
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

/// A copy of the boxes, and a tree over them once it comes back.
struct Job {
    boxes: Vec<Aabb>,
    bvh: Bvh,
    builder: Builder,
}

/// The thread that builds, and what it is at.
pub(crate) struct Worker {
    /// `None` only while this is dropped.
    jobs: Option<Sender<Job>>,
    done: Receiver<Job>,
    thread: Option<JoinHandle<()>>,
    /// Number of the job that it works at; 0 for none.
    current: u64,
    /// Memory of the job before.
    spare: Option<Job>,
}

impl Worker {
    fn start() -> Self {
        let (jobs, todo) = channel::<Job>();
        let (finished, done) = channel();
        let thread = std::thread::spawn(move || {
            let mut scratch = BuildScratch::new();
            for mut job in todo {
                let options = BuildOptions::default();
                let built = rebuild(&mut job.bvh, &job.boxes, job.builder, &options, &mut scratch);
                if built.is_err() || finished.send(job).is_err() {
                    break;
                }
            }
        });
        Self { jobs: Some(jobs), done, thread: Some(thread), current: 0, spare: None }
    }

    /// Sends a copy of the boxes off; gives the job's number, unlike that of any other, or 0 if the thread has ended.
    fn send<P: Primitives + ?Sized>(&mut self, primitives: &P, builder: Builder) -> u64 {
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let (mut boxes, bvh) = self.spare.take().map_or_else(Default::default, |job| (job.boxes, job.bvh));
        boxes.clear();
        boxes.extend((0..primitives.len()).map(|i| primitives.aabb(i)));
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(Job { boxes, bvh, builder }).is_ok());
        self.current = if sent { NUMBER.fetch_add(1, Ordering::Relaxed) } else { 0 };
        self.current
    }
}

impl Drop for Worker {
    /// Waits for the tree being built, if any.
    fn drop(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            // A panic there has been told already.
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
    let mut worker = scratch.background.take().unwrap_or_else(Worker::start);
    let mut swapped = false;
    match worker.done.try_recv() {
        Ok(mut job) => {
            // A tree over primitives of somebody else, who used the same scratch memory, is of no use here.
            if bvh.history().background_job == worker.current && job.bvh.len() == primitives.len() {
                std::mem::swap(bvh, &mut job.bvh);
                swapped = true;
            }
            (worker.spare, worker.current) = (Some(job), 0);
        }
        Err(TryRecvError::Empty) => {}
        // It cannot go on: start again with the next update.
        Err(TryRecvError::Disconnected) => worker = Worker::start(),
    }
    let tally = pass(bvh, primitives, background.rotate, scratch);
    if worker.current == 0 {
        raw::parts(bvh).history.background_job = worker.send(primitives, background.builder);
    }
    scratch.background = Some(worker);
    let decision = if swapped { Decision::Swap } else { Decision::AsAlways };
    Ok(Update { decision, ..tally.update(bvh) })
}
