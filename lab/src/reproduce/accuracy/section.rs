//! What the points look like: for each knob a chart of scattered settings for each error, and
//! tables.

use super::curve::{Curve, Family, families, pareto_front};
use super::point::Point;
use crate::compare::unique;
use crate::reproduce::chart::{self, Chart, Kind, Series, precise};

/// A knob in the report.
pub(crate) struct Section {
    pub(crate) knob: String,
    pub(crate) charts: Vec<Chart>,
    /// In Markdown, one for each error.
    pub(crate) tables: String,
}

/// What every chart and table of this kind means.
pub(crate) const LEGEND: &str = "Lower left is better. Filled: on the Pareto front. Ringed: the default. accuracy.csv \
                                 holds every point and what was timed.";

/// A section for each knob.
pub(crate) fn sections(points: &[Point]) -> Vec<Section> {
    let section = |of_knob: &[Family<'_>]| Section {
        knob: of_knob[0].knob.to_owned(),
        charts: of_knob.iter().map(draw).collect(),
        tables: of_knob.iter().map(table).collect(),
    };
    families(points).chunk_by(|a, b| a.knob == b.knob).map(section).collect()
}

/// What a setting costs: memory where it takes some, time otherwise.
fn cost(point: &Point) -> f64 {
    point.bytes.map_or(point.time_ms, |bytes| bytes as f64 * 1e-6)
}

/// What [`cost`] is, and its unit.
fn cost_words(family: &Family<'_>) -> [&'static str; 2] {
    let mut points = family.curves.iter().flat_map(|curve| &curve.points);
    if points.any(|point| point.bytes.is_some()) { ["memory", "MB"] } else { ["time", "ms"] }
}

fn front(family: &Family<'_>, curve: &Curve<'_>) -> Vec<bool> {
    let places: Vec<_> = curve.points.iter().map(|point| (cost(point), point.error)).collect();
    pareto_front(&places, family.noise())
}

fn draw(family: &Family<'_>) -> Chart {
    let series = family.curves.iter().enumerate().map(|(color, curve)| {
        let points = curve.points.iter().zip(front(family, curve)).map(|(point, is_filled)| chart::Point {
            label: point.setting.clone(),
            is_filled,
            is_ringed: point.is_default,
            ..chart::Point::at(cost(point), point.error)
        });
        Series { name: curve.name(), color, kind: Kind::Marks, points: points.collect() }
    });
    Chart {
        title: family.knob.to_owned(),
        x_label: cost_words(family).join(", "),
        y_label: format!("{}, {}", family.error_name, family.unit),
        series: series.collect(),
        ..Chart::default()
    }
}

/// Errors and costs of all settings, those on the Pareto front in bold.
fn table(family: &Family<'_>) -> String {
    let name = |curve: &Curve<'_>| if curve.name().is_empty() { "error".to_owned() } else { curve.name() };
    let names: Vec<_> = family.curves.iter().map(name).collect();
    let mut text = format!(
        "\n{}: {} ({}), and in brackets the {}\n\n| setting | {} |\n|---|{}\n",
        family.knob,
        family.error_name,
        family.unit,
        cost_words(family).join(" in "),
        names.join(" | "),
        "---|".repeat(names.len())
    );
    let points = family.curves.iter().flat_map(|curve| &curve.points);
    let settings = unique(points.map(|point| point.setting.as_str()));
    for setting in settings {
        text += &format!("| {setting} |");
        for curve in &family.curves {
            let at =
                curve.points.iter().zip(front(family, curve)).find(|(point, _)| point.setting == setting);
            text += &at.map_or(" – |".to_owned(), |(point, is_best)| {
                let (bold, default) =
                    (if is_best { "**" } else { "" }, if point.is_default { "\\*" } else { "" });
                format!(" {bold}{}{bold} ({}){default} |", precise(point.error), precise(cost(point)))
            });
        }
        text += "\n";
    }
    let is_resolution = ["step", "key frames", "samples"].iter().any(|word| family.knob.contains(word));
    let orders: Vec<_> = family.curves.iter().map(|curve| curve.order().filter(|_| is_resolution)).collect();
    if orders.iter().any(Option::is_some) {
        let cells = orders.iter().map(|order| order.map_or("–".to_owned(), |order| format!("{order:.2}")));
        text += &format!("| *order of convergence* | {} |\n", cells.collect::<Vec<_>>().join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_every_setting_and_the_order() {
        let point = |n: u32, error, at: &str| {
            Point::new(&format!("step{at}"), &format!("{n} steps"), n == 8, f64::from(n))
                .with("distance", error, "m")
        };
        let points = [point(4, 4.0, ""), point(8, 2.0, ""), point(16, 1.0, ""), point(4, 0.0, " at rest")];
        let [section] = &sections(&points)[..] else { panic!("one knob") };
        for line in [
            "| setting | error | rest |",
            "| 4 steps | **4.00** (4.00) | **0** (4.00) |",
            "| 8 steps | **2.00** (8.00)\\* | – |",
            "| *order of convergence* | 1.00 | – |",
        ] {
            assert!(section.tables.contains(line), "{}", section.tables);
        }
        assert_eq!((section.charts.len(), section.charts[0].series.len()), (1, 2));
    }

    #[test]
    fn only_what_nothing_beats_is_bold() {
        let point = |setting: &str, time_ms, error| Point {
            noise: Some(1.3),
            ..Point::new("bins", setting, false, time_ms).with("time", error, "ms")
        };
        let points = [point("16", 1.0, 1.1), point("32", 1.2, 1.0), point("slow", 3.0, 5.0)];
        let tables = &sections(&points)[0].tables;
        assert!(
            tables.contains("| 16 | **1.10**")
                && tables.contains("| 32 | 1.00")
                && tables.contains("| slow | 5.00")
        );
    }

    /// `docs/ACCURACY.md` links to the folders that its tables are of: the last that has a knob.
    #[test]
    fn the_page_shows_the_rows_it_links_to() {
        let docs = crate::files::workspace().join("docs");
        let page = std::fs::read_to_string(docs.join("ACCURACY.md")).unwrap();
        let links = page.split("/accuracy.csv)").filter_map(|before| before.rsplit_once("](benchmarks/"));
        let mut shown = std::collections::BTreeMap::new();
        for folder in links.map(|(_, link)| format!("benchmarks/{link}")).filter(|f| docs.join(f).is_dir()) {
            let points: Vec<Point> =
                crate::reproduce::journal::read(&docs.join(&folder).join("accuracy.csv")).unwrap();
            shown.extend(sections(&points).into_iter().map(|s| (s.knob.clone(), (folder.clone(), s))));
        }
        assert!(shown.len() >= 10, "ten knobs");
        for (folder, section) in shown.into_values() {
            for table in section.tables.trim().split("\n\n").filter(|part| part.starts_with('|')) {
                assert!(page.contains(table), "the page lacks this table:\n{table}");
            }
            let chart = format!("{folder}/figures/accuracy-{}.svg", crate::stage::slug(&section.knob));
            assert!(page.contains(&chart) && docs.join(&chart).is_file(), "{chart}");
        }
    }
}
