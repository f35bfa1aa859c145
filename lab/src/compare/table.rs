//! The rows of the result file; and as text: tables, and ratios of times within one run, where the
//! state of the machine cancels out.

use std::collections::HashSet;
use std::hash::Hash;

use serde::{Deserialize, Serialize};

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

    /// One line on what ran where and when.
    pub(super) fn heading(&self) -> String {
        let On { machine: Machine { cpu, cores, simd, load, started, .. }, revision, embree } = &self.machine;
        let load = load.map(|l| format!(", load {l:.1}")).unwrap_or_default();
        let embree = embree.as_ref().map(|v| format!(", Embree {v}")).unwrap_or_default();
        let day = started.get(..10).unwrap_or_default();
        format!("{cpu}, {cores} cores, {simd}{load}; {day}; Pivot {}{embree}", revision.short())
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
/// What a row was measured with: rows of one table agree in it.
fn measurement(row: &Row) -> (&str, &str, usize) {
    let what = if row.what == "limit" { "update" } else { row.what.as_str() };
    (what, &row.scene, row.threads)
}

/// A table of each measurement; first the figure that can be compared between scenes: nanoseconds a
/// triangle, or rays a second.
pub(super) fn tables(rows: &[Row]) -> String {
    let tables = rows.chunk_by(|a, b| measurement(a) == measurement(b)).map(table);
    tables.collect::<Vec<_>>().join("\n")
}

fn table(rows: &[Row]) -> String {
    let first = &rows[0];
    let (what, scene, threads) = measurement(first);
    let unit = if rows.iter().any(|row| row.million_rays_per_s.is_some()) { "Mrays/s" } else { "ns/tri" };
    let mut text = format!(
        "\n{what}, {scene}, {} triangles, {}, {} frames; {unit} by the {}\n",
        first.triangles,
        threads_of(threads),
        first.frames,
        middle(first)
    );
    text += &format!(
        "  {:<30} {unit:>8} {:>10} {:>10} {:>10} {:>10} {:>10} {:>8} {:>10} {:>9}\n",
        "", "median ms", "min", "max", "mean", "its update", "SAH", "hits", "different"
    );
    for row in rows {
        let per_triangle = (unit == "ns/tri").then(|| 1e6 * time(row) / row.triangles.max(1) as f64);
        let figure = row.million_rays_per_s.or(per_triangle).map_or("-".to_owned(), |v| format!("{v:.1}"));
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
        let (cost, update) = (number(row.sah_over_sweep), number(row.mean_update_ms));
        let hits = if row.what == "limit" { "-".to_owned() } else { row.hits.to_string() };
        let remark = if row.agrees { "" } else { "  NOT THE SAME HITS" };
        text += &format!(
            "  {:<30} {figure:>8} {:>10.3} {:>10.3} {:>10.3} {:>10.3} {update:>10} {cost:>8} {hits:>10} {:>9}{remark}\n",
            row.contestant, row.median_ms, row.min_ms, row.max_ms, row.mean_ms, row.different
        );
    }
    text.trim_end().to_owned()
}

/// Each value once, in the order of their first appearance.
pub(crate) fn unique<T: Copy + Eq + Hash>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = HashSet::new();
    values.filter(|value| seen.insert(*value)).collect()
}

/// A number of threads in words.
fn threads_of(threads: usize) -> String {
    format!("{threads} thread{}", if threads == 1 { "" } else { "s" })
}

/// What is measured, one contestant over another; `*` stands for the best of all others whose names
/// begin so.
const RATIOS: [[&str; 3]; 19] = [
    ["update", "pivot refit", "memory limit"],
    ["update", "pivot refit", "embree refit"],
    ["update", "pivot refit", "obvhs refit"],
    ["update", "pivot refit+rotate", "pivot refit"],
    ["update", "pivot refit+rotate", "embree low"],
    ["update", "pivot refit+rotate+regrow", "pivot refit+rotate"],
    ["update", "pivot lbvh", "embree low"],
    ["update", "pivot ploc", "embree low"],
    ["build", "pivot binned-parallel", "obvhs fast"],
    ["trace", "pivot avx512", "embree packets of 16"],
    ["trace", "pivot avx2", "embree packets of 8, avx2"],
    ["trace", "pivot leaves of 4", "embree packets of 16"],
    ["incoherent", "pivot wide", "embree single"],
    ["incoherent", "pivot single", "embree single"],
    ["incoherent", "pivot wide", "obvhs cwbvh"],
    ["incoherent", "pivot single", "obvhs binary"],
    ["frame", "pivot refit+rotate", "embree *"],
    ["frame", "pivot auto", "embree *"],
    ["frame", "pivot auto", "pivot *"],
];

/// What counts of a measurement: means of whole frames and updates, since a median would leave out
/// what repairs cost; medians of all else.
fn middle(row: &Row) -> &'static str {
    if ["frame", "update"].contains(&measurement(row).0) { "mean" } else { "median" }
}

/// The time that counts.
pub(super) fn time(row: &Row) -> f64 {
    if middle(row) == "mean" { row.mean_ms } else { row.median_ms }
}

/// The time of `over` over that of `under` in one measurement.
fn ratio(rows: &[Row], on: (&str, usize), what: &str, over: &str, under: &str) -> Option<f64> {
    let here = |row: &&Row| measurement(row) == (what, on.0, on.1) && time(row) > 0.0;
    let here = || rows.iter().filter(here);
    let ours = here().find(|row| row.contestant == over)?;
    let is_meant = |row: &&Row| match under.strip_suffix('*') {
        Some(start) => row.contestant != over && row.contestant.starts_with(start),
        None => row.contestant == under,
    };
    Some(time(ours) / here().filter(is_meant).map(time).min_by(f64::total_cmp)?)
}

/// All ratios that the rows allow, a line each, a column for each scene.
pub(super) fn ratios(rows: &[Row]) -> String {
    let scenes = unique(rows.iter().map(|row| row.scene.as_str()));
    let threads = unique(rows.iter().map(|row| row.threads));
    let mut text = String::new();
    for n in threads {
        for [what, over, under] in RATIOS {
            let values: Vec<_> =
                scenes.iter().map(|scene| ratio(rows, (scene, n), what, over, under)).collect();
            if values.iter().any(Option::is_some) {
                let cell = |v: &Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2}"));
                let cells: String = values.iter().map(|v| format!("{:>18}", cell(v))).collect();
                let under = under.replace('*', "best of the rest");
                let title = format!("{what}, {over} / {under}, {}", threads_of(n));
                text += &format!("\n  {title:<66}{cells}");
            }
        }
    }
    if text.is_empty() {
        return text;
    }
    let heads: String = scenes.iter().map(|scene| format!("{scene:>18}")).collect();
    format!("\n  {:<66}{heads}{text}\n", "ratios of times")
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
    fn rows_with_missing_hits_do_not_agree() {
        let reference = Answers { rays: 20_000, hits: 20_000, ..Answers::default() };
        let row = |hits| {
            let record = Record { answers: Answers { hits, ..reference }, ..Record::default() };
            record.row("update", "c", &Setting::default(), &reference).agrees
        };
        assert!(row(19_998) && !row(19_990));
    }

    #[test]
    fn a_row_without_a_rate_has_no_figure_among_rates() {
        let row = |contestant: &str, million_rays_per_s| Row {
            contestant: contestant.to_owned(),
            triangles: 1000,
            median_ms: 2.0,
            million_rays_per_s,
            ..Row::default()
        };
        let figure = |rows: &[Row]| {
            let text = tables(rows);
            let line = text.lines().find_map(|line| line.strip_prefix("  set-up")).expect("a row");
            line.split_whitespace().next().map(str::to_owned)
        };
        assert_eq!(figure(&[row("pivot", Some(3.0)), row("set-up", None)]).as_deref(), Some("-"));
        assert_eq!(figure(&[row("set-up", None)]).as_deref(), Some("2000.0"));
    }

    #[test]
    fn the_best_of_the_rest_is_the_fastest_other_of_that_name() {
        let row = |contestant: &str, mean_ms: f64| Row {
            scene: "n-body".to_owned(),
            what: "frame".to_owned(),
            contestant: contestant.to_owned(),
            threads: 1,
            mean_ms,
            ..Row::default()
        };
        let rows = [
            row("pivot auto", 3.0),
            row("pivot refit", 4.0),
            row("embree low", 2.0),
            row("embree refit", 6.0),
        ];
        let text = ratios(&rows);
        let found: Vec<_> = text.lines().skip(2).filter_map(|line| line.split_whitespace().last()).collect();
        assert_eq!(found, ["1.50", "0.75"], "{text}");
        assert_eq!(ratios(&[]), "");
    }
}
