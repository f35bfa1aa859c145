//! Two runs laid over each other: what got worse beyond noise.
//!
//! Frames are paired by loop and number. Of their ratios, now over before, the median counts. Times
//! are first divided by the median of these medians over all strategies of the scene, which is how
//! busy the machine was then, since only ratios within a run mean something; a slowdown of all
//! strategies looks the same, so it is listed. SAH costs are compared as they are: they do not
//! depend on the machine.

use maud::{Markup, html};
use serde::Serialize;

use super::chart::number;
use super::claims;
use super::record::Row;
use super::report::{cell, table};
use super::results::{Results, SceneRun, Spread};

/// A time has changed if its ratio is further from 1 than this, and than three standard errors.
const TIME_NOISE: f64 = 0.10;
/// Costs are the same to the last digit, unless the tree is another; differences below this do not
/// matter.
const COST_NOISE: f64 = 0.005;

/// What differs between two runs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    /// Revision and start of the run before.
    pub(crate) before: String,
    /// Times now over those before, all strategies of a scene together.
    pub(crate) machine: Vec<Machine>,
    /// How many pairs of scene, strategy and measure were compared.
    pub(crate) compared: usize,
    pub(crate) changes: Vec<Change>,
    /// Claims with another verdict than before.
    pub(crate) verdicts: Vec<String>,
    /// Scenes that cannot be compared, and why.
    pub(crate) left_out: Vec<String>,
}

/// One measure of one strategy on one scene that changed beyond noise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Change {
    pub(crate) scene: String,
    pub(crate) strategy: String,
    /// `update`, `trace` or `SAH cost`.
    pub(crate) what: &'static str,
    /// Now over before; above 1 is worse.
    pub(crate) ratio: f64,
    /// What counts as noise: this much on either side of 1.
    pub(crate) noise: f64,
}

/// How much longer everything took on a scene than before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Machine {
    pub(crate) scene: String,
    /// `update` or `trace`.
    pub(crate) what: &'static str,
    pub(crate) ratio: f64,
}

type Measure = (&'static str, fn(&Row) -> f64);
const MEASURES: [Measure; 3] =
    [("update", |row| row.update_ms), ("trace", |row| row.trace_ms), (COST, |row| row.sah_cost)];
const COST: &str = "SAH cost";

impl Comparison {
    pub(crate) fn new(before: &Results, now: &Results) -> Self {
        let mut ratios = Vec::new();
        let mut left_out = Vec::new();
        for scene in &now.scenes {
            let label = &scene.facts.label;
            let Some(other) = before.scene(label) else {
                left_out.push(format!("{label}: not in the run before"));
                continue;
            };
            if let Some(what) = different_work((other, before), (scene, now)) {
                left_out.push(format!("{label}: other {what} than before"));
                continue;
            }
            for strategy in &now.settings.strategies {
                ratios.extend(MEASURES.iter().filter_map(|measure| ratio(other, scene, strategy, measure)));
            }
        }
        let mut machine = Vec::new();
        for scene in now.scenes.iter().map(|scene| &scene.facts.label) {
            for what in MEASURES.map(|(what, _)| what).into_iter().filter(|&what| what != COST) {
                let of = |r: &&Change| r.scene == *scene && r.what == what;
                let spread = Spread::of(ratios.iter().filter(of).map(|r| r.ratio));
                machine.extend(spread.map(|s| Machine { scene: scene.clone(), what, ratio: s.median }));
            }
        }
        let compared = ratios.len();
        let mut changes: Vec<Change> = ratios.into_iter().filter_map(|r| r.beyond_noise(&machine)).collect();
        changes.sort_by(|a, b| b.ratio.total_cmp(&a.ratio));
        let (judged_before, judged) = (claims::judge(before), claims::judge(now));
        let verdicts = judged_before.iter().zip(&judged).filter(|(a, b)| a.verdict != b.verdict);
        Self {
            before: format!("{}, {}", before.revision.short(), before.machine.started),
            machine,
            compared,
            changes,
            verdicts: verdicts
                .map(|(a, b)| format!("{}: {}, before {}", b.claim, b.verdict.words(), a.verdict.words()))
                .collect(),
            left_out,
        }
    }

    /// What got worse.
    pub(crate) fn regressions(&self) -> impl Iterator<Item = &Change> {
        self.changes.iter().filter(|change| change.ratio > 1.0)
    }

    /// For the terminal.
    pub(crate) fn in_lines(&self) -> String {
        let mut lines = vec![self.summary()];
        lines.extend(self.regressions().map(|c| format!("{:18}  {}", "regression", c.in_words())));
        lines.extend(self.verdicts.iter().map(|v| format!("{:18}  {v}", "other verdict")));
        lines.join("\n")
    }

    fn summary(&self) -> String {
        let spread = Spread::of(self.machine.iter().map(|machine| machine.ratio));
        let all = spread.map_or_else(String::new, |s| {
            format!(
                "; all strategies of a scene together took {} to {} times as long",
                number(s.min),
                number(s.max)
            )
        });
        format!(
            "{} measures compared with {}: {} worse and {} better beyond noise{all}",
            self.compared,
            self.before,
            self.regressions().count(),
            self.changes.iter().filter(|change| change.ratio < 1.0).count(),
        )
    }

    /// A section of the report.
    pub(crate) fn section(&self) -> Markup {
        html! {
            section id="baseline" {
                h2 { "Beside the run before" }
                p { (self.summary()) "." }
                p.soft {
                    "Medians over pairs of frames, now over before; times divided by what all strategies of \
                     the scene together took. A time has \
                     changed if that is beyond " (format!("{:.0}", 100.0 * TIME_NOISE)) " % and three standard errors, \
                     a cost if beyond " (format!("{:.1}", 100.0 * COST_NOISE)) " %."
                }
                @if !self.changes.is_empty() { (table(&HEADS, 3, self.changes.iter().map(Change::cells))) }
                @for line in self.verdicts.iter().chain(&self.left_out) { p.soft { (line) "." } }
            }
        }
    }
}

const HEADS: [&str; 5] = ["Scene", "Strategy", "What", "Now over before", "Noise"];

impl Change {
    fn cells(&self) -> (Option<&str>, Vec<Markup>) {
        let Self { scene, strategy, what, ratio, noise } = self;
        let class = if *ratio > 1.0 { "worse" } else { "better" };
        let ratio = html! { span class=(class) { (number(*ratio)) } };
        (None, vec![cell(scene), cell(strategy), cell(what), ratio, html! { "± " (number(*noise)) }])
    }

    /// The same relative to how busy the machine was, if it is beyond noise.
    fn beyond_noise(self, machine: &[Machine]) -> Option<Self> {
        let of = |m: &&Machine| (m.scene.as_str(), m.what) == (self.scene.as_str(), self.what);
        let machine = machine.iter().find(of).map_or(1.0, |m| m.ratio);
        let (ratio, noise) = match self.what {
            COST => (self.ratio, COST_NOISE),
            _ => (self.ratio / machine, TIME_NOISE.max(self.noise / machine)),
        };
        // As far below as above: half as much is as great a change as twice as much.
        let is_beyond = ratio > 1.0 + noise || ratio < 1.0 / (1.0 + noise);
        is_beyond.then_some(Self { ratio, noise, ..self })
    }

    fn in_words(&self) -> String {
        let Self { scene, strategy, what, ratio, noise } = self;
        format!("{scene}, {strategy}, {what}: {} times as much, noise {}", number(*ratio), number(*noise))
    }
}

/// Why two runs did not do the same on a scene.
fn different_work(
    (a, before): (&SceneRun, &Results),
    (b, now): (&SceneRun, &Results),
) -> Option<&'static str> {
    [
        ("triangles", a.facts.triangles != b.facts.triangles),
        ("frames a loop", a.facts.frames != b.facts.frames),
        ("image size", before.settings.size != now.settings.size),
        ("number of threads", before.settings.threads != now.settings.threads),
    ]
    .into_iter()
    .find_map(|(what, differs)| differs.then_some(what))
}

/// The median ratio of all frames, with three of its standard errors as noise.
fn ratio(before: &SceneRun, now: &SceneRun, strategy: &str, &(what, value): &Measure) -> Option<Change> {
    let old = before.of(strategy);
    let old = |row: &Row| old.iter().find(|r| (r.round, r.frame) == (row.round, row.frame)).map(|r| value(r));
    let pairs = now.of(strategy).into_iter().filter_map(|row| Some(value(row) / old(row)?));
    let ratios: Vec<f64> = pairs.filter(|r| r.is_finite() && *r > 0.0).collect();
    let ratio = Spread::of(ratios.iter().copied())?.median;
    let deviation = Spread::of(ratios.iter().map(|r| (r - ratio).abs()))?.median;
    // The median's standard error, from the median deviation as if it were normal.
    let error = 1.2533 * 1.4826 * deviation / (ratios.len() as f64).sqrt();
    let (scene, strategy) = (now.facts.label.clone(), strategy.to_owned());
    Some(Change { scene, strategy, what, ratio, noise: 3.0 * error })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::claims::tests::{results, scene};

    #[test]
    fn only_what_is_beyond_noise_and_the_machine_counts() {
        let run = |factor: f64, update: f64, cost: f64| {
            results(vec![scene(
                "n-body",
                &[
                    ("refit", 2.0 * factor, 10.0 * factor, 40.0),
                    ("refit+rotate", update * factor, 12.0 * factor, cost),
                    ("sweep", 9.0 * factor, 8.0 * factor, 30.0),
                ],
            )])
        };
        let before = run(1.0, 3.0, 33.0);
        let same = Comparison::new(&before, &run(1.7, 3.2, 33.1));
        assert_eq!(same.changes, []);
        assert!(same.machine.iter().all(|m| (m.ratio - 1.7).abs() < 1e-9));
        assert_eq!((same.machine.len(), same.compared), (2, 9));
        let worse = Comparison::new(&before, &run(0.5, 4.5, 40.0));
        let named: Vec<_> = worse.regressions().map(|c| (c.strategy.as_str(), c.what)).collect();
        assert_eq!(named, [("refit+rotate", "update"), ("refit+rotate", "SAH cost")]);
        assert!(worse.in_lines().contains("regression          n-body, refit+rotate, update: 1.50 times"));
        let better = Comparison::new(&run(1.0, 4.5, 33.0), &before);
        assert!(better.regressions().next().is_none() && better.changes.len() == 1);
    }

    #[test]
    fn other_work_is_not_compared() {
        let refit = [("refit", 1.0, 1.0, 9.0)];
        let (before, mut now) = (results(vec![scene("lion", &refit)]), results(vec![scene("lion", &refit)]));
        now.scenes[0].facts.triangles += 1;
        let comparison = Comparison::new(&before, &now);
        assert_eq!((comparison.compared, comparison.left_out.len()), (0, 1));
        assert!(comparison.left_out[0].contains("triangles"));
    }
}
