//! Pivot's experiments. Each command of `cargo xtask` is a module with its arguments and a function
//! `run`.
//!
//! `docs/EXTENDING.md` shows how to add an experiment, a claim, a chart, a contestant or a scene.
#![forbid(unsafe_code)]

pub mod compare;
pub mod effects;
pub mod export;
pub mod files;
pub mod interrupt;
pub mod list;
pub mod process;
pub mod render;
pub mod reproduce;
pub mod soak;

mod machine;
mod pool;
mod progress;
mod stage;

/// A check that failed: exit code 1, where bad input has 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct CheckFailed(pub String);
