//! The paper's claims, each judged by a stated rule from what was measured.
//!
//! Update times are compared frame by frame (the median of the ratios, which a busy machine disturbs least), frame
//! times as sums over the frames that both strategies were measured on.

use serde::Serialize;

use super::contestants::{IDEAL, IDEAL_PARALLEL_BINNED};
use super::results::{Results, SceneRun, Spread};

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

/// A claim with what was found.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Claim {
    pub(crate) claim: &'static str,
    /// Where the paper makes it.
    pub(crate) source: &'static str,
    /// The paper's figure.
    pub(crate) paper: &'static str,
    /// What was measured, scene by scene.
    pub(crate) ours: String,
    pub(crate) verdict: Verdict,
    /// When it holds, and when in part.
    pub(crate) rule: &'static str,
    /// What decided, or why nothing could.
    pub(crate) why: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Verdict {
    Holds,
    HoldsInPart,
    DoesNotHoldHere,
    NotTested,
}

impl Verdict {
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::HoldsInPart => "holds in part",
            Self::DoesNotHoldHere => "does not hold here",
            Self::NotTested => "not tested",
        }
    }
}

/// What a claim comes to: ours, verdict, why.
struct Finding(String, Verdict, String);

impl Finding {
    fn not_tested(why: impl Into<String>) -> Self {
        Self("–".to_owned(), Verdict::NotTested, why.into())
    }
}

/// All claims, in the paper's order.
pub(crate) fn judge(results: &Results) -> Vec<Claim> {
    let claim = |claim, source, paper, rule, Finding(ours, verdict, why)| Claim {
        claim,
        source,
        paper,
        ours,
        verdict,
        rule,
        why,
    };
    vec![
        claim(
            "Rotations add little to the time of refitting",
            "section 3, figure 4",
            "1.6 to 2 times refit",
            "Update time over refit's, median over frames. Holds if at most 2 in every scene that moves; in part if \
             in at least half of them.",
            rotation_overhead(results),
        ),
        claim(
            "An update with rotations costs an order of magnitude less than an ideally parallel rebuild",
            "section 3, figure 4",
            "usually about 10 times cheaper",
            "Update time of ideal-parallel-binned over refit+rotate's, median over frames. Holds if at least 5 in more \
             than half of the scenes that move; in part if above 1 in as many.",
            rotation_against_rebuild(results),
        ),
        claim(
            "With rotations frames are as fast as with refitting, or faster",
            "section 3, figure 6a",
            "almost always better",
            "Total frame time over refit's. Holds if at most 1.02 in every scene; in part if in more than half.",
            frames_against_refit(results),
        ),
        claim(
            "Never faster than the ideal update, often close to it",
            "section 3, figure 6a",
            "never; often fairly close",
            "Total frame time over ideal's. Holds if at least 0.98 in every scene and at most 1.25 in half of them; in \
             part if one of the two.",
            frames_against_ideal(results),
        ),
        claim(
            "Where deformation is slight, rotations track the ideal and the parallel rebuild is slower",
            "section 3, figure 6a",
            "cloth ball, fairy forest: very close to ideal",
            "Total frame time on cloth-ball and fairy-forest. Holds if within 1.25 of ideal and below \
             ideal-parallel-binned on each; in part if one of the two on each.",
            gentle_scenes(results),
        ),
        claim(
            "Under large deformation the cost of refitting explodes, with rotations it does not",
            "section 3, figure 6b",
            "orders of magnitude against far less",
            "Worst SAH cost over that of a fresh sweep build on the same frame, on exploding-dragon, lion and n-body. \
             Holds if 10 or more for refit and below 10 with rotations on each; in part if on one of them.",
            deforming_scenes(results),
        ),
        claim(
            "In utter chaos rotations beat refitting but lose to rebuilding, even serially",
            "section 3, bart-museum",
            "better than refit, worse than a serial binned rebuild",
            "Total frame time on bart-museum. Holds if below refit's and above binned's; in part if one of the two.",
            museum(results),
        ),
        claim(
            "On the largest scene even refitting beats the ideally parallel rebuild",
            "section 3, lion",
            "refit faster than ideal parallel binned",
            "Total frame time on lion. Holds if refit and refit+rotate are both below ideal-parallel-binned; in part \
             if one of them.",
            lion(results),
        ),
        claim(
            "The speed of the animation matters little, and loops heal what fast motion does",
            "section 3, figure 5",
            "100 and 500 frames a loop alike; 20 worse at first, nearly as good after a few loops",
            "Mean SAH cost with rotations. Holds if 100 frames a loop are within 1.25 of 500 in the last loop, and 20 \
             frames a loop are worse in the first loop and within 1.25 of 500 in the last; in part if one of these.",
            speeds(results),
        ),
        claim(
            "Rotations can end below the cost of a fresh sweep build",
            "section 4, fairy-forest",
            "a higher quality tree than a sweeping rebuild",
            "SAH cost over a fresh sweep build's on the same frame of fairy-forest. Holds if below 1 on the last \
             frame measured; in part if on any frame after the first.",
            below_sweep(results),
        ),
        claim(
            "Only nodes with grandchildren can be rotated, a quarter of all",
            "section 3",
            "about one quarter",
            "Nodes of the first tree with grandchildren, as a part of all. Holds if between 0.2 and 0.3 in every \
             scene; in part if in more than half.",
            candidates(results),
        ),
        claim(
            "Quality is stable over loops, although the jump from the last frame to the first is large",
            "section 3, figure 6b",
            "stable over 2.3 loops",
            "Mean SAH cost with rotations in later loops over that on the same frames of the first. Holds if at most \
             1.1 in every scene that moves; in part if in more than half.",
            stability(results),
        ),
        claim(
            "Rotating at random, annealed, improves a static tree",
            "section 1.1, after Kensler 2008",
            "up to 18 % with path tracing",
            "Not decided by these runs.",
            Finding::not_tested("the runs hold no annealed builder and no path tracing"),
        ),
    ]
}

/// Total frame time of `a` over that of `b`, on frames that both were measured on.
fn frame_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    let pairs = scene.pairs(a, b);
    let sum = |f: fn(&(&super::record::Row, &super::record::Row)) -> f64| pairs.iter().map(f).sum::<f64>();
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

/// Values by scene.
struct Table(Vec<(String, f64)>);

impl Table {
    fn of<'a>(
        scenes: impl IntoIterator<Item = &'a SceneRun>,
        value: impl Fn(&SceneRun) -> Option<f64>,
    ) -> Self {
        let rows = scenes.into_iter().filter_map(|s| Some((s.facts.label.clone(), value(s)?)));
        Self(rows.filter(|(_, v)| v.is_finite()).collect())
    }

    fn len(&self) -> usize {
        self.0.len()
    }

    fn count(&self, holds: impl Fn(f64) -> bool) -> usize {
        self.0.iter().filter(|(_, v)| holds(*v)).count()
    }

    fn text(&self) -> String {
        self.0.iter().map(|(name, v)| format!("{name} {v:.2}")).collect::<Vec<_>>().join(", ")
    }

    /// Names of those for which `holds` is false.
    fn except(&self, holds: impl Fn(f64) -> bool) -> String {
        let names = self.0.iter().filter(|(_, v)| !holds(*v)).map(|(name, _)| name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }

    /// A finding where each scene passes or not: holds in all; in part in at least `part` of them.
    fn finding(&self, what: &str, passes: impl Fn(f64) -> bool + Copy, part: usize) -> Finding {
        let (all, passed) = (self.len(), self.count(passes));
        if all == 0 {
            return Finding::not_tested("no scene that moves was run with all the strategies it compares");
        }
        let (verdict, why) = if passed == all {
            (Verdict::Holds, format!("{what} in {}", if all == 1 { "the only scene" } else { "every scene" }))
        } else {
            let verdict = if passed >= part { Verdict::HoldsInPart } else { Verdict::DoesNotHoldHere };
            (verdict, format!("{what} in {passed} of {all} scenes; not in {}", self.except(passes)))
        };
        Finding(self.text(), verdict, why)
    }
}

/// More than half of `n`.
fn most(n: usize) -> usize {
    n / 2 + 1
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

fn rotation_overhead(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| update_time(s, ROTATE, REFIT));
    table.finding("at most 2", |ratio| ratio <= 2.0, table.len().div_ceil(2))
}

fn rotation_against_rebuild(results: &Results) -> Finding {
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

fn frames_against_refit(results: &Results) -> Finding {
    let table = Table::of(moving(results), |s| frame_time(s, ROTATE, REFIT));
    table.finding("at or below refit", |ratio| ratio <= NOISE, most(table.len()))
}

fn frames_against_ideal(results: &Results) -> Finding {
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

fn gentle_scenes(results: &Results) -> Finding {
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

fn deforming_scenes(results: &Results) -> Finding {
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

fn museum(results: &Results) -> Finding {
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

fn lion(results: &Results) -> Finding {
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

fn speeds(results: &Results) -> Finding {
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

fn below_sweep(results: &Results) -> Finding {
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

fn candidates(results: &Results) -> Finding {
    let table = Table::of(&results.scenes, |s| Some(s.facts.candidates));
    table.finding("between 0.2 and 0.3", |part| (0.2..=0.3).contains(&part), most(table.len()))
}

fn stability(results: &Results) -> Finding {
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

#[cfg(test)]
mod tests {
    use super::super::check::Checks;
    use super::super::record::Row;
    use super::super::results::{SceneFacts, Settings};
    use super::*;
    use crate::machine::{Machine, Revision};

    /// Three frames of a scene: update time, trace time and cost of each strategy.
    fn scene(label: &str, strategies: &[(&'static str, f64, f64, f64)]) -> SceneRun {
        let row =
            |frame: usize, &(strategy, update_ms, trace_ms, sah_cost): &(&'static str, f64, f64, f64)| Row {
                scene: label.to_owned(),
                strategy,
                threads: 2,
                round: frame / 2,
                frame: frame % 2,
                animate_ms: 0.0,
                update_ms,
                trace_ms,
                frame_ms: update_ms + trace_ms,
                sah_cost,
                rotations: 0,
                height: 9,
                nodes_visited: 0,
                rays_primary: 0,
                rays_shadow: 0,
                hits: 0,
                dropped: 0,
                frames_per_loop: 2,
                time_s: 0.0,
            };
        SceneRun {
            facts: SceneFacts {
                label: label.to_owned(),
                slug: label.to_owned(),
                about: String::new(),
                triangles: 10,
                moving: 10,
                effects: Vec::new(),
                frames: 2,
                rebuild_every: 1,
                build_ms: 1.0,
                candidates: 0.25,
                notes: Vec::new(),
            },
            pictures: Vec::new(),
            rows: (0..3).flat_map(|frame| strategies.iter().map(move |s| row(frame, s))).collect(),
            speeds: Vec::new(),
            checks: Checks::default(),
        }
    }

    fn results(scenes: Vec<SceneRun>) -> Results {
        let settings = Settings {
            preset: "quick",
            experiments: Vec::new(),
            strategies: Vec::new(),
            loops: 1.5,
            size: 1,
            threads: 2,
            seed: 0,
            reductions: Vec::new(),
            command: String::new(),
        };
        let (machine, revision) = (Machine::read(), Revision::read());
        Results { machine, revision, settings, scenes, interrupted: false }
    }

    fn verdict(results: &Results, words: &str) -> Verdict {
        let claims = judge(results);
        claims.iter().find(|c| c.claim.contains(words)).expect("a claim").verdict
    }

    #[test]
    fn what_the_paper_saw_holds() {
        let all = results(vec![
            scene(
                "n-body",
                &[
                    ("refit", 1.0, 50.0, 500.0),
                    ("refit+rotate", 1.8, 12.0, 60.0),
                    ("ideal", 0.0, 11.0, 40.0),
                    ("ideal-parallel-binned", 18.0, 11.5, 42.0),
                ],
            ),
            scene(
                "fairy-forest",
                &[
                    ("refit", 1.0, 10.5, 31.0),
                    ("refit+rotate", 1.8, 9.0, 29.0),
                    ("ideal", 0.0, 10.0, 30.0),
                    ("ideal-parallel-binned", 20.0, 10.0, 30.0),
                ],
            ),
        ]);
        for words in [
            "add little",
            "order of magnitude",
            "as fast as with refitting",
            "Never faster",
            "slight",
            "explodes",
            "below the cost of a fresh",
            "a quarter of all",
            "stable over loops",
        ] {
            assert_eq!(verdict(&all, words), Verdict::Holds, "{words}");
        }
        for words in ["utter chaos", "largest scene", "speed of the animation", "annealed"] {
            assert_eq!(verdict(&all, words), Verdict::NotTested, "{words}");
        }
    }

    #[test]
    fn the_contrary_does_not() {
        let all = results(vec![
            scene(
                "lion",
                &[
                    ("refit", 1.0, 10.0, 30.0),
                    ("refit+rotate", 3.0, 12.0, 600.0),
                    ("ideal", 0.0, 20.0, 30.0),
                    ("ideal-parallel-binned", 0.5, 2.0, 30.0),
                ],
            ),
            scene(
                "bart-museum",
                &[("refit", 1.0, 1.0, 9.0), ("refit+rotate", 2.0, 1.0, 9.0), ("binned", 9.0, 1.0, 9.0)],
            ),
        ]);
        for words in
            ["order of magnitude", "as fast as with refitting", "explodes", "largest scene", "utter chaos"]
        {
            assert_eq!(verdict(&all, words), Verdict::DoesNotHoldHere, "{words}");
        }
        assert_eq!(verdict(&all, "add little"), Verdict::HoldsInPart, "in one of two scenes");
        assert_eq!(verdict(&all, "Never faster"), Verdict::HoldsInPart, "close, but below");
    }

    #[test]
    fn nothing_measured_decides_nothing() {
        assert!(judge(&results(Vec::new())).iter().all(|c| c.verdict == Verdict::NotTested));
        let still = SceneRun { facts: SceneFacts { moving: 0, ..scene("x", &[]).facts }, ..scene("x", &[]) };
        assert_eq!(verdict(&results(vec![still]), "add little"), Verdict::NotTested);
    }
}
