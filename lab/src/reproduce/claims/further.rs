//! Claims that the paper makes in passing: worst frames, steadiness, causes, and what it expects of
//! combinations.

use super::bounds::Bounds;
use super::findings::{missing, moving, nothing_compared};
use super::ratios::{REFIT, ROTATE, at_least, at_most, mean_cost, update_time, worst_cost};
use super::table::{Table, by_times, graded};
use super::{Finding, Rule};
use crate::reproduce::contestants::{ASYNCHRONOUS, IDEAL, IDEAL_PARALLEL_BINNED};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};
use crate::reproduce::{MUSEUM, SPEED_STRATEGY};

/// Spread of some measure of a strategy over the frames measured.
fn spread(scene: &SceneRun, strategy: &str, measure: fn(&Row) -> f64) -> Option<Spread> {
    Spread::of(scene.of(strategy).into_iter().map(measure))
}

pub(super) const WORST_FRAME: Rule = Rule {
    claim: "The worst frame with rotations is no worse than that of other techniques, but for the museum",
    source: "section 5",
    paper: "roughly matches or outperforms, in worst case frame time, too",
    rule: "Longest frame time over the longest of refit and of ideal-parallel-binned, whichever is less. Holds if at most 1.25 in \
           every scene that moves other than bart-museum; in part if in more than half of them.",
    judge: worst_frame,
};

fn worst_frame(results: &Results, b: &Bounds) -> Finding {
    let others = moving(results).filter(|s| s.facts.label != MUSEUM);
    let worst = |scene: &SceneRun, name| Some(spread(scene, name, |row| row.frame_ms)?.max);
    let table = Table::of(others, |s| {
        Some(worst(s, ROTATE)? / worst(s, REFIT)?.min(worst(s, IDEAL_PARALLEL_BINNED)?))
    });
    if table.is_empty() {
        return nothing_compared();
    }
    let passes = at_most(b.worst_frame);
    let (verdict, near) = by_times([&table], |[t]| graded(t.all(&passes), t.most(&passes)));
    Finding(table.text(), verdict, table.scenes_where(&format!("at most {}", b.worst_frame), passes) + &near)
}

pub(super) const INSENSITIVE: Rule = Rule {
    claim: "The time of an update depends little on the frame",
    source: "section 3, figure 4",
    paper: "fairly insensitive to which specific frame",
    rule: "Update time that nine tenths of the frames stay below over that of one tenth, with refit, with rotations and with \
           serial binned rebuilds; the greatest of these. Holds if at most 1.5 in every scene that moves; in part if in more \
           than half of them.",
    judge: insensitive,
};

fn insensitive(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| {
        let ratio = |name| spread(s, name, |row| row.update_ms).map(|times| times.p90 / times.p10);
        [REFIT, ROTATE, "binned"].into_iter().map(ratio).try_fold(0.0, |most, ratio| Some(ratio?.max(most)))
    });
    if table.is_empty() {
        return nothing_compared();
    }
    let passes = at_most(b.insensitive);
    let (verdict, near) = by_times([&table], |[t]| graded(t.all(&passes), t.most(&passes)));
    Finding(table.text(), verdict, table.scenes_where(&format!("at most {}", b.insensitive), passes) + &near)
}

pub(super) const MUSEUM_CAUSE: Rule = Rule {
    claim: "In the museum even a fresh tree is as poor as the worst that refitting comes to elsewhere",
    source: "section 3, bart-museum",
    paper: "as poor as refit's worst in the lion and the exploding dragon",
    rule: "Mean SAH cost of ideal on bart-museum over the greatest of refit on lion and on exploding-dragon. Holds if at least 0.8 \
           on both; in part if on one of them.",
    judge: museum_cause,
};

fn museum_cause(results: &Results, b: &Bounds) -> Finding {
    const OTHERS: [&str; 2] = ["lion", "exploding-dragon"];
    let Some(ideal) = results.scene(MUSEUM).and_then(|s| mean_cost(s, IDEAL)) else {
        return missing(&[MUSEUM]);
    };
    let others = OTHERS.iter().filter_map(|name| results.scene(name));
    let table = Table::of(others, |s| Some(ideal / spread(s, REFIT, |row| row.sah_cost)?.max));
    if table.is_empty() {
        return missing(&OTHERS);
    }
    let as_poor = at_least(b.as_poor);
    let verdict = graded(table.len() == OTHERS.len() && table.all(&as_poor), table.count(&as_poor) > 0);
    let why = format!("a fresh tree over the museum costs {ideal:.1} on average");
    Finding(table.text(), verdict, why)
}

pub(super) const SETTLING: Rule = Rule {
    claim: "Once motion stops, quality keeps rising",
    source: "section 4",
    paper: "more pronounced if the animation settles down",
    rule: "SAH cost after 50 more updates with rotations of geometry that has stopped at half of the loop, over the cost when it \
           stopped. Holds if below 1 in every scene that moves; in part if in more than half of them.",
    judge: settling,
};

fn settling(results: &Results, b: &Bounds) -> Finding {
    let of = |ratio: fn([f64; 3]) -> f64| Table::of(moving(results), move |s| s.facts.settled.map(ratio));
    let table = of(|[stopped, after, _]| after / stopped);
    if table.is_empty() {
        return Finding::not_run("no scene was stopped");
    }
    let passes = |ratio| ratio < b.settles;
    let fresh = of(|[_, after, fresh]| after / fresh);
    let why = format!(
        "{}; over a fresh sweep build then: {}",
        table.scenes_where(&format!("below {}", b.settles), passes),
        fresh.text_to(3)
    );
    Finding(table.text_to(3), graded(table.all(passes), table.most(passes)), why)
}

pub(super) const MEMORY: Rule = Rule {
    claim: "Rotations need hardly any memory",
    source: "abstract",
    paper: "requires negligible memory",
    rule: "Bytes that refit+rotate keeps from one update to the next, over those of the tree. Holds if at most 0.1 in every scene \
           that moves; in part if in more than half of them. They grow with the threads, not with the scene.",
    judge: memory,
};

fn memory(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| s.facts.memory);
    if table.is_empty() {
        return Finding::not_run("no scene was stopped");
    }
    let passes = at_most(b.memory);
    let why = table.scenes_where(&format!("at most {}", b.memory), &passes);
    Finding(table.text_to(3), graded(table.all(&passes), table.most(&passes)), why)
}

pub(super) const FEWER_CORES: Rule = Rule {
    claim: "With rotations between its trees, asynchronous rebuilding needs fewer cores",
    source: "section 5, after Wald, Ize and Parker 2008",
    paper: "more frames without losing too much quality, so fewer rebuild cores",
    rule: "Mean SAH cost of refit+rotate+background, which builds with one core, over that of asynchronous, which builds with \
           all. Holds if at most 1 in every scene that moves; in part if in more than half of them. These costs depend on the \
           machine.",
    judge: fewer_cores,
};

fn fewer_cores(results: &Results, b: &Bounds) -> Finding {
    const ONE_CORE: &str = "refit+rotate+background";
    let mean = |s: &SceneRun, name| Some(spread(s, name, |row| row.sah_cost)?.mean);
    let table = Table::of(moving(results), |s| Some(mean(s, ONE_CORE)? / mean(s, ASYNCHRONOUS)?));
    if table.is_empty() {
        return nothing_compared();
    }
    let passes = at_most(b.fewer_cores);
    let (verdict, near) = by_times([&table], |[t]| graded(t.all(&passes), t.most(&passes)));
    let why = table.scenes_where(&format!("at most {}", b.fewer_cores), passes) + &near;
    Finding(table.text(), verdict, format!("{why}; all cores were {}", results.settings.threads))
}

pub(super) const HLBVH: Rule = Rule {
    claim: "Where deformation is moderate, an HLBVH takes about four times as long as rotations, and is worse",
    source: "section 5, fairy-forest",
    paper: "about 4 times longer, and a lower quality tree",
    rule: "On fairy-forest. Holds if the sum of hlbvh's update times is at least 3 times refit+rotate's, and its greatest SAH cost \
           over a fresh sweep build's is above that of rotations; in part if one of the two.",
    judge: hlbvh,
};

fn hlbvh(results: &Results, b: &Bounds) -> Finding {
    const NAME: &str = "fairy-forest";
    let Some(scene) = results.scene(NAME) else { return missing(&[NAME]) };
    let found = (update_time(scene, "hlbvh", ROTATE), worst_cost(scene, "hlbvh"), worst_cost(scene, ROTATE));
    let (Some(times), Some(built), Some(rotated)) = found else { return missing(&[NAME]) };
    let longer = at_least(b.hlbvh);
    let (verdict, near) = by_times([&Table::single((NAME, times))], |[t]| {
        graded(t.all(&longer) && built > rotated, t.all(&longer) || built > rotated)
    });
    let why = format!("at worst it costs {built:.3} of a fresh sweep build, rotations {rotated:.3}{near}");
    Finding(format!("{times:.1} times as long"), verdict, why)
}

pub(super) const FAST_MOTION: Rule = Rule {
    claim: "Even a loop of 20 frames performs well beside other updates",
    source: "section 3, figure 5",
    paper: "it still performs well compared to the other update methods",
    rule: "Sum of the frame times over ideal-parallel-binned's, both at 20 frames a loop. Holds if at most 1.25 over all loops; in \
           part if over those after the first.",
    judge: fast_motion,
};

fn fast_motion(results: &Results, b: &Bounds) -> Finding {
    let sum = |scene: &SceneRun, frames: usize, strategy: &str, from: usize| {
        let (_, rows) = scene.speeds.iter().find(|(n, _)| *n == frames)?;
        let of = rows.iter().filter(|row| row.strategy == strategy && row.round >= from);
        Some(of.map(|row| row.frame_ms).sum::<f64>()).filter(|sum| *sum > 0.0)
    };
    let found = results.scenes.iter().find_map(|s| {
        let over = |from| Some(sum(s, 20, SPEED_STRATEGY, from)? / sum(s, 20, IDEAL_PARALLEL_BINNED, from)?);
        Some((s, over(0)?, over(1)?))
    });
    let Some((scene, all, later)) = found else {
        return Finding::not_run("figure 5 was not run with two loops of 20 frames");
    };
    let passes = at_most(b.fast_motion);
    let tables = [("all loops", all), ("later loops", later)].map(Table::single);
    let (verdict, near) =
        by_times(tables.each_ref(), |[all, later]| graded(all.all(&passes), later.all(&passes)));
    let mut why = format!("{later:.2} after the first loop{near}");
    if let Some((middle, slow)) = sum(scene, 100, SPEED_STRATEGY, 0).zip(sum(scene, 500, SPEED_STRATEGY, 0)) {
        why += &format!("; frames of the loop of 100 take {:.2} of those of 500", middle / slow);
    }
    Finding(format!("{} {all:.2}", scene.facts.label), verdict, why)
}
