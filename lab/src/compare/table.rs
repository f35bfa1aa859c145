//! Results as text: tables, and ratios of times within one run, where the state of the machine
//! cancels out.

use std::collections::HashSet;
use std::hash::Hash;

use super::row::Row;

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
pub(super) fn threads_of(threads: usize) -> String {
    format!("{threads} thread{}", if threads == 1 { "" } else { "s" })
}

/// What is measured, one contestant over another; `*` stands for the best of all others whose names
/// begin so.
const RATIOS: [[&str; 3]; 21] = [
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
    ["incoherent", "pivot wide", "embree single, robust"],
    ["incoherent", "pivot wide, fast", "embree single"],
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
pub(super) fn middle(row: &Row) -> &'static str {
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

/// The times of all rows that both runs have, and those of the second over those of the first.
pub(super) fn side_by_side(rows: &[Row], others: &[Row]) -> String {
    let mut text = format!("\n  {:<80} {:>10} {:>10} {:>8}\n", "", "ms", "beside", "ratio");
    for row in rows {
        let names = |row: &Row| [&row.what, &row.scene, &row.contestant].map(Clone::clone);
        let key = |row: &Row| (names(row), row.triangles, row.threads);
        let Some(other) = others.iter().find(|other| key(other) == key(row)) else { continue };
        let (ours, theirs, n) = (time(row), time(other), threads_of(row.threads));
        let title = format!("{}, {}, {}, {n}, {}", row.what, row.scene, row.contestant, middle(row));
        text += &format!("  {title:<80} {ours:>10.3} {theirs:>10.3} {:>8.2}\n", theirs / ours);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn rows_that_both_runs_have_stand_beside_each_other() {
        let row = |what: &str, threads, mean_ms: f64| Row {
            what: what.to_owned(),
            scene: "n-body".to_owned(),
            contestant: "pivot refit".to_owned(),
            threads,
            mean_ms,
            median_ms: 3.0,
            ..Row::default()
        };
        let text = side_by_side(
            &[row("update", 1, 2.0), row("update", 2, 1.0), row("trace", 1, 4.0)],
            &[row("trace", 1, 8.0), row("build", 2, 1.0), row("update", 1, 5.0)],
        );
        let lines: Vec<_> =
            text.lines().skip(2).map(|line| line.split_whitespace().collect::<Vec<_>>()).collect();
        assert_eq!(lines.len(), 2, "{text}");
        assert!(lines[0].ends_with(&["mean", "2.000", "5.000", "2.50"]), "{text}");
        assert!(lines[1].ends_with(&["median", "3.000", "3.000", "1.00"]), "{text}");
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
