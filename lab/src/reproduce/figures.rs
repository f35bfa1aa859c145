//! The paper's figures, drawn so that they can be laid beside it.

use serde::Serialize;

use super::accuracy::Section;
use super::chart::{Chart, Kind, Point, Series, figure};
use super::contestants::{Contestant, IDEAL, IDEAL_PARALLEL_BINNED};
use super::record::{Row, mean_update_ms};
use super::results::{Results, SceneRun, Spread};
use super::{MUSEUM, OTHER_KEYS, SPEED_STRATEGIES, SPEED_STRATEGY, SPEEDS, accuracy};
use crate::stage;

/// A figure: a file, and a part of the report.
#[derive(Serialize)]
pub(crate) struct Figure {
    /// Name without extension.
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) caption: String,
    pub(crate) svg: String,
}

/// Strategies drawn, if any of them was run.
const DRAWN: [&str; 6] =
    ["refit", "refit+rotate", "refit+rotate+regrow", "auto", IDEAL, IDEAL_PARALLEL_BINNED];

/// The place of a strategy in the list of all, which is its colour.
fn color(strategy: &str) -> usize {
    Contestant::all().iter().position(|contestant| contestant.name == strategy).unwrap_or(0)
}

/// The strategies of [`DRAWN`] that were run; all strategies if none of them was.
fn drawn(results: &Results) -> impl Iterator<Item = &String> {
    let all = &results.settings.strategies;
    let has_any = all.iter().any(|name| DRAWN.contains(&name.as_str()));
    all.iter().filter(move |name| !has_any || DRAWN.contains(&name.as_str()))
}

/// A line through places.
fn line(name: &str, color: usize, places: impl Iterator<Item = (f64, f64)>) -> Series {
    let points = places.map(|(x, y)| Point::at(x, y)).collect();
    Series { name: name.to_owned(), color, kind: Kind::Line, points }
}

/// Figure 4: time to update by scene and strategy, mean over frames.
fn update_times(results: &Results) -> Option<Chart> {
    let scenes: Vec<_> = results.main_scenes().filter(|scene| !scene.rows.is_empty()).collect();
    let series = drawn(results).filter(|name| *name != IDEAL).map(|name| {
        let point = |(place, scene): (usize, &&SceneRun)| {
            let rows = scene.of(name);
            let Spread { p10: low, p90: high, .. } = Spread::of(rows.iter().map(|row| row.update_ms))?;
            Some(Point { low, high, ..Point::at(place as f64, mean_update_ms(&rows)) })
        };
        let points = scenes.iter().enumerate().filter_map(point).collect();
        Series { name: name.clone(), color: color(name), kind: Kind::Bars, points }
    });
    (!scenes.is_empty()).then(|| Chart {
        y_label: "update time, ms".to_owned(),
        series: series.collect(),
        places: scenes.iter().map(|scene| scene.label.clone()).collect(),
        ..Chart::default()
    })
}

type Measure = (&'static str, &'static str, fn(&Row) -> f64);

/// What figures 5 and 6 show on the left, and on the right.
const MEASURES: [Measure; 2] =
    [("frame time", "update + trace, ms", |row| row.frame_ms), ("SAH cost", "SAH cost", |row| row.sah_cost)];

/// A chart of each measure for one scene, with the lines that `series` makes of it. A
/// vertical rule ends each of `loops` loops, which are `length` long on the x axis.
fn pair(
    scene: &SceneRun,
    x_label: &str,
    (loops, length): (usize, usize),
    series: impl Fn(fn(&Row) -> f64) -> Vec<Series>,
) -> [Chart; 2] {
    MEASURES.map(|(title, y_label, value)| Chart {
        title: format!("{}: {title}", scene.label),
        x_label: x_label.to_owned(),
        y_label: y_label.to_owned(),
        series: series(value),
        rules: (1..=loops).map(|round| (round * length) as f64).collect(),
        ..Chart::default()
    })
}

/// Figure 6 for one scene: (a) frame time, (b) SAH cost, over all loops.
fn over_frames(results: &Results, scene: &SceneRun) -> Option<[Chart; 2]> {
    let last = scene.rows.last()?;
    Some(pair(scene, "frame", (last.round, last.frames_per_loop), |value| {
        let at = |row: &Row| (row.step() as f64, value(row));
        drawn(results).map(|name| line(name, color(name), scene.of(name).into_iter().map(at))).collect()
    }))
}

/// Figure 5 for one scene: refitting with rotations at several speeds, over loops, and other
/// updates at the fastest.
fn over_loops(scene: &SceneRun) -> Option<[Chart; 2]> {
    let last = scene.speed_rows.iter().map(|row| row.round).max()?;
    let speeds = SPEEDS.map(|frames| (format!("{frames} frames a loop"), frames, SPEED_STRATEGY));
    // Of the fastest motion, where they ran.
    let other = |&name: &&'static str| {
        let ran = !scene.at_speed(SPEEDS[0], name).is_empty();
        ran.then(|| (format!("{name}, {} frames", SPEEDS[0]), SPEEDS[0], name))
    };
    let others = SPEED_STRATEGIES[1..].iter().filter_map(other);
    let all: Vec<_> = speeds.into_iter().chain(others).collect();
    Some(pair(scene, "loops of the animation", (last, 1), |value| {
        let drawn = |(color, (name, frames, strategy)): (usize, &(String, usize, &str))| {
            let at = |row: &Row| (row.round as f64 + row.frame as f64 / *frames as f64, value(row));
            line(name, color, scene.at_speed(*frames, strategy).into_iter().map(at))
        };
        all.iter().enumerate().map(drawn).collect()
    }))
}

/// The museum from all its key frames: cost with rotations, over loops.
fn from_other_keys(results: &Results) -> Option<Chart> {
    let runs: Vec<_> = [MUSEUM].iter().chain(&OTHER_KEYS).filter_map(|name| results.scene(name)).collect();
    let at = |row: &Row| (row.step() as f64, row.sah_cost);
    let line =
        |(i, scene): (usize, &&SceneRun)| line(&scene.label, i, scene.of(SPEED_STRATEGY).into_iter().map(at));
    (runs.len() > 1).then(|| Chart {
        title: "bart-museum, started from each key frame".to_owned(),
        x_label: "frame".to_owned(),
        y_label: "SAH cost with rotations".to_owned(),
        series: runs.iter().enumerate().map(line).collect(),
        ..Chart::default()
    })
}

/// All figures, in the order of the report.
pub(crate) fn all(results: &Results) -> Vec<Figure> {
    let mut figures = Vec::new();
    let mut add = |name: String, title: &str, caption: &str, charts: &[Chart], columns| {
        let svg = figure(charts, columns);
        figures.push(Figure { name, title: title.to_owned(), caption: caption.to_owned(), svg });
    };
    if let Some(chart) = update_times(results).filter(|_| wanted(results, "fig4")) {
        let caption = "Mean over frames; thin lines span the middle 80 %. The paper shows refit, refit+rotate and \
                       ideal-parallel-binned. Strategies not drawn are in the tables of scenes and in frames.csv.";
        add("fig4".to_owned(), "Time to update (figure 4)", caption, &[chart], 1);
    }
    for scene in results.main_scenes().filter(|_| wanted(results, "fig6")) {
        if let Some(charts) = over_frames(results, scene) {
            let title = format!("Frame time and cost, {} (figure 6)", scene.label);
            let caption = "Left: time to update and render. Right: SAH cost of the tree rendered. A vertical line \
                           marks the jump from the end of the animation to its start.";
            add(format!("fig6-{}", scene.slug), &title, caption, &charts, 2);
        }
    }
    for scene in &results.scenes {
        if let Some(charts) = over_loops(scene) {
            let title = format!("Speed of the animation, {} (figure 5)", scene.label);
            let caption = "Refitting with rotations; the same motion in fewer or more frames.";
            add(format!("fig5-{}", scene.slug), &title, caption, &charts, 2);
        }
    }
    if let Some(chart) = from_other_keys(results) {
        let caption = "The paper blames its exception on the first frame, which makes a poor first tree. Here the loop \
                       starts from each of the five shapes, with the tree of that shape.";
        add("museum-keys".to_owned(), "The museum from its other key frames", caption, &[chart], 1);
    }
    for Section { knob, charts, .. } in accuracy::sections(&results.accuracy) {
        let title = format!("What accuracy costs in time: {knob}");
        let columns = charts.len().min(2);
        add(format!("accuracy-{}", stage::slug(&knob)), &title, accuracy::LEGEND, &charts, columns);
    }
    figures
}

/// Whether an experiment, or the claims that rest on it, were asked for.
fn wanted(results: &Results, experiment: &str) -> bool {
    results.settings.experiments.iter().any(|e| e == experiment || e == "claims")
}
