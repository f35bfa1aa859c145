//! Builders of bounding volume hierarchies.
//!
//! [`build`] makes a [`Bvh`] from the boxes of its primitives, and [`rebuild`] makes the next one in the same memory.
//! Top down, by the surface area heuristic (SAH), [`Builder::Sweep`] tries every split between the sorted centres on all
//! three axes and is the yardstick of quality; [`Builder::Binned`] tries a few dozen; [`Builder::BinnedParallel`] gives the
//! same tree on all threads. For a tree a frame there are those that sort the primitives along the Morton curve:
//! [`Builder::Lbvh`], [`Builder::Hlbvh`] and [`Builder::Ploc`], from the fastest build to the best tree.
//!
//! A tree that is made once and used long deserves more: [`Builder::HillClimbed`], [`Builder::Annealed`] and
//! [`Builder::Reinserted`] improve that of a sweep, and [`hill_climb`], [`anneal`] and [`reinsert`](fn@reinsert) any tree,
//! the last within a budget that suits a repair between two frames, too. For an animation that is known in advance
//! [`build_over_poses`] and [`build_by_motion`] make one tree that is good in all poses.
//!
//! Each builder is deterministic: its tree depends on the boxes and the options alone, bit for bit, not on
//! the number of threads nor on the machine. Primitives with an empty box (see [`bvh_core`]) are kept
//! together in a subtree of their own beside all others.
//!
//! ```
//! use bvh_build::{BuildOptions, Builder, build};
//! use bvh_core::{Aabb, Vec3, sah_cost};
//!
//! let boxes: Vec<Aabb> = (0..100)
//!     .map(|i| Vec3::new((i % 10) as f32, (i / 10) as f32, 0.0))
//!     .map(|corner| Aabb::new(corner, corner + Vec3::ONE))
//!     .collect();
//! let bvh = build(&boxes, Builder::Binned, &BuildOptions::default(), None)?;
//! assert_eq!(bvh.len(), 100);
//! assert!(sah_cost(&bvh) < 30.0);
//! # Ok::<(), bvh_build::BuildError>(())
//! ```

mod binned;
mod climb;
mod four;
mod hlbvh;
mod item;
mod layout;
mod leaves;
mod morton;
mod motion;
mod nearest;
mod ploc;
mod plot;
mod poses;
mod radix;
mod raw;
mod reinsert;
mod rigid;
mod sweep;
mod tree;

use std::str::FromStr;

use bvh_core::{Bvh, MAX_PRIMITIVES, Node, Primitives};

pub use crate::climb::{Anneal, HillClimb, anneal, hill_climb};
pub use crate::motion::{Decomposition, build_by_motion};
pub use crate::poses::{Pose, build_over_poses, cost_over_poses, optimize_over_poses};
pub use crate::reinsert::{Reinsert, ReinsertScratch, reinsert};

use crate::binned::{Bins, Single};
use crate::hlbvh::Tops;
use crate::item::{Gathered, Item};
use crate::morton::Codes;
use crate::ploc::Clusters;
use crate::plot::Plot;
use crate::tree::Boxes;

#[cfg(test)]
mod tests;

/// How to build a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Builder {
    /// Full sweep SAH: every split between neighbours in the order of the centres, on all three axes. Serial,
    /// unless called from within a rayon pool of several threads.
    Sweep,
    /// Binned SAH on all three axes, serial (Wald 2007). Two to four primitives get the best of all trees.
    Binned,
    /// The same tree as [`Binned`](Self::Binned), built on all threads of the current rayon pool.
    BinnedParallel,
    /// Splits along the Morton curve through the centres (Lauterbach et al. 2009), on all threads of the current rayon
    /// pool: the fastest build, for a tree of 1.2 times the cost.
    Lbvh,
    /// Binned SAH over clusters along the Morton curve, which are built as by [`Lbvh`](Self::Lbvh) (Pantaleoni and
    /// Luebke 2010), on all threads of the current rayon pool.
    Hlbvh,
    /// Parallel locally-ordered clustering (Meister and Bittner 2018), on all threads of the current rayon pool: a tree
    /// like that of [`Binned`](Self::Binned) in less than half the time.
    Ploc,
    /// [`Sweep`](Self::Sweep), then rotations until none gains: see [`hill_climb`]. For trees that are made once.
    HillClimbed,
    /// [`Sweep`](Self::Sweep), then rotations by simulated annealing: see [`anneal`]. For trees that are made once.
    Annealed,
    /// [`Sweep`](Self::Sweep), then subtrees put where they cost least: see [`reinsert`](fn@reinsert), on all threads of
    /// the current rayon pool. For trees that are made once; better than annealing, in a fraction of the time.
    Reinserted,
}

impl Builder {
    /// All builders: those for [every frame](Self::PER_FRAME), then those for trees that are made once.
    pub const ALL: [Self; 9] = [
        Self::Sweep,
        Self::Binned,
        Self::BinnedParallel,
        Self::Lbvh,
        Self::Hlbvh,
        Self::Ploc,
        Self::HillClimbed,
        Self::Annealed,
        Self::Reinserted,
    ];

    /// The builders that may build a tree a frame, if need be, and the sweep that they are measured by.
    pub const PER_FRAME: [Self; 6] =
        [Self::Sweep, Self::Binned, Self::BinnedParallel, Self::Lbvh, Self::Hlbvh, Self::Ploc];

    /// Name on command lines and in result files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::Binned => "binned",
            Self::BinnedParallel => "binned-parallel",
            Self::Lbvh => "lbvh",
            Self::Hlbvh => "hlbvh",
            Self::Ploc => "ploc",
            Self::HillClimbed => "hill-climbed",
            Self::Annealed => "annealed",
            Self::Reinserted => "reinserted",
        }
    }
}

impl FromStr for Builder {
    type Err = UnknownBuilder;

    /// The builder of that [name](Self::name).
    fn from_str(name: &str) -> Result<Self, UnknownBuilder> {
        let found = || UnknownBuilder(name.to_owned());
        Self::ALL.into_iter().find(|builder| builder.name() == name).ok_or_else(found)
    }
}

impl std::fmt::Display for Builder {
    /// Its [name](Self::name).
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// There is no builder of this name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownBuilder(String);

impl std::fmt::Display for UnknownBuilder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let expected = Builder::ALL.map(Builder::name).join(", ");
        write!(f, "unknown builder '{}'; expected one of {expected}", self.0)
    }
}

impl std::error::Error for UnknownBuilder {}

/// Settings of a build. Values out of range count as the nearest one in range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildOptions {
    /// Most primitives in one leaf, 1 to [`MAX_LEAF_SIZE`](bvh_core::MAX_LEAF_SIZE). A leaf takes more than
    /// one only where that lowers the SAH cost.
    ///
    /// The default is 1, the choice of Kopta et al. 2012 (section 2): primitives whose motion may diverge
    /// must not share a leaf.
    pub max_leaf_size: u32,
    /// Bins on each axis, 2 to 256; for the binned builders only. Nodes of few primitives use fewer.
    pub bins: u32,
    /// Bits of the Morton codes, for the builders that sort by them.
    pub code_bits: CodeBits,
    /// How many neighbours on either side [`Builder::Ploc`] compares each cluster with, 1 to 32.
    pub search_radius: u32,
    /// How long [`Builder::HillClimbed`] may take.
    pub hill_climb: HillClimb,
    /// How [`Builder::Annealed`] cools down.
    pub anneal: Anneal,
    /// The budget of [`Builder::Reinserted`].
    pub reinsert: Reinsert,
}

/// How many bits a Morton code has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum CodeBits {
    /// 39, what fits into 64 bits beside the number of one in 16 million; and 63 if there are more primitives, or more than
    /// half of them then share their code with the one before.
    #[default]
    Auto,
    /// 30: about a thousand cells along each axis.
    Bits30,
    /// 63: about two million cells along each axis.
    Bits63,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            max_leaf_size: 1,
            bins: 32,
            code_bits: CodeBits::Auto,
            search_radius: 8,
            hill_climb: HillClimb::default(),
            anneal: Anneal::default(),
            reinsert: Reinsert::default(),
        }
    }
}

/// What an optimisation did to a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Optimized {
    /// Passes over the tree.
    pub passes: u32,
    /// Rotations, or subtrees moved.
    pub changes: u64,
    /// SAH cost before ([`sah_cost`](bvh_core::sah_cost)), or its mean over poses.
    pub before: f64,
    /// SAH cost after.
    pub after: f64,
}

/// Why no tree was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BuildError {
    /// More primitives than a tree can number.
    TooManyPrimitives(usize),
    /// A tree over poses, but no pose.
    NoPoses,
    /// A pose of another number of primitives than the tree or the first pose has.
    PoseLength {
        /// The pose, from 0.
        pose: usize,
        /// Its number of primitives.
        found: usize,
        /// The number in the tree or the first pose.
        expected: usize,
    },
}

impl std::fmt::Display for BuildError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooManyPrimitives(n) => write!(f, "{n} primitives given; at most {MAX_PRIMITIVES} fit"),
            Self::NoPoses => write!(f, "no poses given; at least one is needed"),
            Self::PoseLength { pose, found, expected } => {
                write!(f, "pose {pose} has {found} primitives; it should have {expected}")
            }
        }
    }
}

impl std::error::Error for BuildError {}

/// Memory that builds keep from one to the next, so that they allocate nothing once it is large enough (but for
/// [`Builder::Sweep`] and what starts from it). It has no influence on results.
#[derive(Default)]
pub struct BuildScratch {
    items: Vec<Item>,
    dropped: Vec<Item>,
    spare: Vec<Item>,
    bins: Vec<Bins>,
    codes: Codes,
    tops: Tops,
    clusters: Clusters,
}

impl std::fmt::Debug for BuildScratch {
    /// The name alone: what is in it means nothing between calls.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BuildScratch").finish_non_exhaustive()
    }
}

impl BuildScratch {
    /// No memory as yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes room for builds by [`Builder::Binned`] and [`Builder::BinnedParallel`] over up to so many primitives. Such room
    /// is address space, until it is written to.
    ///
    /// # Panics
    /// If it would take more than `isize::MAX` bytes.
    pub fn reserve(&mut self, primitives: usize) {
        for items in [&mut self.items, &mut self.spare] {
            items.reserve_exact(primitives.saturating_sub(items.len()));
        }
    }

    /// How many primitives of the last build had an empty box.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped.len()
    }

    /// Memory that is kept, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let Self { items, dropped, spare, bins, codes, tops, clusters } = self;
        let items = [items, dropped, spare].map(bytes_of).iter().sum::<usize>();
        items + bytes_of(bins) + codes.bytes() + tops.bytes() + clusters.bytes()
    }
}

/// Memory of a list, used or not.
fn bytes_of<T>(list: &Vec<T>) -> usize {
    list.capacity() * size_of::<T>()
}

/// Builds a tree over `primitives`: [`rebuild`] with no memory but that of `recycled`, if it is of use.
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`].
pub fn build<P: Primitives + ?Sized>(
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    recycled: Option<Bvh>,
) -> Result<Bvh, BuildError> {
    let mut bvh = recycled.unwrap_or_default();
    rebuild(&mut bvh, primitives, builder, options, &mut BuildScratch::new())?;
    Ok(bvh)
}

/// Replaces `bvh` by a new tree over `primitives`, in the same memory; what it held does not matter.
///
/// O(n log n) for common scenes, O([`MAX_HEIGHT`](bvh_core::MAX_HEIGHT) n) at worst. `scratch` grows to, in bytes a
/// primitive, 64 binned, 48 LBVH, 52 HLBVH, 128 PLOC, 32 more with long codes; a sweep takes 140 of its own.
///
/// Where the SAH cannot choose (centres that cannot be told apart, a node without area) and where the tree
/// would get too high, a node is split in the middle of its primitives: no tree is higher than
/// [`MAX_HEIGHT`](bvh_core::MAX_HEIGHT), whatever the primitives. Those without extent, all alike, far from the origin
/// or beyond the range of `f32` areas make valid trees with tight boxes, too; how good those are is another matter,
/// where `f32` cannot tell places or areas apart. Primitives with an empty box are kept, and dropped
/// (see [`bvh_core`]).
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`]; `bvh` is then as it was.
pub fn rebuild<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    scratch: &mut BuildScratch,
) -> Result<(), BuildError> {
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
    let BuildScratch { items, dropped, spare, bins, codes, tops, clusters } = scratch;
    raw::write(bvh, n, |nodes, order| {
        if n == 0 {
            nodes.fill(Node::NOTHING);
            return 2;
        }
        let Gathered { centers, exact } = item::gather(primitives, items, dropped, threads);
        let boxed = items.len();
        let mut grow = |plot: Plot<'_>| match builder {
            Builder::Sweep | Builder::HillClimbed | Builder::Annealed | Builder::Reinserted => {
                sweep::build(items, n, threads > 1, plot)
            }
            Builder::Binned | Builder::BinnedParallel => {
                binned::build(items, (spare, bins), &Single, options.bins, threads, plot)
            }
            Builder::Lbvh => {
                morton::build(items, &codes.sort(items, &centers, options.code_bits, threads), threads, plot)
            }
            Builder::Hlbvh => {
                let sorted = codes.sort(items, &centers, options.code_bits, threads);
                hlbvh::build(items, &sorted, (tops, spare, bins), options.bins, threads, plot)
            }
            Builder::Ploc => {
                let sorted = codes.sort(items, &centers, options.code_bits, threads);
                ploc::build(items, &sorted, options.search_radius, clusters, threads, plot)
            }
        };
        let plot = Plot::new(nodes, order);
        match (boxed, dropped.len()) {
            (_, 0) => grow(plot),
            (0, _) => plot.halve(dropped),
            (left, _) => plot.fork(left, |l, r| (grow(l), r.halve(dropped))),
        };
        let root = if boxed == n { 0 } else { 2 };
        if boxed > 0 && optimize(nodes, root, builder, options) {
            layout::depth_first(nodes, &mut Vec::new());
            layout::slots_in_order(nodes, order);
        }
        if !exact {
            refit(nodes, order, primitives);
        }
        leaves::merge(nodes, options.max_leaf_size)
    });
    Ok(())
}

/// Improves the tree below the node in slot `root`, if the builder is one that does; whether it is.
fn optimize(nodes: &mut [Node], root: usize, builder: Builder, options: &BuildOptions) -> bool {
    match builder {
        Builder::HillClimbed => {
            climb::climb(nodes, root, &options.hill_climb);
        }
        Builder::Annealed => {
            climb::cool(nodes, root, &options.anneal);
        }
        Builder::Reinserted => {
            reinsert::optimize(&mut Boxes { nodes, root }, &options.reinsert, &mut ReinsertScratch::new());
        }
        _ => return false,
    }
    true
}

/// Sets all boxes to those that the primitives need; one primitive a leaf, children behind their parents.
fn refit<P: Primitives + ?Sized>(nodes: &mut [Node], order: &[u32], primitives: &P) {
    for i in (0..nodes.len()).rev().filter(|&i| i != 1) {
        let node = nodes[i];
        nodes[i].set_aabb(if node.is_leaf() {
            primitives.aabb(order[node.first()] as usize)
        } else {
            nodes[node.first()].aabb().union(nodes[node.first() + 1].aabb())
        });
    }
}
