//! Progress of long work: a bar on a terminal, now and then a plain line otherwise.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use anim::printable;
use indicatif::{ProgressBar, ProgressStyle};

use crate::files;

/// Time between plain lines.
const QUIET: Duration = Duration::from_secs(10);

/// Work that is under way; shown on standard error, gone when dropped.
pub(crate) struct Progress {
    /// Draws nothing without a terminal, or on a dumb one.
    bar: ProgressBar,
    /// The last plain line.
    last: Mutex<Instant>,
}

impl Progress {
    /// Starts work on `what`, in `total` steps.
    pub(crate) fn new(what: impl Into<String>, total: u64) -> Self {
        let bar = ProgressBar::new(total).with_message(printable(&what.into()));
        if !bar.is_hidden() {
            let style = ProgressStyle::with_template("{msg} {wide_bar:.blue/dim} {pos}/{len}, {eta} left");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self { bar, last: Mutex::new(Instant::now()) }
    }

    /// Says how many steps are done.
    pub(crate) fn at(&self, done: u64) {
        self.bar.set_position(done);
        if self.bar.is_hidden()
            && let Ok(mut last) = self.last.lock()
            && last.elapsed() >= QUIET
        {
            *last = Instant::now();
            let total = self.bar.length().unwrap_or(done);
            let left = left(self.bar.elapsed(), done as f64, total as f64);
            files::remark(&format!("{}: {done} of {total}{left}", self.bar.message()));
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
        self.bar.finish_and_clear();
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
