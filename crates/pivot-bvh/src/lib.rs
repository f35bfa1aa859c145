#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub use bvh_build::*;
pub use bvh_core::*;
pub use bvh_update::*;

/// The example of the project's README.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
pub struct ProjectReadme;
