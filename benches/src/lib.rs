//! Pivot beside other libraries: every contestant behind one trait, so that all get the same
//! triangles, the same positions and the same rays, and their answers can be compared.
//!
//! A contestant holds its own copy of the triangles and of the positions. [`Contestant::pose`]
//! writes new positions into that copy, as an application would write them where the library reads
//! them; it is a plain copy for everyone and not part of any time. [`Contestant::update`] is what
//! is timed: everything from there until rays can be traced, and so whatever else that library
//! wants to have, such as an array of boxes.
//!
//! Triangles are expected in an order that is good for memory (that of the leaves of some tree),
//! the same for all contestants.
#![deny(unsafe_code)]

mod bounce;
mod bvh;
mod contest;
pub mod embree;
mod field;
mod limit;
pub mod measure;
mod mesh;
mod obvhs;
mod parry;
mod pivot;
mod rays;
mod sah;
mod view;

pub use bounce::bounces;
pub use contest::{Contest, Entry};
pub use field::{LIMIT, field};
pub use rays::{Hits, RAYS, Rays};
pub use view::{Answers, Contestant, View, set_up_rays};

/// Why a contestant could not do its work.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{who}: {what}")]
pub struct Failure {
    /// The contestant.
    pub who: &'static str,
    /// What went wrong.
    pub what: String,
}
