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

use bvh_core::{Triangles, Vec3};
use rt_cpu::Pixel;

pub use bounce::bounces;
pub use field::{Contest, Entry, LIMIT, field};
pub use rays::{Hits, RAYS, Rays};
pub use view::{Answers, View, set_up_rays};

/// Why a contestant could not do its work.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{who}: {what}")]
pub struct Failure {
    /// The contestant.
    pub who: &'static str,
    /// What went wrong.
    pub what: String,
}

/// One library in one configuration, with the triangles it was made for.
///
/// Everything runs in the current rayon pool; Embree on as many threads as its device was made for.
pub trait Contestant: Send + Sync {
    /// Takes positions of the vertices, as many as it was made with.
    fn pose(&mut self, positions: &[Vec3]);

    /// Brings the tree up to date with the positions; the first time, builds it.
    ///
    /// # Errors
    /// If the library reports an error.
    fn update(&mut self) -> Result<(), Failure>;

    /// Whether updates learn from what is cast: it is to be shown every frame then, measured or
    /// not.
    fn learns(&self) -> bool {
        false
    }

    /// SAH cost of the tree as [`bvh_core::sah_cost`] defines it; `None` if the tree cannot be read
    /// or has other than two children a node.
    fn sah_cost(&self) -> Option<f64> {
        None
    }

    /// Finds the first triangle along each ray.
    fn closest(&self, rays: &Rays, hits: &mut Hits);

    /// Finds whether anything lies along each ray. Answers beyond the number of rays have no
    /// meaning.
    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]);

    /// The triangles as they are now.
    fn triangles(&self) -> Triangles<'_>;

    /// Whether [`closest`](Self::closest) gives normals of what it hits: shadow rays are made from
    /// these then, rather than from the triangles.
    fn gives_normals(&self) -> bool {
        false
    }

    /// Casts the primary and the shadow rays of every pixel of a view, in tiles over all threads.
    ///
    /// # Panics
    /// If the number of pixels is not that of the view's camera.
    fn cast(&self, view: &View, pixels: &mut [Pixel]) {
        view::cast(self, view, pixels);
    }
}
