//! Ctrl-C: once to stop after the current frame and keep what is measured, twice to stop at once.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::files;

/// What shells expect of a program that was interrupted.
pub(crate) const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Takes over from the default, which is to end at once.
pub(crate) fn catch() {
    let caught = ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        files::tell("interrupted: stopping after this step; once more stops at once");
    });
    if let Err(error) = caught {
        files::tell(&format!("note: an interrupt will lose work in progress: {error}"));
    }
}

/// Whether to stop as soon as it is convenient.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
