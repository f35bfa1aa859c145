//! A run in brief: `summary.json` for programs, a few lines for the terminal.
//!
//! The schema is described in `docs/RESULTS.md`; a change that could break a reader raises
//! [`SCHEMA`].

use serde::{Deserialize, Serialize};

use super::chart::count;
use super::check::Checks;
use super::claims::Claim;
use super::contestants::{Contestant, IDEAL};
use super::record::{Row, mean_frame_ms, mean_update_ms};
use super::results::{Results, SceneRun, Spread};
use super::stages::{StageSummary, stages};
use super::{SPEED_STRATEGY, SPEEDS, accuracy};

/// Version of the schema.
pub(crate) const SCHEMA: u32 = 3;

/// A run in brief.
#[derive(Serialize)]
pub(crate) struct Summary<'a> {
    schema: u32,
    #[serde(flatten)]
    results: &'a Results,
    checks: Checks,
    claims: &'a [Claim],
}

impl<'a> Summary<'a> {
    pub(crate) fn new(results: &'a Results, claims: &'a [Claim]) -> Self {
        Self { schema: SCHEMA, results, checks: results.checks(), claims }
    }
}

/// A strategy on one scene, over the frames it was measured on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StrategySummary {
    pub(crate) strategy: String,
    /// How its update time comes about, where it is not simply measured.
    pub(crate) accounting: Option<String>,
    pub(crate) samples: usize,
    pub(crate) animate_ms: Spread,
    /// The mean counts updates between the frames measured, too; so does that of `frame_ms`.
    pub(crate) update_ms: Spread,
    pub(crate) trace_ms: Spread,
    pub(crate) frame_ms: Spread,
    pub(crate) sah_cost: Spread,
    /// SAH cost on the last frame.
    pub(crate) last_cost: f64,
    /// SAH cost over that of a fresh sweep build, on the frames that both have.
    pub(crate) sah_over_sweep: Option<Spread>,
    pub(crate) rotations: u64,
    pub(crate) greatest_height: u32,
    /// What it decided, most frequent first; empty if it does the same in every frame.
    pub(crate) decisions: Vec<Decided>,
    /// Time and counters of the stages of a frame, in order.
    pub(crate) stages: Vec<StageSummary>,
}

impl SceneRun {
    /// Sums up the rows of every strategy that was measured.
    pub(crate) fn summarise(&mut self, names: &[String]) {
        let summary = |name: &String| {
            let over = self.pairs(name, IDEAL).into_iter().map(|(a, b)| a.sah_cost / b.sah_cost);
            // A tree whose root has no area costs nothing, and 0 / 0 is no number.
            let over = Spread::of(over.filter(|ratio| ratio.is_finite()));
            let summary = strategy(name, &self.plan, &self.of(name))?;
            Some(StrategySummary { sah_over_sweep: over, decisions: decisions(self, name), ..summary })
        };
        self.strategies = names.iter().filter_map(summary).collect();
        let rows = |frames| self.at_speed(frames, SPEED_STRATEGY);
        let at = |frames| Some((frames, strategy(SPEED_STRATEGY, &self.plan, &rows(frames))?));
        self.speed_summaries = SPEEDS.into_iter().filter_map(at).collect();
    }
}

/// The summary of some rows by themselves.
fn strategy(name: &str, plan: &[String], rows: &[&Row]) -> Option<StrategySummary> {
    let spread = |value: fn(&Row) -> f64| Spread::of(rows.iter().map(|row| value(row)));
    Some(StrategySummary {
        strategy: name.to_owned(),
        accounting: Contestant::from_name(name).ok().and_then(|c| c.accounting()),
        samples: rows.len(),
        animate_ms: spread(|row| row.animate_ms)?,
        update_ms: Spread { mean: mean_update_ms(rows), ..spread(|row| row.update_ms)? },
        trace_ms: spread(|row| row.trace_ms)?,
        frame_ms: Spread { mean: mean_frame_ms(rows), ..spread(|row| row.frame_ms)? },
        sah_cost: spread(|row| row.sah_cost)?,
        last_cost: rows.last()?.sah_cost,
        sah_over_sweep: None,
        rotations: rows.iter().map(|row| row.rotations).sum(),
        greatest_height: rows.iter().map(|row| row.height).max()?,
        decisions: Vec::new(),
        stages: stages(plan, rows),
    })
}

/// Verdicts, and what accuracy costs, as Markdown tables for a document.
pub(crate) fn tables(results: &Results, claims: &[Claim]) -> String {
    let (machine, settings) = (&results.machine, &results.settings);
    let mut text = format!(
        "{}, {} threads, {}, revision {}, preset {}\n\n| claim | in the paper | here | by the bounds written first |\n|---|---|---|---|\n",
        machine.cpu,
        settings.threads,
        machine.started.get(..10).unwrap_or_default(),
        results.revision.short(),
        settings.preset
    );
    text.extend(claims.iter().map(|c| {
        format!("| {} | {} | {} | {} |\n", c.claim, c.paper, c.verdict.words(), c.first_verdict.words())
    }));
    text.extend(accuracy::sections(&results.accuracy).into_iter().map(|section| section.tables));
    text
}

/// What was checked, in one sentence.
pub(crate) fn checks_in_words(checks: &Checks) -> String {
    let [pictures, pixels, rays, hits, trees, differences] =
        [checks.pictures, checks.pixels, checks.rays, checks.rays_hit, checks.trees, checks.differences]
            .map(count);
    if checks.pictures + checks.rays + checks.trees + checks.differences == 0 {
        return "no pictures, rays or trees were compared".to_owned();
    }
    format!(
        "checked: {pictures} pairs of pictures ({pixels} pixels) bit by bit, {rays} rays ({hits} hits) against brute \
         force, {trees} trees validated: {differences} differences"
    )
}

/// A decision, with how often it was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Decided {
    /// In words; where the words hold a number that differs from frame to frame, its range.
    pub(crate) decision: String,
    pub(crate) frames: usize,
    /// The first frame, counted through all loops.
    pub(crate) first: usize,
}

/// What does the same in every frame decides this.
const ALWAYS: &str = "as always";

/// The decisions of a strategy on a scene, most frequent first; none if it does the same in every
/// frame.
fn decisions(scene: &SceneRun, strategy: &str) -> Vec<Decided> {
    // With the least and the greatest number in the place of `#`.
    let mut kinds: Vec<(Decided, [u64; 2])> = Vec::new();
    for row in scene.of(strategy) {
        let (decision, n) = without_number(&row.decision);
        if let Some((kind, [least, most])) = kinds.iter_mut().find(|(kind, _)| kind.decision == decision) {
            kind.frames += 1;
            (*least, *most) = (n.min(*least), n.max(*most));
        } else {
            kinds.push((Decided { decision, frames: 1, first: row.step() }, [n; 2]));
        }
    }
    if kinds.iter().all(|(kind, _)| kind.decision == ALWAYS || kind.decision.is_empty()) {
        return Vec::new();
    }
    kinds.sort_by_key(|(kind, _)| (std::cmp::Reverse(kind.frames), kind.first));
    let with_numbers = |(kind, [least, most]): (Decided, [u64; 2])| {
        let numbers =
            if least == most { count(least) } else { format!("{} to {}", count(least), count(most)) };
        Decided { decision: kind.decision.replace('#', &numbers), ..kind }
    };
    kinds.into_iter().map(with_numbers).collect()
}

/// The words with `#` for the first number in them, and that number.
fn without_number(words: &str) -> (String, u64) {
    let Some(start) = words.find(|c: char| c.is_ascii_digit()) else { return (words.to_owned(), 0) };
    let rest = words[start..].trim_start_matches(|c: char| c.is_ascii_digit());
    let number = &words[start..words.len() - rest.len()];
    (format!("{}#{rest}", &words[..start]), number.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_of_trees_that_cost_nothing_can_be_read() {
        let names = ["refit", IDEAL].map(str::to_owned);
        let of = |cost: f64, frame| {
            names.clone().map(|strategy| Row { strategy, frame, sah_cost: cost, ..Row::default() })
        };
        for (rows, mean) in [(vec![of(0.0, 0)], None), (vec![of(0.0, 0), of(2.0, 1)], Some(1.0))] {
            let mut run = SceneRun { rows: rows.concat(), ..SceneRun::default() };
            run.summarise(&names);
            let read: SceneRun =
                serde_json::from_str(&serde_json::to_string(&run).unwrap()).expect("a summary");
            assert_eq!(read.strategies[0].sah_over_sweep.map(|spread| spread.mean), mean);
        }
    }

    #[test]
    fn like_decisions_are_counted_together() {
        let row = |(frame, decision): (usize, &&str)| Row {
            strategy: "auto".to_owned(),
            frame,
            decision: (*decision).to_owned(),
            ..Row::default()
        };
        let run = |decisions: &[&str]| SceneRun {
            rows: decisions.iter().enumerate().map(row).collect(),
            ..SceneRun::default()
        };
        let decided =
            decisions(&run(&["refit", "regrown above 12 trees: x", "regrown above 4000 trees: x"]), "auto");
        let words = |d: &Decided| format!("{} {} {}", d.decision.replace('\u{202f}', " "), d.frames, d.first);
        assert_eq!(
            decided.iter().map(words).collect::<Vec<_>>(),
            ["regrown above 12 to 4 000 trees: x 2 1", "refit 1 0"]
        );
        assert_eq!(decisions(&run(&[ALWAYS, ALWAYS]), "auto"), []);
        assert_eq!(decisions(&run(&["refit"]), "refit"), []);
    }
}
