//! How much work rays have, and how much more in a tree whose SAH cost is above what it was: from counts, not by the clock.
//!
//! A ray through a tree with excess `e`, a part of the cost when the tree was good, is taken to visit `1 + slope e` times as
//! many nodes as then. The slope differs between scenes by a factor of ten: what has grown may lie in front of the camera or
//! behind it. When a new tree takes the excess away, the counts before and after tell, both excesses measured by the same
//! standard: that of the tree before.

/// What is taken for the slope before anything is known.
const USUAL: f64 = 0.4;
/// Slopes are kept between this and its inverse.
const MOST: f64 = 16.0;
/// Excess that has to go at once for the counts to tell more of that than of the motion.
const LEAST: f64 = 0.05;
/// What one observation counts for in the average of logarithms, if so much excess has gone; the less, the less.
const SHARE: f64 = 0.5;
const MUCH: f64 = 0.2;

/// What rays have met in one frame.
#[derive(Clone, Copy, Debug)]
struct Seen {
    tree: Fitted,
    /// Nodes visited, per ray.
    visits: f64,
}

/// The excess of a tree, and by which standard: its reference, which no other tree shares.
#[derive(Clone, Copy, Debug)]
struct Fitted {
    excess: f64,
    reference: f64,
}

/// What counts have told so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Slope {
    learned: Option<f64>,
    /// What a ray would take through a good tree, by the last counts, in nanoseconds of one core.
    ray: Option<f64>,
    /// The tree of this update, if it was neither repaired nor built anew.
    fitted: Option<Fitted>,
    /// What was seen after the update before.
    last: Option<Seen>,
    /// What was seen after this one.
    now: Option<Seen>,
    /// What was seen before the new tree of this update, and the excess of that.
    renewed: Option<(Seen, f64)>,
}

impl Slope {
    /// An update begins, of whatever tree.
    pub(crate) fn begin(&mut self) {
        (self.fitted, self.renewed) = (None, None);
        self.last = self.now.take();
    }

    /// The tree has been fitted and has so much excess by this reference.
    pub(crate) fn fitted(&mut self, excess: f64, reference: f64) {
        self.fitted = Some(Fitted { excess, reference });
    }

    /// The tree was repaired: by how much is not known.
    pub(crate) fn repaired(&mut self) {
        self.fitted = None;
    }

    /// A new tree took the place of one with this reference; `excess` gives its excess by the same, if that is of use.
    pub(crate) fn renewed(&mut self, reference: f64, excess: impl FnOnce() -> f64) {
        self.fitted = None;
        let before = self.last.take().filter(|seen| seen.tree.reference == reference);
        self.renewed = before.map(|seen| (seen, excess()));
    }

    /// In the tree of this update so many rays have visited so many nodes, each in so many nanoseconds.
    pub(crate) fn visited(&mut self, rays: u64, nodes: u64, node_ns: f64) {
        if rays == 0 || nodes == 0 {
            return;
        }
        let visits = nodes as f64 / rays as f64;
        // What is repaired or new is as good as it gets.
        let excess = self.fitted.map_or(0.0, |tree| tree.excess.max(0.0));
        let ray = visits * node_ns / (1.0 + self.get() * excess);
        self.ray = Some(ray).filter(|ray| *ray > 0.0 && ray.is_finite()).or(self.ray);
        if let Some((before, excess)) = self.renewed.take()
            && before.tree.excess - excess > LEAST
        {
            self.learn([before.tree.excess, before.visits], [excess, visits]);
        }
        self.now = self.fitted.map(|tree| Seen { tree, visits });
    }

    /// Solves `visits / better visits = (1 + slope excess) / (1 + slope better excess)`, given excess and visits of each.
    fn learn(&mut self, worse: [f64; 2], better: [f64; 2]) {
        let per_slope = better[1] * worse[0] - worse[1] * better[0];
        let seen = if per_slope > 0.0 { (worse[1] - better[1]) / per_slope } else { MOST };
        let old = self.get();
        // Motion may have hidden all of it, or done all of it.
        let seen = seen.clamp(old / 4.0, old * 4.0);
        let share = SHARE * ((worse[0] - better[0]) / MUCH).min(1.0);
        self.learned = Some((old.ln() + share * (seen / old).ln()).exp().clamp(1.0 / MOST, MOST));
    }

    pub(crate) fn get(&self) -> f64 {
        if crate::ablation::is_off(1) { USUAL } else { self.learned.unwrap_or(USUAL) }
    }

    /// What a ray takes through a good tree, in nanoseconds of one core, if counts have told.
    pub(crate) fn ray(&self) -> Option<f64> {
        if crate::ablation::is_off(2) { return None; }
        self.ray
    }

    /// What was learned, if anything was.
    pub(crate) fn learned(&self) -> Option<f64> {
        self.learned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Trees that are built anew at once, with their excess before and after and the nodes that rays visit.
    fn after(renewals: &[[(f64, u64); 2]]) -> Slope {
        let mut slope = Slope::default();
        for &[(excess, nodes), (excess_after, nodes_after)] in renewals {
            slope.begin();
            slope.fitted(excess, 7.0);
            slope.visited(1000, nodes, 1.0);
            slope.begin();
            slope.renewed(7.0, || excess_after);
            slope.visited(1000, nodes_after, 1.0);
        }
        slope
    }

    #[test]
    fn new_trees_tell_what_excess_costs() {
        // With a slope of 2, and new trees that are as good as the old one was, or worse.
        assert!((after(&[[(0.5, 20_000), (0.0, 10_000)]; 20]).get() - 2.0).abs() < 1e-3);
        assert!((after(&[[(0.5, 20_000), (0.25, 15_000)]; 20]).get() - 2.0).abs() < 1e-3);
    }

    #[test]
    fn little_excess_other_trees_and_what_is_no_count_teach_nothing() {
        assert_eq!(after(&[[(0.04, 30_000), (0.0, 10_000)]]).learned(), None);
        assert_eq!(after(&[[(0.0, 30_000), (0.5, 10_000)]]).learned(), None);
        assert_eq!(after(&[[(0.5, 30_000), (0.0, 0)]]).learned(), None);
        assert_eq!(after(&[[(f64::NAN, 30_000), (0.0, 10_000)]]).learned(), None);
        let told = |between: fn(&mut Slope), reference| {
            let mut slope = Slope::default();
            slope.fitted(0.5, 7.0);
            slope.visited(1000, 20_000, 1.0);
            slope.begin();
            between(&mut slope);
            slope.renewed(reference, || 0.0);
            slope.visited(1000, 10_000, 1.0);
            slope.learned()
        };
        assert!(told(|_| {}, 7.0).is_some());
        assert_eq!(told(|_| {}, 8.0), None);
        let no_rays = |slope: &mut Slope| slope.visited(0, 1, 1.0);
        assert!(told(no_rays, 7.0).is_some());
        let repaired_between = |slope: &mut Slope| {
            slope.fitted(0.1, 7.0);
            slope.repaired();
            slope.visited(1000, 10_000, 1.0);
            slope.begin();
        };
        assert_eq!(told(repaired_between, 7.0), None);
    }

    #[test]
    fn rays_are_as_long_as_they_would_be_in_a_good_tree() {
        let mut slope = after(&[[(0.5, 20_000), (0.0, 10_000)]; 20]);
        assert_eq!(slope.ray(), Some(10.0));
        slope.begin();
        slope.fitted(0.5, 7.0);
        slope.visited(1000, 20_000, 3.0);
        assert!(slope.ray().is_some_and(|ray| (ray - 30.0).abs() < 1e-3));
        for nonsense in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            slope.visited(1000, 20_000, nonsense);
            assert!(slope.ray().is_some_and(|ray| (ray - 30.0).abs() < 1e-3));
        }
    }

    #[test]
    fn what_cannot_be_is_bounded() {
        // Fewer visits the worse the tree, and more than any slope would do.
        assert_eq!(after(&[[(0.5, 10_000), (0.0, 40_000)]; 20]).get(), 1.0 / MOST);
        assert_eq!(after(&[[(0.5, 90_000_000), (0.0, 1)]; 20]).get(), MOST);
        assert!((after(&[[(1.0, 90_000_000), (0.5, 1)]; 40]).get() - MOST).abs() < 1e-6);
        assert_eq!(after(&[[(f64::INFINITY, 2), (0.0, 1)]; 20]).get(), 1.0 / MOST);
    }
}
