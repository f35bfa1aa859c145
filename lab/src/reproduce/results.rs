//! Everything a run leaves behind: what report, figures, claims and summary are made from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::accuracy::Point;
use super::check::Checks;
use super::offline::OfflineTree;
use super::record::Row;
use super::summary::StrategySummary;
use crate::compare::Row as Peer;
use crate::effects;
use crate::machine::{Machine, Revision};

/// A whole run; but for the rows, which have files of their own, also what `summary.json` has of
/// it.
#[derive(Serialize, Deserialize)]
pub(crate) struct Results {
    pub(crate) machine: Machine,
    pub(crate) revision: Revision,
    pub(crate) settings: Settings,
    pub(crate) scenes: Vec<SceneRun>,
    /// Settings of accuracy with what they cost.
    #[serde(skip)]
    pub(crate) accuracy: Vec<Point>,
    /// Whether it was stopped before its end, or is under way.
    pub(crate) interrupted: bool,
}

/// What was to run, and how.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Settings {
    pub(crate) preset: String,
    pub(crate) experiments: Vec<String>,
    /// As they were named: two files may have the same label.
    #[serde(default)]
    pub(crate) scenes: Vec<String>,
    pub(crate) strategies: Vec<String>,
    /// Frames in a loop.
    pub(crate) frames: usize,
    pub(crate) loops: f64,
    /// Loops of figure 5, if that was asked for.
    pub(crate) speed_loops: Option<f64>,
    /// Pixels on each side of the image.
    pub(crate) size: u32,
    pub(crate) threads: usize,
    /// How rays were grouped.
    pub(crate) traversal: String,
    pub(crate) seed: u64,
    /// Clip of a glTF file, if one was named.
    pub(crate) clip: Option<String>,
    /// What was made less than the paper's protocol asks for.
    pub(crate) reductions: Vec<String>,
    /// The command that does the same again.
    pub(crate) command: String,
}

/// A scene and what was measured on it.
#[derive(Default, Serialize, Deserialize)]
pub(crate) struct SceneRun {
    pub(crate) label: String,
    /// Part of file names.
    pub(crate) slug: String,
    /// Whether it serves one claim only, and stands in no figure.
    pub(crate) supplement: bool,
    /// Whether all was measured that was asked for.
    pub(crate) finished: bool,
    pub(crate) about: String,
    pub(crate) triangles: usize,
    /// Triangles that can move.
    pub(crate) moving: usize,
    pub(crate) effects: Vec<String>,
    /// The stages of a frame, in order.
    pub(crate) plan: Vec<String>,
    /// Bytes of key frames in memory.
    pub(crate) key_bytes: usize,
    /// Errors of the simulation, by name.
    pub(crate) measures: BTreeMap<String, f64>,
    /// Frames in a loop.
    pub(crate) frames: usize,
    /// One frame in this number was measured.
    pub(crate) measure_every: usize,
    /// Building the first tree.
    pub(crate) build_ms: f64,
    /// Part of all nodes of the first tree that have grandchildren.
    pub(crate) candidates: f64,
    /// Nodes visited for a pixel that heat maps show white.
    pub(crate) hottest: u32,
    pub(crate) notes: Vec<String>,
    /// SAH costs with rotations: where motion stopped, after more updates, and of a fresh tree
    /// there.
    pub(crate) settled: Option<[f64; 3]>,
    /// Bytes that rotations keep between updates over those of the tree.
    pub(crate) memory: Option<f64>,
    /// What each effect costs.
    #[serde(default)]
    pub(crate) effect_costs: Vec<effects::Cost>,
    /// Its rows in `accuracy.csv` and in `peers.csv`; 0 also in results of older revisions.
    #[serde(default)]
    pub(crate) accuracy_rows: usize,
    #[serde(default)]
    pub(crate) peer_rows: usize,
    pub(crate) checks: Checks,
    /// The rows of figures 4 and 6, and of figure 5 by frames in a loop, in brief.
    pub(crate) strategies: Vec<StrategySummary>,
    #[serde(rename = "speeds")]
    pub(crate) speed_summaries: BTreeMap<usize, StrategySummary>,
    /// Trees built once and for all, where such builders are there.
    pub(crate) offline: Vec<OfflineTree>,
    #[serde(rename = "images")]
    pub(crate) pictures: Vec<Picture>,
    /// Rows of figures 4 and 6.
    #[serde(skip)]
    pub(crate) rows: Vec<Row>,
    /// Rows of figure 5.
    #[serde(skip)]
    pub(crate) speed_rows: Vec<Row>,
    /// Other libraries beside this one.
    #[serde(skip)]
    pub(crate) peers: Vec<Peer>,
}

/// A rendered frame, or a heat map of it.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Picture {
    pub(crate) frame: usize,
    /// Of whose tree this is the heat map: nodes visited for each pixel. The frame as it looks if
    /// `None`.
    pub(crate) strategy: Option<String>,
    /// Name in the folder `images`.
    pub(crate) file: String,
    /// Its content.
    #[serde(skip)]
    pub(crate) bytes: Vec<u8>,
}

/// Samples in brief; all 0 by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    /// A tenth of the samples are below.
    pub(crate) p10: f64,
    /// A tenth of the samples are above.
    pub(crate) p90: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) mean: f64,
}

impl Spread {
    /// Of at least one sample.
    pub(crate) fn of(samples: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = samples.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let quantile = |q: f64| {
            let at = q * (sorted.len() - 1) as f64;
            let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
            below + (above - below) * at.fract()
        };
        let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
        Some(Self { median: quantile(0.5), p10: quantile(0.1), p90: quantile(0.9), min, max, mean })
    }
}

/// The median of samples; 0 of none.
pub(crate) fn median(samples: impl IntoIterator<Item = f64>) -> f64 {
    Spread::of(samples).unwrap_or_default().median
}

impl SceneRun {
    /// Rows of one strategy, in order.
    pub(crate) fn of(&self, strategy: &str) -> Vec<&Row> {
        self.rows.iter().filter(|row| row.strategy == strategy).collect()
    }

    /// Whether anything moves.
    pub(crate) fn moves(&self) -> bool {
        self.moving > 0
    }

    /// Rows of figure 5 at a number of frames in a loop.
    pub(crate) fn at_speed(&self, frames: usize, strategy: &str) -> Vec<&Row> {
        let is_its = |row: &&Row| row.frames_per_loop == frames && row.strategy == strategy;
        self.speed_rows.iter().filter(is_its).collect()
    }

    /// Rows of two strategies on the same frames, in order; none if either was not run.
    pub(crate) fn pairs(&self, a: &str, b: &str) -> Vec<(&Row, &Row)> {
        let of_b: BTreeMap<_, _> = self.of(b).into_iter().map(|row| (row.step(), row)).collect();
        self.of(a).into_iter().filter_map(|row| Some((row, *of_b.get(&row.step())?))).collect()
    }
}

impl Results {
    /// The scene of that name, if something was measured on it.
    pub(crate) fn scene(&self, label: &str) -> Option<&SceneRun> {
        self.scenes.iter().find(|s| s.label == label && !s.rows.is_empty())
    }

    /// The scenes but for those that serve one claim only.
    pub(crate) fn main_scenes(&self) -> impl Iterator<Item = &SceneRun> {
        self.scenes.iter().filter(|s| !s.supplement)
    }

    /// Those of them that something moves in and that were measured.
    pub(crate) fn moving(&self) -> impl Iterator<Item = &SceneRun> {
        self.main_scenes().filter(|s| s.moves() && !s.rows.is_empty())
    }

    /// All checks together.
    pub(crate) fn checks(&self) -> Checks {
        let mut all = Checks::default();
        self.scenes.iter().for_each(|scene| all.add(&scene.checks));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_interpolated() {
        let spread = Spread::of([4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!((spread.min, spread.median, spread.max, spread.mean), (1.0, 2.5, 4.0, 2.5));
        assert!((spread.p10 - 1.3).abs() < 1e-12 && (spread.p90 - 3.7).abs() < 1e-12);
        assert_eq!(Spread::of([]), None);
        assert_eq!(Spread::of([7.0]).unwrap().p90, 7.0);
    }
}
