//! How much more work rays have in a tree whose SAH cost is above what it was: learned from counts, not by the clock.
//!
//! A ray through a tree with excess `e`, a part of the cost when the tree was good, is taken to visit `1 + slope e` times as
//! many nodes as then. The slope differs between scenes by a factor of ten: what has grown may lie in front of the camera or
//! behind it. Counts of two frames between which the excess has changed, best by a repair, tell.

/// What is taken for the slope before anything is known.
const USUAL: f64 = 0.6;
/// Slopes are kept between this and its inverse.
const MOST: f64 = 16.0;
/// Excess that has to come or go between two counts for these to tell more of that than of the motion.
const LEAST: f64 = 0.05;
/// What one observation counts for in the average of logarithms.
const SHARE: f64 = 0.5;

/// What rays have met in one frame.
#[derive(Clone, Copy, Debug)]
struct Seen {
    excess: f64,
    /// Nodes visited, per ray.
    visits: f64,
}

/// What counts have told so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Slope {
    learned: Option<f64>,
    last: Option<Seen>,
}

impl Slope {
    /// In a tree with so much excess, so many rays have visited so many nodes.
    pub(crate) fn visited(&mut self, excess: f64, rays: u64, nodes: u64) {
        if rays == 0 || nodes == 0 || !excess.is_finite() {
            return;
        }
        let now = Seen { excess, visits: nodes as f64 / rays as f64 };
        if let Some(last) = self.last.replace(now)
            && (last.excess - now.excess).abs() > LEAST
        {
            let (worse, better) = if last.excess > now.excess { (last, now) } else { (now, last) };
            self.learn(worse, better);
        }
    }

    /// Solves `worse.visits / better.visits = (1 + slope worse.excess) / (1 + slope better.excess)`.
    fn learn(&mut self, worse: Seen, better: Seen) {
        let per_slope = better.visits * worse.excess - worse.visits * better.excess;
        let seen = if per_slope > 0.0 { (worse.visits - better.visits) / per_slope } else { MOST };
        let old = self.get();
        // Motion may have hidden all of it, or done all of it.
        let seen = seen.clamp(old / 4.0, old * 4.0);
        self.learned = Some((old.ln() + SHARE * (seen / old).ln()).exp().clamp(1.0 / MOST, MOST));
    }

    pub(crate) fn get(&self) -> f64 {
        self.learned.unwrap_or(USUAL)
    }

    /// What was learned, if anything was.
    pub(crate) fn learned(&self) -> Option<f64> {
        self.learned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(frames: &[(f64, u64)]) -> Slope {
        let mut slope = Slope::default();
        for &(excess, nodes) in frames {
            slope.visited(excess, 1000, nodes);
        }
        slope
    }

    #[test]
    fn repairs_tell_what_excess_costs() {
        // With a slope of 2, and a scene that stays as it is.
        let frames: Vec<_> = (0..40).map(|i| [(0.5, 20_000), (0.0, 10_000), (0.25, 15_000)][i % 3]).collect();
        assert!((after(&frames).get() - 2.0).abs() < 1e-3);
        // The tree after a repair need not be as good as it was.
        let frames: Vec<_> = (0..40).map(|i| [(0.5, 20_000), (0.25, 15_000)][i % 2]).collect();
        assert!((after(&frames).get() - 2.0).abs() < 1e-3);
    }

    #[test]
    fn little_change_and_what_is_no_count_teach_nothing() {
        assert_eq!(after(&[(0.0, 10_000), (0.04, 30_000)]).learned(), None);
        assert_eq!(after(&[(0.5, 10_000), (0.0, 0)]).learned(), None);
        assert_eq!(after(&[(f64::INFINITY, 10_000), (0.0, 1_000)]).learned(), None);
        let mut slope = after(&[(0.5, 10_000)]);
        slope.visited(0.0, 0, 1_000);
        assert_eq!(slope.get(), USUAL);
    }

    #[test]
    fn what_cannot_be_is_bounded() {
        // Fewer visits the worse the tree, and more than any slope would do.
        assert_eq!(after(&[(0.5, 10_000), (0.0, 40_000)].repeat(20)).get(), 1.0 / MOST);
        assert_eq!(after(&[(0.5, 90_000_000), (0.0, 1)].repeat(20)).get(), MOST);
        assert!((after(&[(1.0, 90_000_000), (0.5, 1)].repeat(20)).get() - MOST).abs() < 1e-6);
    }
}
