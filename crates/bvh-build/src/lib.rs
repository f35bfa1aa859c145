//! Builders of bounding volume hierarchies.
//!
//! [`build`] makes a [`Bvh`] top down from the boxes of its primitives, by the surface area heuristic (SAH):
//! [`Builder::Sweep`] tries every split between the sorted centres on all three axes and is the yardstick of
//! quality; [`Builder::Binned`] tries a few dozen and is fast; [`Builder::BinnedParallel`] gives the same
//! tree on all threads of the current rayon pool.
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
#![forbid(unsafe_code)]

mod binned;
mod four;
mod item;
mod leaves;
mod plot;
mod sweep;

use bvh_core::{Bvh, MAX_PRIMITIVES, Node, Primitives};

use crate::item::Items;
use crate::plot::Plot;

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
}

impl Builder {
    /// All builders.
    pub const ALL: [Self; 3] = [Self::Sweep, Self::Binned, Self::BinnedParallel];

    /// Name on command lines and in result files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::Binned => "binned",
            Self::BinnedParallel => "binned-parallel",
        }
    }
}

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
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self { max_leaf_size: 1, bins: 32 }
    }
}

/// Why no tree was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BuildError {
    /// More primitives than a tree can number.
    TooManyPrimitives(usize),
}

impl std::fmt::Display for BuildError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooManyPrimitives(n) => write!(f, "{n} primitives given; at most {MAX_PRIMITIVES} fit"),
        }
    }
}

impl std::error::Error for BuildError {}

/// Builds a tree over `primitives`. `recycled` gives its memory, if it is of use; its content does not matter.
///
/// O(n log n) for common scenes, O([`MAX_HEIGHT`](bvh_core::MAX_HEIGHT) n) at worst. Temporary memory a
/// primitive: 64 bytes binned, 140 sweep.
///
/// Where the SAH cannot choose (centres that cannot be told apart, a node without area) and where the tree
/// would get too high, a node is split in the middle of its primitives.
///
/// # Errors
/// If there are more than [`MAX_PRIMITIVES`].
pub fn build<P: Primitives + ?Sized>(
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    recycled: Option<Bvh>,
) -> Result<Bvh, BuildError> {
    let n = primitives.len();
    if n > MAX_PRIMITIVES {
        return Err(BuildError::TooManyPrimitives(n));
    }
    let tree = Bvh::build(2 * n.max(1), recycled, |nodes, order| {
        if n == 0 {
            return 2;
        }
        order.resize(n, 0);
        let in_pool = rayon::current_thread_index().is_some();
        let threads = match builder {
            Builder::Sweep if in_pool => rayon::current_num_threads(),
            Builder::Sweep | Builder::Binned => 1,
            Builder::BinnedParallel => rayon::current_num_threads(),
        };
        let Items { boxed, dropped, exact } = item::gather(primitives, threads > 1);
        let grow = |items, plot| match builder {
            Builder::Sweep => sweep::build(items, n, threads > 1, plot),
            Builder::Binned | Builder::BinnedParallel => binned::build(items, options.bins, threads, plot),
        };
        let plot = Plot::new(nodes, order);
        match (boxed.len(), dropped.len()) {
            (_, 0) => grow(boxed, plot),
            (0, _) => plot.halve(&dropped),
            (left, _) => plot.fork(left, |l, r| (grow(boxed, l), r.halve(&dropped))),
        };
        if !exact {
            refit(nodes, order, primitives);
        }
        leaves::merge(nodes, options.max_leaf_size)
    });
    Ok(tree.expect("builders write trees"))
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
