//! Progress of long work: a bar on a terminal, now and then a plain line otherwise.

use std::io::{IsTerminal, stderr};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anim::printable;
use indicatif::{ProgressBar, ProgressStyle};

use crate::files;

/// Time between plain lines.
const QUIET: Duration = Duration::from_secs(10);

/// Work that is under way; shown on standard error, gone when dropped.
pub(crate) struct Progress {
    what: String,
    total: u64,
    bar: Option<ProgressBar>,
    start: Instant,
    last: Mutex<Instant>,
}

impl Progress {
    /// Starts work on `what`, in `total` steps.
    pub(crate) fn new(what: impl Into<String>, total: u64) -> Self {
        let what = printable(&what.into());
        let bar = stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{msg} {wide_bar:.blue/dim} {pos}/{len}, {eta} left");
            let bar = ProgressBar::new(total).with_message(what.clone());
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        });
        let start = Instant::now();
        Self { what, total, bar, start, last: Mutex::new(start) }
    }

    /// Says how many steps are done.
    pub(crate) fn at(&self, done: u64) {
        if let Some(bar) = &self.bar {
            bar.set_position(done);
        } else if let Ok(mut last) = self.last.lock()
            && last.elapsed() >= QUIET
        {
            *last = Instant::now();
            let left = left(self.start.elapsed(), done as f64, self.total as f64);
            files::remark(&format!("{}: {done} of {}{left}", self.what, self.total));
        }
    }
}

/// What is left at the pace so far, in words; nothing before something is done.
pub(crate) fn left(elapsed: Duration, done: f64, total: f64) -> String {
    let seconds = elapsed.as_secs_f64() * (total - done) / done;
    match Duration::try_from_secs_f64(seconds.round()) {
        Ok(left) if done > 0.0 => format!(", about {} left", humantime::format_duration(left)),
        _ => String::new(),
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_takes_as_long_as_what_is_done() {
        let minute = Duration::from_secs(60);
        assert_eq!(left(minute, 1.0, 3.0), ", about 2m left");
        assert_eq!(left(minute, 4.0, 4.0), ", about 0s left");
        for nothing in [left(minute, 0.0, 3.0), left(minute, 0.0, 0.0), left(minute, 5.0, 4.0)] {
            assert_eq!(nothing, "");
        }
    }
}
