//! What each claim comes to.

use super::table::{Table, most};
use super::{Finding, Verdict};
use crate::reproduce::contestants::{IDEAL, IDEAL_PARALLEL_BINNED};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};

const REFIT: &str = "refit";
const ROTATE: &str = "refit+rotate";

/// Times that differ by less count as equal.
const NOISE: f64 = 1.02;
/// "Close": within a quarter.
const CLOSE: f64 = 1.25;
/// "An order of magnitude": nearer to ten than to one.
const MAGNITUDE: f64 = 5.0;

/// Scenes that deform extensively, by the paper (section 3); the museum, its exception, is judged apart.
const DEFORMING: [&str; 3] = ["exploding-dragon", "lion", "n-body"];
/// Scenes that deform a little (section 3).
const GENTLE: [&str; 2] = ["cloth-ball", "fairy-forest"];

/// Total frame time of `a` over that of `b`, on frames that both were measured on.
fn frame_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    let pairs = scene.pairs(a, b);
    let sum = |f: fn(&(&Row, &Row)) -> f64| pairs.iter().map(f).sum::<f64>();
    (!pairs.is_empty()).then(|| sum(|(a, _)| a.frame_ms) / sum(|(_, b)| b.frame_ms))
}

/// Median over frames of the update time of `a` over that of `b`.
fn update_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(a, b).iter().map(|(a, b)| a.update_ms / b.update_ms))?.median)
}

/// SAH cost over that of a fresh sweep build, frame by frame; `worst` of it.
fn worst_cost(scene: &SceneRun, strategy: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(strategy, IDEAL).iter().map(|(a, b)| a.sah_cost / b.sah_cost))?.max)
}

fn missing(names: &[&str]) -> Finding {
    Finding::not_tested(format!("needs {} with the strategies it compares", names.join(" and ")))
}

/// One of two conditions makes a part.
fn both(first: bool, second: bool) -> Verdict {
    match (first, second) {
        (true, true) => Verdict::Holds,
        (false, false) => Verdict::DoesNotHoldHere,
        _ => Verdict::HoldsInPart,
    }
}

fn moving(results: &Results) -> impl Iterator<Item = &SceneRun> {
    results.scenes.iter().filter(|scene| scene.moves())
}

pub(super) fn rotation_overhead(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, ROTATE, REFIT));
    table.finding("at most 2", |ratio| ratio <= 2.0, table.len().div_ceil(2))
}

pub(super) fn rotation_against_rebuild(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, IDEAL_PARALLEL_BINNED, ROTATE));
    if table.len() == 0 {
        return table.finding("", |_| true, 0);
    }
    let (large, cheaper) = (table.count(|r| r >= MAGNITUDE), table.count(|r| r > 1.0));
    let verdict = if large >= most(table.len()) {
        Verdict::Holds
    } else if cheaper >= most(table.len()) {
        Verdict::HoldsInPart
    } else {
        Verdict::DoesNotHoldHere
    };
    let why = format!(
        "at least {MAGNITUDE} in {large} and above 1 in {cheaper} of {} scenes; the rebuild is granted 8 threads, the \
         update had {}",
        table.len(),
        results.settings.threads
    );
    Finding(table.text(), verdict, why)
}

pub(super) fn frames_against_refit(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, REFIT));
    table.finding("at or below refit", |ratio| ratio <= NOISE, most(table.len()))
}

pub(super) fn frames_against_ideal(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, IDEAL));
    if table.len() == 0 {
        return table.finding("", |_| true, 0);
    }
    let above = |ratio: f64| ratio >= 1.0 / NOISE;
    let close = table.count(|ratio| ratio <= CLOSE);
    let never_below = table.count(above) == table.len();
    let mut why = format!("within a quarter of ideal in {close} of {} scenes", table.len());
    if !never_below {
        why += &format!("; below it in {}", table.except(above));
    }
    Finding(table.text(), both(never_below, 2 * close >= table.len()), why)
}

pub(super) fn gentle_scenes(results: &Results) -> Finding {
    let chosen: Vec<_> = GENTLE.iter().filter_map(|name| results.scene(name)).collect();
    let ideal = Table::of(chosen.iter().copied(), |s| frame_time(s, ROTATE, IDEAL));
    let rebuild = Table::of(chosen.iter().copied(), |s| frame_time(s, IDEAL_PARALLEL_BINNED, ROTATE));
    if ideal.len() == 0 || rebuild.len() == 0 {
        return missing(&GENTLE);
    }
    let close = ideal.count(|r| r <= CLOSE) == ideal.len();
    let slower = rebuild.count(|r| r > 1.0) == rebuild.len();
    let ours = format!("over ideal: {}; the rebuild over it: {}", ideal.text(), rebuild.text());
    let why = format!(
        "{} ideal; the ideally parallel rebuild is {}",
        if close { "within a quarter of" } else { "not within a quarter of" },
        if slower { "slower on each" } else { "not slower on each" },
    );
    Finding(ours, both(close, slower), why + &only(&chosen, &GENTLE))
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

pub(super) fn museum(results: &Results) -> Finding {
    const NAME: &str = "bart-museum";
    let found = results
        .scene(NAME)
        .and_then(|s| Some((frame_time(s, ROTATE, REFIT)?, frame_time(s, ROTATE, "binned")?)));
    let Some((refit, binned)) = found else { return missing(&[NAME]) };
    let ours = format!("{refit:.2} of refit, {binned:.2} of a serial binned rebuild");
    let words = |r: f64| if r < 1.0 { "faster" } else { "slower" };
    let why = format!("{} than refit, {} than the serial rebuild", words(refit), words(binned));
    Finding(ours, both(refit < 1.0, binned > 1.0), why)
}

pub(super) fn lion(results: &Results) -> Finding {
    const NAME: &str = "lion";
    let found = results.scene(NAME).and_then(|s| {
        Some((frame_time(s, REFIT, IDEAL_PARALLEL_BINNED)?, frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED)?))
    });
    let Some((refit, rotate)) = found else { return missing(&[NAME]) };
    let ours = format!("refit {refit:.2}, refit+rotate {rotate:.2} of the ideally parallel rebuild");
    let words = |r: f64| if r < 1.0 { "faster" } else { "slower" };
    let why = format!(
        "refit is {}, refit+rotate {}; they had {} threads, the rebuild is granted 8",
        words(refit),
        words(rotate),
        results.settings.threads
    );
    Finding(ours, both(refit < 1.0, rotate < 1.0), why)
}

pub(super) fn speeds(results: &Results) -> Finding {
    /// Mean cost in the first loop and in the last whole one.
    fn ends(scene: &SceneRun, frames: usize) -> Option<(f64, f64)> {
        let (_, rows) = scene.speeds.iter().find(|(n, _)| *n == frames)?;
        let whole = rows.len() / frames;
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
        return Finding::not_tested(
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
    Finding(ours, both(alike, heals), why)
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
    Finding(ours, verdict, format!("the last frame's tree costs {last:.3} of a fresh one"))
}

pub(super) fn candidates(results: &Results) -> Finding {
    let table = Table::of(&results.scenes, |s| Some(s.facts.candidates));
    table.finding("between 0.2 and 0.3", |part| (0.2..=0.3).contains(&part), most(table.len()))
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
        return Finding::not_tested("needs more than one loop of refit+rotate");
    }
    table.finding("at most 1.1", |ratio| ratio <= 1.1, most(table.len()))
}
