//! What is compared, and contestants before they have triangles.

use bvh_core::Triangles;

use crate::{Contestant, Failure};

/// What is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contest {
    /// Keeping a tree up to date, frame after frame.
    Update,
    /// Building a tree from nothing.
    Build,
    /// Tracing rays through a fresh tree.
    Trace,
    /// Tracing rays that have little in common through a fresh tree.
    Incoherent,
    /// Updating and tracing, frame after frame: this project and Embree in every dynamic
    /// configuration.
    Frame,
}

type Make = Box<dyn Fn(&Triangles<'_>) -> Result<Box<dyn Contestant>, Failure> + Send + Sync>;

/// A contestant before it has triangles.
pub struct Entry {
    /// Its name, which begins with the library's.
    pub name: String,
    /// Whether its tree depends on the frames before, so that it must see all of them.
    pub keeps_tree: bool,
    make: Make,
}

impl Entry {
    pub(crate) fn new(
        name: impl Into<String>,
        keeps_tree: bool,
        make: impl Fn(&Triangles<'_>) -> Result<Box<dyn Contestant>, Failure> + Send + Sync + 'static,
    ) -> Self {
        Self { name: name.into(), keeps_tree, make: Box::new(make) }
    }

    /// Makes the contestant with its own copy of the triangles; no tree is built yet.
    ///
    /// # Errors
    /// If the library cannot take them.
    pub fn make(&self, triangles: &Triangles<'_>) -> Result<Box<dyn Contestant>, Failure> {
        (self.make)(triangles)
    }
}
