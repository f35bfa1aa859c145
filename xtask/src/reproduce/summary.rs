//! `summary.json`: a run in brief, for programs; and in a few lines, for the terminal.
//!
//! The schema is described in `xtask/README.md`; a change that could break a reader raises [`SCHEMA`].

use std::collections::BTreeMap;

use serde::Serialize;

use super::chart::count;
use super::check::Checks;
use super::claims::Claim;
use super::contestants::{Contestant, IDEAL};
use super::record::Row;
use super::results::{Results, SceneFacts, SceneRun, Settings, Spread};
use super::stages::{StageSummary, stages};
use crate::machine::{Machine, Revision};

/// Version of the schema.
const SCHEMA: u32 = 1;

#[derive(Serialize)]
struct Summary<'a> {
    schema: u32,
    interrupted: bool,
    machine: &'a Machine,
    revision: &'a Revision,
    settings: &'a Settings,
    checks: Checks,
    claims: &'a [Claim],
    scenes: Vec<SceneSummary<'a>>,
}

#[derive(Serialize)]
struct SceneSummary<'a> {
    #[serde(flatten)]
    facts: &'a SceneFacts,
    checks: &'a Checks,
    strategies: Vec<StrategySummary>,
    /// Figure 5, by frames in a loop.
    speeds: BTreeMap<usize, StrategySummary>,
    images: Vec<&'a str>,
}

/// A strategy on one scene, over the frames it was measured on.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct StrategySummary {
    pub(crate) strategy: &'static str,
    /// How its update time comes about, where it is not simply measured.
    pub(crate) accounting: Option<String>,
    pub(crate) samples: usize,
    pub(crate) animate_ms: Spread,
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
    /// Time and counters of the stages of a frame, in order.
    pub(crate) stages: Vec<StageSummary>,
}

/// Every strategy that was measured on a scene.
pub(crate) fn strategies(scene: &SceneRun, settings: &Settings) -> Vec<StrategySummary> {
    let all = settings.strategies.iter().filter_map(|&name| Contestant::from_name(name).ok());
    all.filter_map(|contestant| {
        let rows = scene.of(contestant.name);
        let over = scene.pairs(contestant.name, IDEAL).into_iter().map(|(a, b)| a.sah_cost / b.sah_cost);
        strategy(&contestant, &scene.facts, &rows, Spread::of(over))
    })
    .collect()
}

fn strategy(
    contestant: &Contestant,
    facts: &SceneFacts,
    rows: &[&Row],
    over: Option<Spread>,
) -> Option<StrategySummary> {
    let spread = |value: fn(&Row) -> f64| Spread::of(rows.iter().map(|row| value(row)));
    Some(StrategySummary {
        strategy: contestant.name,
        accounting: contestant.accounting(),
        samples: rows.len(),
        animate_ms: spread(|row| row.animate_ms)?,
        update_ms: spread(|row| row.update_ms)?,
        trace_ms: spread(|row| row.trace_ms)?,
        frame_ms: spread(|row| row.frame_ms)?,
        sah_cost: spread(|row| row.sah_cost)?,
        last_cost: rows.last()?.sah_cost,
        sah_over_sweep: over,
        rotations: rows.iter().map(|row| row.rotations).sum(),
        greatest_height: rows.iter().map(|row| row.height).max()?,
        stages: stages(&facts.plan, rows),
    })
}

fn speeds(scene: &SceneRun) -> BTreeMap<usize, StrategySummary> {
    let summary = |rows: &[Row]| {
        let contestant = Contestant::from_name(rows.first()?.strategy).ok()?;
        strategy(&contestant, &scene.facts, &rows.iter().collect::<Vec<_>>(), None)
    };
    scene.speeds.iter().filter_map(|(frames, rows)| Some((*frames, summary(rows)?))).collect()
}

/// The whole summary.
pub(crate) fn json(results: &Results, claims: &[Claim]) -> serde_json::Result<String> {
    let scene = |scene: &'_ SceneRun| strategies(scene, &results.settings);
    let summary = Summary {
        schema: SCHEMA,
        interrupted: results.interrupted,
        machine: &results.machine,
        revision: &results.revision,
        settings: &results.settings,
        checks: results.checks(),
        claims,
        scenes: results
            .scenes
            .iter()
            .map(|run| SceneSummary {
                facts: &run.facts,
                checks: &run.checks,
                strategies: scene(run),
                speeds: speeds(run),
                images: run.pictures.iter().map(|p| p.file.as_str()).collect(),
            })
            .collect(),
    };
    Ok(serde_json::to_string_pretty(&summary)? + "\n")
}

/// A line for each claim.
pub(crate) fn claims_in_lines(claims: &[Claim]) -> String {
    let line = |c: &Claim| format!("{:18}  {}: {}", c.verdict.words(), c.claim, c.ours);
    claims.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// What was checked, in one sentence.
pub(crate) fn checks_in_words(checks: &Checks) -> String {
    let [pictures, pixels, rays, hits, trees, differences] =
        [checks.pictures, checks.pixels, checks.rays, checks.rays_hit, checks.trees, checks.differences]
            .map(count);
    format!(
        "checked: {pictures} pairs of pictures ({pixels} pixels) bit by bit, {rays} rays ({hits} hits) against brute \
         force, {trees} trees validated: {differences} differences"
    )
}
