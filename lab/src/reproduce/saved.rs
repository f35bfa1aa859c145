//! The results of an earlier run, read back from their folder: to draw the report again, to go on
//! after an interrupt, to compare with.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::Entry;
use super::accuracy::Point;
use super::check::Checks;
use super::journal::read;
use super::record::Row;
use super::results::{Results, SceneRun, Settings};
use super::speed_strategies;
use super::summary::SCHEMA;
use crate::compare::Row as Peer;
use crate::files;

/// Reads a folder: the scenes it knows all about, and rows of figures 4 and 6, and of figure 5, of
/// one that was under way.
pub(super) fn load(folder: &Path) -> Result<(Results, [Vec<Row>; 2])> {
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
        let label = run.label.as_str();
        run.peers = peers.extract_if(.., |peer| peer.scene == label).collect();
        [run.rows, run.speed_rows] = take(&mut rest, label);
        if run.finished {
            // No rows may be missing.
            let rows = run.strategies.iter().map(|s| (&frames, run.of(&s.strategy).len(), s.samples));
            let speed_rows = run.speed_summaries.iter().map(|(&n, s)| {
                // The summary has the samples of one strategy; the others have as many.
                let found = run.speed_rows.iter().filter(|row| row.frames_per_loop == n).count();
                (&speeds, found, s.samples * speed_strategies(n).len())
            });
            let points = results.accuracy.iter().filter(|point| point.scene == label).count();
            let (of_points, of_peers) = (run.accuracy_rows, run.peer_rows);
            // Older revisions did not count these.
            let counted = [(&accuracy, points, of_points), (&beside, run.peers.len(), of_peers)];
            let counted = counted.into_iter().filter(|&(.., expected)| expected > 0);
            for (file, found, expected) in rows.chain(speed_rows).chain(counted) {
                ensure!(
                    found == expected,
                    "{}: {found} rows of {label} where summary.json counted {expected}; measure again",
                    file.display()
                );
            }
        }
        run.summarise(&results.settings.strategies);
    }
    Ok((results, rest))
}

/// Refuses a folder with an unfinished run: a new one would discard its rows.
pub(super) fn ensure_ended(folder: &Path) -> Result<()> {
    let summary = fs::read(folder.join("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_slice(&summary).unwrap_or_default();
    ensure!(
        summary["interrupted"] != true,
        "{}: holds an unfinished run; go on with --resume, or empty the folder, or name another --out",
        folder.display()
    );
    Ok(())
}

fn take(rows: &mut [Vec<Row>; 2], label: &str) -> [Vec<Row>; 2] {
    rows.each_mut().map(|rows| rows.extract_if(.., |row| row.scene == label).collect())
}

/// Gives the entries what an earlier run has measured of them, and returns the points of accuracy
/// of those that it finished. Both runs must be one: of the same settings, revision and machine.
pub(super) fn take_over(folder: &Path, now: &Results, entries: &mut [Entry]) -> Result<Vec<Point>> {
    let (mut before, mut rest) = load(folder)?;
    let settings = |of: &Results| Settings { command: String::new(), ..of.settings.clone() };
    let machine = |of: &Results| {
        let machine = of.machine.clone();
        (machine.cpu, machine.simd, machine.flags, machine.cores)
    };
    for (what, same) in [
        ("settings or scenes", settings(&before) == settings(now)),
        ("a revision", before.revision == now.revision),
        ("a machine or compiler flags", machine(&before) == machine(now)),
    ] {
        ensure!(
            same,
            "{}: holds rows measured with {what} other than now, by `{}`; empty the folder to start again, \
             or name another --out",
            folder.display(),
            before.settings.command
        );
    }
    for Entry { label, before: run, .. } in &mut *entries {
        let known = before.scenes.extract_if(.., |run| run.label == *label).next();
        *run = known.unwrap_or_else(|| {
            let [rows, speed_rows] = take(&mut rest, label);
            SceneRun { rows, speed_rows, ..SceneRun::default() }
        });
        if !run.finished {
            let begun = std::mem::take(run);
            let [rows, speed_rows] = [begun.rows, begun.speed_rows].map(whole_steps);
            // Trees that depend on the past are checked again on the way to where it goes on.
            let checks = Checks { rays: 0, rays_hit: 0, trees: 0, ..begun.checks };
            *run = SceneRun { checks, rows, speed_rows, ..SceneRun::default() };
        }
    }
    let is_kept = |point: &Point| entries.iter().any(|e| e.before.finished && e.label == point.scene);
    Ok(before.accuracy.into_iter().filter(is_kept).collect())
}

/// Leaves out the last step unless it is sure to be whole. Rows of a step are written in the order
/// of the contestants, so it is whole if it ends with the same strategy as the step before it. The
/// first step of strategies that take turns, or of one that plays alone, has no such step before
/// it, and is left out.
fn whole_steps(mut rows: Vec<Row>) -> Vec<Row> {
    let Some(last) = rows.last() else { return rows };
    let before = rows.iter().rposition(|row| row.step() != last.step());
    let end = |row: &Row| (row.frames_per_loop, row.strategy.clone());
    let is_whole = before.is_some_and(|at| end(&rows[at]) == end(last));
    if !is_whole {
        rows.truncate(before.map_or(0, |at| at + 1));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_incomplete_last_step_is_measured_again() {
        let step = |frames_per_loop, frame, strategies: &[&str]| -> Vec<Row> {
            let row =
                |name: &&str| Row { frames_per_loop, frame, strategy: (*name).to_owned(), ..Row::default() };
            strategies.iter().map(row).collect()
        };
        let turns = |frame| step(20, frame, &["refit", "auto", "ideal"]);
        let alone = |frame| step(20, frame, &["asynchronous"]);
        let all = [turns(0), turns(5), turns(10), alone(0), alone(5), alone(10)].concat();
        // After how many rows a run may be killed, and how many of them are kept.
        let kept = [0, 0, 0, 0, 3, 3, 6, 6, 6, 9, 9, 11, 12];
        for (killed, kept) in kept.into_iter().enumerate() {
            assert_eq!(whole_steps(all[..killed].to_vec()), all[..kept], "killed after {killed} rows");
        }
        // A run of one frame, where steps of all follow one another.
        let one = [turns(0), alone(0)].concat();
        assert_eq!(whole_steps(one), []);
        // Figure 5 goes on at another speed.
        let speeds = [step(20, 5, &["refit+rotate"]), step(100, 0, &["refit+rotate"])].concat();
        assert_eq!(whole_steps(speeds.clone()), speeds[..1]);
    }
}
