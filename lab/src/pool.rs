//! The threads that everything timed runs on.

use anyhow::{Context, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads that the paper's machine ran (section 3).
pub(crate) const PAPER_THREADS: usize = 8;

/// The option `--threads`.
#[derive(clap::Args)]
pub(crate) struct Threads {
    /// Threads for updates and rendering [default: the paper's 8, or the cores there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
}

impl Threads {
    /// How many: the paper's number, or as many as this machine has cores, unless something is
    /// given.
    pub(crate) fn count(&self) -> usize {
        self.threads.map_or_else(|| cores().min(PAPER_THREADS), |n| n as usize)
    }

    /// A pool of that many threads.
    pub(crate) fn pool(&self) -> Result<ThreadPool> {
        pool(self.count())
    }
}

/// Hardware threads that this process may use.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A pool of that many threads.
pub(crate) fn pool(threads: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .with_context(|| format!("{threads} threads cannot be started; fewer may do"))
}
