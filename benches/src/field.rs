//! Who takes part in which contest.

use crate::limit::Limit;
use crate::{Contest, Entry, bvh, embree, obvhs, parry, pivot};

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
