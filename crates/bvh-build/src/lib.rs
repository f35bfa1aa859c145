//! Builders of bounding volume hierarchies.
//!
//! [`build`] makes a [`Bvh`] from the boxes of its primitives, and [`rebuild`] makes the next tree
//! in the same memory. Take [`Builder::balanced`] unless you know better, [`Builder::fast`] for a
//! new tree in each frame, [`Builder::best`] for a tree that is made once and used for long.
//!
//! ```
//! use bvh_build::{Builder, build};
//! use bvh_core::{Aabb, Vec3, sah_cost};
//!
//! let boxes: Vec<Aabb> = (0..100)
//!     .map(|i| Vec3::new((i % 10) as f32, (i / 10) as f32, 0.0))
//!     .map(|corner| Aabb::new(corner, corner + Vec3::ONE))
//!     .collect();
//! let bvh = build(&boxes, Builder::balanced())?;
//! assert_eq!(bvh.len(), 100);
//! assert!(sah_cost(&bvh) < 30.0);
//! # Ok::<(), bvh_build::BuildError>(())
//! ```
//!
//! | builder | how | use |
//! |---|---|---|
//! | [`Sweep`](Builder::Sweep) | every split, by the surface area heuristic (SAH) | yardstick |
//! | [`Binned`](Builder::Binned), [`BinnedParallel`](Builder::BinnedParallel) | a few dozen splits, by the SAH | |
//! | [`Lbvh`](Builder::Lbvh) | splits along the Morton curve | `fast` |
//! | [`Hlbvh`](Builder::Hlbvh) | binned SAH over clusters along the curve | |
//! | [`Ploc`](Builder::Ploc) | merges neighbours along the curve | `balanced` |
//! | [`HillClimbed`](Builder::HillClimbed), [`Annealed`](Builder::Annealed), [`Reinserted`](Builder::Reinserted) | a sweep, then improved | `best` is `Reinserted` |
//!
//! [`hill_climb`], [`anneal`] and [`reinsert`](fn@reinsert) improve any tree; `reinsert` keeps to a
//! budget that also suits a repair between two frames. For an animation known in advance,
//! [`build_over_poses`] makes one tree that is good in all poses.
//!
//! Every builder is deterministic: its tree depends on the boxes and the options alone, bit for
//! bit, not on the number of threads or the machine. Primitives with an empty box (see
//! [`bvh_core`]) lie in a subtree of their own, unless one leaf holds everything.

mod binned;
mod hlbvh;
mod layout;
mod leaves;
mod lists;
mod morton;
mod neighbor_search;
mod offline_rotations;
mod optimized;
mod options;
mod ploc;
mod poses;
mod prim_ref;
mod radix;
mod raw;
mod reinsert;
mod small_trees;
mod subtree_slot;
mod sweep;
mod tree;

use bvh_core::{Bvh, MAX_PRIMITIVES, Node, Pair, Primitives};
use thiserror::Error;

pub use crate::offline_rotations::{Anneal, HillClimb, anneal, hill_climb};
pub use crate::optimized::Optimized;
pub use crate::options::{BuildOptions, Builder};
pub use crate::poses::build_over_poses;
pub use crate::reinsert::{Reinsert, ReinsertScratch, reinsert};
pub use bvh_core::UnknownName;

use crate::binned::{Bins, OnePrimitive};
use crate::hlbvh::ClusterMemory;
use crate::lists::{bytes_of, make_room};
use crate::morton::{Codes, with_keys};
use crate::ploc::PlocMemory;
use crate::prim_ref::{Gathered, PrimRef};
use crate::subtree_slot::SubtreeSlot;
use crate::tree::Boxes;

#[cfg(test)]
mod tests;

/// Why no tree was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BuildError {
    /// More primitives than a tree can number.
    #[error("{0} primitives given; at most {MAX_PRIMITIVES} fit")]
    TooManyPrimitives(usize),
    /// A tree over poses, but no pose.
    #[error("no poses given; at least one is needed")]
    NoPoses,
    /// A pose of another number of primitives than the tree or the first pose has.
    #[error("pose {pose} has {found} primitives; it should have {expected}")]
    PoseLength {
        /// The pose, from 0.
        pose: usize,
        /// Its number of primitives.
        found: usize,
        /// The number in the tree or the first pose.
        expected: usize,
    },
}

/// Memory that builds keep from one to the next, so that they allocate nothing once it is large
/// enough (except [`Builder::Sweep`] and the builders that start from it). It has no influence on
/// results.
#[derive(Default)]
pub struct BuildScratch {
    prims: Vec<PrimRef>,
    dropped: Vec<PrimRef>,
    spare: Vec<PrimRef>,
    bins: Vec<Bins>,
    codes: Codes,
    clusters: ClusterMemory,
    ploc: PlocMemory,
}

impl std::fmt::Debug for BuildScratch {
    /// The name alone: the content means nothing between calls.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BuildScratch").finish_non_exhaustive()
    }
}

impl BuildScratch {
    /// Number of primitives of the last build that had an empty box.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped.len()
    }

    /// Memory kept, in bytes.
    #[must_use]
    pub fn memory_usage(&self) -> usize {
        let Self { prims, dropped, spare, bins, codes, clusters, ploc } = self;
        let prims = [prims, dropped, spare].map(bytes_of).iter().sum::<usize>();
        prims + bytes_of(bins) + codes.memory_usage() + clusters.memory_usage() + ploc.memory_usage()
    }
}

const NO_PAIR: Pair = Pair([Node::NOTHING; 2]);

/// Builds a tree over `primitives` with default options: one primitive a leaf.
///
/// See [`build_with`] for options and [`rebuild`] for complexity, memory and hard input.
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`].
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Triangles, Vec3};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2], [1, 2, 3]] };
/// let bvh = build(&triangles, Builder::default())?;
/// assert!(bvh.validate(&triangles).is_ok());
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn build<P: Primitives + ?Sized>(primitives: &P, builder: Builder) -> Result<Bvh, BuildError> {
    build_with(primitives, builder, &BuildOptions::default())
}

/// Builds a tree over `primitives` with `options`; see [`rebuild`] for complexity, memory and hard
/// input.
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`].
///
/// ```
/// use bvh_build::{BuildOptions, Builder, build_with};
/// use bvh_core::{Aabb, Vec3, stats};
///
/// let boxes = [Aabb::new(Vec3::ZERO, Vec3::ONE); 9];
/// let options = BuildOptions::default().with_max_leaf_size(4);
/// let bvh = build_with(&boxes, Builder::Binned, &options)?;
/// assert_eq!(stats(&bvh).largest_leaf, 4);
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn build_with<P: Primitives + ?Sized>(
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
) -> Result<Bvh, BuildError> {
    let mut bvh = Bvh::default();
    rebuild(&mut bvh, primitives, builder, options, &mut BuildScratch::default())?;
    Ok(bvh)
}

/// Replaces `bvh` by a new tree over `primitives`, in the same memory. The old content does not
/// matter.
///
/// O(n log n) for common scenes, O([`MAX_HEIGHT`](bvh_core::MAX_HEIGHT) n) at worst; for
/// [`Builder::Reinserted`] O(n²), where most boxes overlap. `scratch`
/// grows to, in bytes a primitive: 64 binned (in parallel up to 96), 48 LBVH, 52 HLBVH, 128 PLOC,
/// 32 more with long codes, and up to 64 more for each that has no box. A sweep takes 140 of its
/// own.
///
/// Where the SAH cannot choose (equal centres, a node without area) and where the tree would get
/// too high, a node is split in the middle of its primitives. So no tree is higher than
/// [`MAX_HEIGHT`](bvh_core::MAX_HEIGHT). Primitives without extent, all alike, far from the origin
/// or beyond the range of `f32` areas make valid trees with tight boxes, too; they may cost more
/// where `f32` cannot tell places or areas apart. Primitives with an empty box are kept, and
/// dropped (see [`bvh_core`]).
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`]; `bvh` is then as it was.
///
/// # Panics
/// If primitives panic; `bvh` may then be empty.
///
/// ```
/// use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
/// use bvh_core::{Aabb, Bvh, Vec3};
///
/// let (mut bvh, mut scratch) = (Bvh::default(), BuildScratch::default());
/// let options = BuildOptions::default();
/// for frame in 0..3 {
///     let boxes = [0.0, 1.0, 2.0].map(|x| Aabb::new(Vec3::X * x, Vec3::ONE * (x + frame as f32)));
///     // Allocates in the first frame only.
///     rebuild(&mut bvh, &boxes, Builder::fast(), &options, &mut scratch)?;
///     assert!(bvh.validate(&boxes).is_ok());
/// }
/// # Ok::<(), bvh_build::BuildError>(())
/// ```
pub fn rebuild<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    scratch: &mut BuildScratch,
) -> Result<(), BuildError> {
    // Asked once: a valid tree must not depend on an implementation that gives the same number
    // twice.
    let n = primitives.len();
    if n > MAX_PRIMITIVES {
        return Err(BuildError::TooManyPrimitives(n));
    }
    let in_pool = rayon::current_thread_index().is_some();
    let threads = match builder {
        Builder::Binned => 1,
        Builder::Sweep | Builder::HillClimbed | Builder::Annealed if !in_pool => 1,
        _ => rayon::current_num_threads(),
    };
    let BuildScratch { prims, dropped, spare, bins, codes, clusters, ploc } = scratch;
    raw::write(bvh, |pairs, order| {
        make_room(pairs, n.max(1), NO_PAIR, threads);
        make_room(order, n, 0, threads);
        if n == 0 {
            dropped.clear();
            pairs.fill(NO_PAIR);
            return;
        }
        let nodes: &mut [Node] = bytemuck::cast_slice_mut(pairs);
        let Gathered { centers, exact } = prim_ref::gather(primitives, n, prims, dropped, threads);
        let boxed = prims.len();
        let mut build = |slot: SubtreeSlot<'_>| match builder {
            Builder::Sweep | Builder::HillClimbed | Builder::Annealed | Builder::Reinserted => {
                sweep::build(prims, n, threads > 1, slot);
            }
            Builder::Binned | Builder::BinnedParallel => {
                binned::build(prims, (spare, bins), &OnePrimitive, options.bins, threads, slot);
            }
            Builder::Lbvh => with_keys!(codes.sort(prims, &centers, threads), keys => {
                morton::build(keys, prims, threads > 1, slot);
            }),
            Builder::Hlbvh => with_keys!(codes.sort(prims, &centers, threads), keys => {
                hlbvh::build(prims, keys, (clusters, spare, bins), options.bins, threads, slot);
            }),
            Builder::Ploc => {
                let sorted = codes.sort(prims, &centers, threads);
                ploc::build(prims, &sorted, options.search_radius, ploc, threads, slot);
            }
        };
        let slot = SubtreeSlot::new(nodes, order);
        match (boxed, dropped.len()) {
            (_, 0) => build(slot),
            (0, _) => slot.halve(dropped),
            (left, _) => slot.fork(left, |l, r| (build(l), r.halve(dropped))),
        };
        let root = if boxed == n { 0 } else { 2 };
        if boxed > 0 && optimize(nodes, root, builder, options) {
            layout::slots_in_order(nodes, order);
        }
        if !exact {
            refit(nodes, order, primitives);
        }
        let used = leaves::merge(nodes, options.max_leaf_size);
        pairs.truncate(used / 2);
    });
    Ok(())
}

/// Improves the tree below the node in slot `root`, and leaves its nodes depth first, if the
/// builder is one that does; whether it is.
fn optimize(nodes: &mut [Node], root: usize, builder: Builder, options: &BuildOptions) -> bool {
    match builder {
        Builder::HillClimbed => _ = offline_rotations::climb(nodes, root, &options.hill_climb),
        Builder::Annealed => _ = offline_rotations::cool(nodes, root, &options.anneal),
        Builder::Reinserted => {
            let tree = &mut Boxes { nodes, root };
            reinsert::optimize(tree, &options.reinsert, &mut ReinsertScratch::default());
            layout::depth_first(nodes, &mut Vec::new());
        }
        _ => return false,
    }
    true
}

/// Sets all boxes to those of the primitives; one primitive a leaf, children behind their parents.
fn refit<P: Primitives + ?Sized>(nodes: &mut [Node], order: &[u32], primitives: &P) {
    for i in (0..nodes.len()).rev().filter(|&i| i != 1) {
        let node = nodes[i];
        nodes[i].set_aabb(if node.is_leaf() {
            primitives.aabb(order[node.first()] as usize).sanitized()
        } else {
            nodes[node.first()].aabb().union(nodes[node.first() + 1].aabb())
        });
    }
}
