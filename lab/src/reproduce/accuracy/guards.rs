//! The guard against vertices that are not finite: what it costs a refit, and what a few such
//! vertices do to a picture without it.
//!
//! The guard is the *validity* that primitives report to the kernels of an update
//! (`Primitives::aabb_lanes`). [`Unguarded`] triangles report a constant, so the compiler removes
//! the guard from the same kernels.

use anyhow::{Context, Result, ensure};
use bvh_build::{Builder, build};
use bvh_core::glam::Vec4;
use bvh_core::{Aabb, Bvh, Primitives, Triangles, Vec3};
use bvh_update::{Rotate, Strategy, Updater};

use super::Point;
use super::bench::{Bench, differing, in_turns};
use crate::stage::timed;

/// Triangles whose boxes are never checked.
struct Unguarded<'a>(Triangles<'a>);

impl Primitives for Unguarded<'_> {
    #[inline]
    fn len(&self) -> usize {
        self.0.indices.len()
    }

    fn bounds(&self, i: usize) -> Aabb {
        self.0.bounds(i)
    }

    #[inline(always)]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        let [min, max, _] = self.0.aabb_lanes(i);
        [min, max, Vec4::ZERO]
    }

    #[inline]
    fn prefetch_index(&self, i: usize) {
        self.0.prefetch_index(i);
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        self.0.prefetch_data(i);
    }
}

/// One vertex in this many is broken.
const BROKEN: usize = 1000;

/// Whether the guard is there, the tree, and what updates it.
type Entrant = (bool, Bvh, Updater);

/// Updates the tree; gives the milliseconds.
fn update((guarded, tree, updater): &mut Entrant, triangles: Triangles<'_>) -> Result<f64> {
    let (done, time_ms) = timed(|| match guarded {
        true => updater.update(tree, &triangles),
        false => updater.update(tree, &Unguarded(triangles)),
    });
    done.context("no update")?;
    Ok(time_ms)
}

/// Refits with and without rotations, on sound triangles for the time, on broken ones for the
/// error.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let last = bench.stage.scene.animation.duration();
    bench.stage.pose(0.3 * last);
    if !bench.stage.triangles().positions.iter().all(|p| p.is_finite()) {
        // Broken already: the time would be that of the careful fit.
        return Ok(());
    }
    for strategy in [Strategy::Refit, Strategy::RefitRotate(Rotate::default())] {
        bench.stage.pose(0.0);
        let mut tree = Bvh::clone(&bench.stage.first_tree);
        tree.set_dynamic(|_| true);
        let mut entrants = [true, false].map(|guarded| (guarded, tree.clone(), Updater::new(strategy)));
        // To and fro between two frames, the same for both contestants.
        let mut turn = 0;
        let times = in_turns(8 * bench.log.rounds(), 2, |which| {
            bench.stage.pose(last * [0.30, 0.31][turn / 2 % 2]);
            turn += 1;
            update(&mut entrants[which], bench.stage.triangles())
        })?;
        let [a, b] = entrants.each_ref().map(|(_, tree, _)| tree.fingerprint());
        ensure!(a == b, "sound triangles, but the guard changes a tree");

        let sound = bench.stage.triangles();
        let mut positions = sound.positions.to_vec();
        let mut random = fastrand::Rng::with_seed(bench.log.seed);
        for _ in 0..positions.len().div_ceil(BROKEN) {
            let vertex = random.usize(0..positions.len());
            positions[vertex] = Vec3::NAN;
        }
        let broken = Triangles { positions: &positions, ..sound };
        let fresh = build(&broken, Builder::Sweep).context("no tree")?;
        let expected = bench.see(&fresh, &broken, &bench.flat());
        for (entrant, time_ms) in entrants.iter_mut().zip(times) {
            update(entrant, broken)?;
            let error = differing(&bench.see(&entrant.1, &broken, &bench.flat()), &expected);
            let (on, knob) = (entrant.0, format!("guards against NaN at {strategy}"));
            let against = format!("error with one vertex in {BROKEN} NaN, against a fresh tree");
            let note = format!("time of an update, sound; {against}");
            let point = Point { note, ..Point::new(&knob, if on { "on" } else { "off" }, on, time_ms) };
            bench.log.add(point.with("pixels lost to broken triangles", error, "in a million"))?;
        }
    }
    Ok(())
}
