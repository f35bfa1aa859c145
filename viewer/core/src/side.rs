//! One tree and what became of it: its strategy, its updates, its picture.

use std::collections::VecDeque;
use std::sync::Arc;

use bvh_core::{Aabb, Bvh};
use bvh_update::{Strategy, Update, Updater};
use rt_cpu::{Camera, Image, PointLight, RenderOptions, RenderStats, render};
use stage::Stage;

use crate::Clock;
use crate::step::Outcome;

/// Lines that the log keeps.
pub(crate) const LOG: usize = 6;

/// Side of the squares of pixels that are traced as one, at most.
const COARSEST: u32 = 16;
/// And in the first picture, of which it is not known how long it takes.
const COARSE_AT_FIRST: u32 = 4;

/// The strategies to choose from: all but those whose trees depend on time.
pub(crate) fn strategies() -> Vec<Strategy> {
    Strategy::all().into_iter().filter(|strategy| !strategy.name().ends_with("background")).collect()
}

/// What a frame of the animation took, when it was last shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sample {
    pub(crate) update_ms: f32,
    pub(crate) cost: f32,
    /// 0 until the frame is drawn.
    pub(crate) trace_ns: f32,
}

/// A tree with its strategy.
pub(crate) struct Side {
    /// No other side has this number.
    pub(crate) number: u64,
    pub(crate) strategy: Strategy,
    /// Shared with a step while one is under way.
    pub(crate) tree: Arc<Bvh>,
    /// The frame that the tree is of.
    pub(crate) frame: usize,
    pub(crate) updater: Updater,
    /// The tree before, as memory for the next.
    pub(crate) spare: Option<Bvh>,
    /// The last sample of each frame.
    pub(crate) samples: Vec<Option<Sample>>,
    /// What was decided, one line an update, the last one first.
    pub(crate) log: VecDeque<String>,
    pub(crate) last: Update,
    /// Boxes of the nodes that rotated in the last update.
    pub(crate) flashes: Vec<Aabb>,
    /// Sum of `count` samples of the picture.
    pub(crate) sum: Image,
    pub(crate) count: u32,
    sample: Image,
    /// Side of the squares of pixels that are traced as one while something moves, and in the
    /// present picture.
    coarse: u32,
    pub(crate) coarse_now: u32,
    /// The sum when it had half as many samples, or as many.
    half: Image,
    /// Distance of the picture from the converged one, as the halves of its samples differ: root
    /// mean square over its pixels, 1 for white. `None` for one sample.
    pub(crate) noise: Option<f64>,
    pub(crate) stats: RenderStats,
    /// Milliseconds that tracing the last picture took, and the SAH cost of the tree then.
    pub(crate) trace_ms: f64,
    traced_cost: f32,
}

impl Side {
    /// Makes a side of the first tree of an animation with this number of frames, and of this SAH
    /// cost.
    pub(crate) fn new(number: u64, tree: Arc<Bvh>, strategy: Strategy, frames: usize, cost: f64) -> Self {
        let first = Sample { cost: cost as f32, ..Sample::default() };
        Self {
            number,
            strategy,
            tree,
            frame: 0,
            updater: Updater::new(strategy),
            spare: None,
            samples: (0..frames).map(|frame| (frame == 0).then_some(first)).collect(),
            log: VecDeque::new(),
            last: Update::default(),
            flashes: Vec::new(),
            sum: Image::new(0, 0),
            count: 0,
            sample: Image::new(0, 0),
            coarse: COARSE_AT_FIRST,
            coarse_now: COARSEST,
            half: Image::new(0, 0),
            noise: None,
            stats: RenderStats::default(),
            trace_ms: 0.0,
            traced_cost: 1.0,
        }
    }

    /// Takes note of an update to a frame.
    pub(crate) fn updated(&mut self, frame: usize, outcome: Outcome) {
        let Outcome { update, line, ms, cost, flashes } = outcome;
        if let Some(update) = update {
            self.last = update;
            if let Some(place) = self.samples.get_mut(frame) {
                *place = Some(Sample { update_ms: ms as f32, cost: cost as f32, trace_ns: 0.0 });
            }
        }
        self.log.push_front(line);
        self.log.truncate(LOG);
        (self.frame, self.flashes, self.count) = (frame, flashes, 0);
    }

    /// Whether the picture is as fine as it gets, with that many samples.
    pub(crate) fn is_done(&self, samples: u32) -> bool {
        self.coarse_now == 1 && self.count >= samples
    }

    /// Chooses how coarse the next picture is. Where something moves, tracing is to take the
    /// milliseconds of a budget, and while the scene plays the picture stays so; then it becomes
    /// finer.
    pub(crate) fn choose_coarse(&mut self, frame: usize, budget: Option<f64>, plays: bool) {
        if let Some(budget) = budget {
            self.coarse = self.coarse_within(frame, budget);
        }
        let coarse = if budget.is_some() || plays { self.coarse } else { (self.coarse_now / 2).max(1) };
        if budget.is_some() || coarse != self.coarse_now {
            self.count = 0;
        }
        self.coarse_now = coarse;
    }

    /// The smallest squares whose tracing should take a budget of milliseconds at most. The time of
    /// the last picture grows with the number of rays and with the tree's cost since.
    fn coarse_within(&self, frame: usize, budget: f64) -> u32 {
        if self.trace_ms == 0.0 {
            return COARSE_AT_FIRST;
        }
        let growth = f64::from(self.sample(frame).cost / self.traced_cost).max(1.0);
        let one_ray_a_pixel = self.trace_ms * growth * f64::from(self.coarse_now * self.coarse_now);
        // Finer only if there is room to spare, so that it does not go to and fro.
        let room = |coarse| if coarse < self.coarse { 0.8 * budget } else { budget };
        let fits = |&coarse: &u32| one_ray_a_pixel / f64::from(coarse * coarse) <= room(coarse);
        (1..COARSEST).find(fits).unwrap_or(COARSEST)
    }

    /// Adds a sample to the picture, or begins a new one.
    pub(crate) fn trace(
        &mut self,
        stage: &Stage,
        frame: usize,
        camera: &Camera,
        options: &RenderOptions,
        clock: Clock,
    ) {
        let options = RenderOptions { sample: self.count, ..*options };
        let light: PointLight = stage.light();
        let image = if self.count == 0 { &mut self.sum } else { &mut self.sample };
        let start = clock();
        self.stats = render(&self.tree, &stage.mesh(), camera, Some(&light), &options, image);
        self.trace_ms = 1e3 * (clock() - start);
        self.traced_cost = self.sample(frame).cost.max(f32::MIN_POSITIVE);
        if self.count > 0 {
            self.sum.add(&self.sample);
        }
        self.count += 1;
        if self.count == 1 {
            self.noise = None;
        }
        if let Some(Some(sample)) = self.samples.get_mut(frame) {
            sample.trace_ns = (1e6 * self.trace_ms / self.stats.rays().max(1) as f64) as f32;
        }
    }

    /// Estimates the noise where the samples have doubled. Were the errors of the two halves
    /// independent, their mean would be off by half of what they differ by. Samples are spread
    /// evenly, so it is somewhat less.
    pub(crate) fn estimate_noise(&mut self) {
        if !self.count.is_power_of_two() {
            return;
        }
        if self.count > 1 {
            let pixels = self.sum.pixels().iter().flatten().zip(self.half.pixels().iter().flatten());
            let squares: f64 = pixels.map(|(sum, half)| f64::from(sum - 2.0 * half).powi(2)).sum();
            let values = 3 * self.sum.pixels().len().max(1);
            self.noise = Some((squares / values as f64).sqrt() / f64::from(self.count));
        }
        self.half.clone_from(&self.sum);
    }

    /// SAH cost of the tree, where it was updated to a frame.
    pub(crate) fn sample(&self, frame: usize) -> Sample {
        self.samples.get(frame).copied().flatten().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use scenes::LightEffects;

    use super::*;

    #[test]
    fn pictures_of_a_tree_whose_cost_grows_are_coarser() {
        let boxes = [Aabb::new(bvh_core::Vec3::ZERO, bvh_core::Vec3::ONE); 2];
        let tree = bvh_build::build(&boxes, bvh_build::Builder::Sweep).expect("two boxes");
        let mut side = Side::new(0, Arc::new(tree), Strategy::Refit, 2, 1.0);
        let mut chosen = |cost, trace_ms, frame, budget| {
            side.samples[1] = Some(Sample { cost, ..Sample::default() });
            side.trace_ms = trace_ms;
            side.choose_coarse(frame, Some(budget), true);
            side.coarse_now
        };
        assert_eq!(chosen(1.0, 0.0, 0, 10.0), COARSE_AT_FIRST);
        assert_eq!(chosen(1.0, 10.0, 0, 10.0), 4, "as before: the time is the budget");
        assert_eq!(chosen(4.0, 10.0, 1, 10.0), 8, "four times the cost, a fourth of the rays");
        assert_eq!(chosen(4.0, 1e6, 1, 10.0), COARSEST);
    }

    #[test]
    fn noise_is_the_distance_to_the_converged_picture() {
        let toys = Path::new("toys.glb");
        let animation = anim::parse(toys, &scenes::toys_glb(), &Default::default()).expect("a glTF file");
        let stage = Stage::new(scenes::scene_of(toys, animation)).expect("few triangles");
        let light = LightEffects::AMBIENT_OCCLUSION;
        let (camera, options) = (stage.camera(48, 36), stage.options_with(light));
        let traced = |samples: u32| {
            let mut side = Side::new(0, Arc::clone(&stage.first_tree), Strategy::default(), 1, 1.0);
            for _ in 0..samples {
                side.trace(&stage, 0, &camera, &options, || 0.0);
                side.estimate_noise();
            }
            side.sum.scale(1.0 / samples as f32);
            side
        };
        let converged = traced(1024);
        assert_eq!(traced(1).noise, None);
        for samples in [4, 16, 64] {
            let side = traced(samples);
            let pixels = side.sum.pixels().iter().flatten().zip(converged.sum.pixels().iter().flatten());
            let squares: f64 = pixels.map(|(a, b)| f64::from(a - b).powi(2)).sum();
            let actual = (squares / (3.0 * 48.0 * 36.0)).sqrt();
            let ratio = side.noise.expect("two halves") / actual;
            assert!((0.7..2.0).contains(&ratio), "{samples} samples: {ratio} of {actual}");
        }
    }
}
