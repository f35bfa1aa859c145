//! The threads that everything timed runs on.

use anyhow::{Context, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads that the paper's machine ran (section 3).
pub(crate) const PAPER_THREADS: usize = 8;

/// The paper's number of threads, or as many as this machine has cores.
pub(crate) fn default_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from).min(PAPER_THREADS)
}

/// A pool of that many threads.
pub(crate) fn pool(threads: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .with_context(|| format!("{threads} threads cannot be started; fewer may do"))
}
