//! What is traced.

use bvh_core::{Bvh, Triangles};

pub(crate) use bvh_core::Visits as Work;
pub(crate) use bvh_core::with_test;

/// A tree and the triangles that are its primitives.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) triangles: &'a Triangles<'a>,
}

impl Scene<'_> {
    /// The number of the primitive in a slot; that of none for one that is not there.
    #[inline(always)]
    pub(crate) fn primitive(&self, slot: usize) -> u32 {
        let bvh = self.bvh;
        // In order, slots are primitives: there is no need to look up which they are.
        if bvh.is_in_order() { slot as u32 } else { bvh.order().get(slot).copied().unwrap_or(u32::MAX) }
    }
}
