//! Keeps a bounding volume hierarchy good while its primitives move.
//!
//! The centre of this crate is one pass over the tree that *refits* every box to the primitives'
//! new positions and *rotates* at every node on the way up (Kopta, Kensler, Ize, Spjut, Brunvand,
//! Davis: *Fast, Effective BVH Updates for Dynamic Ray-Traced Scenes Using Tree Rotations*, 2012).
//! Around it stand the updates that it is measured against, and those that repair what rotations do
//! not reach.
//!
//! An [`Updater`] does in each frame what its [`Strategy`] says:
//!
//! ```text
//! refit/      the pass: refits and rotations                 the paper
//! quality/    how good a tree is: its cost beside a baseline
//! repair/     a new top above subtrees that are still good
//! rebuild/    a new tree: now, once this one is bad, or from the background
//! auto/       decides in each frame: the pass, and perhaps a new top or tree; or a new tree at once
//! ```
//!
//! ```
//! use bvh_build::{Builder, build};
//! use bvh_core::{Aabb, Vec3};
//! use bvh_update::Updater;
//!
//! let boxes = |time: f32| -> Vec<Aabb> {
//!     let corner = |i: usize| Vec3::new(i as f32, (i as f32 * 0.1 + time).sin(), 0.0);
//!     (0..100).map(corner).map(|corner| Aabb::new(corner, corner + 0.5)).collect()
//! };
//! let mut bvh = build(&boxes(0.0), Builder::Sweep)?;
//! let mut updater = Updater::default();
//! for frame in 1..5 {
//!     updater.update(&mut bvh, &boxes(frame as f32))?;
//! }
//! assert!(bvh.validate(&boxes(4.0)).is_ok());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Static subtrees are not visited ([`Bvh::set_dynamic`](bvh_core::Bvh::set_dynamic)). The tree
//! that results depends on the tree before, the primitives and the reported load alone: not on the
//! number of threads (the pass runs in the current rayon pool) and not on the SIMD level. The
//! exception is [`Strategy::Background`], where it depends on how long builds take.
#![deny(unsafe_code)]

mod auto;
mod quality;
mod rebuild;
mod refit;
mod repair;
mod report;
mod ski_rental;
mod sleep;
mod state;
mod strategy;
mod update;
mod workspace;

pub use auto::{Auto, Load};
pub use bvh_build::{BuildError, BuildOptions, Builder, UnknownName};
pub use rebuild::{Background, BackgroundCost, Degraded};
pub use refit::{BlockCost, Rotate, plain};
pub use repair::PartialRebuild;
pub use report::{Decision, Reason, Update, UpdateError};
pub use sleep::SleepDelay;
pub use strategy::{Reinsertion, Strategy};
pub use update::{Updater, refit, refit_and_rotate};
