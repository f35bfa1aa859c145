//! The weights of the model that `Auto` decides by, and how the clock corrects them where that is asked for.
//!
//! Each kind of work has a *factor*: the time it took over what the model says, averaged over the last few times. Only
//! ratios of weights matter to decisions, so what has not been measured yet is taken to be off by as much as passes are,
//! which are measured in every frame.

use std::fmt;
use std::time::{Duration, Instant};

use crate::growth::Growth;
use crate::scratch::Scratch;
use crate::slope::Slope;

/// Times of one core, in nanoseconds; only their ratios matter, and those vary little between machines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Weights {
    /// Fitting a node to its children or its primitive.
    pub(crate) fit_node: f64,
    /// Trying rotations at a node, averaged over all nodes.
    pub(crate) rotate_node: f64,
    /// Splitting and merging leaves, for each node of the tree.
    pub(crate) settle_node: f64,
    /// Looking at a node for a cut.
    pub(crate) cut_node: f64,
    /// Building the top, for each subtree below it.
    pub(crate) graft_subtree: f64,
    /// Building the whole tree, for each primitive, and in haste.
    pub(crate) rebuild_primitive: f64,
    pub(crate) hasty_primitive: f64,
    /// Casting a ray through a good tree, in coherent packets, where counts do not tell.
    pub(crate) ray: f64,
}

impl Weights {
    pub(crate) const MODEL: Self = Self {
        fit_node: 9.5,
        rotate_node: 3.5,
        settle_node: 50.0,
        cut_node: 9.0,
        graft_subtree: 400.0,
        rebuild_primitive: 85.0,
        hasty_primitive: 45.0,
        ray: 25.0,
    };
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Work {
    /// Refitting, with or without rotations.
    Pass,
    /// Looking for a cut and building the top above it.
    Repair,
    /// Building a good tree.
    Rebuild,
    /// Building one in haste.
    Haste,
    /// Casting rays.
    Rays,
}

/// Factors are kept between this and its inverse.
const MOST: f64 = 64.0;
/// One time counts as no more than this many times the average, or less than its inverse: the machine may have been busy.
const OUTLIER: f64 = 2.0;
/// What one time counts for in the average.
const SHARE: f64 = 0.25;

/// How far times are off the model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    factors: [Option<f64>; 5],
    /// Excess of the tree that rays are cast at now, and what that costs them.
    pub(crate) excess: f64,
    pub(crate) slope: Slope,
    pub(crate) growth: Growth,
    /// What it shows.
    pub(crate) now: fn() -> Instant,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            factors: [None; 5],
            excess: 0.0,
            slope: Slope::default(),
            growth: Growth::default(),
            now: Instant::now,
        }
    }
}

impl Clock {
    /// Takes into account that work took so long, where the model says `expected` nanoseconds. Times of nothing and
    /// no time tell nothing.
    pub(crate) fn learn(&mut self, work: Work, expected: f64, took: Duration) {
        let sample = took.as_secs_f64() * 1e9 / expected;
        if !(sample > 0.0 && sample.is_finite()) {
            return;
        }
        let factor = &mut self.factors[work as usize];
        let before = factor.unwrap_or(sample);
        let sample = sample.clamp(before / OUTLIER, before * OUTLIER);
        *factor = Some((before + SHARE * (sample - before)).clamp(1.0 / MOST, MOST));
    }

    /// [`learn`](Self::learn) of so many rays through the present tree.
    pub(crate) fn traced(&mut self, rays: u64, took: Duration) {
        let ray = self.ray() * (1.0 + self.slope.get() * self.excess);
        self.learn(Work::Rays, rays as f64 * ray, took);
    }

    /// What a ray through a good tree takes by the model.
    fn ray(&self) -> f64 {
        self.slope.ray().unwrap_or(Weights::MODEL.ray)
    }

    /// The model's weights, as counts have it.
    pub(crate) fn counted(&self) -> Weights {
        Weights { ray: self.ray(), ..Weights::MODEL }
    }

    fn factor(&self, work: Work) -> f64 {
        self.factors[work as usize].or(self.factors[Work::Pass as usize]).unwrap_or(1.0)
    }

    /// The same, corrected by the clock.
    pub(crate) fn weights(&self) -> Weights {
        let Weights {
            fit_node,
            rotate_node,
            settle_node,
            cut_node,
            graft_subtree,
            rebuild_primitive,
            hasty_primitive,
            ray,
        } = self.counted();
        let [pass, repair] = [Work::Pass, Work::Repair].map(|work| self.factor(work));
        Weights {
            fit_node: fit_node * pass,
            rotate_node: rotate_node * pass,
            settle_node: settle_node * pass,
            cut_node: cut_node * repair,
            graft_subtree: graft_subtree * repair,
            rebuild_primitive: rebuild_primitive * self.factor(Work::Rebuild),
            hasty_primitive: hasty_primitive * self.factor(Work::Haste),
            ray: ray * self.factor(Work::Rays),
        }
    }

    pub(crate) fn calibration(&self) -> Calibration {
        let [pass, repair, rebuild, hasty_rebuild, rays] = self.factors;
        Calibration { pass, repair, rebuild, hasty_rebuild, rays }
    }
}

impl Scratch {
    /// Tells how long it took, by the wall clock, to cast so many rays through the tree of the last update with this
    /// memory, for [`Auto`](crate::Auto) by the clock. Times of nothing and no time change nothing.
    pub fn traced(&mut self, rays: u64, time: Duration) {
        self.clock.traced(rays, time);
    }

    /// Tells how many nodes so many rays have visited in the tree of the last update with this memory, for
    /// [`Auto`](crate::Auto), which learns from that what rays cost in this scene and how much more excess makes it. Nodes may
    /// be counted once for each ray or once for each packet, but always in the same way; `node_ns` is what one takes one core,
    /// with all that hangs on it, in nanoseconds, roughly: a constant of the tracer, so that trees depend on nothing that
    /// cannot be repeated. Call it once after any update, or never; no rays and no nodes change nothing.
    pub fn visited(&mut self, rays: u64, nodes: u64, node_ns: f64) {
        self.clock.slope.visited(rays, nodes, node_ns);
        self.clock.growth.visited(rays, nodes);
    }

    /// How many more nodes rays visit, as a part, in a tree of twice the SAH cost; by what [`visited`](Self::visited) was
    /// told before and after new trees. `None` as long as that says nothing.
    #[must_use]
    pub fn visits_per_excess(&self) -> Option<f64> {
        self.clock.slope.learned()
    }

    /// What the clock has told of updates by [`Auto`](crate::Auto) with this memory, and of their rays.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.clock.calibration()
    }
}

/// How far the times that [`Auto`](crate::Auto) has measured are off its model: time taken over time expected of one
/// core, averaged over the last few times and kept between 1/64 and 64. `None` for what has not been measured: decisions
/// take it to be off by as much as passes are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Calibration {
    /// Refitting, with or without rotations.
    pub pass: Option<f64>,
    /// Building the top of the tree anew.
    pub repair: Option<f64>,
    /// Building a good tree.
    pub rebuild: Option<f64>,
    /// Building a tree in haste.
    pub hasty_rebuild: Option<f64>,
    /// Casting rays, as told to [`Scratch::traced`].
    pub rays: Option<f64>,
}

impl fmt::Display for Calibration {
    /// One line that explains decisions by the clock.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pass, repair, rebuild, hasty_rebuild, rays } = *self;
        f.write_str("by the clock, over the model:")?;
        let all = [
            ("passes", pass),
            ("repairs", repair),
            ("rebuilds", rebuild),
            ("hasty rebuilds", hasty_rebuild),
            ("rays", rays),
        ];
        let mut separator = " ";
        for (what, factor) in all {
            if let Some(factor) = factor {
                write!(f, "{separator}{what} {factor:.2}")?;
                separator = ", ";
            }
        }
        if separator == " " { f.write_str(" nothing measured yet") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ns(n: f64) -> Duration {
        Duration::from_secs_f64(n * 1e-9)
    }

    #[test]
    fn times_are_smoothed_and_one_that_is_far_off_counts_little() {
        let mut clock = Clock::default();
        clock.learn(Work::Pass, 1000.0, ns(2000.0));
        assert_eq!(clock.calibration().pass, Some(2.0));
        // As if it were twice the average.
        clock.learn(Work::Pass, 1000.0, ns(1e9));
        assert_eq!(clock.calibration().pass, Some(2.5));
        for _ in 0..50 {
            clock.learn(Work::Pass, 1000.0, ns(500.0));
        }
        let factor = clock.calibration().pass.expect("measured");
        assert!((factor - 0.5).abs() < 1e-3, "{factor}");
    }

    #[test]
    fn what_is_no_time_or_no_work_changes_nothing_and_factors_are_bounded() {
        let mut clock = Clock::default();
        for (expected, took) in [
            (0.0, ns(1.0)),
            (1000.0, Duration::ZERO),
            (f64::NAN, ns(1.0)),
            (f64::INFINITY, ns(1.0)),
            (-1.0, ns(1.0)),
        ] {
            clock.learn(Work::Rebuild, expected, took);
        }
        clock.excess = f64::INFINITY;
        clock.traced(100, ns(1.0));
        clock.excess = f64::NAN;
        clock.traced(100, ns(1.0));
        clock.excess = 0.0;
        clock.traced(0, ns(1.0));
        assert_eq!(clock.calibration(), Calibration::default());
        assert_eq!(clock.weights(), Weights::MODEL);
        clock.learn(Work::Haste, 1.0, Duration::MAX);
        clock.learn(Work::Rays, f64::MAX, ns(1.0));
        assert_eq!(clock.calibration().hasty_rebuild, Some(MOST));
        assert_eq!(clock.calibration().rays, Some(1.0 / MOST));
    }

    #[test]
    fn what_has_not_been_measured_is_off_as_passes_are() {
        let mut clock = Clock::default();
        clock.learn(Work::Pass, 100.0, ns(300.0));
        let Weights { rebuild_primitive, ray, .. } = clock.weights();
        assert_eq!([rebuild_primitive, ray], [255.0, 75.0]);
        clock.learn(Work::Rebuild, 100.0, ns(50.0));
        assert_eq!(clock.weights().rebuild_primitive, 42.5);
        assert_eq!(
            clock.calibration().to_string(),
            "by the clock, over the model: passes 3.00, rebuilds 0.50"
        );
        assert!(Calibration::default().to_string().ends_with("nothing measured yet"));
    }

    #[test]
    fn rays_through_a_worse_tree_are_expected_to_take_longer() {
        let mut good = Clock::default();
        let mut bad = Clock { excess: 1.0 / good.slope.get(), ..good };
        good.traced(1000, ns(25_000.0));
        bad.traced(1000, ns(50_000.0));
        for clock in [good, bad] {
            let factor = clock.calibration().rays.expect("measured");
            assert!((factor - 1.0).abs() < 1e-6, "{factor}");
        }
    }
}
