//! A bounding volume hierarchy (BVH) meant for geometry that moves.
//!
//! The tree is binary, its nodes 32 bytes, siblings adjacent ([`Bvh`], [`Node`]). This crate holds what every
//! user of such a tree needs: boxes ([`Aabb`]), the surface area heuristic ([`sah_cost`]), the six tree
//! rotations of Kensler 2008 ([`rotation`]), validation ([`Bvh::validate`]), statistics ([`stats`]) and
//! queries through closures ([`Bvh::overlaps`], [`Bvh::cast_ray`]) and picking ([`closest_hit`], [`any_hit`]). Trees are made by the crate `bvh-build`
//! and kept good by `bvh-update`.
//!
//! Primitives are numbered from 0 and known by their boxes only ([`Primitives`]). Coordinates are `f32`;
//! any axis convention will do.
//!
//! # What hard input gives
//!
//! Primitives with a NaN or an infinite coordinate are *dropped*: they stay in their leaf with an empty box, are never
//! hit by a ray, and come back when they are finite again. (Queries by box give all primitives of a leaf, whose own
//! boxes the caller tests: in leaves of several a dropped one may be among them.) Primitives without extent are like
//! any other. Areas that exceed the range of `f32` are infinite as [`Aabb::half_area`]; costs are summed from `f64`
//! areas, which never do. Areas may underflow to 0; a tree without area has the cost 0. Far from the origin boxes are
//! as exact as the coordinates they are given. No tree is higher than [`MAX_HEIGHT`], so walks keep their stack in an
//! array of that size.
//!
//! Throughout, a node is `N`, its children `L` and `R`, its grandchildren `LL LR RL RR`.

mod aabb;
mod bvh;
mod cost;
mod history;
mod hit;
mod node;
#[doc(hidden)]
pub mod pick;
mod prefetch;
mod primitives;
mod query;
mod ray;
pub mod rotation;
mod simd;
#[doc(hidden)]
pub mod slab;
mod stats;
mod structure;
#[doc(hidden)]
pub mod triangle;
mod validate;

pub use aabb::Aabb;
pub use bvh::{Bvh, MAX_HEIGHT, MAX_PRIMITIVES, Parts};
pub use cost::{COST_INTERSECT, COST_TRAVERSE, sah_cost};
pub use glam;
pub use glam::Vec3;
pub use history::{History, Layout, LeafHistory, Measure};
pub use hit::Hit;
pub use node::{MAX_LEAF_SIZE, Node};
pub use pick::{
    Visits, any_hit, any_hit_brute, any_hit_counted, closest_hit, closest_hit_brute, closest_hit_counted,
};
pub use prefetch::prefetch;
pub use primitives::{InOrder, Primitives, Triangles};
pub use ray::Ray;
pub use rotation::Rotation;
pub use simd::SimdLevel;
pub use stats::{Stats, stats};
pub use structure::Malformed;
pub use triangle::{TriangleTest, UnknownName};
pub use validate::Invalid;
