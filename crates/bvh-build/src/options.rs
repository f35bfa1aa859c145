//! Which builder, and its settings.

use crate::{Anneal, HillClimb, Reinsert};

/// How to build a tree.
///
/// ```
/// use bvh_build::Builder;
///
/// assert_eq!(Builder::default(), Builder::balanced());
/// assert_eq!("lbvh".parse(), Ok(Builder::fast()));
/// assert_eq!(Builder::best().name(), "reinserted");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Builder {
    /// Full sweep SAH: every split between neighbours in the order of the centres, on all three
    /// axes. Serial, except within a rayon pool of several threads.
    Sweep,
    /// Binned SAH on all three axes, serial (Wald 2007). Two to four primitives get the optimal
    /// tree.
    Binned,
    /// The same tree as [`Binned`](Self::Binned), built on all threads of the current rayon pool.
    BinnedParallel,
    /// Splits along the Morton curve through the centres (Lauterbach et al. 2009), on all threads
    /// of the current rayon pool: the fastest build, at 1.13 to 1.19 times the SAH cost of a sweep
    /// (`docs/ACCURACY.md`).
    Lbvh,
    /// Binned SAH over clusters along the Morton curve, which are built as by [`Lbvh`](Self::Lbvh)
    /// (Pantaleoni and Luebke 2010), on all threads of the current rayon pool.
    Hlbvh,
    /// Parallel locally-ordered clustering (Meister and Bittner 2018), on all threads of the
    /// current rayon pool: a tree like that of [`Binned`](Self::Binned) in 0.4 to 0.6 of the time
    /// (`docs/ACCURACY.md`).
    #[default]
    Ploc,
    /// [`Sweep`](Self::Sweep), then rotations until none gains; see
    /// [`hill_climb`](crate::hill_climb).
    HillClimbed,
    /// [`Sweep`](Self::Sweep), then rotations by simulated annealing; see
    /// [`anneal`](crate::anneal).
    Annealed,
    /// [`Sweep`](Self::Sweep), then each subtree moved to where it costs least; see
    /// [`reinsert`](fn@crate::reinsert), on all threads of the current rayon pool. A lower
    /// cost than by annealing with 25 passes (not the default of 400), in about twice the time
    /// (`docs/ACCURACY.md`).
    Reinserted,
}

bvh_core::named!(
    Builder,
    "builder",
    Sweep = "sweep",
    Binned = "binned",
    BinnedParallel = "binned-parallel",
    Lbvh = "lbvh",
    Hlbvh = "hlbvh",
    Ploc = "ploc",
    HillClimbed = "hill-climbed",
    Annealed = "annealed",
    Reinserted = "reinserted"
);

impl Builder {
    /// The builders for a new tree in each frame, and the sweep as their yardstick.
    pub const PER_FRAME: [Self; 6] =
        [Self::Sweep, Self::Binned, Self::BinnedParallel, Self::Lbvh, Self::Hlbvh, Self::Ploc];

    /// Returns the fastest build: [`Lbvh`](Self::Lbvh).
    #[must_use]
    pub const fn fast() -> Self {
        Self::Lbvh
    }

    /// Returns a good tree from a fast build, the default: [`Ploc`](Self::Ploc).
    #[must_use]
    pub const fn balanced() -> Self {
        Self::Ploc
    }

    /// Returns the best tree, for trees that are made once: [`Reinserted`](Self::Reinserted).
    #[must_use]
    pub const fn best() -> Self {
        Self::Reinserted
    }
}

/// Settings of a build. A value out of range counts as the nearest one in range.
///
/// ```
/// use bvh_build::{BuildOptions, Reinsert};
///
/// let budget = Reinsert::default().with_passes(3);
/// let options = BuildOptions::default().with_max_leaf_size(4).with_reinsert(budget);
/// assert_eq!((options.max_leaf_size, options.reinsert.passes), (4, 3));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Largest number of primitives in one leaf, 1 to [`MAX_LEAF_SIZE`](bvh_core::MAX_LEAF_SIZE). A
    /// leaf takes several only where that does not raise the SAH cost.
    ///
    /// The default is 1, the choice of Kopta et al. 2012 (section 2): primitives whose motion may
    /// diverge must not share a leaf.
    pub max_leaf_size: u32,
    /// Bins on each axis, 2 to 256, for [`Builder::Binned`], [`Builder::BinnedParallel`] and
    /// [`Builder::Hlbvh`]; 32 by default. Nodes of few primitives use fewer.
    pub bins: u32,
    /// Number of neighbours on either side that [`Builder::Ploc`] compares each cluster with, 1 to
    /// 32; 8 by default.
    pub search_radius: u32,
    /// The budget of [`Builder::HillClimbed`].
    pub hill_climb: HillClimb,
    /// The schedule of [`Builder::Annealed`].
    pub anneal: Anneal,
    /// The budget of [`Builder::Reinserted`].
    pub reinsert: Reinsert,
}

bvh_core::with_methods!(BuildOptions: with_max_leaf_size(max_leaf_size: u32), with_bins(bins: u32),
    with_search_radius(search_radius: u32), with_hill_climb(hill_climb: HillClimb),
    with_anneal(anneal: Anneal), with_reinsert(reinsert: Reinsert));

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            max_leaf_size: 1,
            bins: 32,
            search_radius: 8,
            hill_climb: HillClimb::default(),
            anneal: Anneal::default(),
            reinsert: Reinsert::default(),
        }
    }
}
