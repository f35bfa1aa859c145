//! The strategies: named ways to bring a tree up to date with primitives that have moved.

use std::fmt;
use std::str::FromStr;

use bvh_build::{BuildError, BuildOptions, Builder, Reinsert, rebuild, reinsert};
use bvh_core::{Bvh, History, Measure, Node, Primitives, sah_cost};
use thiserror::Error;

use crate::auto::{self, Auto};
use crate::background::{self, Background};
use crate::block::{LISTED, Tally};
use crate::decision::Decision;
use crate::degraded::{self, Degraded};
use crate::leaves::{self, Leaves};
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::regrow::{self, Open, Regrow};

/// What to do with a tree between two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strategy {
    /// Recompute all boxes, structure fixed (Wald, Boulos, Shirley 2007).
    Refit,
    /// Refit and rotate in one pass (Kopta et al. 2012).
    RefitRotate(Rotate),
    /// Build a new tree. Which primitives move is as it was.
    Rebuild(Builder, BuildOptions),
    /// Refit, with or without rotations, and build a new tree when this one has degraded (Lauterbach et al. 2006).
    Degraded(Degraded),
    /// Refit, with or without rotations, and build the tree anew above those subtrees that are still good once it has
    /// degraded (Yoon, Curtis, Manocha 2007; Garanzha 2008; ours): see [`Regrow`].
    Regrow(Regrow),
    /// Refit, with or without rotations, and put the worst few subtrees where they cost least (Bittner et al. 2013;
    /// Meister and Bittner 2018).
    Reinsert(Reinsertion),
    /// Refit, with or without rotations, and split and merge leaves (Kopta et al. 2012, section 2, future work): see
    /// [`Leaves`].
    Leaves(Leaves),
    /// Refit, with or without rotations, while new trees are built in the background, each in turn put in the place of
    /// the one before (Ize et al. 2007). The trees depend on how long that takes.
    Background(Background),
    /// Choose from refitting, rotating, merging leaves, regrowing and building anew what costs the least time.
    Auto(Auto),
}

/// The budget of insertion-based repair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reinsertion {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Part of the nodes tried in each update, those of the greatest inefficiency; 0.01 by default.
    pub part: f64,
}

impl Default for Reinsertion {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), part: 0.01 }
    }
}

/// The budget of rotations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rotate {
    /// Rotations are tried at each node in one of this many updates, at different nodes each time; a power of two,
    /// else the next one. The default is 1, every node in every update: trying takes a quarter of the pass, and what
    /// is left out costs more than that in all but gentle motion.
    pub period: u32,
}

impl Default for Rotate {
    fn default() -> Self {
        Self { period: 1 }
    }
}

/// Which nodes rotations are tried at in one update.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    mask: usize,
    turn: usize,
}

impl Turn {
    pub(crate) fn new(rotate: Rotate, updates: u32) -> Self {
        let period = rotate.period.clamp(1, 1 << 31).next_power_of_two();
        Self { mask: period as usize - 1, turn: updates as usize }
    }

    /// Whether it is every node's turn.
    pub(crate) fn is_always(self) -> bool {
        self.mask == 0
    }

    /// Parts a list of inner nodes into those whose turn it is, and the others.
    pub(crate) fn split<'a>(self, list: &[u32], lists: &'a mut [[u32; LISTED]; 2]) -> [&'a [u32]; 2] {
        let [now, later] = lists;
        let mut count = 0;
        for (i, &slot) in list.iter().enumerate() {
            // Written to both and counted in one, as a branch would be mispredicted. The remainders spare checks.
            now[count % LISTED] = slot;
            later[(i - count) % LISTED] = slot;
            count += usize::from(self.includes(slot as usize));
        }
        [&now[..count], &later[..list.len() - count]]
    }

    /// Whether it is the turn of the node in this slot.
    #[inline]
    pub(crate) fn includes(self, slot: usize) -> bool {
        (slot / 2).wrapping_add(self.turn) & self.mask == 0
    }
}

impl Strategy {
    /// All strategies, with their defaults.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let rotate = Some(Rotate::default());
        let mut all = vec![
            Self::Refit,
            Self::RefitRotate(Rotate::default()),
            Self::Degraded(Degraded::default()),
            Self::Degraded(Degraded { rotate, ..Degraded::default() }),
            Self::Regrow(Regrow { rotate: None, ..Regrow::default() }),
            Self::Regrow(Regrow { rotate, ..Regrow::default() }),
            Self::Auto(Auto::default()),
            Self::Background(Background::default()),
            Self::Background(Background { rotate, ..Background::default() }),
            Self::Reinsert(Reinsertion::default()),
            Self::Leaves(Leaves::default()),
            Self::Regrow(Regrow { rotate: None, open: Open::Overlapping, ..Regrow::default() }),
            Self::Regrow(Regrow { rotate, open: Open::Overlapping, ..Regrow::default() }),
            Self::Regrow(Regrow { rotate: None, open: Open::Divergent, ..Regrow::default() }),
            Self::Regrow(Regrow { rotate, open: Open::Divergent, ..Regrow::default() }),
        ];
        all.extend(Builder::PER_FRAME.map(|builder| Self::Rebuild(builder, BuildOptions::default())));
        all
    }

    /// Name as the command line and results have it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Refit => "refit",
            Self::RefitRotate(_) => "refit+rotate",
            Self::Rebuild(builder, _) => builder.name(),
            Self::Degraded(Degraded { rotate: None, .. }) => "refit+rebuild",
            Self::Degraded(_) => "refit+rotate+rebuild",
            Self::Regrow(Regrow { rotate, open, .. }) => match (open, rotate) {
                (Open::Grown, None) => "refit+regrow",
                (Open::Grown, Some(_)) => "refit+rotate+regrow",
                (Open::Overlapping, None) => "refit+selective",
                (Open::Overlapping, Some(_)) => "refit+rotate+selective",
                (Open::Divergent, None) => "refit+divergent",
                (Open::Divergent, Some(_)) => "refit+rotate+divergent",
            },
            Self::Auto(_) => "auto",
            Self::Reinsert(Reinsertion { rotate: None, .. }) => "refit+reinsert",
            Self::Reinsert(_) => "refit+rotate+reinsert",
            Self::Leaves(Leaves { rotate: None, .. }) => "refit+leaves",
            Self::Leaves(_) => "refit+rotate+leaves",
            Self::Background(Background { rotate: None, .. }) => "refit+background",
            Self::Background(_) => "refit+rotate+background",
        }
    }
}

impl FromStr for Strategy {
    type Err = UnknownStrategy;

    /// The strategy of that [name](Self::name), with its defaults.
    fn from_str(name: &str) -> Result<Self, UnknownStrategy> {
        let found = || UnknownStrategy { found: name.to_owned() };
        Self::all().into_iter().find(|s| s.name() == name).ok_or_else(found)
    }
}

impl fmt::Display for Strategy {
    /// Its [name](Self::name).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// There is no strategy of this name.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("unknown strategy '{found}'; expected one of {}", names().join(", "))]
pub struct UnknownStrategy {
    found: String,
}

fn names() -> Vec<&'static str> {
    Strategy::all().iter().map(Strategy::name).collect()
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Update {
    /// Whether the whole tree is a new one.
    pub rebuilt: bool,
    /// What was decided, where the strategy decides.
    pub decision: Decision,
    /// Rotations applied, by kind in the order of [`Rotation::ALL`](bvh_core::Rotation::ALL).
    pub rotations: [u64; 6],
    /// SAH cost of the tree as it is now, where the update knows it for free: [`sah_cost`], but from `f32` areas, as
    /// far as those are finite. `None` after a rebuild.
    pub sah_cost: Option<f64>,
    /// Height of the tree as it is now.
    pub height: u32,
    /// Nodes whose boxes were recomputed.
    pub nodes_visited: u64,
    /// Primitives that are dropped at present, for want of finite coordinates: of those visited, or after a rebuild of
    /// all.
    pub dropped: u64,
}

impl Update {
    /// Rotations applied, of all kinds.
    #[must_use]
    pub fn rotations_applied(&self) -> u64 {
        self.rotations.iter().sum()
    }
}

/// Why a tree was not updated. It is as it was, or refitted if a rebuild was to follow.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// Another number of primitives than the tree holds: build a new tree.
    #[error("the tree holds {tree} primitives, but {given} were given")]
    Count {
        /// Primitives of the tree.
        tree: usize,
        /// Primitives given.
        given: usize,
    },
    /// A rebuild failed.
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// Brings `bvh` up to date with primitives that have moved, as `strategy` says.
///
/// Primitives without finite coordinates are dropped from all boxes, counted in [`Update::dropped`], and back in the
/// first update that finds them finite. After it every box is tight, wherever the primitives went: onto one point, far
/// from the origin, beyond the range of `f32` areas. A rotation is applied only if it lowers the area, strictly, and
/// leaves the tree no higher than [`MAX_HEIGHT`](bvh_core::MAX_HEIGHT).
///
/// Runs in the current rayon pool; the tree that results is the same, bit for bit, for every number of threads and
/// every SIMD level ([`Strategy::Background`] excepted, which depends on time, and [`Auto`], which learns from
/// [`Scratch::visited`] and, if asked, from the clock). Refitting, with or without rotations,
/// takes O(n) time for the n nodes above primitives that move, and after the first call allocates nothing. A whole tree
/// that takes the place of one, without options of its own, has no larger leaves than that had or might have had; where
/// [`Auto`] has merged leaves, than that had before.
///
/// # Errors
/// If the number of primitives is not that of the tree, or a build fails.
pub fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    strategy: &Strategy,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    if primitives.len() != bvh.len() {
        return Err(UpdateError::Count { tree: bvh.len(), given: primitives.len() });
    }
    expect_measure(raw::parts(bvh).history, strategy);
    scratch.clock.slope.begin();
    scratch.clock.growth.begin();
    match strategy {
        Strategy::Refit => Ok(pass(bvh, primitives, None, scratch).update(bvh)),
        Strategy::RefitRotate(rotate) => Ok(pass(bvh, primitives, Some(*rotate), scratch).update(bvh)),
        Strategy::Rebuild(builder, options) => new_tree(bvh, primitives, *builder, options, scratch),
        Strategy::Degraded(degraded) => degraded::update(bvh, primitives, degraded, scratch),
        Strategy::Regrow(regrow) => regrow::update(bvh, primitives, regrow, scratch),
        Strategy::Reinsert(options) => {
            let tally = pass(bvh, primitives, options.rotate, scratch);
            let budget = Reinsert::default().with_part(options.part).with_passes(1);
            reinsert(bvh, &budget, &mut scratch.reinsert);
            // The cost is not known for free.
            Ok(Update { sah_cost: None, ..tally.update(bvh) })
        }
        Strategy::Leaves(leaves) => leaves::update(bvh, primitives, leaves, scratch),
        Strategy::Background(background) => background::update(bvh, primitives, background, scratch),
        Strategy::Auto(auto) => auto::update(bvh, primitives, *auto, scratch),
    }
}

impl Tally {
    /// What the pass tells of itself; `bvh` is the tree after it.
    pub(crate) fn update(&self, bvh: &Bvh) -> Update {
        // Still areas are already among those of the tree.
        let cost = (self.area + bvh.static_area()) / bvh.root().aabb().half_area_f64();
        Update {
            rotations: self.rotations,
            // Areas beyond the range of f32, or a root without area.
            sah_cost: Some(if cost.is_finite() { cost } else { sah_cost(bvh) }),
            height: bvh.height(),
            nodes_visited: self.leaves + self.inner,
            dropped: self.dropped,
            ..Update::default()
        }
    }
}

/// Forgets what another strategy has measured.
fn expect_measure(history: &mut History, strategy: &Strategy) {
    let measure = match strategy {
        Strategy::Refit | Strategy::RefitRotate(_) | Strategy::Rebuild(..) => return,
        Strategy::Reinsert(_) | Strategy::Background(_) => return,
        Strategy::Degraded(_) => Measure::Ratio,
        Strategy::Regrow(Regrow { open: Open::Divergent, .. }) => Measure::Divergence,
        Strategy::Regrow(_) | Strategy::Auto(_) => Measure::Areas,
        Strategy::Leaves(_) => Measure::Leaves,
    };
    if std::mem::take(&mut history.has_other_moving) {
        match measure {
            // `take_references` sees to it.
            Measure::Areas | Measure::Divergence => history.has_other_moving = true,
            Measure::Leaves => history.reference = 0.0,
            _ => {}
        }
    }
    if history.measure != measure {
        let History { updates, background_job, spare_pair, spare_pair_count, layout, largest_leaf, .. } =
            *history;
        *history = History {
            measure,
            updates,
            background_job,
            spare_pair,
            spare_pair_count,
            layout,
            largest_leaf,
            ..History::default()
        };
    }
}

/// Options for a tree in the place of `bvh`, whose builder is not known: with leaves as large as its largest. O(n) if
/// that is not known.
pub(crate) fn options_like(bvh: &mut Bvh) -> BuildOptions {
    let parts = raw::parts(bvh);
    if parts.history.largest_leaf == 0 {
        parts.history.largest_leaf = parts.nodes.iter().map(Node::count).max().unwrap_or(1) as u32;
    }
    BuildOptions::default().with_max_leaf_size(parts.history.largest_leaf)
}

/// Builds a new tree in which the same primitives move.
pub(crate) fn new_tree<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    builder: Builder,
    options: &BuildOptions,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let measure = bvh.history().measure;
    let any_still = note_moving(bvh, &mut scratch.moving);
    rebuild(bvh, primitives, builder, options, &mut scratch.build)?;
    if any_still {
        bvh.set_dynamic(|p| scratch.moving[p]);
    }
    let history = raw::parts(bvh).history;
    (history.measure, history.largest_leaf) = (measure, options.max_leaf_size);
    let (nodes_visited, dropped) = (bvh.nodes().len() as u64 - 1, scratch.build.dropped() as u64);
    Ok(Update { rebuilt: true, height: bvh.height(), nodes_visited, dropped, ..Update::default() })
}

/// Notes which primitives move, unless all do. Looks at what is in the tree: slots that are not in use may hold anything.
pub(crate) fn note_moving(bvh: &Bvh, moving: &mut Vec<bool>) -> bool {
    if bvh.all_dynamic() {
        return false;
    }
    moving.clear();
    moving.resize(bvh.len(), false);
    bvh.visit(|_, node, _| {
        if node.is_dynamic() {
            bvh.primitives(node).iter().for_each(|&p| moving[p as usize] = true);
        }
    });
    true
}
