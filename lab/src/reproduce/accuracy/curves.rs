//! The points of each knob as curves.
//!
//! A curve has one error under one condition. A chart shows which of its points nothing beats, and
//! a table lists all of them.

use super::Point;
use crate::compare::unique;
use crate::reproduce::chart::{self, Chart, Kind, Series, precise};

/// One error of one knob, on all scenes and under all conditions.
pub(super) struct Family<'a> {
    pub(super) knob: &'a str,
    pub(super) error_name: &'a str,
    unit: &'a str,
    pub(super) curves: Vec<Curve<'a>>,
}

/// The settings of a knob on one scene under one condition.
pub(super) struct Curve<'a> {
    pub(super) scene: &'a str,
    /// Empty if there is but one.
    pub(super) condition: &'a str,
    pub(super) points: Vec<&'a Point>,
}

/// Sorts points into families, in the order of their first points.
pub(super) fn families(points: &[Point]) -> Vec<Family<'_>> {
    let mut families: Vec<Family<'_>> = Vec::new();
    for point in points {
        let (knob, condition) = point.knob.split_once(" at ").unwrap_or((&point.knob, ""));
        let same = |f: &Family<'_>| f.knob == knob && f.error_name == point.error_name;
        let at = families.iter().position(same).unwrap_or_else(|| {
            let (error_name, unit) = (&point.error_name, &point.unit);
            families.push(Family { knob, error_name, unit, curves: Vec::new() });
            families.len() - 1
        });
        let (curves, scene) = (&mut families[at].curves, point.scene.as_str());
        match curves.iter_mut().find(|curve| (curve.scene, curve.condition) == (scene, condition)) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { scene, condition, points: vec![point] }),
        }
    }
    families
}

impl<'a> Curve<'a> {
    /// The scene and the condition.
    pub(super) fn name(&self) -> String {
        let parts = [self.scene, self.condition].into_iter().filter(|part| !part.is_empty());
        parts.collect::<Vec<_>>().join(", ")
    }

    pub(super) fn get(&self, setting: &str) -> Option<&'a Point> {
        self.points.iter().copied().find(|point| point.setting == setting)
    }

    /// The order of convergence, where settings are numbers of steps: the slope p of the line
    /// through the logarithms of error = c / number^p that fits best.
    fn order(&self) -> Option<f64> {
        let place = |point: &&Point| {
            let number: f64 = point.setting.split(' ').next()?.parse().ok()?;
            Some((number.ln(), point.error.ln()))
        };
        let places: Vec<_> =
            self.points.iter().filter(|p| p.error > 0.0).map(place).collect::<Option<_>>()?;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| places.iter().map(of).sum::<f64>() / places.len() as f64;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        let slope = mean(&|p| (p.0 - x) * (p.1 - y)) / mean(&|p| (p.0 - x).powi(2));
        (places.len() > 2 && slope.is_finite()).then_some(-slope)
    }
}

/// Of points (cost, error), less of either being better: whether each is on the Pareto front, that
/// is, none is at least as good in both and better in one, where errors that differ by no more than
/// a factor `noise` are equal. Points that are not numbers never are. O(n log n).
fn pareto_front(points: &[(f64, f64)], noise: f64) -> Vec<bool> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| !points[i].0.is_nan() && !points[i].1.is_nan()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut front = vec![false; points.len()];
    let mut last: Option<(f64, f64)> = None;
    for i in order {
        // Twins stay together.
        front[i] = last.is_none_or(|last| noise * points[i].1 < last.1 || points[i] == last);
        if front[i] {
            last = Some(points[i]);
        }
    }
    front
}

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
    // The factor within which errors are equal: 1 where they are exact.
    let all = family.curves.iter().flat_map(|curve| &curve.points);
    let noise = all.filter_map(|point| point.noise).fold(1.0, f64::max);
    let places: Vec<_> = curve.points.iter().map(|point| (cost(point), point.error)).collect();
    pareto_front(&places, noise)
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
        "\n{}: {} ({}), and in brackets the {}; bold: on the Pareto front, \\*: the default\n\n\
         | setting | {} |\n|---|{}\n",
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
    fn the_front_is_what_nothing_beats() {
        let points = [
            (1.0, 9.0),
            (2.0, 4.0),
            // As slow as the one before, and worse; as accurate, and slower.
            (2.0, 5.0),
            (3.0, 4.0),
            (4.0, 1.0),
            // Twins stay together.
            (5.0, 0.0),
            (5.0, 0.0),
            (6.0, 0.5),
            (f64::NAN, 0.0),
            (0.0, f64::NAN),
            (f64::INFINITY, -1.0),
        ];
        let front = pareto_front(&points, 1.0);
        let expected = [true, true, false, false, true, true, true, false, false, false, true];
        assert_eq!(front, expected);
        assert!(pareto_front(&[], 1.0).is_empty());
        // Of equal errors the cheapest is on it; step by step they lead to one that is not equal.
        let points = [(1.0, 1.08), (2.0, 1.04), (3.0, 1.0), (4.0, 0.98)];
        assert_eq!(pareto_front(&points, 1.05), [true, false, true, false]);
        // Against the definition by another way: sorted by cost, the front goes strictly down.
        let mut random = fastrand::Rng::with_seed(3);
        let points: Vec<(f64, f64)> = (0..200).map(|_| (random.f64(), random.f64())).collect();
        let mut sorted = points.clone();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut least = f64::INFINITY;
        let down: Vec<_> = sorted
            .into_iter()
            .filter(|p| {
                p.1 < least && {
                    least = p.1;
                    true
                }
            })
            .collect();
        let mut front: Vec<_> =
            points.iter().zip(pareto_front(&points, 1.0)).filter_map(|(p, on)| on.then_some(*p)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert_eq!(front, down);
    }

    #[test]
    fn points_are_sorted_by_knob_error_and_condition() {
        let point = |knob: &str, error_name: &str| Point {
            knob: knob.to_owned(),
            error_name: error_name.to_owned(),
            ..Point::default()
        };
        let points = [
            point("test at near", "leaks"),
            point("test at near", "distance"),
            point("test at far", "leaks"),
            point("test at far", "leaks"),
            point("bins", "cost"),
        ];
        let families = families(&points);
        let shape: Vec<_> = families
            .iter()
            .map(|f| (f.knob, f.error_name, f.curves.iter().map(|c| c.points.len()).collect::<Vec<_>>()))
            .collect();
        let expected =
            [("test", "leaks", vec![1, 2]), ("test", "distance", vec![1]), ("bins", "cost", vec![1])];
        assert_eq!(shape, expected);
        assert_eq!(families[0].curves[1].name(), "far");
    }

    #[test]
    fn the_order_is_the_slope_of_the_logarithms() {
        let point = |n: u32| Point {
            error: 3.0 / f64::from(n * n),
            ..Point::new("step", &format!("{n} steps"), false, 0.0)
        };
        let points = [point(4), point(8), point(64)];
        let order = |points: &[Point]| families(points)[0].curves[0].order();
        assert!((order(&points).unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(
            order(&[point(4), point(8), Point::new("step", "sweep", false, 0.0).with("", 1.0, "")]),
            None
        );
        assert_eq!(order(&points[..2]), None);
    }

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
