//! Why there is no Embree.

use std::path::PathBuf;

/// Name of the environment variable that says where Embree is.
pub const VARIABLE: &str = "PIVOT_EMBREE";

/// Why there is no Embree.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NotFound {
    /// Nothing of the usual names.
    #[error(
        "Embree is not installed, so it is left out; to have it, install it (Debian's libembree3-3 has version \
         3) or unpack the wheel `pip download --no-deps embreex` gives (version 4), and name the library or its \
         folder with --embree or in {VARIABLE}"
    )]
    Nowhere,
    /// Nothing at the path that was given.
    #[error("{0}: no Embree there; expected libembree4 or libembree3, or a folder with one of them")]
    NotThere(PathBuf),
    /// It is there, but does not load.
    #[error("{path}: cannot be loaded as Embree: {reason}")]
    Broken {
        /// The library.
        path: PathBuf,
        /// What the system's loader said.
        reason: String,
    },
    /// It gives no device.
    #[error("Embree gives no device on this machine (error {0})")]
    Device(i32),
}
