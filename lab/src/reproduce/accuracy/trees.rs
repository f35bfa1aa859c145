//! Trees: update strategies with their budgets of rotations, and builders with their settings.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::Bvh;
use bvh_update::{Rotate, Strategy, Updater};

use super::bench::{Bench, Over, fastest};
use super::point::Point;
use crate::interrupt;
use crate::stage::ms;

/// A strategy at work.
#[derive(Default)]
struct Entrant {
    name: String,
    strategy: Strategy,
    tree: Bvh,
    updater: Updater,
    updates: usize,
    update_ms: f64,
    height: u32,
    /// Sums of the errors over the frames compared.
    errors: [f64; 2],
}

/// All strategies whose trees depend on the motion alone, rotations at four budgets among them.
fn entrants(bench: &Bench<'_>) -> Result<Vec<Entrant>> {
    let strategies = Strategy::all().into_iter().filter(|strategy| match strategy {
        // Trees that arrive from the background depend on what else the machine does.
        Strategy::Background(_) => false,
        // The same trees as in parallel.
        Strategy::Rebuild(Builder::Binned, _) => false,
        _ => true,
    });
    let named = strategies.map(|strategy| (strategy.name().to_owned(), strategy));
    let fewer = [2, 4, 8].map(|period| {
        (format!("refit+rotate at 1 node in {period}"), Strategy::RefitRotate(Rotate { period }))
    });
    let entrant = |(name, strategy)| {
        let mut entrant =
            Entrant { name, strategy, tree: bench.stage.first_tree.clone(), ..Entrant::default() };
        entrant.warm_up(bench)?;
        Ok(entrant)
    };
    named.chain(fewer).map(entrant).collect()
}

/// Each strategy updates its tree frame by frame through a loop; on some frames the trees are
/// compared with a fresh one.
pub(super) fn strategies(bench: &mut Bench<'_>) -> Result<()> {
    if !bench.moves() {
        return Ok(());
    }
    bench.stage.pose(0.0);
    let mut entrants = entrants(bench)?;
    let (frames, played, wanted) =
        (bench.log.effort.frames, bench.log.effort.played, bench.log.effort.compared);
    let mut compared = 0;
    let mut selves: Vec<f64> = Vec::new();
    // On the first frame all trees are fresh.
    for frame in 1..played {
        bench.stage.pose(bench.stage.time_of(frame, frames));
        // `wanted` times, evenly, and on the last frame played.
        let part = |frame: usize| frame * wanted / (played - 1);
        let compare = part(frame) != part(frame - 1);
        for entrant in entrants.iter_mut().filter(|e| compare || !e.rebuilds()) {
            entrant.update(bench)?;
        }
        if compare {
            let sweep = bench.sweep()?;
            let trees: Vec<&Bvh> = entrants.iter().map(|entrant| &entrant.tree).collect();
            if let Some(over) = bench.over(&sweep, &trees) {
                for (entrant, errors) in entrants.iter_mut().zip(over.errors) {
                    entrant.errors = [0, 1].map(|k| entrant.errors[k] + errors[k]);
                }
                selves.resize(over.selves.len(), 0.0);
                selves.iter_mut().zip(over.selves).for_each(|(sum, ratio)| *sum += ratio);
                compared += 1;
            }
        }
        bench.log.done(frame, played - 1);
        if interrupt::requested() {
            break;
        }
    }
    if compared == 0 {
        return Ok(());
    }
    selves.iter_mut().for_each(|sum| *sum /= f64::from(compared));
    let frames_seen = match frames - played {
        0 => format!("{compared} of {frames} frames a loop"),
        _ => format!("{compared} of the first {played} of {frames} frames a loop, and of none later"),
    };
    for entrant in entrants {
        let is_default = entrant.strategy == Strategy::default();
        let note = format!(
            "time of an update, mean of {}; errors, mean of {frames_seen}; the tree was at most {} high",
            entrant.updates, entrant.height
        );
        let time_ms = entrant.update_ms / entrant.updates.max(1) as f64;
        let point = Point::new("update strategy", entrant.name, is_default, time_ms).noted(note);
        bench.log.add_tree(&point, entrant.errors.map(|sum| sum / f64::from(compared)), &selves)?;
    }
    Ok(())
}

impl Entrant {
    /// Whether its tree depends on the current frame only.
    fn rebuilds(&self) -> bool {
        matches!(self.strategy, Strategy::Rebuild(..))
    }

    /// Lets it find its memory, on a tree that is thrown away.
    fn warm_up(&mut self, bench: &Bench<'_>) -> Result<()> {
        let tree = self.tree.clone();
        self.update(bench)?;
        (self.tree, self.updates, self.update_ms) = (tree, 0, 0.0);
        Ok(())
    }

    fn update(&mut self, bench: &Bench<'_>) -> Result<()> {
        let triangles = bench.stage.triangles();
        let start = Instant::now();
        let done = self.updater.set_strategy(self.strategy).update(&mut self.tree, &triangles);
        self.update_ms += ms(start);
        self.height = self.height.max(done.with_context(|| format!("{} failed", self.name))?.height);
        self.updates += 1;
        Ok(())
    }
}

/// All builders, the binned one with 4 to 256 bins, the clustering one with radii of 1 to 32, the
/// sweep with leaves of up to 8, and annealing for more or less long, in the middle of the loop.
pub(super) fn builders(bench: &mut Bench<'_>) -> Result<()> {
    let default = BuildOptions::default();
    let of = |builder, options, name: String, is_default| (builder, options, name, is_default);
    let bins = [4, 8, 16, 32, 64, 256].map(|bins| {
        let name = format!("{bins} bins");
        of(Builder::BinnedParallel, default.with_bins(bins), name, bins == default.bins)
    });
    let radii = [1, 2, 4, 8, 16, 32].map(|radius| {
        let options = default.with_search_radius(radius);
        of(Builder::Ploc, options, format!("ploc radius {radius}"), radius == default.search_radius)
    });
    let others = Builder::ALL
        .into_iter()
        .filter(|b| ![Builder::Binned, Builder::BinnedParallel, Builder::Ploc, Builder::Annealed].contains(b))
        .map(|builder| of(builder, default, builder.name().to_owned(), false));
    let annealed = bench.log.effort.anneal_passes.iter().map(|&passes| {
        let options = default.with_anneal(default.anneal.with_passes(passes));
        let is_default = passes == default.anneal.passes;
        of(Builder::Annealed, options, format!("annealed {passes} passes"), is_default)
    });
    let leaves = [2, 4, 8].map(|size| {
        of(Builder::Sweep, default.with_max_leaf_size(size), format!("sweep, leaves of up to {size}"), false)
    });
    let settings: Vec<_> =
        bins.into_iter().chain(radii).chain(others).chain(leaves).chain(annealed).collect();

    bench.pose_in_the_middle();
    let sweep = bench.sweep()?;
    let mut built = Vec::new();
    for (i, (builder, options, setting, _)) in settings.iter().enumerate() {
        if interrupt::requested() {
            return Ok(());
        }
        let mut tree = Bvh::default();
        let mut scratch = BuildScratch::new();
        let mut result = Ok(());
        let time_ms = fastest(bench.log.effort.repeats, || {
            result = rebuild(&mut tree, &bench.stage.triangles(), *builder, options, &mut scratch);
        });
        result.with_context(|| format!("{setting}: no tree"))?;
        built.push((tree, time_ms));
        bench.log.done(i + 1, settings.len());
    }
    let trees: Vec<&Bvh> = built.iter().map(|(tree, _)| tree).collect();
    let Some(Over { errors, selves }) = bench.over(&sweep, &trees) else { return Ok(()) };
    for (((_, _, setting, is_default), (_, time_ms)), errors) in settings.iter().zip(&built).zip(errors) {
        let note = format!(
            "time of a build, fastest of at most {}; errors in the middle of the loop",
            bench.log.effort.repeats
        );
        let point = Point::new("builder", setting.as_str(), *is_default, *time_ms).noted(note);
        bench.log.add_tree(&point, errors, &selves)?;
    }
    Ok(())
}
