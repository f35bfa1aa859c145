//! Progress of long work: a bar on a terminal, now and then a plain line otherwise.

use std::io::{IsTerminal, stderr};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::files;

/// Time between plain lines.
const QUIET: Duration = Duration::from_secs(10);

/// Work that is under way; shown on standard error, gone when dropped.
pub(crate) struct Progress {
    what: String,
    total: u64,
    bar: Option<ProgressBar>,
    last: Mutex<Instant>,
}

impl Progress {
    /// Starts work on `what`, in `total` steps.
    pub(crate) fn new(what: impl Into<String>, total: u64) -> Self {
        let what = what.into();
        let bar = stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{msg} {wide_bar:.blue/dim} {pos}/{len}, {eta} left");
            let bar = ProgressBar::new(total).with_message(what.clone());
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        });
        Self { what, total, bar, last: Mutex::new(Instant::now()) }
    }

    /// Says how many steps are done.
    pub(crate) fn at(&self, done: u64) {
        if let Some(bar) = &self.bar {
            bar.set_position(done);
        } else if let Ok(mut last) = self.last.lock()
            && last.elapsed() >= QUIET
        {
            *last = Instant::now();
            files::remark(&format!("{}: {done} of {}", self.what, self.total));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
