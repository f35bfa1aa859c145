//! Ctrl-C: once to stop after the current frame and keep what is measured, twice to stop at once.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::files;

/// What shells expect of a program that was interrupted.
pub const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Takes over from the default, which is to end at once.
pub fn catch() {
    let caught = ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        files::remark("interrupted: stopping after this step; once more stops at once");
    });
    if let Err(error) = caught {
        files::remark(&format!("note: an interrupt will lose work in progress: {error}"));
    }
}

/// Returns whether to stop as soon as it is convenient.
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// After an interrupt, says how to go on.
pub(crate) fn say_how_to_go_on(how: &str) {
    if requested() {
        files::remark(&format!("stopped; what was measured is kept. Go on with: {how}"));
    }
}
