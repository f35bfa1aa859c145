//! A delay before what has come to rest counts as static.

use bvh_core::Bvh;

/// Marks those primitives as dynamic that move, and for some updates those that have stopped.
///
/// Updates skip static subtrees, so rotations never reach what stopped in a bad state. The paper
/// rotates at all nodes, so quality rises once motion stops (Kopta et al. 2012, section 4). The
/// delay preserves this for some updates.
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3};
/// use bvh_update::{SleepDelay, Updater};
///
/// let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 8];
/// let mut bvh = build(&boxes, Builder::Sweep)?;
/// let (mut updater, mut delay) = (Updater::default(), SleepDelay::new(20));
/// for frame in 0..30 {
///     // The first three move for ten frames.
///     let dynamic = delay.mark(&mut bvh, |primitive| frame < 10 && primitive < 3);
///     assert_eq!(dynamic, if frame < 20 { 8 } else { 3 });
///     updater.update(&mut bvh, &boxes)?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SleepDelay {
    updates: u32,
    /// For each primitive, the updates since it moved.
    rested: Vec<u32>,
    /// How often the tree had been marked when it was marked here.
    marked: u32,
}

impl SleepDelay {
    /// Primitives stay dynamic for this many updates after they have moved. At first all count as
    /// just stopped.
    #[must_use]
    pub fn new(updates: u32) -> Self {
        Self { updates, rested: Vec::new(), marked: 0 }
    }

    /// Marks primitives before an update; `moves` says which have moved since the last one. Gives
    /// the number of dynamic ones.
    ///
    /// O(n). Calls [`Bvh::set_dynamic`] if some primitive falls asleep or wakes. While some sleep,
    /// it also does so if the tree was marked another number of times than when this marked it
    /// last: others have marked it, or an [`Updater`](crate::Updater) has rebuilt it.
    ///
    /// Take a new `SleepDelay` for another tree, which may have been marked as often, and after
    /// [`Bvh::reorder_primitives`], since primitives then have other numbers: what has just stopped
    /// may fall asleep at once.
    pub fn mark(&mut self, bvh: &mut Bvh, moves: impl Fn(usize) -> bool) -> usize {
        let Self { updates, rested, marked } = self;
        let is_new = rested.len() != bvh.len();
        if is_new {
            rested.clear();
            rested.resize(bvh.len(), 0);
        }
        let (mut awake, mut changed) = (0, is_new);
        for (primitive, rested) in rested.iter_mut().enumerate() {
            let was_awake = *rested <= *updates;
            *rested = if moves(primitive) { 0 } else { rested.saturating_add(1) };
            let is_awake = *rested <= *updates;
            awake += usize::from(is_awake);
            changed |= was_awake != is_awake;
        }
        // Marks of others, or of a rebuild, which keeps them leaf by leaf.
        if changed || (awake < rested.len() && bvh.update_state().changes.dynamic != *marked) {
            bvh.set_dynamic(|primitive| rested[primitive] <= *updates);
            *marked = bvh.update_state().changes.dynamic;
        }
        awake
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use bvh_build::{BuildOptions, Builder, build};
    use bvh_core::{Aabb, Node, Primitives, Vec3, sah_cost};

    use super::*;
    use crate::{Rotate, Strategy, Updater};

    /// Boxes that jump twice and stop, all but one, which stays.
    fn cost_after_a_burst(delay: u32) -> (f64, u32) {
        let boxes = |frame: usize| -> Vec<Aabb> {
            let place = |i: usize| Vec3::new((i % 13) as f32, (i * 7 % 17) as f32, (i * 11 % 19) as f32);
            let flight = |i: usize| place(i * 31) * (3 * frame.min(2)) as f32;
            (0..2000).map(|i| place(i) + flight(i)).map(|p| Aabb::new(p, p + 0.5)).collect()
        };
        let mut bvh = build(&boxes(0), Builder::Sweep).expect("few enough");
        let mut updater = Updater::new(Strategy::RefitRotate(Rotate::default()));
        let mut delay = SleepDelay::new(delay);
        for frame in 1..60 {
            delay.mark(&mut bvh, |i| frame <= 2 && i != 0);
            updater.update(&mut bvh, &boxes(frame)).expect("same count");
            bvh.validate(&boxes(frame)).expect("valid");
        }
        assert!(!bvh.root().is_dynamic(), "all are asleep in the end");
        (sah_cost(&bvh), bvh.update_state().changes.dynamic)
    }

    #[test]
    fn rotations_go_on_for_some_updates_where_motion_has_stopped() {
        let [(without, marked_at_once), (with, marked)] = [0, 20].map(cost_after_a_burst);
        assert!(with < 0.95 * without, "{with} for {without}");
        // At first, with a delay again for the one that never moves, and for the others.
        assert_eq!((marked_at_once, marked), (2, 3));
    }

    #[test]
    fn sleepers_in_leaves_with_others_are_marked_once() {
        let boxes = [Aabb::new(Vec3::ZERO, Vec3::ONE); 2];
        let mut bvh = Bvh::new(&[Node::leaf(boxes[0], 0, 2), Node::NOTHING], vec![0, 1]).expect("a leaf");
        let mut delay = SleepDelay::new(0);
        for _ in 0..9 {
            assert_eq!(delay.mark(&mut bvh, |i| i == 0), 1);
        }
        assert_eq!(bvh.update_state().changes.dynamic, 1, "as one falls asleep");
    }

    /// A rebuild makes those dynamic, too, that shared a leaf with what is.
    #[test]
    fn a_rebuilt_tree_is_marked_again() {
        let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 100];
        let moves = |primitive: usize| primitive.is_multiple_of(7);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few enough");
        let (mut updater, mut delay) = (Updater::default(), SleepDelay::new(0));
        for max_leaf_size in [4, 3, 2, 1] {
            let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
            updater.set_strategy(Strategy::Rebuild(Builder::Sweep, options));
            updater.update(&mut bvh, &boxes).expect("built");
            delay.mark(&mut bvh, moves);
            let mut expected = bvh.clone();
            expected.set_dynamic(moves);
            assert!(bvh.nodes() == expected.nodes(), "leaves of {max_leaf_size}");
        }
    }

    #[test]
    fn a_new_tree_is_marked_again() {
        let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 9];
        let mut delay = SleepDelay::new(0);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few enough");
        assert_eq!(delay.mark(&mut bvh, |i| i < 4), 4);
        let mut bvh = build(&boxes, Builder::Sweep).expect("few enough");
        assert_eq!(delay.mark(&mut bvh, |i| i < 4), 4);
        assert!(!bvh.all_dynamic());
        // From a tree whose only leaf is dynamic, since one of its primitives is.
        let mut leaf =
            Bvh::new(&[Node::leaf(boxes[0], 0, 9), Node::NOTHING], (0..9).collect()).expect("a leaf");
        let mut delay = SleepDelay::new(0);
        assert_eq!((delay.mark(&mut leaf, |i| i < 4), leaf.all_dynamic()), (4, true));
        let mut bvh = build(&boxes, Builder::Sweep).expect("few enough");
        assert_eq!((delay.mark(&mut bvh, |i| i < 4), bvh.all_dynamic()), (4, false));
        bvh.set_dynamic(|_| true);
        assert_eq!((delay.mark(&mut bvh, |i| i < 4), bvh.all_dynamic()), (4, false), "marked by others");
        let mut smaller = build(&boxes[..5], Builder::Sweep).expect("few enough");
        assert_eq!(delay.mark(&mut smaller, |_| true), 5);
        assert!(smaller.all_dynamic());
    }

    /// A rebuild that panicked leaves an empty tree, and the next one counts as another.
    #[test]
    fn a_tree_built_after_a_panic_is_marked_again() {
        struct Panics;
        impl Primitives for Panics {
            fn len(&self) -> usize {
                9
            }

            fn bounds(&self, _: usize) -> Aabb {
                panic!("no box")
            }
        }
        let boxes = vec![Aabb::new(Vec3::ZERO, Vec3::ONE); 9];
        let (mut bvh, mut delay) = (build(&boxes, Builder::Sweep).expect("few enough"), SleepDelay::new(0));
        assert_eq!(delay.mark(&mut bvh, |i| i < 4), 4);
        let mut updater = Updater::new(Strategy::Rebuild(Builder::Sweep, BuildOptions::default()));
        let update = AssertUnwindSafe(|| updater.update(&mut bvh, &Panics));
        catch_unwind(update).expect_err("no box");
        updater.update(&mut bvh, &boxes).expect("built");
        assert_eq!((delay.mark(&mut bvh, |i| i < 4), bvh.all_dynamic()), (4, false));
    }
}
