//! What the points look like: panels of scattered settings, for the report and as files, with a sentence below each.

use maud::{Markup, PreEscaped, html};

use super::advice::{Cost, sentence};
use super::curve::{Family, families, pareto_front};
use super::point::Point;
use crate::reproduce::chart::{Mark, SCATTER_SIZE, Scatter, Series, precise};
use crate::reproduce::figures::{Figure, STYLE};
use crate::reproduce::results::{Results, SceneRun};

/// The panel of a family.
fn scatter<'a>(family: &Family<'a>) -> Scatter<'a> {
    let (cost, noise) = (Cost::of(family), family.noise());
    let series = family.curves.iter().map(|curve| {
        let points: Vec<_> = curve.points.iter().map(|point| (cost.at(point), point.error)).collect();
        let marks = curve.points.iter().zip(points.iter().zip(pareto_front(&points, noise)));
        let mark = |(point, (&(x, y), on_front)): (&&'a Point, (&(f64, f64), bool))| Mark {
            x,
            y,
            label: &point.setting,
            on_front,
            is_default: point.is_default,
            hover: hover(point, cost),
        };
        Series { name: curve.condition, marks: marks.map(mark).collect() }
    });
    Scatter {
        title: family.knob,
        x_label: if cost == Cost::Megabytes { "memory, MB".to_owned() } else { "time, ms".to_owned() },
        y_label: format!("{}, {}", family.error_name, family.unit),
        series: series.collect(),
    }
}

fn hover(point: &Point, cost: Cost) -> String {
    let Point { knob, setting, error, unit, note, .. } = point;
    let condition =
        knob.split_once(" at ").map(|(_, condition)| format!(" at {condition}")).unwrap_or_default();
    let default = if point.is_default { " (the default)" } else { "" };
    let (x, y) = (precise(cost.at(point)), precise(*error));
    format!("{setting}{condition}{default}: {x} {}, {y} {unit}; {note}", cost.unit())
}

/// What the notes of all points have in common.
fn notes(family: &Family<'_>) -> String {
    let points = || family.curves.iter().flat_map(|curve| &curve.points);
    let first = points().next().map_or("", |point| &point.note);
    let of_all = |clause: &&str| points().all(|point| point.note.split("; ").any(|other| other == *clause));
    let mut text = first.split("; ").filter(of_all).collect::<Vec<_>>().join("; ");
    if let Some(letter) = text.get_mut(..1) {
        letter.make_ascii_uppercase();
        text.push('.');
    }
    text
}

/// The section of the report; nothing if nothing was measured.
pub(crate) fn html(results: &Results) -> Markup {
    let scenes: Vec<_> = results.scenes.iter().filter(|scene| !scene.accuracy.is_empty()).collect();
    if scenes.is_empty() {
        return Markup::default();
    }
    html! {
        section {
            h2 { "What accuracy costs in time" }
            p {
                "Every setting of every knob: its error to the top, what it costs to the right, so that lower left is better. "
                "Settings that nothing beats in both, the Pareto front, are filled and joined; defaults have rings, \
                 of builders one for each that has a setting. Times that differ no more than the reference does from itself are equal. \
                 Zero stands below a dotted line where the axis is logarithmic. All points, with what was timed, are in "
                code { "accuracy.csv" } "."
            }
            @for scene in scenes {
                div data-scene=(scene.facts.label) {
                    h3 { (scene.facts.label) }
                    div.panels {
                        @for family in families(&scene.accuracy) {
                            figure {
                                div.scroll { (scatter(&family).svg((0.0, 0.0))) }
                                figcaption { (sentence(&family)) " " (notes(&family)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A file for each scene.
pub(crate) fn figures(results: &Results) -> Vec<Figure> {
    results.scenes.iter().filter(|scene| !scene.accuracy.is_empty()).map(figure).collect()
}

fn figure(scene: &SceneRun) -> Figure {
    let families = families(&scene.accuracy);
    let (width, height) = SCATTER_SIZE;
    let svg = html! {
        @let all = (2.0 * width, families.len().div_ceil(2) as f64 * height + HEAD);
        svg xmlns="http://www.w3.org/2000/svg" width=(all.0) height=(all.1)
            viewBox=(format!("0 0 {} {}", all.0, all.1)) {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="var(--paper)" {}
            g class="chart" {
                text class="title" x="12" y="20" { (scene.facts.label) }
                text class="label" x=(all.0 - 14.0) y="20" text-anchor="end" {
                    "filled: on the Pareto front; ring: the default"
                }
            }
            @for (i, family) in families.iter().enumerate() {
                (scatter(family).svg(((i % 2) as f64 * width, HEAD + (i / 2) as f64 * height)))
            }
        }
    };
    Figure { name: format!("accuracy-{}", scene.facts.slug), svg: svg.into_string() }
}

/// Height of the line above a figure.
const HEAD: f64 = 32.0;
