//! What the points look like: a chart of scattered settings for each family, and a sentence on what
//! to choose.

use super::advice::{Cost, sentence};
use super::curve::{Family, families, pareto_front};
use crate::reproduce::chart::{Chart, Kind, Point, Series};
use crate::reproduce::results::SceneRun;

/// Each knob with its error, and what to choose.
pub(crate) fn sentences(scene: &SceneRun) -> impl Iterator<Item = (String, String)> {
    families(&scene.accuracy).into_iter().map(|f| (format!("{}, {}", f.knob, f.error_name), sentence(&f)))
}

/// The charts of a scene, and what they say.
pub(crate) fn charts(scene: &SceneRun) -> (Vec<Chart>, String) {
    let families = families(&scene.accuracy);
    let sentences: Vec<_> = sentences(scene).map(|(knob, words)| format!("{knob}: {words}")).collect();
    let legend = "Lower left is better. Filled: on the Pareto front. Ringed: the default. accuracy.csv holds every point \
                  and what was timed.";
    (families.iter().map(chart).collect(), format!("{legend} {}", sentences.join(" ")))
}

fn chart(family: &Family<'_>) -> Chart {
    let (cost, noise) = (Cost::of(family), family.noise());
    let series = family.curves.iter().enumerate().map(|(color, curve)| {
        let places: Vec<_> = curve.points.iter().map(|point| (cost.at(point), point.error)).collect();
        let points = curve.points.iter().zip(pareto_front(&places, noise)).map(|(point, is_filled)| Point {
            label: point.setting.clone(),
            is_filled,
            is_ringed: point.is_default,
            ..Point::at(cost.at(point), point.error)
        });
        Series { name: curve.condition.to_owned(), color, kind: Kind::Marks, points: points.collect() }
    });
    Chart {
        title: family.knob.to_owned(),
        x_label: cost.axis().to_owned(),
        y_label: format!("{}, {}", family.error_name, family.unit),
        series: series.collect(),
        ..Chart::default()
    }
}
