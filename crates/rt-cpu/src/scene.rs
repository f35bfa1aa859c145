//! What is traced.

use bvh_core::{Bvh, Triangles};

pub(crate) use bvh_core::Visits as Work;
pub(crate) use bvh_core::with_test;

/// A tree and the triangles that are its primitives.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) triangles: &'a Triangles<'a>,
    /// Whether slots of the tree are numbers of triangles: then there is no need to look up which
    /// they are.
    is_in_order: bool,
}

impl<'a> Scene<'a> {
    pub(crate) fn new(bvh: &'a Bvh, triangles: &'a Triangles<'a>) -> Self {
        Self { bvh, triangles, is_in_order: bvh.is_in_order() }
    }

    /// The number of the primitive in a slot; that of none for one that is not there.
    #[inline(always)]
    pub(crate) fn primitive(&self, slot: usize) -> u32 {
        if self.is_in_order { slot as u32 } else { self.bvh.order().get(slot).copied().unwrap_or(u32::MAX) }
    }
}
