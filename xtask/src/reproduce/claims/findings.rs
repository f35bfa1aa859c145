//! What each claim comes to.

use super::table::{Table, most};
use super::{Finding, Verdict};
use crate::pool::PAPER_THREADS;
use crate::reproduce::MUSEUM;
use crate::reproduce::contestants::{IDEAL, IDEAL_PARALLEL_BINNED, PAPER_BINNED};
use crate::reproduce::offline;
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};

pub(super) const REFIT: &str = "refit";
pub(super) const ROTATE: &str = "refit+rotate";
pub(super) const REBUILD: &str = "refit+rotate+rebuild";

/// Times that differ by less count as equal.
pub(super) const NOISE: f64 = 1.05;
/// "Close": within a quarter.
const CLOSE: f64 = 1.25;
/// "An order of magnitude": nearer to ten than to one.
const MAGNITUDE: f64 = 5.0;
/// "1.6 to 2 times", and noise.
const OVERHEAD: f64 = 2.0 * NOISE;
/// Still "little" for most.
const GREAT_OVERHEAD: f64 = 3.0;
/// The least that annealing gains where it gains "up to 18 %": nearer to that than to nothing, with noise.
const ANNEALED: f64 = 0.93;

/// Scenes that deform extensively, by the paper (section 3); the museum, its exception, is judged apart.
const DEFORMING: [&str; 3] = ["exploding-dragon", "lion", "n-body"];
/// Scenes that deform a little (section 3).
const GENTLE: [&str; 2] = ["cloth-ball", "fairy-forest"];
/// Scenes of triangles of all sizes and shapes, and such as come from a scanner.
const HETEROGENEOUS: [&str; 2] = ["bart-museum", "fairy-forest"];
const SCANNED: [&str; 2] = ["exploding-dragon", "lion"];

/// Frame time of `a` over that of `b`: the median over frames that both were measured on, weighted by the time of `b`.
/// Like the ratio of the sums, long frames count for more; but what else the machine does on a few frames does not.
pub(super) fn frame_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    let pairs = scene.pairs(a, b);
    let mut ratios: Vec<_> = pairs.iter().map(|(a, b)| (a.frame_ms / b.frame_ms, b.frame_ms)).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * ratios.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut below = 0.0;
    let reaches_half = |(_, weight): &&(f64, f64)| {
        below += weight;
        below >= half
    };
    ratios.iter().find(reaches_half).map(|(ratio, _)| *ratio)
}

/// The ratio of the sums, where a few frames take long of themselves.
pub(super) fn total_frame_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    let pairs = scene.pairs(a, b);
    let sum = |f: fn(&(&Row, &Row)) -> f64| pairs.iter().map(f).sum::<f64>();
    (!pairs.is_empty()).then(|| sum(|(a, _)| a.frame_ms) / sum(|(_, b)| b.frame_ms))
}

/// Median over frames of the update time of `a` over that of `b`.
fn update_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(a, b).iter().map(|(a, b)| a.update_ms / b.update_ms))?.median)
}

/// SAH cost over that of a fresh sweep build, frame by frame; the worst.
fn worst_cost(scene: &SceneRun, strategy: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(strategy, IDEAL).iter().map(|(a, b)| a.sah_cost / b.sah_cost))?.max)
}

/// SAH cost over the first loop, on average.
pub(super) fn mean_cost(scene: &SceneRun, strategy: &str) -> Option<f64> {
    let first = scene.of(strategy).into_iter().filter(|row| row.round == 0);
    Some(Spread::of(first.map(|row| row.sah_cost))?.mean)
}

/// Beyond noise.
pub(super) fn faster(ratio: f64) -> bool {
    ratio <= 1.0 / NOISE
}

/// Beyond noise.
pub(super) fn slower(ratio: f64) -> bool {
    ratio >= NOISE
}

pub(super) fn missing(names: &[&str]) -> Finding {
    Finding::not_run(format!("needs {} with the strategies it compares", names.join(" and ")))
}

/// One of two conditions makes a part.
pub(super) fn pair_verdict(first: bool, second: bool) -> Verdict {
    match (first, second) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::DoesNotHoldHere,
        _ => Verdict::HoldsInPart,
    }
}

fn moving(results: &Results) -> impl Iterator<Item = &SceneRun> {
    results.main_scenes().filter(|scene| scene.moves())
}

/// The same ratio if rebuilds were as the paper's code had them, and if this side had the paper's threads too.
fn other_views(results: &Results, ratio: impl Fn(&SceneRun, &str) -> Option<f64>) -> String {
    let mut text = String::new();
    let paper = Table::of(moving(results), |s| Some(ratio(s, PAPER_BINNED)? / PAPER_THREADS as f64));
    if paper.len() > 0 {
        text += &format!("; with the paper’s rebuild: {}", paper.text());
    }
    text
}

pub(super) fn rotation_overhead(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, ROTATE, REFIT));
    let Finding(ours, verdict, mut why) = table.at_most(OVERHEAD, usize::MAX);
    let verdict = match verdict {
        Verdict::DoesNotHoldHere if table.count(|r| r <= GREAT_OVERHEAD) >= most(table.len()) => {
            why += &format!("; at most {GREAT_OVERHEAD} in {}", table.count(|r| r <= GREAT_OVERHEAD));
            Verdict::HoldsInPart
        }
        other => other,
    };
    Finding(ours, verdict, why)
}

pub(super) fn rotation_against_rebuild(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, IDEAL_PARALLEL_BINNED, ROTATE));
    if table.len() == 0 {
        return table.at_most(1.0, 0);
    }
    let (large, cheaper) = (table.count(|r| r >= MAGNITUDE), table.count(slower));
    let verdict = if large >= most(table.len()) {
        Verdict::Holds
    } else if cheaper >= most(table.len()) {
        Verdict::HoldsInPart
    } else {
        Verdict::DoesNotHoldHere
    };
    let threads = results.settings.threads;
    let mut why =
        format!("at least {MAGNITUDE} in {large} and above {NOISE} in {cheaper} of {} scenes", table.len());
    why += &table.near(&[MAGNITUDE, NOISE]);
    why += &other_views(results, |s, rebuild| update_time(s, rebuild, ROTATE));
    why += &format!("; the rebuild is granted {PAPER_THREADS} threads, the update had {threads}");
    if threads < PAPER_THREADS {
        let factor = PAPER_THREADS as f64 / threads as f64;
        let projected = Table(table.0.iter().map(|(name, r)| (name.clone(), r * factor)).collect());
        why += &format!("; projection, were the update to scale as well: {}", projected.text());
    }
    Finding(table.text(), verdict, why)
}

pub(super) fn frames_against_refit(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, REFIT));
    table.at_most(NOISE, most(table.len()))
}

pub(super) fn frames_against_rebuild(results: &Results) -> Finding {
    let others = moving(results).filter(|s| s.facts.label != MUSEUM);
    let table = Table::of(others, |s| frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED));
    let Finding(ours, verdict, mut why) = table.at_most(NOISE, most(table.len()));
    let museum = results.scene(MUSEUM).and_then(|s| frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED));
    if let Some(ratio) = museum.filter(|_| table.len() > 0) {
        why += &format!("; bart-museum {ratio:.2}");
    }
    Finding(ours, verdict, why)
}

pub(super) fn frames_against_ideal(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, IDEAL));
    if table.len() == 0 {
        return table.at_most(1.0, 0);
    }
    let above = |ratio: f64| ratio >= 1.0 / NOISE;
    let close = table.count(|ratio| ratio <= CLOSE);
    let mut why = format!("within a quarter of ideal in {close} of {} scenes", table.len());
    if !table.all(above) {
        why += &format!("; below it in {}", table.except(above));
    }
    let verdict = pair_verdict(table.all(above), 2 * close >= table.len());
    Finding(table.text(), verdict, why + &table.near(&[CLOSE, 1.0 / NOISE]))
}

pub(super) fn gentle_scenes(results: &Results) -> Finding {
    let chosen: Vec<_> = GENTLE.iter().filter_map(|name| results.scene(name)).collect();
    let ideal = Table::of(chosen.iter().copied(), |s| frame_time(s, ROTATE, IDEAL));
    let rebuild = Table::of(chosen.iter().copied(), |s| frame_time(s, IDEAL_PARALLEL_BINNED, ROTATE));
    if ideal.len() == 0 || rebuild.len() == 0 {
        return missing(&GENTLE);
    }
    let (is_close, is_slower) = (ideal.all(|r| r <= CLOSE), rebuild.all(slower));
    let ours = format!("over ideal: {}; the rebuild over it: {}", ideal.text(), rebuild.text());
    let why = format!(
        "{} ideal; the ideally parallel rebuild is {}{}{}",
        if is_close { "within a quarter of" } else { "not within a quarter of" },
        if is_slower { "slower on each" } else { "not slower on each" },
        ideal.near(&[CLOSE]),
        rebuild.near(&[NOISE]),
    );
    Finding(ours, pair_verdict(is_close, is_slower), why + &only(&chosen, &GENTLE))
}

/// Says which of the scenes a claim names were run, if not all.
fn only(run: &[&SceneRun], named: &[&str]) -> String {
    if run.len() == named.len() {
        return String::new();
    }
    let names: Vec<_> = run.iter().map(|s| s.facts.label.as_str()).collect();
    format!("; of the scenes named only {} was run", names.join(", "))
}

pub(super) fn deforming_scenes(results: &Results) -> Finding {
    let chosen: Vec<_> = DEFORMING.iter().filter_map(|name| results.scene(name)).collect();
    let refit = Table::of(chosen.iter().copied(), |s| worst_cost(s, REFIT));
    let rotate = Table::of(chosen.iter().copied(), |s| worst_cost(s, ROTATE));
    if refit.len() == 0 || refit.len() != rotate.len() {
        return missing(&DEFORMING);
    }
    let held =
        refit.0.iter().zip(&rotate.0).filter(|(refit, rotate)| refit.1 >= 10.0 && rotate.1 < 10.0).count();
    let verdict = match held {
        n if n == refit.len() => Verdict::Holds,
        0 => Verdict::DoesNotHoldHere,
        _ => Verdict::HoldsInPart,
    };
    let ours = format!("refit: {}; with rotations: {}", refit.text(), rotate.text());
    let why = format!("so in {held} of {} scenes", refit.len());
    Finding(ours, verdict, why + &only(&chosen, &DEFORMING))
}

pub(super) fn lion(results: &Results) -> Finding {
    const NAME: &str = "lion";
    let found = results.scene(NAME).and_then(|s| {
        Some((s, frame_time(s, REFIT, IDEAL_PARALLEL_BINNED)?, frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED)?))
    });
    let Some((scene, refit, rotate)) = found else { return missing(&[NAME]) };
    let ours = format!("refit {refit:.2}, refit+rotate {rotate:.2} of the ideally parallel rebuild");
    let words = |r: f64| {
        if faster(r) {
            "faster"
        } else if slower(r) {
            "slower"
        } else {
            "as fast"
        }
    };
    let mut why = format!(
        "refit is {}, refit+rotate {}; they had {} threads, the rebuild is granted {PAPER_THREADS}",
        words(refit),
        words(rotate),
        results.settings.threads
    );
    // As above, with the slower rebuild's time divided as that of the other is.
    let pairs = scene.pairs(REFIT, PAPER_BINNED);
    let sum = |f: fn(&(&Row, &Row)) -> f64| pairs.iter().map(f).sum::<f64>();
    if !pairs.is_empty() {
        let ratio = sum(|(a, _)| a.frame_ms) / sum(|(_, b)| b.update_ms / PAPER_THREADS as f64 + b.trace_ms);
        why += &format!("; with the paper’s rebuild, refit {ratio:.2}");
    }
    Finding(ours, pair_verdict(faster(refit), faster(rotate)), why)
}

pub(super) fn speeds(results: &Results) -> Finding {
    /// Mean cost in the first loop and in the last whole one.
    fn ends(scene: &SceneRun, frames: usize) -> Option<(f64, f64)> {
        let (_, rows) = scene.speeds.iter().find(|(n, _)| *n == frames)?;
        let measured = |round: usize| rows.iter().filter(|r| r.round == round).count();
        let whole = (0..).take_while(|&round| measured(round) == measured(0).max(1)).count();
        let mean = |round: usize| {
            Spread::of(rows.iter().filter(|r| r.round == round).map(|r| r.sah_cost)).map(|s| s.mean)
        };
        (whole >= 2).then(|| Some((mean(0)?, mean(whole - 1)?)))?
    }
    let found = results
        .scenes
        .iter()
        .find_map(|s| Some((&s.facts.label, ends(s, 20)?, ends(s, 100)?, ends(s, 500)?)));
    let Some((label, fast, middle, slow)) = found else {
        return Finding::not_run(
            "figure 5 was not run with at least two whole loops of 20, 100 and 500 frames",
        );
    };
    let alike = middle.1 / slow.1 <= CLOSE;
    let heals = fast.0 > slow.0 && fast.1 / slow.1 <= CLOSE;
    let ours = format!(
        "{label}, over 500 frames a loop: 100 frames {:.2}; 20 frames {:.2} in the first loop, {:.2} in the last",
        middle.1 / slow.1,
        fast.0 / slow.0,
        fast.1 / slow.1
    );
    let why = format!(
        "100 and 500 are {}; 20 {}",
        if alike { "alike" } else { "not alike" },
        if heals { "catches up" } else { "is not worse at first and nearly as good at last" }
    );
    Finding(ours, pair_verdict(alike, heals), why)
}

pub(super) fn below_sweep(results: &Results) -> Finding {
    const NAME: &str = "fairy-forest";
    let ratios: Vec<f64> = results
        .scene(NAME)
        .map(|s| s.pairs(ROTATE, IDEAL).iter().skip(1).map(|(a, b)| a.sah_cost / b.sah_cost).collect())
        .unwrap_or_default();
    let (Some(&last), Some(spread)) = (ratios.last(), Spread::of(ratios.iter().copied())) else {
        return missing(&[NAME]);
    };
    let verdict = match (last < 1.0, spread.min < 1.0) {
        (true, _) => Verdict::Holds,
        (false, true) => Verdict::HoldsInPart,
        (false, false) => Verdict::DoesNotHoldHere,
    };
    let ours = format!("{last:.3} on the last frame, {:.3} at best", spread.min);
    Finding(ours, verdict, format!("the last frame’s tree costs {last:.3} of a fresh one"))
}

pub(super) fn candidates(results: &Results) -> Finding {
    let table = Table::of(results.main_scenes(), |s| Some(s.facts.candidates));
    if table.len() == 0 {
        return Finding::not_run("no scene was run");
    }
    let quarter = |part: f64| (0.2..=0.3).contains(&part);
    let (verdict, why) = match table.count(quarter) {
        n if n == table.len() => (Verdict::Holds, "between 0.2 and 0.3 in every scene".to_owned()),
        n => {
            let verdict =
                if n >= most(table.len()) { Verdict::HoldsInPart } else { Verdict::DoesNotHoldHere };
            (
                verdict,
                format!("between 0.2 and 0.3 in {n} of {}; not in {}", table.len(), table.except(quarter)),
            )
        }
    };
    Finding(table.text(), verdict, why)
}

pub(super) fn stability(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| {
        let rows = s.of(ROTATE);
        let later: Vec<_> = rows.iter().filter(|r| r.round > 0).collect();
        let first = |frame| rows.iter().find(|r| r.round == 0 && r.frame == frame);
        let before: f64 = later.iter().filter_map(|r| first(r.frame)).map(|r| r.sah_cost).sum();
        (!later.is_empty()).then(|| later.iter().map(|r| r.sah_cost).sum::<f64>() / before)
    });
    if table.len() == 0 {
        return Finding::not_run("needs more than one loop of refit+rotate");
    }
    let Finding(ours, verdict, why) = table.at_most(1.1, most(table.len()));
    Finding(ours, verdict, format!("{why}; {} loops", results.settings.loops))
}

pub(super) fn annealing(results: &Results) -> Finding {
    let ratio = |scene: &SceneRun| {
        let time = |name: &str| scene.offline.iter().find(|t| t.builder == name).map(|t| t.path_ms);
        Some(time("annealed")? / time(offline::REFERENCE)?)
    };
    let of = |names: &[&str]| Table::of(names.iter().filter_map(|name| results.scene(name)), ratio);
    let (mixed, scanned) = (of(&HETEROGENEOUS), of(&SCANNED));
    if mixed.len() == 0 {
        return Finding::not_run("annealed trees were not built, or not for bart-museum or fairy-forest");
    }
    let gains = mixed.count(|r| r <= ANNEALED) > 0;
    let little = scanned.all(|r| r > ANNEALED);
    let verdict = match (gains, little) {
        (true, true) => Verdict::Holds,
        (true, false) => Verdict::HoldsInPart,
        (false, _) => Verdict::DoesNotHoldHere,
    };
    let mut ours = mixed.text();
    if scanned.len() > 0 {
        ours += &format!("; {}", scanned.text());
    }
    let best = mixed.0.iter().map(|(_, r)| 1.0 - r).fold(f64::NEG_INFINITY, f64::max);
    let why = format!("gains {:.0} % at best on heterogeneous scenes", 100.0 * best);
    Finding(ours, verdict, why + &mixed.near(&[ANNEALED]) + &scanned.near(&[ANNEALED]))
}
