//! The results of an earlier run, read back from their folder: to draw the report again, to go on
//! after an interrupt, to compare with.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::SPEED_STRATEGIES;
use super::journal;
use super::record::Row;
use super::results::{Results, SceneRun, Settings};
use super::summary::{SCHEMA, StrategySummary};
use crate::compare::Row as Peer;

#[derive(Deserialize)]
struct Version {
    schema: u32,
}

/// What a folder holds: the scenes it knows all about, and rows of one that was under way.
pub(super) struct Saved {
    pub(super) results: Results,
    pub(super) rows: Vec<Row>,
    pub(super) speed_rows: Vec<Row>,
}

/// Reads a folder.
pub(super) fn load(folder: &Path) -> Result<Saved> {
    let path = folder.join("summary.json");
    let shown = path.display();
    let text = fs::read(&path)
        .with_context(|| format!("{shown}: cannot be read; name a folder that `reproduce` has written"))?;
    let Version { schema } = serde_json::from_slice(&text).with_context(|| format!("{shown}: no summary"))?;
    ensure!(schema == SCHEMA, "{shown}: schema {schema}, but this program reads {SCHEMA}; measure again");
    let mut results: Results =
        serde_json::from_slice(&text).with_context(|| format!("{shown}: not what schema {SCHEMA} says"))?;
    let [frames, speeds] = ["frames.csv", "fig5.csv"].map(|name| folder.join(name));
    let (mut rows, mut speed_rows) = (journal::read(&frames)?, journal::read(&speeds)?);
    results.accuracy = journal::read(&folder.join("accuracy.csv"))?;
    let mut peers = journal::read::<Peer>(&folder.join("peers.csv"))?;
    for run in &mut results.scenes {
        for picture in &mut run.pictures {
            let path = folder.join("images").join(&picture.file);
            picture.bytes = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        }
        let label = run.facts.label.as_str();
        run.peers = peers.extract_if(.., |peer| peer.scene == label).collect();
        run.rows = take(&mut rows, label);
        run.speeds = by_speed(take(&mut speed_rows, label));
        if run.facts.finished {
            for StrategySummary { strategy, samples, .. } in &run.strategies {
                ensure_rows(&frames, label, run.of(strategy).len(), *samples)?;
            }
            for (n, StrategySummary { samples, .. }) in &run.speed_summaries {
                // The summary has the samples of one strategy; the others have as many.
                let found =
                    run.speeds.iter().find(|(frames, _)| frames == n).map_or(0, |(_, rows)| rows.len());
                ensure_rows(&speeds, label, found, samples * SPEED_STRATEGIES.len())?;
            }
        }
        run.summarise(&results.settings.strategies);
    }
    Ok(Saved { results, rows, speed_rows })
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

fn take(rows: &mut Vec<Row>, label: &str) -> Vec<Row> {
    rows.extract_if(.., |row| row.scene == label).collect()
}

fn by_speed(rows: Vec<Row>) -> Vec<(usize, Vec<Row>)> {
    let mut speeds: Vec<(usize, Vec<Row>)> = Vec::new();
    for row in rows {
        match speeds.iter_mut().find(|(frames, _)| *frames == row.frames_per_loop) {
            Some((_, rows)) => rows.push(row),
            None => speeds.push((row.frames_per_loop, vec![row])),
        }
    }
    speeds
}

impl Saved {
    /// Rows that a scene has already, if it was not finished, without those of an incomplete last
    /// step: a step has `strategies` rows, of figure 5 one for each of [`SPEED_STRATEGIES`].
    pub(super) fn begun(&mut self, label: &str, strategies: usize) -> [Vec<Row>; 2] {
        let from_scene = |run: &mut SceneRun| {
            let speeds = std::mem::take(&mut run.speeds).into_iter().flat_map(|(_, rows)| rows).collect();
            [std::mem::take(&mut run.rows), speeds]
        };
        let known = self.results.scenes.iter_mut().find(|run| run.facts.label == label).map(from_scene);
        let rows = known.unwrap_or_else(|| [&mut self.rows, &mut self.speed_rows].map(|r| take(r, label)));
        let [frames, speeds] = rows;
        [whole_steps(frames, strategies), whole_steps(speeds, SPEED_STRATEGIES.len())]
    }

    /// The scene, if everything was measured on it.
    pub(super) fn finished(&mut self, label: &str) -> Option<SceneRun> {
        let scenes = &mut self.results.scenes;
        let at = scenes.iter().position(|run| run.facts.label == label && run.facts.finished)?;
        Some(scenes.remove(at))
    }

    /// Whether going on with it makes one run: the same settings, revision and machine.
    pub(super) fn ensure_same(&self, now: &Results, folder: &Path) -> Result<()> {
        let settings = |s: &Settings| Settings { command: String::new(), ..s.clone() };
        let Results { machine, revision, settings: before, .. } = &self.results;
        let differs = if settings(before) != settings(&now.settings) {
            "settings"
        } else if (&revision.commit, revision.dirty) != (&now.revision.commit, now.revision.dirty) {
            "a revision"
        } else if (&machine.cpu, &machine.simd, machine.cores)
            != (&now.machine.cpu, &now.machine.simd, now.machine.cores)
        {
            "a machine"
        } else {
            return Ok(());
        };
        anyhow::bail!(
            "{}: holds rows measured with {differs} other than now; leave --resume out to start again, or name another \
             --out",
            folder.display()
        )
    }
}

fn whole_steps(mut rows: Vec<Row>, rows_a_step: usize) -> Vec<Row> {
    let step = |row: &Row| (row.frames_per_loop, row.round, row.frame);
    if let Some(last) = rows.last().map(step)
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
    fn only_an_incomplete_last_step_is_measured_again() {
        let row = |frames_per_loop, round, frame| Row { round, frame, frames_per_loop, ..Row::default() };
        let rows = vec![row(20, 0, 1), row(20, 1, 1), row(100, 0, 1), row(100, 0, 1)];
        assert_eq!(whole_steps(rows.clone(), 2), rows);
        assert_eq!(whole_steps(rows.clone(), 3), rows[..2]);
        assert_eq!(whole_steps(Vec::new(), 3), []);
        assert_eq!(
            by_speed(rows).iter().map(|(n, rows)| (*n, rows.len())).collect::<Vec<_>>(),
            [(20, 2), (100, 2)]
        );
    }
}
