//! Trees: update strategies with their budgets of rotations, bounds on height, and builders with
//! their settings.

use anyhow::{Context, Result};
use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Bvh, MAX_HEIGHT};
use bvh_update::{Rotate, Strategy, Update, plain};

use super::Point;
use super::bench::{Bench, noise};
use crate::interrupt;
use crate::reproduce::contestants::{Method, Worker, load_of};
use crate::stage::{fresh_tree, timed};

/// A way to update a tree, at work.
struct Entrant {
    setting: String,
    is_default: bool,
    /// Whether the tree depends on the current frame only.
    rebuilds: bool,
    update: Worker,
    tree: Bvh,
    /// Times of the updates.
    times_ms: Vec<f64>,
    height: u32,
    /// Sums of the errors over the frames compared.
    errors: [f64; 2],
}

impl Entrant {
    fn new(setting: String, is_default: bool, rebuilds: bool, tree: Bvh, update: Worker) -> Self {
        let (times_ms, height, errors) = (Vec::new(), 0, [0.0; 2]);
        Self { setting, is_default, rebuilds, update, tree, times_ms, height, errors }
    }
}

/// All strategies whose trees depend on the motion alone, rotations at four budgets among them.
pub(super) fn strategies(bench: &mut Bench<'_>) -> Result<()> {
    bench.stage.pose(0.0);
    let strategies = Strategy::all().into_iter().filter(|strategy| match strategy {
        // Trees that arrive from the background depend on what else the machine does.
        Strategy::Background(_) => false,
        // The same trees as in parallel.
        Strategy::Rebuild(Builder::Binned, _) => false,
        _ => true,
    });
    let named = strategies.map(|strategy| (strategy.name().to_owned(), strategy));
    let fewer = [2, 4, 8].map(|period| {
        let budget = Rotate::default().with_period(period);
        (format!("refit+rotate at 1 node in {period}"), Strategy::RefitRotate(budget))
    });
    let entrant = |(setting, strategy): (String, Strategy)| {
        let (method, mut tree) = (Method::Strategy(strategy), Bvh::clone(&bench.stage.first_tree));
        let mut update = method.start(&mut tree, &[])?;
        // It finds its memory, on a tree that is thrown away.
        let warm = update(&mut tree.clone(), &bench.stage.triangles(), load_of(bench.log.size));
        warm.with_context(|| format!("{setting} failed"))?;
        let is_default = setting == Strategy::default().name();
        Ok(Entrant::new(setting, is_default, method.rebuilds(), tree, update))
    };
    let entrants = named.chain(fewer).map(entrant).collect::<Result<_>>()?;
    play(bench, "update strategy", "an update", entrants)
}

/// Bounds on the height of trees, from that of the first tree up to the library's: what a lower one
/// would keep rotations from. The bound is a constant of the library. Here the plain update runs
/// from a depth that makes the bound lower.
pub(super) fn height_bounds(bench: &mut Bench<'_>) -> Result<()> {
    let first = Bvh::clone(&bench.stage.first_tree);
    let lowest = first.height();
    let higher = [32, 40, 48, 64, MAX_HEIGHT].into_iter().filter(|&bound| bound > lowest);
    let entrant = |bound: u32| {
        let setting = match bound == lowest {
            true => "height of the first tree".to_owned(),
            false => format!("{bound} levels"),
        };
        let update: Worker = Box::new(move |tree, triangles, _| {
            plain::update_below(tree, triangles, Some(Rotate::default()), MAX_HEIGHT - bound);
            let mut update = Update::default();
            update.height = tree.height();
            Ok(update)
        });
        Entrant::new(setting, bound == MAX_HEIGHT, false, first.clone(), update)
    };
    let entrants = std::iter::once(lowest).chain(higher).map(entrant).collect();
    play(bench, "height bound", "the plain update", entrants)
}

/// Each entrant updates its tree frame by frame through a loop; on some frames the trees are
/// compared with a fresh one. `what` is what the entrants do. Nothing if nothing moves.
fn play(bench: &mut Bench<'_>, knob: &str, what: &str, mut entrants: Vec<Entrant>) -> Result<()> {
    if !bench.stage.scene.animation.topology().moves.contains(&true) {
        return Ok(());
    }
    let (frames, is_cut) = (bench.log.frames, bench.log.is_cut);
    let (played, wanted) =
        if is_cut { (frames.div_ceil(5), 1) } else { (frames, bench.log.pick([2, 2, 20])) };
    let mut compared = 0;
    let mut selves: Vec<f64> = Vec::new();
    // On the first frame all trees are fresh.
    for frame in (1..played).take_while(|_| !interrupt::requested()) {
        bench.stage.pose(bench.stage.time_of(frame, frames));
        // `wanted` times, evenly, and on the last frame played.
        let part = |frame: usize| frame * wanted / (played - 1);
        let compare = part(frame) != part(frame - 1);
        for entrant in entrants.iter_mut().filter(|e| compare || !e.rebuilds) {
            let (triangles, load) = (bench.stage.triangles(), load_of(bench.log.size));
            let (done, time_ms) = timed(|| (entrant.update)(&mut entrant.tree, &triangles, load));
            let done = done.with_context(|| format!("{} failed", entrant.setting))?;
            entrant.times_ms.push(time_ms);
            entrant.height = entrant.height.max(done.height);
        }
        if compare {
            let sweep = fresh_tree(bench.stage)?;
            let trees: Vec<&Bvh> = entrants.iter().map(|entrant| &entrant.tree).collect();
            let Some((errors, times)) = bench.over(&sweep, &trees) else { break };
            for (entrant, errors) in entrants.iter_mut().zip(errors) {
                entrant.errors = [0, 1].map(|k| entrant.errors[k] + errors[k]);
            }
            selves.resize(times.len(), 0.0);
            selves.iter_mut().zip(times).for_each(|(sum, ratio)| *sum += ratio);
            compared += 1;
        }
    }
    let mean = |sum: f64| sum / f64::from(compared);
    let noise = noise(&selves.into_iter().map(mean).collect::<Vec<_>>());
    let frames_seen = match frames - played {
        0 => format!("{compared} of {frames} frames a loop"),
        _ => format!("{compared} of the first {played} of {frames} frames a loop, and of none later"),
    };
    for entrant in entrants.into_iter().filter(|_| compared > 0) {
        let (updates, height) = (entrant.times_ms.len(), entrant.height);
        let note = format!(
            "time of {what}, mean of {updates}; errors, mean of {frames_seen}; the tree was at most {height} high"
        );
        let time_ms = entrant.times_ms.iter().sum::<f64>() / updates as f64;
        let point = Point { note, ..Point::new(knob, &entrant.setting, entrant.is_default, time_ms) };
        bench.log.add_tree(&point, entrant.errors.map(mean), noise)?;
    }
    Ok(())
}

/// Milliseconds of a build that is measured once.
const LONG: f64 = 300.0;

/// All builders, the binned one with 4 to 256 bins, the clustering one with radii of 1 to 32, the
/// sweep with leaves of up to 8, and annealing for more or less long, in the middle of the loop.
pub(super) fn builders(bench: &mut Bench<'_>) -> Result<()> {
    let default = BuildOptions::default();
    let bins = [4, 8, 16, 32, 64, 256].map(|bins| {
        let name = format!("{bins} bins");
        (Builder::BinnedParallel, default.with_bins(bins), name, bins == default.bins)
    });
    let radii = [1, 2, 4, 8, 16, 32].map(|radius| {
        let options = default.with_search_radius(radius);
        (Builder::Ploc, options, format!("ploc radius {radius}"), radius == default.search_radius)
    });
    let others = Builder::ALL
        .into_iter()
        .filter(|b| ![Builder::Binned, Builder::BinnedParallel, Builder::Ploc, Builder::Annealed].contains(b))
        .map(|builder| (builder, default, builder.name().to_owned(), false));
    let passes: [&[u32]; 3] = [&[], &[25], &[25, 100, 400, 1600]];
    let passes = if bench.log.is_cut { &[] } else { bench.log.pick(passes) };
    let annealed = passes.iter().map(|&passes| {
        let options = default.with_anneal(default.anneal.with_passes(passes));
        let is_default = passes == default.anneal.passes;
        (Builder::Annealed, options, format!("annealed {passes} passes"), is_default)
    });
    let leaves = [2, 4, 8].map(|size| {
        (Builder::Sweep, default.with_max_leaf_size(size), format!("sweep, leaves of up to {size}"), false)
    });
    let settings: Vec<_> =
        bins.into_iter().chain(radii).chain(others).chain(leaves).chain(annealed).collect();

    bench.pose_in_the_middle();
    let (sweep, triangles) = (fresh_tree(bench.stage)?, bench.stage.triangles());
    // Not in turns: some take a thousand times as long as others.
    let mut built = Vec::new();
    for (builder, options, setting, _) in &settings {
        let (mut tree, mut scratch, mut fastest) = (Bvh::default(), BuildScratch::default(), f64::INFINITY);
        for _ in 0..bench.log.pick([1, 3, 5]) {
            if interrupt::requested() {
                return Ok(());
            }
            let (done, time_ms) = timed(|| rebuild(&mut tree, &triangles, *builder, options, &mut scratch));
            done.with_context(|| format!("{setting}: no tree"))?;
            fastest = fastest.min(time_ms);
            if fastest > LONG {
                break;
            }
        }
        built.push((tree, fastest));
    }
    let trees: Vec<&Bvh> = built.iter().map(|(tree, _)| tree).collect();
    let Some((errors, selves)) = bench.over(&sweep, &trees) else { return Ok(()) };
    for (((_, _, setting, is_default), (_, time_ms)), errors) in settings.iter().zip(&built).zip(errors) {
        let note = "time of the fastest build; errors in the middle of the loop".to_owned();
        let point = Point { note, ..Point::new("builder", setting, *is_default, *time_ms) };
        bench.log.add_tree(&point, errors, noise(&selves))?;
    }
    Ok(())
}
