//! What each claim comes to.

use super::bounds::Bounds;
use super::ratios::{
    REFIT, ROTATE, at_least, at_most, frame_time, median_frame_time, other_views, update_time, worst_cost,
};
use super::table::{Table, by_times, graded};
use super::{Finding, Rule, Verdict};
use crate::reproduce::contestants::{IDEAL, IDEAL_PARALLEL_BINNED};
use crate::reproduce::offline;
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};
use crate::reproduce::{BLENDED, MUSEUM};

/// Scenes that deform extensively, by the paper (section 3); the museum, its exception, is judged
/// apart.
const DEFORMING: [&str; 3] = ["exploding-dragon", "lion", "n-body"];
/// Scenes that deform a little (section 3).
const GENTLE: [&str; 2] = ["cloth-ball", "fairy-forest"];
/// Scenes of triangles of all sizes and shapes, and such as come from a scanner.
const HETEROGENEOUS: [&str; 2] = ["bart-museum", "fairy-forest"];
const SCANNED: [&str; 2] = ["exploding-dragon", "lion"];

pub(super) fn missing(names: &[&str]) -> Finding {
    Finding::not_run(format!("needs {} with the strategies it compares", names.join(" and ")))
}

pub(super) fn nothing_compared() -> Finding {
    Finding::not_run("no scene that moves was run with all the strategies it compares")
}

pub(super) fn moving(results: &Results) -> impl Iterator<Item = &SceneRun> {
    results.main_scenes().filter(|scene| scene.moves())
}

pub(super) const ROTATION_OVERHEAD: Rule = Rule {
    claim: "Rotations add little to the time of refitting",
    source: "section 3, figure 4",
    paper: "1.6 to 2 times refit",
    rule: "Sum of the update times over refit's. Holds if at most 2.1 in every scene that moves; in part if at most 3 in more than \
           half of them.",
    judge: rotation_overhead,
};

fn rotation_overhead(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, ROTATE, REFIT));
    if table.is_empty() {
        return nothing_compared();
    }
    let (little, great) = (at_most(b.overhead), at_most(b.overhead_in_part));
    let (verdict, near) = by_times([&table], |[t]| graded(t.all(&little), t.most(&great)));
    let mut why = table.scenes_where(&format!("at most {}", b.overhead), &little) + &near;
    if verdict != Verdict::Holds {
        why += &format!(
            "; at most {} in {}; a tree that was never rotated is refitted here in one sweep through \
             memory, which rotated trees cannot use, so that what is compared with is faster than the paper’s refit",
            b.overhead_in_part,
            table.count(great)
        );
    }
    Finding(table.text(), verdict, why)
}

pub(super) const ROTATION_AGAINST_REBUILD: Rule = Rule {
    claim: "An update with rotations costs an order of magnitude less than an ideally parallel rebuild",
    source: "section 3, figure 4",
    paper: "usually about 10 times cheaper",
    rule: "Sum of the update times of ideal-parallel-binned over refit+rotate's. Holds if at least 5 in more than half of the scenes \
           that move; in part if at least 1.05 in as many.",
    judge: rotation_against_rebuild,
};

fn rotation_against_rebuild(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, IDEAL_PARALLEL_BINNED, ROTATE));
    if table.is_empty() {
        return nothing_compared();
    }
    let (large, cheaper) = (at_least(b.magnitude), at_least(b.equal));
    let (verdict, near) = by_times([&table], |[t]| graded(t.most(&large), t.most(&cheaper)));
    let (large, cheaper) = (table.count(large), table.count(cheaper));
    let why = format!(
        "at least {} in {large} and {} in {cheaper} of {} scenes{near}",
        b.magnitude,
        b.equal,
        table.len()
    );
    let views =
        other_views(results, |rebuild| Table::of(moving(results), |s| update_time(s, rebuild, ROTATE)));
    Finding(table.text(), verdict, why + &views)
}

/// Whether something holds in that part of the scenes.
fn in_part_of(part: f64, table: &Table, holds: impl Fn(f64) -> bool) -> bool {
    // The part is rounded.
    table.count(holds) as f64 >= part * table.len() as f64 - 1e-3
}

pub(super) const FRAMES_AGAINST_REFIT: Rule = Rule {
    claim: "With rotations frames are almost always as fast as with refitting, or faster",
    source: "section 3, figure 6a",
    paper: "almost always better",
    rule: "Sum of the frame times over refit's. Holds if at most 1.05 in at least five sixths (\"almost always\") of the \
           scenes that move; in part if in more than half of them.",
    judge: frames_against_refit,
};

fn frames_against_refit(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, REFIT));
    if table.is_empty() {
        return nothing_compared();
    }
    let passes = at_most(b.equal);
    let (verdict, near) =
        by_times([&table], |[t]| graded(in_part_of(b.refit_scenes, t, &passes), t.most(&passes)));
    Finding(table.text(), verdict, table.scenes_where(&format!("at most {}", b.equal), passes) + &near)
}

pub(super) const FRAMES_AGAINST_REBUILD: Rule = Rule {
    claim: "Rotations match or beat even an ideally parallel rebuild, but for the museum",
    source: "section 5",
    paper: "on all but the BART scene",
    rule: "Sum of the frame times over ideal-parallel-binned's. Holds if at most 1.1 (not \"significantly slower\") in every \
           scene that moves other than bart-museum; in part if in more than half of them.",
    judge: frames_against_rebuild,
};

fn frames_against_rebuild(results: &Results, b: &Bounds) -> Finding {
    let others = || moving(results).filter(|s| s.facts.label != MUSEUM);
    let table = Table::of(others(), |s| frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED));
    if table.is_empty() {
        return nothing_compared();
    }
    let passes = at_most(b.matches);
    let (verdict, near) = by_times([&table], |[t]| graded(t.all(&passes), t.most(&passes)));
    let mut why = table.scenes_where(&format!("at most {}", b.matches), passes) + &near;
    if let Some(ratio) = results.scene(MUSEUM).and_then(|s| frame_time(s, ROTATE, IDEAL_PARALLEL_BINNED)) {
        why += &format!("; {ratio:.2} in {MUSEUM}, which the claim leaves out");
    }
    why += &other_views(results, |rebuild| Table::of(others(), |s| frame_time(s, ROTATE, rebuild)));
    Finding(table.text(), verdict, why)
}

pub(super) const FRAMES_AGAINST_IDEAL: Rule = Rule {
    claim: "Never faster than the ideal update, often close to it",
    source: "section 3, figure 6a",
    paper: "never; often fairly close",
    rule: "Sum of the frame times over ideal's. Holds if at least 0.952 (1/1.05) in every scene that moves and at most 1.5 (\"fairly \
           close\") in half of them; in part if one of the two.",
    judge: frames_against_ideal,
};

fn frames_against_ideal(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, IDEAL));
    if table.is_empty() {
        return nothing_compared();
    }
    let above = at_least(1.0 / b.equal);
    let close = |t: &Table| t.count(at_most(b.ideal_close));
    let (verdict, near) = by_times([&table], |[t]| {
        let (never_below, often_close) = (t.all(&above), 2 * close(t) >= t.len());
        graded(never_below && often_close, never_below || often_close)
    });
    let mut why =
        format!("at most {} of ideal in {} of {} scenes", b.ideal_close, close(&table), table.len());
    if !table.all(&above) {
        why += &format!("; below it in {}", table.except(above));
    }
    Finding(table.text(), verdict, why + &near)
}

pub(super) const GENTLE_SCENES: Rule = Rule {
    claim: "Where deformation is slight, rotations track the ideal and the parallel rebuild is slower",
    source: "section 3, figure 6a",
    paper: "cloth ball, fairy forest: very close to ideal",
    rule: "Sum of the frame times on cloth-ball and fairy-forest. Holds if on both at most 1.25 of ideal's, and \
           ideal-parallel-binned's on both at least 1.1 of it (\"significantly slower\"); in part if one of the two.",
    judge: gentle_scenes,
};

fn gentle_scenes(results: &Results, b: &Bounds) -> Finding {
    let chosen: Vec<_> = GENTLE.iter().filter_map(|name| results.scene(name)).collect();
    let of_rebuild = |rebuild| Table::of(chosen.iter().copied(), |s| frame_time(s, rebuild, ROTATE));
    let ideal = Table::of(chosen.iter().copied(), |s| frame_time(s, ROTATE, IDEAL));
    let rebuild = of_rebuild(IDEAL_PARALLEL_BINNED.into());
    if ideal.is_empty() || rebuild.is_empty() {
        return missing(&GENTLE);
    }
    let (close, slower) = (at_most(b.very_close), at_least(b.slower));
    let (verdict, near) = by_times([&ideal, &rebuild], |[ideal, rebuild]| {
        let (tracks, beats) = (ideal.all(&close), rebuild.all(&slower));
        graded(tracks && beats, tracks || beats)
    });
    let ours = format!("over ideal: {}; the rebuild over it: {}", ideal.text(), rebuild.text());
    let why = format!(
        "{} ideal; the ideally parallel rebuild is {}{near}",
        if ideal.all(close) { "within a quarter of" } else { "not within a quarter of" },
        rebuild.scenes_where("slower by a tenth", slower),
    );
    Finding(ours, verdict, why + &only(&chosen, &GENTLE) + &other_views(results, of_rebuild))
}

/// Says which of the scenes a claim names were run, if not all.
fn only(run: &[&SceneRun], named: &[&str]) -> String {
    if run.len() == named.len() {
        return String::new();
    }
    let names: Vec<_> = run.iter().map(|s| s.facts.label.as_str()).collect();
    format!("; of the scenes named only {} was run", names.join(", "))
}

pub(super) const DEFORMING_SCENES: Rule = Rule {
    claim: "Under large deformation the cost of refitting explodes, with rotations it does not",
    source: "section 3, figure 6b",
    paper: "orders of magnitude against far less",
    rule: "Worst SAH cost over that of a fresh sweep build on the same frame, on exploding-dragon, lion and n-body. \
           Holds if 10 or more for refit and below 10 with rotations on each; in part if on one of them.",
    judge: deforming_scenes,
};

fn deforming_scenes(results: &Results, b: &Bounds) -> Finding {
    let chosen: Vec<_> = DEFORMING.iter().filter_map(|name| results.scene(name)).collect();
    let refit = Table::of(chosen.iter().copied(), |s| worst_cost(s, REFIT));
    let rotate = Table::of(chosen.iter().copied(), |s| worst_cost(s, ROTATE));
    if refit.is_empty() || refit.len() != rotate.len() {
        return missing(&DEFORMING);
    }
    let held = refit
        .0
        .iter()
        .zip(&rotate.0)
        .filter(|(refit, rotate)| refit.1 >= b.explodes && rotate.1 < b.explodes)
        .count();
    let ours = format!("refit: {}; with rotations: {}", refit.text(), rotate.text());
    let mut why = format!("so in {held} of {} scenes", refit.len());
    if let Some(blended) = results.scene(BLENDED)
        && let Some((refit, rotate)) = worst_cost(blended, REFIT).zip(worst_cost(blended, ROTATE))
    {
        why += &format!(
            "; {refit:.2} and {rotate:.2} where the dragon's pieces shear and shrink between 16 key frames"
        );
    }
    Finding(ours, graded(held == refit.len(), held > 0), why + &only(&chosen, &DEFORMING))
}

pub(super) const LION: Rule = Rule {
    claim: "On the largest scene even refitting beats the ideally parallel rebuild",
    source: "section 3, lion",
    paper: "refit faster than ideal parallel binned",
    rule: "Sum of the frame times on lion. Holds if ideal-parallel-binned's is at least 1.05 of refit's; in part if it is on half of \
           the frames measured (their median). refit+rotate is judged with the other scenes, above.",
    judge: lion,
};

fn lion(results: &Results, b: &Bounds) -> Finding {
    const NAME: &str = "lion";
    let Some(scene) = results.scene(NAME) else { return missing(&[NAME]) };
    let both = |rebuild| {
        let ratios = [REFIT, ROTATE].map(|name| (name, frame_time(scene, name, rebuild)));
        Table(ratios.into_iter().filter_map(|(name, ratio)| Some((name.to_owned(), ratio?))).collect())
    };
    let [all, median] = [
        frame_time(scene, REFIT, IDEAL_PARALLEL_BINNED),
        median_frame_time(scene, REFIT, IDEAL_PARALLEL_BINNED),
    ];
    let (Some(all), Some(median)) = (all, median) else { return missing(&[NAME]) };
    let faster = |ratio| b.faster(ratio);
    let rotates =
        b.lion_rotates == 0.0 || frame_time(scene, ROTATE, IDEAL_PARALLEL_BINNED).is_some_and(faster);
    let tables = [("refit", all), ("refit on the median frame", median)].map(Table::single);
    let (verdict, near) =
        by_times(tables.each_ref(), |[all, median]| graded(all.all(faster) && rotates, median.all(faster)));
    let table = both(IDEAL_PARALLEL_BINNED.into());
    let ours = format!("{} of the ideally parallel rebuild", table.text());
    let rows = scene.of(REFIT);
    let sum = |time: fn(&Row) -> f64| rows.iter().map(|row| time(row)).sum::<f64>();
    let traced = 100.0 * sum(|row| row.trace_ms) / sum(|row| row.frame_ms);
    let mut why = format!(
        "refit is {}; on the median frame {} ({median:.2}){near}",
        b.in_words(all),
        b.in_words(median)
    );
    if verdict != Verdict::Holds {
        why += &format!("; {traced:.0} % of its frame time is tracing, through a tree that gets worse");
    }
    Finding(ours, verdict, why + &other_views(results, both))
}

pub(super) const SPEEDS: Rule = Rule {
    claim: "The speed of the animation matters little, and loops heal what fast motion does",
    source: "section 3, figure 5",
    paper: "100 and 500 frames a loop alike; 20 worse at first, nearly as good after a few loops",
    rule: "Mean SAH cost with rotations. Holds if 100 frames a loop are within 1.25 of 500 in the last loop, and 20 \
           frames a loop are worse in the first loop and within 1.25 of 500 in the last; in part if one of these.",
    judge: speeds,
};

fn speeds(results: &Results, b: &Bounds) -> Finding {
    /// Mean cost in the first loop and in the last whole one.
    fn ends(scene: &SceneRun, frames: usize) -> Option<(f64, f64)> {
        let speeds = scene.speeds();
        let (_, rows) = speeds.iter().find(|(n, _)| *n == frames)?;
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
    let alike = middle.1 / slow.1 <= b.very_close;
    let heals = fast.0 > slow.0 && fast.1 / slow.1 <= b.very_close;
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
    Finding(ours, graded(alike && heals, alike || heals), why)
}

pub(super) const BELOW_SWEEP: Rule = Rule {
    claim: "Rotations can end below the cost of a fresh sweep build",
    source: "section 4, fairy-forest",
    paper: "a higher quality tree than a sweeping rebuild",
    rule: "SAH cost over a fresh sweep build's on the same frame of fairy-forest. Holds if below 1 on the last \
           frame measured; in part if on any frame after the first.",
    judge: below_sweep,
};

fn below_sweep(results: &Results, _: &Bounds) -> Finding {
    const NAME: &str = "fairy-forest";
    let ratios: Vec<f64> = results
        .scene(NAME)
        .map(|s| s.pairs(ROTATE, IDEAL).iter().skip(1).map(|(a, b)| a.sah_cost / b.sah_cost).collect())
        .unwrap_or_default();
    let (Some(&last), Some(spread)) = (ratios.last(), Spread::of(ratios.iter().copied())) else {
        return missing(&[NAME]);
    };
    let ours = format!("{last:.3} on the last frame, {:.3} at best", spread.min);
    let verdict = graded(last < 1.0, spread.min < 1.0);
    Finding(ours, verdict, format!("the last frame’s tree costs {last:.3} of a fresh one"))
}

pub(super) const CANDIDATES: Rule = Rule {
    claim: "Only nodes with grandchildren can be rotated, a quarter of all",
    source: "section 3",
    paper: "about one quarter",
    rule: "Nodes of the first tree with grandchildren, as a part of all. Holds if between 0.2 and 0.3 in every \
           scene; in part if in more than half.",
    judge: candidates,
};

fn candidates(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(results.main_scenes(), |s| Some(s.facts.candidates));
    if table.is_empty() {
        return Finding::not_run("no scene was run");
    }
    let quarter = |part: f64| (b.quarter_low..=b.quarter_high).contains(&part);
    let verdict = graded(table.all(quarter), table.most(quarter));
    Finding(
        table.text_to(4),
        verdict,
        table.scenes_where(&format!("between {} and {}", b.quarter_low, b.quarter_high), quarter),
    )
}

pub(super) const STABILITY: Rule = Rule {
    claim: "Quality is stable over loops, although the jump from the last frame to the first is large",
    source: "section 3, figure 6b",
    paper: "stable over 2.3 loops",
    rule: "Mean SAH cost with rotations in later loops over that on the same frames of the first. Holds if at most \
           1.1 in every scene that moves; in part if in more than half.",
    judge: stability,
};

fn stability(results: &Results, b: &Bounds) -> Finding {
    let table = Table::of(moving(results), |s| {
        let rows = s.of(ROTATE);
        let later: Vec<_> = rows.iter().filter(|r| r.round > 0).collect();
        let first = |frame| rows.iter().find(|r| r.round == 0 && r.frame == frame);
        let before: f64 = later.iter().filter_map(|r| first(r.frame)).map(|r| r.sah_cost).sum();
        (!later.is_empty()).then(|| later.iter().map(|r| r.sah_cost).sum::<f64>() / before)
    });
    if table.is_empty() {
        return Finding::not_run("needs more than one loop of refit+rotate");
    }
    let stable = at_most(b.stable);
    let verdict = graded(table.all(&stable), table.most(&stable));
    let why = table.scenes_where(&format!("at most {}", b.stable), stable);
    Finding(table.text(), verdict, format!("{why}; {} loops", results.settings.loops))
}

pub(super) const ANNEALING: Rule = Rule {
    claim: "Annealed rotations improve a static tree, where triangles are heterogeneous",
    source: "section 1.1, after Kensler 2008",
    paper: "up to 18 % with path tracing",
    rule: "Time of a path-traced picture of the first frame through the annealed tree over that through the swept one. \
           Holds if at most 0.93 on bart-museum or fairy-forest (heterogeneous), and above that on exploding-dragon and \
           lion (as if scanned), or on the one of them that was measured; in part if the first alone.",
    judge: annealing,
};

fn annealing(results: &Results, b: &Bounds) -> Finding {
    let [climbed, annealed] = offline::OFFLINE;
    let tree = |scene: &'_ SceneRun, name| scene.offline.iter().find(|t| t.builder == name).cloned();
    let ratio =
        |scene: &SceneRun| Some(tree(scene, annealed)?.path_ms / tree(scene, offline::REFERENCE)?.path_ms);
    let of = |names: &[&str]| Table::of(names.iter().filter_map(|name| results.scene(name)), ratio);
    let (mixed, scanned) = (of(&HETEROGENEOUS), of(&SCANNED));
    if mixed.is_empty() {
        return Finding::not_run("annealed trees were not built, or not for bart-museum or fairy-forest");
    }
    let gains = at_most(b.annealed);
    let (verdict, near) = by_times([&mixed, &scanned], |[mixed, scanned]| {
        let gained = mixed.count(&gains) > 0;
        graded(gained && !scanned.is_empty() && scanned.count(&gains) == 0, gained)
    });
    let ours = [&mixed, &scanned]
        .into_iter()
        .filter(|t| !t.is_empty())
        .map(Table::text)
        .collect::<Vec<_>>()
        .join("; ");
    let best = mixed.0.iter().map(|(_, ratio)| 100.0 * (ratio - 1.0)).fold(f64::INFINITY, f64::min).round();
    let mut why = match best {
        ..0.0 => format!("gains {:.0} % at best on heterogeneous scenes", -best),
        0.0 => "gains nothing on heterogeneous scenes".to_owned(),
        _ => format!("loses {best:.0} % or more on heterogeneous scenes"),
    } + &near;
    let not_measured = SCANNED.iter().filter(|name| scanned.0.iter().all(|(label, _)| label != *name));
    let not_measured: Vec<_> = not_measured.copied().collect();
    if !not_measured.is_empty() {
        why += &format!("; not measured on {}", not_measured.join(" and "));
    }
    let in_vain = |scene: &&SceneRun| {
        let cost = |name| tree(scene, name).map(|t| t.sah_cost);
        cost(annealed).zip(cost(climbed)).is_some_and(|(annealed, climbed)| annealed >= climbed)
    };
    let in_vain: Vec<_> = results.main_scenes().filter(in_vain).map(|s| s.facts.label.as_str()).collect();
    if !in_vain.is_empty() {
        why += &format!("; on {} annealing found nothing beyond plain climbing", in_vain.join(", "));
    }
    Finding(ours, verdict, why)
}
