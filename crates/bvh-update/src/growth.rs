//! How many more nodes rays visit than when the tree was new, and how much of that a new tree would take away: from counts.
//!
//! The SAH cost is a sum over the whole tree; a camera looks at a part of it. What has become bad there may cost rays a third
//! of their time while the cost, that of walls included, stands still or even falls. The number of nodes that rays visit
//! tells, but it changes with the motion, too. So it is held against the least since the tree was built, and what part of
//! the growth is due to the tree is learned from new trees: by what they took away of it.

use bvh_core::Bvh;

use crate::decision::Decision;
use crate::strategy::Update;

/// Growth that is not more than motion makes in any case: it counts for nothing, and new trees tell nothing of it.
const LEAST: f64 = 0.05;
/// What one observation counts for in the average.
const SHARE: f64 = 0.5;

/// What tells a tree from others, from one update to the next: numbers of its primitives and updates, and its box.
type Tree = (usize, u32, [f32; 6]);

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
    /// Whether counts are to be told of `tree`.
    is_open: bool,
    /// Whether leaves have been merged or split since the last counts.
    has_other_leaves: bool,
    /// The fewest and the last visits of the tree whose place a new one took in this update.
    before: Option<[f64; 2]>,
    /// What part of the growth was due to the tree, by the last new trees.
    due: f64,
    /// What rays have lost to growth since the tree was built, or its top.
    regret: f64,
}

impl Growth {
    /// An update begins, of whatever tree.
    pub(crate) fn begin(&mut self) {
        self.before = match (self.least, self.now) {
            (Some(least), Some(now)) if self.is_told => Some([least, now]),
            _ => None,
        };
        (self.is_told, self.is_open) = (false, false);
    }

    /// The update is of this tree; if it is another one than that of the last update, nothing is known of it.
    pub(crate) fn is_of(&mut self, bvh: &Bvh) {
        if self.tree != Some(key(bvh)) {
            *self = Self { due: self.due, ..Self::default() };
        }
    }

    /// The new tree of this update is no measure of the old one: built in haste, or with other leaves.
    pub(crate) fn tells_nothing(&mut self) {
        self.before = None;
    }

    /// The update has left the tree so; if it is a new one, what was counted before does not hold for it, and if its top is
    /// new, it starts anew as to what has been lost.
    pub(crate) fn end(&mut self, bvh: &Bvh, update: &Update) {
        (self.tree, self.is_open) = (Some(key(bvh)), true);
        let is_regrown = matches!(update.decision, Decision::Regrow { .. });
        // What the new top has taken away of the growth cannot be told from what other leaves have.
        if update.rebuilt || is_regrown && self.has_other_leaves {
            (self.least, self.now, self.has_other_leaves) = (None, None, false);
        }
        if !update.rebuilt {
            self.before = None;
        }
        if update.rebuilt || is_regrown {
            self.regret = 0.0;
        }
    }

    /// Leaves have been merged or split, which changes the number of nodes: by how much, the next counts tell.
    pub(crate) fn leaves_changed(&mut self) {
        self.has_other_leaves = true;
    }

    /// In the tree of the last update so many rays have visited so many nodes.
    pub(crate) fn visited(&mut self, rays: u64, nodes: u64) {
        if rays == 0 || nodes == 0 || !self.is_open {
            return;
        }
        let visits = nodes as f64 / rays as f64;
        if std::mem::take(&mut self.has_other_leaves)
            && let (Some(least), Some(now)) = (&mut self.least, self.now)
        {
            *least *= visits / now;
        }
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

    /// Adds what rays lose to growth in one frame, where all of them took so much in the last; gives it, too.
    pub(crate) fn charge(&mut self, rays: f64) -> f64 {
        let (Some(least), Some(now)) = (self.least, self.now) else { return 0.0 };
        let lost = rays * self.due * (1.0 - least * (1.0 + LEAST) / now).max(0.0);
        self.regret += lost;
        lost
    }

    /// What rays have lost to growth since the tree was built, or its top.
    pub(crate) fn regret(&self) -> f64 {
        self.regret
    }
}

fn key(bvh: &Bvh) -> Tree {
    let aabb = bvh.root().aabb();
    let [min, max] = [aabb.min, aabb.max];
    (bvh.len(), bvh.history().updates, [min.x, min.y, min.z, max.x, max.y, max.z])
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Vec3};

    use super::*;

    fn tree(x: f32) -> Bvh {
        let boxes = [Aabb::new(Vec3::ZERO, Vec3::splat(1.0)), Aabb::new(Vec3::ZERO, Vec3::splat(x))];
        build(&boxes, Builder::Sweep).expect("two boxes")
    }

    const REFIT: Decision = Decision::Refit { one_in: 1 };

    /// An update of a tree, after which a ray visits so many nodes.
    fn update(growth: &mut Growth, bvh: &Bvh, decision: Decision, nodes: u64) {
        growth.begin();
        growth.is_of(bvh);
        let rebuilt = matches!(decision, Decision::Rebuild { .. });
        growth.end(bvh, &Update { rebuilt, decision, ..Update::default() });
        growth.visited(1, nodes);
    }

    const NEW: Decision = Decision::Rebuild { builder: Builder::Ploc };

    /// What is lost in the next update if rays take 1, above what they lose to growth that counts for nothing.
    fn lost(growth: &Growth, bvh: &Bvh) -> f64 {
        let mut growth = Growth { regret: 0.0, ..*growth };
        growth.begin();
        growth.is_of(bvh);
        let lost = growth.charge(1.0);
        assert_eq!(growth.regret(), lost);
        lost
    }

    /// Part of the time of rays that is due to so many times as many visits.
    fn part(times: f64) -> f64 {
        1.0 - (1.0 + LEAST) / times
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn only_new_trees_tell_what_growth_is_due_to() {
        let bvh = tree(2.0);
        let mut growth = Growth::default();
        for nodes in [100, 150, 200, 400] {
            update(&mut growth, &bvh, REFIT, nodes);
            assert_eq!(lost(&growth, &bvh), 0.0);
        }
        // All of it was due to the tree, or none of it, or the new one is even worse.
        for (nodes, expected) in [(100, 0.75), (400, 0.25), (900, 0.0)] {
            let mut growth = Growth { due: 0.5, ..growth };
            update(&mut growth, &bvh, NEW, nodes);
            assert_eq!(lost(&growth, &bvh), 0.0);
            update(&mut growth, &bvh, REFIT, 2 * nodes);
            assert!(near(lost(&growth, &bvh), expected * part(2.0)), "{nodes}");
        }
        // What motion may have made.
        for nodes in [102, 104] {
            update(&mut growth, &bvh, NEW, 100);
            update(&mut growth, &bvh, REFIT, nodes);
            assert_eq!((lost(&growth, &bvh), growth.due), (0.0, SHARE));
        }
    }

    #[test]
    fn losses_add_up_until_the_tree_is_repaired_and_are_held_against_the_fewest_visits() {
        let bvh = tree(2.0);
        let mut growth = Growth { due: 1.0, ..Growth::default() };
        for nodes in [300, 200, 250, 300] {
            update(&mut growth, &bvh, REFIT, nodes);
            growth.charge(10.0);
        }
        let so_far = 10.0 * (part(1.25) + part(1.5));
        assert!(near(growth.regret(), so_far));
        // A third of the nodes is gone with the leaves: still one and a half times as many as there might be.
        growth.leaves_changed();
        update(&mut growth, &bvh, REFIT, 200);
        assert!(near(lost(&growth, &bvh), part(1.5)));
        growth.visited(0, 7);
        growth.visited(7, 0);
        assert!(near(lost(&growth, &bvh), part(1.5)) && near(growth.regret(), so_far));
        update(&mut growth, &bvh, Decision::Regrow { subtrees: 7 }, 200);
        assert_eq!(growth.regret(), 0.0);
        assert!(near(lost(&growth, &bvh), part(1.5)));
        // A new top and other leaves at once.
        growth.leaves_changed();
        update(&mut growth, &bvh, Decision::Regrow { subtrees: 7 }, 50);
        assert_eq!((growth.least, lost(&growth, &bvh)), (Some(50.0), 0.0));
    }

    #[test]
    fn counts_of_another_tree_or_of_long_ago_tell_nothing() {
        let (bvh, other) = (tree(2.0), tree(3.0));
        let due_after = |between: &dyn Fn(&mut Growth)| {
            let mut growth = Growth::default();
            update(&mut growth, &bvh, REFIT, 100);
            update(&mut growth, &bvh, REFIT, 200);
            between(&mut growth);
            update(&mut growth, &bvh, NEW, 100);
            growth.due
        };
        assert_eq!(due_after(&|_| {}), SHARE);
        assert_eq!(due_after(&|growth| update(growth, &other, REFIT, 200)), 0.0);
        let no_counts = |growth: &mut Growth| {
            growth.begin();
            growth.is_of(&bvh);
            growth.end(&bvh, &Update::default());
        };
        assert_eq!(due_after(&no_counts), 0.0);
        let mut growth = Growth { due: 1.0, ..Growth::default() };
        update(&mut growth, &bvh, REFIT, 100);
        update(&mut growth, &bvh, REFIT, 200);
        // Another strategy has updated another tree.
        let before = growth;
        growth.begin();
        growth.visited(1, 7);
        assert_eq!((growth.due, growth.least, growth.now), (before.due, before.least, before.now));
        assert!(near(lost(&growth, &bvh), part(2.0)));
        assert_eq!(lost(&growth, &other), 0.0);
    }
}
