//! The rows of the result file.

use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::table::{middle, threads_of, time, unique};
use crate::files;
use crate::machine::{Machine, Revision};
use crate::reproduce::chart::{Chart, Kind, Point, Series, figure};

/// One contestant on one scene with one number of threads.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) scene: String,
    /// `update`, `limit` (what the memory takes for an update's bytes), `build`, `trace`,
    /// `incoherent`, `view` (making the wide view for that) or `frame`.
    pub(crate) what: String,
    pub(crate) contestant: String,
    pub(crate) threads: usize,
    /// Measured frames; of several runs their medians.
    pub(crate) frames: usize,
    pub(crate) median_ms: f64,
    pub(crate) min_ms: f64,
    pub(crate) max_ms: f64,
    /// Says more than the median where frames do different work.
    pub(crate) mean_ms: f64,
    /// Mean over the measured frames of the tree's SAH cost over that of a full sweep build of the
    /// same frame; nothing where the tree cannot be read.
    pub(crate) sah_over_sweep: Option<f64>,
    /// Primary rays that hit something, in all measured frames of all runs.
    pub(crate) hits: u64,
    /// Primary rays with another answer than the reference: hit or miss, or a distance off by more
    /// than 0.1 %.
    pub(crate) different: u64,
    /// Pixels that are lit in one and in shadow in the other.
    #[serde(default)]
    pub(crate) shadows_different: u64,
    /// Primary rays cast for comparison.
    pub(crate) rays: u64,
    /// Whether hits, lit pixels and answers are the reference's, within the bounds of
    /// [`Answers::agrees_with`](pivot_benches::Answers::agrees_with).
    pub(crate) agrees: bool,
    pub(crate) triangles: usize,
    /// Of whole frames: the mean time of the update.
    pub(crate) mean_update_ms: Option<f64>,
    /// `sah_over_sweep` in the frame where it is worst.
    pub(crate) worst_sah_over_sweep: Option<f64>,
    /// The mean of updates and whole frames, the median of all else, over the number of triangles.
    pub(crate) ns_per_triangle: f64,
    /// Of tracing: primary and shadow rays over the median time.
    pub(crate) million_rays_per_s: Option<f64>,
    /// Pixels that the light reaches.
    pub(crate) lit: u64,
    /// Sum of the distances of all hits.
    pub(crate) t_sum: f64,
}

impl Row {
    /// Where a row belongs, for messages.
    pub(super) fn place(&self) -> String {
        let Self { what, scene, contestant, threads, different, rays, .. } = self;
        let shadows = self.shadows_different;
        format!(
            "{what} of {scene}, {contestant}, {threads} threads ({different} of {rays} rays, {shadows} of their shadows)"
        )
    }
}

/// Everything that was measured: the result file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Report {
    machine: On,
    pub(super) rows: Vec<Row>,
}

/// The machine, and the versions of what ran on it.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct On {
    #[serde(flatten)]
    machine: Machine,
    #[serde(flatten)]
    revision: Revision,
    /// Version of Embree, where it took part.
    embree: Option<String>,
}

impl Report {
    pub(super) fn new(embree: Option<String>) -> Self {
        let machine = On { machine: Machine::read(), revision: Revision::read(), embree };
        Self { machine, rows: Vec::new() }
    }

    pub(super) fn read(path: &Path) -> Result<Self> {
        serde_json::from_slice(&files::read(path)?)
            .with_context(|| format!("{}: not a file that `compare --json` wrote", path.display()))
    }

    /// One line on what ran where and when.
    pub(super) fn heading(&self) -> String {
        let On { machine, revision, embree } = &self.machine;
        let Machine { cpu, cores, simd, flags, load, started, .. } = machine;
        let flags = if flags.is_empty() { String::new() } else { format!(", flags {flags}") };
        let load = load.map(|l| format!(", load {l:.1}")).unwrap_or_default();
        let embree = embree.as_ref().map(|v| format!(", Embree {v}")).unwrap_or_default();
        let day = started.get(..10).unwrap_or_default();
        format!("{cpu}, {cores} cores, {simd}{flags}{load}; {day}; Pivot {}{embree}", revision.short())
    }

    /// Times of all contestants in one measurement, by scene, on the least number of threads.
    pub(super) fn chart(&self, what: &str) -> String {
        let rows = || self.rows.iter().filter(|row| row.what == what);
        let threads = rows().map(|row| row.threads).min().unwrap_or(1);
        let rows = || rows().filter(|row| row.threads == threads);
        let places = unique(rows().map(|row| row.scene.as_str()));
        let names = unique(rows().map(|row| row.contestant.as_str()));
        let series = names.iter().enumerate().map(|(color, name)| {
            let point = |row: &Row| {
                let place = places.iter().position(|place| *place == row.scene).unwrap_or_default();
                let ns = |ms: f64| 1e6 * ms / row.triangles.max(1) as f64;
                Point { low: ns(row.min_ms), high: ns(row.max_ms), ..Point::at(place as f64, ns(time(row))) }
            };
            let points = rows().filter(|row| row.contestant == *name).map(point).collect();
            Series { name: (*name).to_owned(), color, kind: Kind::Bars, points }
        });
        let middle = rows().next().map_or("median", middle);
        let chart = Chart {
            title: format!("{what}, {}: {middle}, least and most", threads_of(threads)),
            y_label: "ns per triangle".to_owned(),
            series: series.collect(),
            places: places.iter().map(|&place| place.to_owned()).collect(),
            ..Chart::default()
        };
        figure(&[chart], 1)
    }
}

#[cfg(test)]
mod tests {
    use pivot_benches::Answers;

    use super::*;
    use crate::compare::Setting;
    use crate::compare::lane::Record;

    #[test]
    fn rows_have_the_columns_that_others_rely_on() {
        let record =
            Record { times_ms: vec![8.0, 1.0, 2.0, 3.0], costs: vec![1.0, 2.0], ..Record::default() };
        let on = Setting { scene: "cloth".to_owned(), triangles: 1000, threads: 2, ..Setting::default() };
        let row = record.row("update", "pivot refit", &on, &Answers::default());
        assert_eq!((row.median_ms, row.min_ms, row.max_ms), (2.5, 1.0, 8.0));
        // By the mean; of traces by the median.
        assert_eq!((row.ns_per_triangle, row.sah_over_sweep), (3500.0, Some(1.5)));
        assert_eq!(record.row("trace", "pivot", &on, &Answers::default()).ns_per_triangle, 2500.0);
        assert_eq!(row.worst_sah_over_sweep, Some(2.0));
        let mut report = Report::new(None);
        report.rows.push(row);
        let file: serde_json::Value = serde_json::to_value(&report).expect("written");
        assert!(file["machine"]["cpu"].is_string());
        for column in ["what", "scene", "triangles", "contestant", "threads", "median_ms", "min_ms", "max_ms"]
        {
            assert!(!file["rows"][0][column].is_null(), "{column}");
        }
        assert_eq!(file["rows"][0]["sah_over_sweep"], 1.5);
        assert_eq!(file["rows"][0]["hits"], 0);
    }

    #[test]
    fn published_files_are_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/benchmarks");
        let files = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
        let reports: Vec<_> = files
            .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
            // Its form is older.
            .filter(|path| !path.ends_with("2026-11-23-ablation-21d30f1.json"))
            .map(|path| Report::read(&path).unwrap())
            .collect();
        assert!(reports.len() > 5);
        for report in reports {
            let Row { what, .. } = report.rows.last().unwrap();
            assert!(!what.is_empty() && !report.chart(what).contains("NaN"), "{}", report.heading());
        }
        let report = Report::new(None);
        assert!(report.heading().contains(", flags "), "{}", report.heading());
    }

    #[test]
    fn rows_with_missing_hits_do_not_agree() {
        let reference = Answers { rays: 20_000, hits: 20_000, ..Answers::default() };
        let row = |hits| {
            let record = Record { answers: Answers { hits, ..reference }, ..Record::default() };
            record.row("update", "c", &Setting::default(), &reference).agrees
        };
        assert!(row(19_998) && !row(19_990));
    }
}
