//! How many more nodes rays visit than when the tree was new, and how much of that a new tree would take away: from counts.
//!
//! The SAH cost is a sum over the whole tree; a camera looks at a part of it. What has become bad there may cost rays a third
//! of their time while the cost, that of walls included, stands still or even falls. The number of nodes that rays visit
//! tells, but it changes with the motion, too. So it is held against the least since the tree was built, and what part of
//! the growth is due to the tree is learned from new trees: by what they took away of it.

use bvh_core::Bvh;

/// Growth that has to be there for a new tree to tell what part of it was due to the old one.
const LEAST: f64 = 0.05;
/// What one observation counts for in the average.
const SHARE: f64 = 0.5;

/// What tells a tree from others, from one update to the next: its number of primitives and its box.
type Tree = (usize, [f32; 6]);

/// What counts have told so far. Visits are per ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Growth {
    /// The tree of the last update.
    tree: Option<Tree>,
    /// The fewest visits since it was built.
    least: Option<f64>,
    /// The last visits.
    now: Option<f64>,
    /// Whether these are of the last update.
    is_told: bool,
    /// The fewest and the last visits of the tree whose place a new one took in this update.
    before: Option<[f64; 2]>,
    /// What part of the growth was due to the tree, by the last new trees.
    due: f64,
    /// What rays have lost to growth since the tree was built.
    regret: f64,
}

impl Growth {
    /// An update begins, of whatever tree.
    pub(crate) fn begin(&mut self) {
        self.before = match (self.least, self.now) {
            (Some(least), Some(now)) if self.is_told => Some([least, now]),
            _ => None,
        };
        self.is_told = false;
    }

    /// The update is of this tree; if it is another one than that of the last update, nothing is known of it.
    pub(crate) fn is_of(&mut self, bvh: &Bvh) {
        if self.tree != Some(key(bvh)) {
            *self = Self { due: self.due, ..Self::default() };
        }
    }

    /// The update has left the tree so; if it is a new one, what was counted before does not hold for it.
    pub(crate) fn end(&mut self, bvh: &Bvh, is_new: bool) {
        self.tree = Some(key(bvh));
        if is_new {
            (self.least, self.now, self.regret) = (None, None, 0.0);
        } else {
            self.before = None;
        }
    }

    /// Leaves have been merged or split, which changes the number of nodes.
    pub(crate) fn leaves_changed(&mut self) {
        self.least = None;
    }

    /// In the tree of the last update so many rays have visited so many nodes.
    pub(crate) fn visited(&mut self, rays: u64, nodes: u64) {
        if rays == 0 || nodes == 0 {
            return;
        }
        let visits = nodes as f64 / rays as f64;
        if let Some([least, before]) = self.before.take()
            && before > least * (1.0 + LEAST)
        {
            let part = ((before - visits) / (before - least)).clamp(-1.0, 1.0);
            self.due = (self.due + SHARE * (part - self.due)).max(0.0);
        }
        self.least = Some(self.least.map_or(visits, |least| least.min(visits)));
        self.now = Some(visits);
        self.is_told = true;
    }

    /// What rays have lost to growth since the tree was built, where all of them take so much in a good tree. To be called
    /// once in each update.
    pub(crate) fn lost(&mut self, rays: f64) -> f64 {
        if let (Some(least), Some(now)) = (self.least, self.now) {
            self.regret += rays * self.due * (now / least - 1.0);
        }
        self.regret
    }
}

fn key(bvh: &Bvh) -> Tree {
    let aabb = bvh.root().aabb();
    let [min, max] = [aabb.min, aabb.max];
    (bvh.len(), [min.x, min.y, min.z, max.x, max.y, max.z])
}

#[cfg(test)]
mod tests {
    use bvh_build::{BuildOptions, Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::*;

    fn tree(x: f32) -> Bvh {
        let boxes = [Aabb::new(Vec3::ZERO, Vec3::splat(1.0)), Aabb::new(Vec3::ZERO, Vec3::splat(x))];
        build(&boxes, Builder::Sweep, &BuildOptions::default(), None).expect("two boxes")
    }

    /// An update of a tree, after which a ray visits so many nodes.
    fn update(growth: &mut Growth, bvh: &Bvh, is_new: bool, nodes: u64) {
        growth.begin();
        growth.is_of(bvh);
        growth.end(bvh, is_new);
        growth.visited(1, nodes);
    }

    /// What is lost in the next update if rays take 1 through a good tree.
    fn lost(growth: &Growth, bvh: &Bvh) -> f64 {
        let mut growth = *growth;
        growth.begin();
        growth.is_of(bvh);
        growth.lost(1.0)
    }

    #[test]
    fn only_new_trees_tell_what_growth_is_due_to() {
        let bvh = tree(2.0);
        let mut growth = Growth::default();
        for nodes in [100, 150, 200, 400] {
            update(&mut growth, &bvh, false, nodes);
            assert_eq!(lost(&growth, &bvh), 0.0);
        }
        // All of it was due to the tree, or none of it, or the new one is even worse.
        for (nodes, expected) in [(100, 0.75), (400, 0.25), (900, 0.0)] {
            let mut growth = Growth { due: 0.5, ..growth };
            update(&mut growth, &bvh, true, nodes);
            assert_eq!(lost(&growth, &bvh), 0.0);
            update(&mut growth, &bvh, false, 2 * nodes);
            assert_eq!(lost(&growth, &bvh), expected, "{nodes}");
        }
    }

    #[test]
    fn losses_add_up_and_are_held_against_the_fewest_visits() {
        let bvh = tree(2.0);
        let mut growth = Growth { due: 1.0, ..Growth::default() };
        for nodes in [300, 200, 250, 300] {
            update(&mut growth, &bvh, false, nodes);
            growth.lost(10.0);
        }
        assert_eq!(growth.lost(10.0), 2.5 + 5.0 + 5.0);
        growth.leaves_changed();
        assert_eq!(growth.lost(10.0), 12.5);
        update(&mut growth, &bvh, false, 100);
        update(&mut growth, &bvh, false, 110);
        assert!((growth.lost(10.0) - 13.5).abs() < 1e-9);
        growth.visited(0, 7);
        growth.visited(7, 0);
        assert!((growth.lost(10.0) - 14.5).abs() < 1e-9);
    }

    #[test]
    fn counts_of_another_tree_or_of_long_ago_tell_nothing() {
        let (bvh, other) = (tree(2.0), tree(3.0));
        let growth_of = |between: &dyn Fn(&mut Growth)| {
            let mut growth = Growth::default();
            update(&mut growth, &bvh, false, 100);
            update(&mut growth, &bvh, false, 200);
            between(&mut growth);
            update(&mut growth, &bvh, true, 100);
            growth.due
        };
        assert_eq!(growth_of(&|_| {}), SHARE);
        assert_eq!(growth_of(&|growth| update(growth, &other, false, 200)), 0.0);
        let no_counts = |growth: &mut Growth| {
            growth.begin();
            growth.is_of(&bvh);
            growth.end(&bvh, false);
        };
        assert_eq!(growth_of(&no_counts), 0.0);
        let mut growth = Growth { due: 1.0, ..Growth::default() };
        update(&mut growth, &bvh, false, 100);
        update(&mut growth, &bvh, false, 200);
        assert_eq!([&bvh, &other].map(|tree| lost(&growth, tree)), [1.0, 0.0]);
    }
}
