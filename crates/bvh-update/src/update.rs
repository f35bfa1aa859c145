//! The entry points: an updater that keeps one tree good, and the two passes alone.

use std::fmt;

use bvh_build::{Reinsert, reinsert};
use bvh_core::{Bvh, Primitives, SimdLevel};

use crate::auto::{self, Auto, Load};
use crate::rebuild::background;
use crate::rebuild::{BackgroundCost, degraded, new_tree};
use crate::refit::{self, BlockCost, Costs, PassOptions, Rotate, parts, pass};
use crate::repair;
use crate::report::{Update, UpdateError};
use crate::state::State;
use crate::strategy::Strategy;
use crate::workspace::Workspace;

/// Keeps a tree good while its primitives move: one strategy, its memory, and what was reported to
/// it.
///
/// Each tree wants an updater of its own: reported loads, and a build in the background, belong to
/// one tree. Of two trees that take turns one may never get a tree from the background. Dropping an
/// updater waits for the build under way.
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3};
/// use bvh_update::{Load, Strategy, Updater};
///
/// let boxes = |time: f32| -> Vec<Aabb> {
///     let corner = |i: usize| Vec3::new(i as f32, time * (i % 7) as f32, 0.0);
///     (0..1000).map(corner).map(|corner| Aabb::new(corner, corner + 0.5)).collect()
/// };
/// let mut bvh = build(&boxes(0.0), Builder::Sweep)?;
/// let mut updater = Updater::new(Strategy::default());
/// for frame in 1..10 {
///     let done = updater.update(&mut bvh, &boxes(frame as f32))?;
///     assert_eq!(done.dropped, 0);
///     // A thousand single rays are cast through the tree before the next update.
///     updater.report(Load::SingleRays(1000));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Updater {
    strategy: Strategy,
    workspace: Workspace,
    load: Option<Load>,
    reports_cost: bool,
}

impl Updater {
    /// Memory that refits and rotations keep, in bytes for each thread that takes part: the same
    /// for all trees that it updates, until it ends. More, if primitives start tasks of their own.
    pub const THREAD_MEMORY: usize = refit::THREAD_MEMORY;

    /// Makes an updater that uses the best SIMD level of this machine.
    #[must_use]
    pub fn new(strategy: Strategy) -> Self {
        Self::with_level(strategy, SimdLevel::best())
    }

    /// Makes an updater that uses `level`, or the best below it that the machine has. Every level
    /// leaves the same tree.
    ///
    /// ```
    /// use bvh_build::{Builder, build};
    /// use bvh_core::{Aabb, SimdLevel, Vec3};
    /// use bvh_update::{Strategy, Updater};
    ///
    /// let boxes = [0.0, 2.0, 5.0].map(|x| Aabb::new(Vec3::X * x, Vec3::X * x + 1.0));
    /// let trees = SimdLevel::available().map(|level| {
    ///     let mut bvh = build(&boxes, Builder::Sweep)?;
    ///     Updater::with_level(Strategy::default(), level).update(&mut bvh, &boxes)?;
    ///     Ok(bvh.fingerprint())
    /// });
    /// let trees = trees.collect::<Result<Vec<_>, Box<dyn std::error::Error>>>()?;
    /// assert!(trees.iter().all(|tree| *tree == trees[0]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn with_level(strategy: Strategy, level: SimdLevel) -> Self {
        let passes = PassOptions::with_level(level);
        let workspace = Workspace { passes, ..Workspace::default() };
        Self { strategy, workspace, load: None, reports_cost: false }
    }

    /// Changes what to do between two frames, from now on.
    pub fn set_strategy(&mut self, strategy: Strategy) -> &mut Self {
        self.strategy = strategy;
        self
    }

    /// Reports what is asked of the tree between two updates, for [`Strategy::Auto`]. It holds for
    /// every update until the next report, which replaces it, and stands in the place of
    /// [`Auto::load`]: two million rays in packets unless set otherwise. Who casts single rays, as
    /// [`closest_hit`](bvh_core::closest_hit) does, should report [`Load::SingleRays`] or their
    /// [visits](bvh_core::Visits). `None` takes earlier reports back.
    pub fn report(&mut self, load: impl Into<Option<Load>>) {
        self.load = load.into();
    }

    /// Makes every update that refits report the SAH cost ([`Update::sah_cost`]), where strategies
    /// that do not need it leave it out. `docs/UPDATE_COST.md` has what the sums take.
    pub fn report_cost(&mut self, report: bool) -> &mut Self {
        self.reports_cost = report;
        self
    }

    /// Makes refits, with and without rotations, record what each of their blocks takes, for
    /// [`take_costs`](Self::take_costs). Sweeps over trees in built order have no blocks. Only for
    /// targets with a clock: later updates panic on `wasm32-unknown-unknown`.
    pub fn record_costs(&mut self) {
        self.workspace.passes.costs.get_or_insert_default();
    }

    /// Returns what the blocks of all passes since the last call took.
    pub fn take_costs(&mut self) -> Vec<BlockCost> {
        self.workspace.passes.costs.as_mut().map(Costs::take).unwrap_or_default()
    }

    /// Returns what the last tree that was built in the background cost; `None` before there was
    /// one.
    #[must_use]
    pub fn background_cost(&self) -> Option<BackgroundCost> {
        self.workspace.background.cost
    }

    /// Brings `bvh` up to date with primitives that have moved.
    ///
    /// Primitives without finite coordinates are dropped from all boxes, counted in
    /// [`Update::dropped`], and return in the first update that finds them finite. After an update
    /// every box is tight, wherever the primitives went: onto one point, far from the origin,
    /// beyond the range of `f32` areas. A rotation is applied only if it lowers the area by more
    /// than 1.2e-38, in the arithmetic of [`area_changes`](bvh_core::rotation::area_changes), and
    /// leaves the tree no higher than [`MAX_HEIGHT`](bvh_core::MAX_HEIGHT).
    ///
    /// Runs in the current rayon pool. The tree that results is the same, bit for bit, for every
    /// number of threads and every SIMD level; only [`Strategy::Background`] depends on time.
    /// Refits, with or without rotations, take O(n) time for the n nodes above dynamic primitives,
    /// and allocate nothing but where a thread takes part for the first time, or a panic has taken
    /// its memory ([`THREAD_MEMORY`](Self::THREAD_MEMORY)). A rebuild keeps which primitives are
    /// dynamic, leaf by leaf ([`Bvh::set_dynamic`]). Its leaves may be as large as the
    /// last build by an update allowed, or as the tree's largest where no update has built it;
    /// [`Strategy::Rebuild`] takes the leaf size from its options.
    ///
    /// [`Strategy::Rebuild`] and [`Strategy::Auto`] take another number of primitives than the tree
    /// holds and build a new tree, in which all primitives are dynamic.
    ///
    /// # Errors
    /// If the number of primitives is not that of the tree and the strategy does not rebuild, or if
    /// a build fails. The tree is as it was then, or has had its pass if a rebuild was to follow.
    ///
    /// # Panics
    /// If primitives panic. The structure of the tree is valid after that:
    /// * after a panic in a pass some boxes are old, and the next update refits all;
    /// * after one in a build in the place of the tree, the tree is empty and needs
    ///   [`Strategy::Rebuild`], [`Strategy::Auto`] or a build;
    /// * where a tree from the background took over, all primitives are dynamic.
    pub fn update<P: Primitives + ?Sized>(
        &mut self,
        bvh: &mut Bvh,
        primitives: &P,
    ) -> Result<Update, UpdateError> {
        let strategy = match (self.strategy, self.load) {
            (Strategy::Auto(_), Some(load)) => Strategy::Auto(Auto { load }),
            (strategy, _) => strategy,
        };
        let (tree, given) = (bvh.len(), primitives.len());
        if tree != given && !matches!(strategy, Strategy::Rebuild(..) | Strategy::Auto(_)) {
            return Err(UpdateError::Count { tree, given });
        }
        let workspace = &mut self.workspace;
        State::note_changes(parts(bvh).state);
        workspace.passes.with_sums = self.reports_cost;
        let Workspace { passes, repair, rebuild, reinsert: reinsertion, background } = workspace;
        match &strategy {
            Strategy::Refit => Ok(pass(bvh, primitives, None, passes).report(bvh)),
            Strategy::RefitRotate(rotate) => Ok(pass(bvh, primitives, Some(*rotate), passes).report(bvh)),
            Strategy::Rebuild(builder, options) => new_tree(bvh, primitives, *builder, options, rebuild),
            Strategy::Degraded(options) => degraded::update(bvh, primitives, options, passes, rebuild),
            Strategy::PartialRebuild(options) => {
                repair::update(bvh, primitives, options, passes, repair, rebuild)
            }
            Strategy::Reinsert(options) => {
                let tally = pass(bvh, primitives, options.rotate, passes);
                let options = Reinsert::default().with_part(options.part).with_passes(1);
                let done = reinsert(bvh, &options, reinsertion);
                Ok(Update { sah_cost: Some(done.after), ..tally.report(bvh) })
            }
            Strategy::Background(options) => {
                Ok(background::update(bvh, primitives, options, passes, rebuild, background))
            }
            Strategy::Auto(options) => auto::update(bvh, primitives, options, workspace),
        }
    }
}

impl Default for Updater {
    /// An updater that chooses: [`Strategy::Auto`].
    fn default() -> Self {
        Self::new(Strategy::default())
    }
}

impl fmt::Debug for Updater {
    /// The strategy and the load alone: the rest is memory.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { strategy, load, .. } = self;
        f.debug_struct("Updater").field("strategy", strategy).field("load", load).finish_non_exhaustive()
    }
}

/// Refits all boxes to the primitives' new positions, structure fixed; see [`Updater::update`].
/// Uses the threads' memory, as an updater does ([`Updater::THREAD_MEMORY`]).
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3};
///
/// let at = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 1.0, 1.0));
/// let mut bvh = build(&[at(0.0), at(1.0)], Builder::Sweep)?;
/// bvh_update::refit(&mut bvh, &[at(0.0), at(9.0)])?;
/// assert_eq!(bvh.root().aabb().max.x, 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the number of primitives is not that of the tree.
pub fn refit<P: Primitives + ?Sized>(bvh: &mut Bvh, primitives: &P) -> Result<Update, UpdateError> {
    Updater::new(Strategy::Refit).update(bvh, primitives)
}

/// Refits all boxes and rotates at every node on the way up (Kopta et al. 2012), as [`refit`] does.
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3};
///
/// let at = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 1.0, 1.0));
/// let mut bvh = build(&[at(0.0), at(1.0), at(10.0)], Builder::Sweep)?;
/// // The second box joins the third.
/// let done = bvh_update::refit_and_rotate(&mut bvh, &[at(0.0), at(9.0), at(10.0)])?;
/// assert_eq!(done.rotations_applied(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the number of primitives is not that of the tree.
pub fn refit_and_rotate<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
) -> Result<Update, UpdateError> {
    Updater::new(Strategy::RefitRotate(Rotate::default())).update(bvh, primitives)
}
