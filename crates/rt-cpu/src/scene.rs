//! What is traced, what is looked for, and what single rays find of it.

pub(crate) use bvh_core::Visits as Work;
pub(crate) use bvh_core::pick::every;
pub(crate) use bvh_core::with_test;
use bvh_core::{Bvh, Ray, Triangles, pick, triangle::Test};
use fearless_simd::Simd;

use crate::Hit;

/// A tree and the triangles that are its primitives.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) triangles: &'a Triangles<'a>,
    /// Whether slots of the tree are numbers of triangles: then there is no need to look up which
    /// they are.
    is_in_order: bool,
}

/// What rays look for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Query {
    Closest,
    Any,
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

    /// What one ray hits, through the tree, of that which `counts` is true for.
    #[inline(always)]
    pub(crate) fn hit<S: Simd, T: Test>(
        &self,
        simd: S,
        query: Query,
        ray: &Ray,
        t_max: f32,
        work: &mut Work,
        counts: impl Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        let Self { bvh, triangles, .. } = self;
        match query {
            Query::Closest => pick::hit::<S, T, false>(simd, bvh, triangles, ray, t_max, work, counts),
            Query::Any => pick::hit::<S, T, true>(simd, bvh, triangles, ray, t_max, work, counts),
        }
    }
}
