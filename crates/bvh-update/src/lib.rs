//! Keeps a bounding volume hierarchy good while its primitives move.
//!
//! The centre of this crate is one pass over the tree that *refits* every box to the primitives' new positions
//! and *rotates* at every node on the way up (Kopta, Ize, Spjut, Brunvand, Davis, Kensler: *Fast, Effective BVH
//! Updates for Animated Scenes*, I3D 2012). Around it stand the updates that it is
//! measured against, refitting alone and rebuilding every frame, and those that repair what rotations do not reach.
//!
//! [`update`] does what a [`Strategy`] says and tells what it did. Refits and rotations do not visit subtrees without
//! moving primitives ([`Bvh::set_moving`](bvh_core::Bvh::set_moving)). The tree that results depends on the tree
//! before and the primitives alone: not on the number of threads (the pass runs in the current rayon pool) and
//! not on the SIMD level; but for [`Strategy::Background`], where it depends on how long builds take, and [`Auto`], which
//! learns from what it is told of rays ([`Scratch::visited`]) and, if asked, from the clock.
#![deny(unsafe_code)]

pub mod ablation;
mod apart;
mod auto;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod background;
mod best;
mod block;
mod clock;
mod cut;
mod decision;
mod degraded;
mod divergent;
mod growth;
mod kernels;
mod leaves;
mod merge;
mod model;
mod pass;
pub mod plain;
mod portable;
mod raw;
mod regrow;
mod selective;
mod settle;
mod slope;
mod strategy;
mod sweep;
mod top;
mod walk;

pub use auto::Auto;
pub use background::{Background, BackgroundCost};
pub use bvh_build::{BuildError, BuildOptions, Builder, UnknownBuilder};
pub use clock::Calibration;
pub use decision::Decision;
pub use degraded::Degraded;
pub use leaves::Leaves;
pub use pass::Scratch;
pub use regrow::{Open, Regrow};
pub use strategy::{Reinsertion, Rotate, Strategy, UnknownStrategy, Update, UpdateError, update};
