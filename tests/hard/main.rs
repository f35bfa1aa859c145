//! The hard cases: what breaks bounding volume hierarchies elsewhere, each a named test with a
//! defined result.
//!
//! `docs/HARD_CASES.md` lists them with the promise behind each. Here a case is a mesh and how it
//! moves; [`hold`] runs it through every strategy, on several threads, at every SIMD level, with
//! small and larger leaves, and casts rays by every triangle test, one by one and in packets. After
//! every frame the tree must be valid and tight, its cost as reported, and what the rays hit must
//! be what brute force hits.

mod check;
mod looks;
mod motion;
mod rays;
mod shape;
mod watertight;
