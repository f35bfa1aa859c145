//! Claims that the paper makes in passing: worst frames, steadiness, causes, and what it expects of
//! combinations.

use super::findings::{missing, without_museum};
use super::table::{
    REFIT, ROTATE, Table, at_least, both, by_ratios, graded, mean_cost, update_time, worst_cost,
};
use super::{Bounds, Finding};
use crate::reproduce::contestants::{ASYNCHRONOUS, IDEAL, IDEAL_PARALLEL_BINNED};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};
use crate::reproduce::{MUSEUM, SPEED_STRATEGIES, SPEED_STRATEGY};

/// Spread of some measure of a strategy over the frames measured.
fn spread(scene: &SceneRun, strategy: &str, measure: fn(&Row) -> f64) -> Option<Spread> {
    Spread::of(scene.of(strategy).into_iter().map(measure))
}

pub(super) fn worst_frame(results: &Results, b: &Bounds) -> Finding {
    let worst = |scene: &SceneRun, name| Some(spread(scene, name, |row| row.frame_ms)?.max);
    let table = Table::of(without_museum(results), |s| {
        Some(worst(s, ROTATE)? / worst(s, REFIT)?.min(worst(s, IDEAL_PARALLEL_BINNED)?))
    });
    Ok(table.compared()?.at_most(b.worst_frame))
}

pub(super) fn insensitive(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(results.moving(), |s| {
        let ratio = |name| spread(s, name, |row| row.update_ms).map(|times| times.p90 / times.p10);
        [REFIT, ROTATE, "binned"].into_iter().map(ratio).try_fold(0.0, |most, ratio| Some(ratio?.max(most)))
    });
    Ok(table.compared()?.at_most(b.insensitive))
}

pub(super) fn museum_cause(results: &Results, b: &Bounds) -> Finding {
    const OTHERS: [&str; 2] = ["lion", "exploding-dragon"];
    let ideal = results.scene(MUSEUM).and_then(|s| mean_cost(s, IDEAL)).ok_or_else(|| missing(&[MUSEUM]))?;
    let others = OTHERS.iter().filter_map(|name| results.scene(name));
    let table = Table::of(others, |s| Some(ideal / spread(s, REFIT, |row| row.sah_cost)?.max));
    let table = table.or(missing(&OTHERS))?;
    let as_poor = at_least(b.as_poor);
    let verdict = graded(table.len() == OTHERS.len() && table.all(&as_poor), table.count(&as_poor) > 0);
    Ok((table.text(), verdict, format!("a fresh tree over the museum costs {ideal:.1} on average")))
}

const NOT_STOPPED: &str = "no scene was stopped";

pub(super) fn settling(results: &Results, b: &Bounds) -> Finding {
    let of = |ratio: fn([f64; 3]) -> f64| {
        Table::of(results.moving(), move |s| s.settled.map(ratio)).exact(3).or(NOT_STOPPED)
    };
    let table = of(|[stopped, after, _]| after / stopped)?;
    let (ours, verdict, why) = table.everywhere(&format!("below {}", b.settles), |ratio| ratio < b.settles);
    let fresh = of(|[_, after, fresh]| after / fresh)?;
    Ok((ours, verdict, format!("{why}; over a fresh sweep build then: {}", fresh.text())))
}

pub(super) fn memory(results: &Results, b: &Bounds) -> Finding {
    Ok(Table::of(results.moving(), |s| s.memory).exact(3).or(NOT_STOPPED)?.at_most(b.memory))
}

pub(super) fn fewer_cores(results: &Results, b: &Bounds) -> Finding {
    const ONE_CORE: &str = "refit+rotate+background";
    let mean = |s: &SceneRun, name| Some(spread(s, name, |row| row.sah_cost)?.mean);
    let table = Table::of(results.moving(), |s| Some(mean(s, ONE_CORE)? / mean(s, ASYNCHRONOUS)?));
    let (ours, verdict, why) = table.compared()?.at_most(b.fewer_cores);
    Ok((ours, verdict, format!("{why}; all cores were {}", results.settings.threads)))
}

pub(super) fn hlbvh(results: &Results, b: &Bounds) -> Finding {
    const NAME: &str = "fairy-forest";
    let found = results.scene(NAME).and_then(|scene| {
        Some((update_time(scene, "hlbvh", ROTATE)?, worst_cost(scene, "hlbvh")?, worst_cost(scene, ROTATE)?))
    });
    let (times, built, rotated) = found.ok_or_else(|| missing(&[NAME]))?;
    let (verdict, near) = by_ratios([(NAME, times)], |[times]| both(times >= b.hlbvh, built > rotated));
    let why = format!("at worst it costs {built:.3} of a fresh sweep build, rotations {rotated:.3}{near}");
    Ok((format!("{times:.1} times as long"), verdict, why))
}

pub(super) fn fast_motion(results: &Results, b: &Bounds) -> Finding {
    let sum = |scene: &SceneRun, frames: usize, strategy: &str, from: usize| {
        let rows = scene.at_speed(frames, strategy);
        let of = rows.iter().filter(|row| row.round >= from);
        Some(of.map(|row| row.frame_ms).sum::<f64>()).filter(|sum| *sum > 0.0)
    };
    let found = results.scenes.iter().find_map(|s| {
        let over = |from| Some(sum(s, 20, SPEED_STRATEGY, from)? / sum(s, 20, IDEAL_PARALLEL_BINNED, from)?);
        Some((s, over(0)?, over(1)?))
    });
    let (scene, all, later) = found.ok_or("figure 5 was not run with two loops of 20 frames")?;
    let ratios = [("all loops", all), ("later loops", later)];
    let (verdict, near) =
        by_ratios(ratios, |[all, later]| graded(all <= b.fast_motion, later <= b.fast_motion));
    let mut why = format!("{later:.2} after the first loop{near}");
    let others =
        SPEED_STRATEGIES.iter().filter(|name| ![SPEED_STRATEGY, IDEAL_PARALLEL_BINNED].contains(name));
    for (name, time) in others.filter_map(|name| Some((name, sum(scene, 20, name, 0)?))) {
        let over = sum(scene, 20, SPEED_STRATEGY, 0).map_or(f64::NAN, |own| own / time);
        why += &format!("; {over:.2} of {name}");
    }
    let mean = |frames| {
        let count = scene.at_speed(frames, SPEED_STRATEGY).len();
        Some(sum(scene, frames, SPEED_STRATEGY, 0)? / count as f64)
    };
    if let Some((middle, slow)) = mean(100).zip(mean(500)) {
        why += &format!("; frames of the loop of 100 take {:.2} of those of 500", middle / slow);
    }
    Ok((format!("{} {all:.2}", scene.label), verdict, why))
}
