//! The results of an earlier run, read back from their folder: to draw the report again, to go on
//! after an interrupt, to compare with.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::check::Checks;
use super::contestants::plays_alone;
use super::journal::read;
use super::record::Row;
use super::results::{Results, SceneRun, Settings};
use super::speed_strategies;
use super::summary::{SCHEMA, StrategySummary};
use crate::compare::Row as Peer;
use crate::files;

/// What a folder holds: the scenes it knows all about, and rows of figures 4 and 6, and of figure
/// 5, of one that was under way.
pub(super) struct Saved {
    pub(super) results: Results,
    rest: [Vec<Row>; 2],
}

/// Reads a folder.
pub(super) fn load(folder: &Path) -> Result<Saved> {
    let path = folder.join("summary.json");
    let shown = path.display();
    let text = fs::read(&path)
        .with_context(|| format!("{shown}: cannot be read; name a folder that `reproduce` has written"))?;
    let summary: Value = serde_json::from_slice(&text).with_context(|| format!("{shown}: no summary"))?;
    let schema = summary.get("schema").with_context(|| format!("{shown}: no summary"))?;
    ensure!(*schema == SCHEMA, "{shown}: schema {schema}, but this program reads {SCHEMA}; measure again");
    let mut results: Results =
        serde_json::from_value(summary).with_context(|| format!("{shown}: not what schema {SCHEMA} says"))?;
    let [frames, speeds, accuracy, beside] =
        ["frames.csv", "fig5.csv", "accuracy.csv", "peers.csv"].map(|name| folder.join(name));
    results.accuracy = read(&accuracy)?;
    let mut rest = [read(&frames)?, read(&speeds)?];
    let mut peers = read::<Peer>(&beside)?;
    for run in &mut results.scenes {
        let images = folder.join("images");
        if !images.exists() {
            // Published without them.
            run.pictures.clear();
        }
        for picture in &mut run.pictures {
            picture.bytes = files::read(&images.join(&picture.file))?;
        }
        let label = run.facts.label.as_str();
        run.peers = peers.extract_if(.., |peer| peer.scene == label).collect();
        [run.rows, run.speed_rows] = take(&mut rest, label);
        if run.facts.finished {
            for StrategySummary { strategy, samples, .. } in &run.strategies {
                ensure_rows(&frames, label, run.of(strategy).len(), *samples)?;
            }
            for (&n, StrategySummary { samples, .. }) in &run.speed_summaries {
                // The summary has the samples of one strategy; the others have as many.
                let found = run.speed_rows.iter().filter(|row| row.frames_per_loop == n).count();
                ensure_rows(&speeds, label, found, samples * speed_strategies(n).len())?;
            }
            let points = results.accuracy.iter().filter(|point| point.scene == label).count();
            let facts = &run.facts;
            for (file, found, counted) in
                [(&accuracy, points, facts.accuracy_rows), (&beside, run.peers.len(), facts.peer_rows)]
            {
                ensure_rows(file, label, found, if counted > 0 { counted } else { found })?;
            }
        }
        run.summarise(&results.settings.strategies);
    }
    Ok(Saved { results, rest })
}

/// Checks that no rows are missing of a scene that counts as finished.
fn ensure_rows(file: &Path, label: &str, found: usize, expected: usize) -> Result<()> {
    ensure!(
        found == expected,
        "{}: {found} rows of {label} where summary.json counted {expected}; measure again",
        file.display()
    );
    Ok(())
}

fn take(rows: &mut [Vec<Row>; 2], label: &str) -> [Vec<Row>; 2] {
    rows.each_mut().map(|rows| rows.extract_if(.., |row| row.scene == label).collect())
}

impl Saved {
    /// What was measured on a scene: all, or else rows without those of an incomplete last step,
    /// and what was compared. A step of the strategies that take turns has as many rows as the
    /// first, at most `strategies`; of figure 5 those of [`speed_strategies`].
    pub(super) fn scene(&mut self, label: &str, strategies: usize) -> SceneRun {
        let at = self.results.scenes.iter().position(|run| run.facts.label == label);
        let run = at.map(|at| self.results.scenes.remove(at)).unwrap_or_else(|| {
            let [rows, speed_rows] = take(&mut self.rest, label);
            SceneRun { rows, speed_rows, ..SceneRun::default() }
        });
        if run.facts.finished {
            return run;
        }
        let rows_a_step = rows_of_first_step(&run.rows).unwrap_or(strategies);
        let rows = whole_steps(run.rows, rows_a_step);
        let rows_a_step = run.speed_rows.last().map_or(0, |row| speed_strategies(row.frames_per_loop).len());
        let speed_rows = whole_steps(run.speed_rows, rows_a_step);
        // Trees that depend on the past are checked again on the way to where it goes on.
        let checks = Checks { rays: 0, rays_hit: 0, trees: 0, ..run.checks };
        SceneRun { checks, rows, speed_rows, ..SceneRun::default() }
    }

    /// Whether going on with it makes one run: the same settings, revision and machine.
    pub(super) fn ensure_same(&self, now: &Results, folder: &Path) -> Result<()> {
        let settings = |of: &Results| Settings { command: String::new(), ..of.settings.clone() };
        let machine = |of: &Results| (of.machine.cpu.clone(), of.machine.simd.clone(), of.machine.cores);
        let before = &self.results;
        for (what, same) in [
            ("settings or scenes", settings(before) == settings(now)),
            ("a revision", before.revision == now.revision),
            ("a machine", machine(before) == machine(now)),
        ] {
            ensure!(
                same,
                "{}: holds rows measured with {what} other than now; leave --resume out to start again, or name \
                 another --out",
                folder.display()
            );
        }
        Ok(())
    }
}

/// How many rows the first step of the strategies that take turns has, if there are more steps.
fn rows_of_first_step(rows: &[Row]) -> Option<usize> {
    let step = |row: &Row| (row.round, row.frame);
    let first = rows.first().map(step)?;
    let in_turns = rows.iter().filter(|row| !plays_alone(&row.strategy));
    let count = in_turns.clone().filter(|row| step(row) == first).count();
    (count < in_turns.count()).then_some(count)
}

fn whole_steps(mut rows: Vec<Row>, rows_a_step: usize) -> Vec<Row> {
    let step = |row: &Row| (row.frames_per_loop, row.round, row.frame);
    if let Some(last) = rows.last().filter(|row| !plays_alone(&row.strategy)).map(step)
        && rows.iter().filter(|row| step(row) == last).count() < rows_a_step
    {
        rows.retain(|row| step(row) != last);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_says_how_many_rows_make_one() {
        let row = |frame, strategy: &str| Row { frame, strategy: strategy.to_owned(), ..Row::default() };
        let mut rows = vec![row(0, "refit"), row(0, "auto")];
        assert_eq!(rows_of_first_step(&rows), None, "it may be incomplete");
        rows.push(row(0, "asynchronous"));
        assert_eq!(rows_of_first_step(&rows), None);
        rows.insert(2, row(5, "refit"));
        assert_eq!(rows_of_first_step(&rows), Some(2));
        assert_eq!(rows_of_first_step(&[]), None);
    }

    #[test]
    fn only_an_incomplete_last_step_is_measured_again() {
        let row = |frames_per_loop, round, frame| Row { round, frame, frames_per_loop, ..Row::default() };
        let rows = vec![row(20, 0, 1), row(20, 1, 1), row(100, 0, 1), row(100, 0, 1)];
        assert_eq!(whole_steps(rows.clone(), 2), rows);
        assert_eq!(whole_steps(rows.clone(), 3), rows[..2]);
        assert_eq!(whole_steps(Vec::new(), 3), []);
        // What plays alone has one row a step, after all of those that take turns.
        let strategy = "asynchronous".to_owned();
        let rows = [rows[..2].to_vec(), vec![Row { strategy, ..row(20, 0, 1) }]].concat();
        assert_eq!(whole_steps(rows.clone(), 3), rows);
    }
}
