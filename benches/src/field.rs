//! Who takes part in which contest.

use bvh_core::Triangles;

use crate::limit::Limit;
use crate::{Contestant, Failure, bvh, embree, obvhs, parry, pivot};

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

/// Name of the entry that is no library but the memory limit.
pub const LIMIT: &str = "memory limit";

/// Returns all who take part. Embree does where a device is given.
#[must_use]
pub fn field(contest: Contest, embree: Option<&embree::Device>) -> Vec<Entry> {
    let mut entries = Vec::new();
    if contest == Contest::Update {
        entries.push(Entry::new(LIMIT, false, |triangles| Ok(Box::new(Limit::new(triangles)))));
    }
    pivot::enter(contest, &mut entries);
    if let Some(device) = embree {
        embree::enter(contest, device, &mut entries);
    }
    obvhs::enter(contest, &mut entries);
    parry::enter(contest, &mut entries);
    bvh::enter(contest, &mut entries);
    entries
}
