//! The state of a viewer: the scene that is shown, its trees, and the settings.

use std::sync::Arc;

use bvh_core::Aabb;
use bvh_update::{Load, Strategy};
use rt_cpu::StageTimes;
use scenes::LightEffects;
use stage::{Stage, default_samples};

use crate::boxes::TypicalCost;
use crate::canvas::Canvas;
use crate::controls::Settings;
use crate::draw::Probe;
use crate::events::{Drag, Request};
use crate::eye::Eye;
use crate::side::Side;
use crate::srgb::SrgbTable;
use crate::step::{How, Step, update};
use crate::{Clock, Ready};

/// Frames a second that animations are made for.
pub(crate) const FRAME_RATE: f64 = 24.0;

/// A scene that is shown.
pub(crate) struct Shown {
    /// No other scene has this number.
    pub(crate) number: u64,
    pub(crate) stage: Stage,
    pub(crate) typical: TypicalCost,
    pub(crate) hottest: u32,
    pub(crate) sides: Vec<Side>,
    /// Costs of fresh trees by frame, in order.
    fresh: Vec<(usize, f64)>,
    pub(crate) frame: usize,
    /// The frame that was asked for last. Steps lead there.
    pub(crate) target: usize,
    /// Whether a step is under way on another thread.
    steps: bool,
    /// The stage before, as memory for the next.
    pub(crate) spare: Option<Stage>,
    /// SAH cost of the first tree.
    first_cost: f64,
}

impl Shown {
    pub(crate) fn frames(&self) -> usize {
        self.stage.scene.frames.max(1)
    }

    /// The cost of a fresh tree at a frame, from the frames around it; `None` before the first is
    /// known.
    pub(crate) fn fresh_cost(&self, frame: usize) -> Option<f64> {
        let after = self.fresh.partition_point(|&(at, _)| at < frame);
        let right = self.fresh.get(after).or(self.fresh.last())?;
        let left = if after > 0 { &self.fresh[after - 1] } else { right };
        let part = (frame as f64 - left.0 as f64) / (right.0 as f64 - left.0 as f64).max(1.0);
        Some(left.1 + (right.1 - left.1) * part.clamp(0.0, 1.0))
    }

    /// Takes note of the cost of a fresh tree at a frame.
    pub(crate) fn add_fresh(&mut self, frame: usize, cost: f64) {
        let at = self.fresh.partition_point(|&(known, _)| known < frame);
        self.fresh.insert(at, (frame, cost));
    }

    /// Whether a step is to be made, or under way.
    pub(crate) fn is_behind(&self) -> bool {
        self.frame != self.target || self.sides.iter().any(|side| side.frame != self.target)
    }

    /// The box of the triangle that was picked.
    pub(crate) fn triangle(&self, primitive: u32) -> Aabb {
        let triangles = self.stage.triangles();
        triangles
            .indices
            .get(primitive as usize)
            .map_or(Aabb::EMPTY, |_| Aabb::around(&triangles.corners(primitive as usize)))
    }
}

/// A viewer.
pub struct State {
    pub(crate) clock: Clock,
    /// What is set by hand.
    pub(crate) settings: Settings,
    scenes: Vec<String>,
    /// The scene that is being loaded.
    pub(crate) loading: Option<String>,
    /// Whether the shell [takes steps](Self::take_step).
    beside: bool,
    /// Scenes and trees so far.
    count: u64,
    pub(crate) message: String,
    pub(crate) shown: Option<Shown>,
    pub(crate) eye: Eye,
    pub(crate) picked: Option<u32>,
    pub(crate) playing: bool,
    /// Frames that are due.
    pub(crate) due: f64,
    pub(crate) recording: bool,
    pub(crate) pointer: (f32, f32),
    pub(crate) drag: Drag,
    /// Keys of flight that are down.
    pub(crate) held: Vec<char>,
    pub(crate) probe: Option<Probe>,
    pub(crate) requests: Vec<Request>,
    /// Whether what is seen has moved since the last picture.
    pub(crate) moved: bool,
    /// Whether something has changed that is drawn.
    pub(crate) stale: bool,
    pub(crate) table: SrgbTable,
    pub(crate) picture: Canvas,
    pub(crate) canvas: Canvas,
    /// Milliseconds that steps of the animation took since the last picture, in place or beside it.
    pub(crate) step_ms: f64,
    /// Milliseconds that the last picture took: such steps, tracing, and the rest.
    pub(crate) last_ms: [f64; 3],
}

impl State {
    /// Makes a viewer of pictures of a size in pixels. It knows some scenes by name or path, and
    /// asks for the first.
    #[must_use]
    pub fn new(width: u32, height: u32, scenes: Vec<String>, clock: Clock) -> Self {
        let mut state = Self {
            clock,
            // The panel takes a fourth of a small picture.
            settings: Settings { overlay: if width < 800 { 1 } else { 2 }, ..Settings::default() },
            loading: None,
            beside: false,
            count: 0,
            message: String::new(),
            shown: None,
            eye: Eye::default(),
            picked: None,
            playing: true,
            due: 0.0,
            recording: false,
            pointer: (0.0, 0.0),
            drag: Drag::Nothing,
            held: Vec::new(),
            probe: None,
            requests: Vec::new(),
            moved: false,
            stale: true,
            table: SrgbTable::new(),
            picture: Canvas::new(width.max(1), height.max(1)),
            canvas: Canvas::default(),
            step_ms: 0.0,
            last_ms: [0.0; 3],
            scenes,
        };
        let first = state.scenes.first().cloned();
        first.into_iter().for_each(|name| state.load(name));
        state
    }

    /// The trees that are shown.
    pub(crate) fn sides(&self) -> impl DoubleEndedIterator<Item = &Side> {
        self.shown.iter().flat_map(|shown| &shown.sides)
    }

    /// Hands over what the shell is asked to do.
    pub fn take_requests(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.requests)
    }

    /// Leaves steps to the shell from now on, which calls [`take_step`](Self::take_step) after each
    /// event and picture. Otherwise they are made at once, by whoever gives the event.
    pub fn step_beside(&mut self) {
        self.beside = true;
    }

    /// Hands over the next step, to be run on another thread, in a rayon pool that is not the one
    /// that draws. There is one at a time of each scene.
    pub fn take_step(&mut self) -> Option<Step> {
        let how = self.how();
        let shown = self.shown.as_mut().filter(|shown| self.beside && !shown.steps && shown.is_behind())?;
        shown.steps = true;
        Some(Step::new(shown, shown.target, how))
    }

    fn how(&self) -> How {
        let Settings { period, flash, heat, .. } = self.settings;
        How { period, flash, smooth: !heat, clock: self.clock }
    }

    /// Returns what is set by hand.
    #[must_use]
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// Returns the frame that is shown and the number of frames; `None` without a scene.
    #[must_use]
    pub fn frame(&self) -> Option<(usize, usize)> {
        self.shown.as_ref().map(|shown| (shown.frame, shown.frames()))
    }

    /// Returns whether the picture stays as it is until the next event.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let samples = self.samples();
        (self.is_loading() || self.sides().all(|side| side.is_done(samples)))
            && !self.shown.as_ref().is_some_and(Shown::is_behind)
            && !self.plays()
            && !self.moved
            && !self.stale
            && self.held.is_empty()
    }

    /// Returns the seconds until the animation's next frame is due, if there is nothing to draw
    /// before; 0 if there is, and infinite while only a step that is under way can bring something.
    #[must_use]
    pub fn idle_seconds(&self) -> f64 {
        // What was not drawn yet of trees that are there, as after a setting has changed.
        let undrawn =
            |shown: &Shown| shown.sides.iter().any(|side| side.frame == shown.frame && side.count == 0);
        let nothing_new =
            !self.moved && !self.stale && self.held.is_empty() && !self.shown.as_ref().is_some_and(undrawn);
        if nothing_new && self.shown.as_ref().is_some_and(|shown| shown.steps) {
            f64::INFINITY
        } else if nothing_new && self.plays() {
            (1.0 - self.due).max(0.0) / (FRAME_RATE * self.settings.speed)
        } else {
            0.0
        }
    }

    /// Returns the milliseconds that the last picture took: the step of the animation, tracing, and
    /// the rest.
    #[must_use]
    pub fn picture_ms(&self) -> [f64; 3] {
        self.last_ms
    }

    pub(crate) fn plays(&self) -> bool {
        self.playing && self.frame().is_some_and(|(_, frames)| frames > 1)
    }

    pub(crate) fn show(&mut self, ready: Ready) {
        let Ready { stage, typical, hottest, first_cost, .. } = ready;
        self.message = stage.scene.notes.first().cloned().unwrap_or_default();
        self.count += 1;
        let before = self.shown.replace(Shown {
            number: self.count,
            stage,
            typical,
            hottest,
            sides: Vec::new(),
            fresh: Vec::new(),
            frame: 0,
            target: 0,
            steps: false,
            spare: None,
            first_cost,
        });
        give_back(before);
        (self.loading, self.picked, self.due) = (None, None, 0.0);
        (self.settings.light, self.settings.samples) = (None, None);
        self.eye.reset();
        self.settings_changed();
        self.moved = true;
    }

    pub(crate) fn load(&mut self, name: String) {
        self.requests.push(Request::Load(name.clone()));
        self.message.clear();
        self.loading = Some(name);
    }

    /// The name of the scene that is shown, or will be.
    pub(crate) fn scene_name(&self) -> &str {
        let shown = self.shown.as_ref().map(|shown| shown.stage.scene.name.as_str());
        self.loading.as_deref().or(shown).unwrap_or("none")
    }

    /// Returns whether a scene was asked for that is not there yet.
    #[must_use]
    pub fn is_loading(&self) -> bool {
        self.loading.is_some()
    }

    /// What the user should know now.
    pub(crate) fn hint(&self) -> String {
        match &self.loading {
            Some(name) if self.message.is_empty() => format!("loading {name} ..."),
            None if self.message.is_empty() => "cost 1.00 x fresh: as good as new".to_owned(),
            _ => self.message.clone(),
        }
    }

    /// Asks for the next scene of the list; not while one is loading.
    pub(crate) fn next_scene(&mut self, back: bool) {
        let count = self.scenes.len();
        if self.loading.is_none() && count > 0 {
            let at = self.scenes.iter().position(|name| name == self.scene_name()).unwrap_or(count - 1);
            self.load(self.scenes[(at + if back { count - 1 } else { 1 }) % count].clone());
        }
    }

    /// Starts the picture again, with a tree for each strategy that is set.
    pub(crate) fn settings_changed(&mut self) {
        let wanted: Vec<Strategy> = std::iter::once(self.settings.left).chain(self.settings.right).collect();
        let Some(shown) = &mut self.shown else { return };
        shown.sides.truncate(wanted.len());
        for (i, strategy) in wanted.into_iter().enumerate() {
            match shown.sides.get_mut(i) {
                Some(side) => side.strategy = strategy,
                None => {
                    self.count += 1;
                    let (tree, frames) = (Arc::clone(&shown.stage.first_tree), shown.frames());
                    shown.sides.push(Side::new(self.count, tree, strategy, frames, shown.first_cost));
                }
            }
        }
        shown.sides.iter_mut().for_each(|side| side.count = 0);
        self.stale = true;
        self.step_here();
    }

    /// Gives all trees back the structure of the first, at the first frame.
    pub(crate) fn restart_trees(&mut self) {
        if let Some(shown) = &mut self.shown {
            give_back(std::mem::take(&mut shown.sides));
            shown.target = 0;
            self.moved = true;
        }
        self.settings_changed();
    }

    /// Moves the animation to a frame.
    pub(crate) fn go_to(&mut self, frame: usize) {
        if let Some(shown) = &mut self.shown {
            shown.target = frame.min(shown.frames() - 1);
            self.step_here();
        }
    }

    /// Brings everything to the frame that was asked for, unless the shell does: each tree that is
    /// not there is updated once.
    fn step_here(&mut self) {
        let (start, how) = ((self.clock)(), self.how());
        let Some(shown) = self.shown.as_mut().filter(|shown| !self.beside && shown.is_behind()) else {
            return;
        };
        shown.frame = shown.target;
        shown.stage.pose(shown.stage.time_of(shown.frame, shown.frames()));
        for side in shown.sides.iter_mut().filter(|side| side.frame != shown.frame) {
            let tree = Arc::make_mut(&mut side.tree);
            let to = (&shown.stage, shown.frame);
            side.updater.report(Load::PacketNodes(side.stats.nodes_visited));
            let outcome = update(tree, &mut side.updater, side.strategy, to, how);
            side.updated(shown.frame, outcome);
        }
        self.step_ms += 1e3 * ((self.clock)() - start);
        self.moved = true;
    }

    /// Shows what a step has led to, if it is of the scene that is shown.
    pub(crate) fn stepped(&mut self, mut step: Step) {
        if let Some(shown) = self.shown.as_mut().filter(|shown| shown.number == step.scene) {
            (shown.frame, shown.steps) = (step.frame, false);
            std::mem::swap(&mut shown.stage, &mut step.stage);
            for work in step.trees.drain(..) {
                let side = shown.sides.iter_mut().find(|side| side.number == work.side);
                if let (Some(side), Some(outcome)) = (side, work.outcome) {
                    side.updater = work.updater;
                    side.spare = Arc::into_inner(std::mem::replace(&mut side.tree, Arc::new(work.tree)));
                    side.updated(step.frame, outcome);
                }
            }
            shown.spare = Some(step.stage);
            self.step_ms += step.ms;
            self.moved = true;
        } else {
            give_back(step);
        }
    }

    pub(crate) fn light_effects(&self) -> LightEffects {
        let scenes =
            self.shown.as_ref().map_or(LightEffects::empty(), |shown| shown.stage.scene.effects.light);
        self.settings.light.unwrap_or(scenes)
    }

    /// Samples of a pixel that the picture is to have once it stands still.
    pub(crate) fn samples(&self) -> u32 {
        if self.settings.heat {
            1
        } else {
            self.settings.samples.unwrap_or(default_samples(self.light_effects()))
        }
    }

    pub(crate) fn samples_done(&self) -> u32 {
        self.sides().map(|side| side.count).min().unwrap_or(0)
    }

    /// What the stages of the last picture took, all trees and threads together.
    pub(crate) fn stage_times(&self) -> StageTimes {
        let mut times = StageTimes::default();
        self.sides().for_each(|side| times += side.stats.times);
        times
    }
}

/// Gives back the memory of what is not needed any more, which may take as long as a picture, on
/// another thread.
fn give_back<T: Send + 'static>(what: T) {
    if !cfg!(target_family = "wasm") {
        rayon::spawn(move || drop(what));
    }
}
