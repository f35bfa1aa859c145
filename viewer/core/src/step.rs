//! A step: everything moves to a frame, and trees are updated to it, in place or beside the thread
//! that draws.

use std::sync::Arc;

use bvh_core::{Aabb, Bvh, sah_cost};
use bvh_update::{
    Decision, Degraded, Load, PartialRebuild, Reinsertion, Strategy, Update, UpdateError, Updater,
};
use stage::Stage;

use crate::Clock;
use crate::boxes;
use crate::side::Side;
use crate::state::Shown;

/// Boxes that flash, at most; more hide what they are drawn over.
const FLASHES: usize = 60;

/// A strategy that tries rotations at each node in one of `period` updates, if it rotates at all.
fn with_budget(mut strategy: Strategy, period: u32) -> Strategy {
    let rotate = match &mut strategy {
        Strategy::RefitRotate(rotate) => Some(rotate),
        Strategy::Degraded(Degraded { rotate, .. })
        | Strategy::PartialRebuild(PartialRebuild { rotate, .. })
        | Strategy::Reinsert(Reinsertion { rotate, .. }) => rotate.as_mut(),
        _ => None,
    };
    if let Some(rotate) = rotate {
        rotate.period = period;
    }
    strategy
}

/// What was decided in an update and why, the reason first: lines are cut where the picture ends.
fn log_line(frame: usize, update: &Update) -> String {
    let why = update.reason.map(|why| format!("lost {:.2} of {:.2} ms: ", why.lost_ms, why.price_ms));
    let what = (update.decision != Decision::AsAlways).then(|| format!("{}; ", update.decision));
    let [why, what] = [why, what].map(Option::unwrap_or_default);
    format!("{frame}: {why}{what}{} rotations", update.rotations_applied())
}

/// How trees are updated.
#[derive(Clone, Copy)]
pub(crate) struct How {
    /// Each node tries rotations once in this number of updates.
    pub(crate) period: u32,
    /// Whether to look for the nodes that rotated.
    pub(crate) flash: bool,
    /// Whether normals are wanted.
    pub(crate) smooth: bool,
    pub(crate) clock: Clock,
}

/// What an update came to.
pub(crate) struct Outcome {
    pub(crate) update: Option<Update>,
    pub(crate) line: String,
    pub(crate) ms: f64,
    /// SAH cost of the tree.
    pub(crate) cost: f64,
    /// Boxes of the nodes that rotated.
    pub(crate) flashes: Vec<Aabb>,
}

/// Brings a tree to the stage's frame.
pub(crate) fn update(
    tree: &mut Bvh,
    updater: &mut Updater,
    strategy: Strategy,
    (stage, frame): (&Stage, usize),
    how: How,
) -> Outcome {
    let before = how.flash.then(|| boxes::links(tree));
    updater.report_cost(true).set_strategy(with_budget(strategy, how.period));
    let start = (how.clock)();
    let updated: Result<Update, UpdateError> = stage.update(tree, updater);
    let ms = 1e3 * ((how.clock)() - start);
    let line =
        updated.as_ref().map_or_else(|e| format!("frame {frame}: {e}"), |update| log_line(frame, update));
    let update = updated.ok();
    let cost = update.and_then(|update| update.sah_cost).unwrap_or_else(|| sah_cost(tree));
    let same = |before: &Vec<u32>| {
        before.len() == tree.nodes().len() && update.is_some_and(|update| !update.rebuilt)
    };
    let flashes = before.filter(same).map(|before| boxes::rotated(tree, &before, FLASHES));
    Outcome { update, line, ms, cost, flashes: flashes.unwrap_or_default() }
}

/// A step to a frame, for another thread: it works on copies, so that what is shown can be drawn
/// meanwhile. Once it has [run](Self::run), it is an [`Event::Stepped`](crate::Event::Stepped).
pub struct Step {
    /// Which scene it is of.
    pub(crate) scene: u64,
    /// A copy of the stage, at any frame.
    pub(crate) stage: Stage,
    pub(crate) frame: usize,
    how: How,
    pub(crate) trees: Vec<Work>,
    /// Milliseconds that it took.
    pub(crate) ms: f64,
}

/// A tree of a step.
pub(crate) struct Work {
    /// Which side's it is.
    pub(crate) side: u64,
    strategy: Strategy,
    pub(crate) updater: Updater,
    /// The tree that is shown, and the one that becomes the next.
    before: Option<Arc<Bvh>>,
    pub(crate) tree: Bvh,
    pub(crate) outcome: Option<Outcome>,
}

impl Step {
    /// Takes what a step to a frame needs from what is shown, for the trees that are not there.
    pub(crate) fn new(shown: &mut Shown, frame: usize, how: How) -> Self {
        let stage = shown.spare.take().unwrap_or_else(|| shown.stage.clone());
        let behind = shown.sides.iter_mut().filter(|side| side.frame != frame);
        let trees = behind.map(Work::of).collect();
        Self { scene: shown.number, stage, frame, how, trees, ms: 0.0 }
    }

    /// Does the work, in the present rayon pool. Takes about as long as the updates of all trees,
    /// and copies them before.
    #[must_use]
    pub fn run(mut self) -> Self {
        let start = (self.how.clock)();
        self.stage.pose(self.stage.time_of(self.frame, self.stage.scene.frames.max(1)));
        if self.how.smooth {
            self.stage.smooth();
        }
        for work in &mut self.trees {
            if let Some(before) = work.before.take() {
                work.tree.clone_from(&before);
            }
            let (strategy, to) = (work.strategy, (&self.stage, self.frame));
            work.outcome = Some(update(&mut work.tree, &mut work.updater, strategy, to, self.how));
        }
        self.ms = 1e3 * ((self.how.clock)() - start);
        self
    }
}

impl Work {
    fn of(side: &mut Side) -> Self {
        let mut updater = std::mem::replace(&mut side.updater, Updater::new(side.strategy));
        updater.report(Load::PacketNodes(side.stats.nodes_visited));
        let (before, tree) = (Some(Arc::clone(&side.tree)), side.spare.take().unwrap_or_default());
        Self { side: side.number, strategy: side.strategy, updater, before, tree, outcome: None }
    }
}
