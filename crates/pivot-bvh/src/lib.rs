#![doc = include_str!("../README.md")]
//! # Where to start
//!
//! | to | take |
//! |---|---|
//! | make a tree over triangles, boxes or your own [`Primitives`] | [`build`], [`Builder::fast`], [`balanced`](Builder::balanced), [`best`](Builder::best) |
//! | keep it good from frame to frame | [`Updater::update`], one updater for each tree |
//! | choose how | [`Strategy`]: the default, [`Auto`], suits nearly all |
//! | find what rays hit | [`closest_hit`], [`any_hit`] |
//! | find what boxes overlap, or what is nearest | [`Bvh::for_each_overlap`], [`Bvh::for_each_pair`], [`Bvh::nearest`] |
//! | say what is asked of the tree, so that `Auto` repairs it when that pays | [`Updater::report`] |
//! | skip what stands still | [`Bvh::set_dynamic`], [`SleepDelay`] |
//!
//! Work runs on the rayon pool that calls. Trees do not depend on the number of threads, unless
//! they are built in the background. Primitives that are not finite are never hit, and come back
//! once they are. With another number of primitives `Auto` and rebuilds make a new tree.
#![forbid(unsafe_code)]

pub use bvh_build::*;
pub use bvh_core::*;
pub use bvh_update::*;

/// The example of the project's README.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
pub struct ProjectReadme;
