//! The results of an earlier run, read back from their folder: to draw the report again, to go on
//! after an interrupt, to compare with.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::SPEED_STRATEGIES;
use super::accuracy::Point;
use super::check::Checks;
use super::journal;
use super::offline::OfflineTree;
use super::record::Row;
use super::results::{Picture, Results, SceneFacts, SceneRun, Settings};
use super::summary::SCHEMA;
use crate::compare::Row as Peer;
use crate::machine::{Machine, Revision};

#[derive(Deserialize)]
struct Version {
    schema: u32,
}

#[derive(Deserialize)]
struct Summary {
    interrupted: bool,
    machine: Machine,
    revision: Revision,
    settings: Settings,
    scenes: Vec<Scene>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(flatten)]
    facts: SceneFacts,
    checks: Checks,
    strategies: Vec<Samples>,
    /// By frames in a loop.
    speeds: BTreeMap<usize, Samples>,
    offline: Vec<OfflineTree>,
    images: Vec<Picture>,
}

/// How many rows of a strategy there were when the summary was written.
#[derive(Deserialize)]
struct Samples {
    strategy: String,
    samples: usize,
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
    let summary: Summary =
        serde_json::from_slice(&text).with_context(|| format!("{shown}: not what schema {SCHEMA} says"))?;
    let Summary { interrupted, machine, revision, settings, scenes } = summary;
    let mut rows = journal::read(&folder.join("frames.csv"))?;
    let mut speed_rows = journal::read(&folder.join("fig5.csv"))?;
    let accuracy = journal::read::<Point>(&folder.join("accuracy.csv"))?;
    let mut peers = journal::read::<Peer>(&folder.join("peers.csv"))?;
    let mut runs = Vec::new();
    for Scene { facts, checks, strategies, speeds, offline, mut images } in scenes {
        for picture in &mut images {
            let path = folder.join("images").join(&picture.file);
            picture.bytes = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        }
        let mut run = SceneRun { pictures: images, checks, offline, ..SceneRun::new(facts) };
        run.peers = peers.extract_if(.., |peer| peer.scene == run.facts.label).collect();
        run.rows = take(&mut rows, &run.facts.label);
        run.speeds = by_speed(take(&mut speed_rows, &run.facts.label));
        if run.facts.finished {
            for Samples { strategy, samples } in &strategies {
                ensure_rows(&folder.join("frames.csv"), &run.facts.label, run.of(strategy).len(), *samples)?;
            }
            for (frames, Samples { samples, .. }) in &speeds {
                // The summary has the samples of one strategy; the others have as many.
                let found = run.speeds.iter().find(|(n, _)| n == frames).map_or(0, |(_, rows)| rows.len());
                let expected = samples * SPEED_STRATEGIES.len();
                ensure_rows(&folder.join("fig5.csv"), &run.facts.label, found, expected)?;
            }
        }
        runs.push(run);
    }
    let results = Results { machine, revision, settings, scenes: runs, accuracy, interrupted };
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
