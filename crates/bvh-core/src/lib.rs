//! A bounding volume hierarchy (BVH) for geometry that moves.
//!
//! The tree is binary, its nodes have 32 bytes, and siblings are adjacent ([`Bvh`], [`Node`]). This
//! crate holds what every user of such a tree needs:
//!
//! * boxes ([`Aabb`]) and primitives, which a tree knows by number and box only ([`Primitives`]);
//! * picking: the first triangle along a ray ([`closest_hit`], [`any_hit`], [`Hit`]);
//! * queries: boxes ([`Bvh::for_each_overlap`]), pairs ([`Bvh::for_each_pair`]), rays
//!   ([`Bvh::cast_ray`]) and the nearest primitive ([`Bvh::nearest`]);
//! * the surface area heuristic ([`sah_cost`]), the six tree rotations of Kensler 2008
//!   ([`rotation`]), validation ([`Bvh::validate`]) and statistics ([`stats()`]).
//!
//! The crate `bvh-build` makes trees and `bvh-update` keeps them good. Coordinates are `f32` in any
//! unit and any axis convention. Functions take and give numbers of primitives as `usize`; the tree
//! and a [`Hit`] store them as `u32`.
//!
//! ```
//! use bvh_core::{Aabb, Bvh, Node, Vec3};
//! use std::ops::ControlFlow;
//!
//! // Two boxes and a tree over them, by hand.
//! let boxes = [0.0, 5.0].map(|x| Aabb::new(Vec3::X * x, Vec3::X * x + Vec3::ONE));
//! let (l, r) = (Node::leaf(boxes[0], 0, 1), Node::leaf(boxes[1], 1, 1));
//! let bvh = Bvh::new(&[Node::parent(&l, &r, 2), Node::NOTHING, l, r], vec![0, 1])?;
//!
//! let mut found = Vec::new();
//! bvh.for_each_overlap(&boxes, &boxes[1].grown(1.0), |p| {
//!     found.push(p);
//!     ControlFlow::Continue(())
//! });
//! assert_eq!(found, [1]);
//! # Ok::<(), bvh_core::Malformed>(())
//! ```
//!
//! # Hard input
//!
//! * A primitive with a NaN or an infinite coordinate is *dropped*: it stays in its leaf with an
//!   empty box, no query finds it, and it comes back with the first update that finds it finite.
//!   But the closures that [`Bvh::cast_ray`] and [`Bvh::nearest`] are given are asked about all
//!   primitives of a leaf, a dropped one among them.
//! * A primitive without extent is like any other.
//! * An area beyond the range of `f32` is infinite as [`Aabb::half_area`]. Costs are sums of `f64`
//!   areas, which are always finite. A tree without area has the cost 0.
//! * No tree is higher than [`MAX_HEIGHT`], so a traversal stack is an array.
//!
//! Throughout, a node is `N`, its children `L` and `R`, its grandchildren `LL LR RL RR`.

mod aabb;
mod bvh;
mod cost;
mod dynamic;
mod hit;
#[doc(hidden)]
pub mod named;
mod node;
#[doc(hidden)]
pub mod pick;
mod prefetch;
mod primitives;
mod query;
mod ray;
mod rewire;
pub mod rotation;
mod simd;
#[doc(hidden)]
pub mod slab;
mod stats;
mod structure;
#[doc(hidden)]
pub mod triangle;
mod update_state;
mod validate;
mod with_methods;

pub use aabb::Aabb;
pub use bvh::{Bvh, MAX_HEIGHT, MAX_PRIMITIVES, OnPanic, Pair, Parts};
pub use cost::sah_cost;
#[doc(no_inline)]
pub use glam;
#[doc(no_inline)]
pub use glam::Vec3;
pub use hit::Hit;
pub use named::UnknownName;
pub use node::{COST_INTERSECT, COST_TRAVERSE, MAX_LEAF_SIZE, Node};
pub use pick::{
    any_hit, any_hit_counted, closest_hit, closest_hit_brute, closest_hit_counted, closest_hit_where,
};
pub use prefetch::{prefetch, prefetch_at};
pub use primitives::{Primitives, Triangles};
pub use query::Visits;
pub use ray::Ray;
pub use rewire::{Branch, NotRewired};
pub use rotation::Rotation;
pub use simd::SimdLevel;
pub use stats::{Stats, stats};
pub use structure::Malformed;
pub use triangle::TriangleTest;
pub use update_state::{Changes, UpdateState};
pub use validate::Invalid;
