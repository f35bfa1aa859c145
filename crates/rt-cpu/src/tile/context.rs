//! What all steps of a packet through the tree share, and the memory that they work in.

use bvh_core::MAX_HEIGHT;
use bytemuck::Zeroable;

use super::cut::Cut;
use super::packet::Packet;
use crate::frustum::{Frame, Frustum, Sides};
use crate::scene::Scene;
use crate::wide::RayOctant;

/// What is needed again and again; a tile's worth of it.
#[derive(Zeroable)]
pub(crate) struct Scratch {
    pub(super) packet: Packet,
    pub(super) stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    pub(super) group_stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    pub(super) cut: Cut,
    /// Those of the packet's frustum; zeroed until needed.
    pub(super) sides: Sides,
    /// Inner nodes visited.
    pub(crate) nodes: u64,
}

/// What all steps of a packet through the tree share.
#[derive(Clone, Copy)]
pub(super) struct Context<'a, S> {
    pub(super) simd: S,
    pub(super) scene: Scene<'a>,
    pub(super) octant: &'a RayOctant,
    /// The packet's, if its rays have one.
    pub(super) frustum: Option<(&'a Frame, &'a Frustum)>,
}
