//! The paper's figures, drawn so that they can be laid beside it.

use maud::{Markup, PreEscaped, html};

use super::accuracy;
use super::chart::{Bar, Bars, Line, PANEL_SIZE, Panel};
use super::contestants::{IDEAL, IDEAL_PARALLEL_BINNED, PAPER, PAPER_BINNED};
use super::record::Row;
use super::results::{Results, SceneRun, Spread};
use super::{MUSEUM, OTHER_KEYS, SPEED_STRATEGY};

/// The style sheet that all charts share with the report.
pub(crate) const STYLE: &str = include_str!("chart/chart.css");

/// A figure as a file of its own.
pub(crate) struct Figure {
    /// Name without extension.
    pub(crate) name: String,
    pub(crate) svg: String,
}

/// A line's or a bar's name and class.
pub(crate) type Key = (String, String);

/// The class of a strategy in the style sheet.
pub(crate) fn class(strategy: &str) -> String {
    strategy.replace('+', "-")
}

/// Which strategies are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// Those of the paper's figures, if they were run.
    Paper,
    All,
}

/// What the report shows before anything is switched.
const SHOWN: [&str; 6] =
    ["refit", "refit+rotate", "refit+rotate+regrow", "auto", IDEAL, IDEAL_PARALLEL_BINNED];

/// Whether a strategy is hidden until it is switched on, where there are others to see.
pub(crate) fn is_off(results: &Results, strategy: &str) -> bool {
    !SHOWN.contains(&strategy) && results.settings.strategies.iter().any(|s| SHOWN.contains(&s.as_str()))
}

fn chosen(results: &Results, which: Which) -> impl Iterator<Item = &String> {
    let all = &results.settings.strategies;
    let is_paper = |name: &String| PAPER.contains(&name.as_str());
    let paper_only = which == Which::Paper && all.iter().any(is_paper);
    all.iter().filter(move |name| !paper_only || is_paper(name))
}

/// Strategies drawn as lines: the accounting rows of the paper stand for the rebuilds they are made of, and the slow
/// rebuild of the paper's code would dwarf all others.
pub(crate) fn line_keys(results: &Results, which: Which) -> Vec<Key> {
    let all = &results.settings.strategies;
    let stands_for = |name: &str| match name {
        "sweep" => Some(IDEAL),
        "binned" | PAPER_BINNED => Some(IDEAL_PARALLEL_BINNED),
        _ => None,
    };
    let has = |other: &str| all.iter().any(|name| name == other);
    let drawn = chosen(results, which).filter(|name| stands_for(name).is_none_or(|other| !has(other)));
    drawn.map(|name| (class(name), name.clone())).collect()
}

/// Strategies drawn as bars: all whose time counts.
pub(crate) fn bar_keys(results: &Results, which: Which) -> Vec<Key> {
    let timed = chosen(results, which).filter(|name| *name != IDEAL);
    timed.map(|name| (class(name), name.clone())).collect()
}

/// Figure 4: time to update by scene and strategy, mean over frames.
pub(crate) fn update_times(results: &Results, which: Which) -> Option<Bars<'static>> {
    let bar = |scene: &SceneRun, (class, name): Key| {
        let spread = Spread::of(scene.of(&name).iter().map(|row| row.update_ms))?;
        let off = is_off(results, &name);
        Some(Bar { class, name, value: spread.mean, low: spread.p10, high: spread.p90, off })
    };
    let groups: Vec<_> = results
        .main_scenes()
        .map(|scene| {
            let bars = bar_keys(results, which).into_iter().filter_map(|key| bar(scene, key)).collect();
            (scene.facts.label.clone(), bars)
        })
        .filter(|(_, bars): &(_, Vec<_>)| !bars.is_empty())
        .collect();
    (!groups.is_empty()).then_some(Bars { y_label: "update time, ms", groups })
}

/// Figure 6 for one scene: (a) frame time, (b) SAH cost, over all loops.
pub(crate) fn over_frames(results: &Results, scene: &SceneRun, which: Which) -> Option<[Panel<'static>; 2]> {
    if scene.rows.is_empty() {
        return None;
    }
    let frames = scene.facts.frames;
    let last = scene.rows.last().map_or(0, |row| row.round * frames + row.frame);
    let panel = |title: &str, y_label, value: fn(&Row) -> f64| Panel {
        title: format!("{}: {title}", scene.facts.label),
        x_label: "frame",
        y_label,
        lines: line_keys(results, which)
            .into_iter()
            .map(|(class, name)| {
                let point = |row: &Row| ((row.round * frames + row.frame) as f64, value(row));
                let points = scene.of(&name).into_iter().map(point).collect();
                Line { points, off: is_off(results, &name), class, name }
            })
            .collect(),
        rules: (1..=last / frames).map(|round| (round * frames) as f64).collect(),
    };
    Some([
        panel("frame time", "update + trace, ms", |row| row.frame_ms),
        panel("SAH cost", "SAH cost", |row| row.sah_cost),
    ])
}

/// Figure 5 for one scene: refitting with rotations at several speeds, over loops.
pub(crate) fn over_loops(scene: &SceneRun) -> Option<[Panel<'static>; 2]> {
    let last = scene.speeds.iter().flat_map(|(_, rows)| rows).map(|row| row.round).max()?;
    let panel = |title: &str, y_label, value: fn(&Row) -> f64| Panel {
        title: format!("{}: {title}", scene.facts.label),
        x_label: "loops of the animation",
        y_label,
        lines: scene
            .speeds
            .iter()
            .map(|(frames, rows)| {
                let x = |row: &Row| row.round as f64 + row.frame as f64 / *frames as f64;
                let (class, name) = speed_key(*frames);
                Line {
                    points: rows.iter().map(|row| (x(row), value(row))).collect(),
                    class,
                    name,
                    off: false,
                }
            })
            .collect(),
        rules: (1..=last).map(|round| round as f64).collect(),
    };
    Some([
        panel("frame time", "update + trace, ms", |row| row.frame_ms),
        panel("SAH cost", "SAH cost", |row| row.sah_cost),
    ])
}

/// Key of a line of figure 5.
pub(crate) fn speed_key(frames: usize) -> Key {
    (format!("loop-{frames}"), format!("{frames} frames a loop"))
}

/// The museum from all its key frames: cost with rotations, over loops.
pub(crate) fn from_other_keys(results: &Results) -> Option<Panel<'static>> {
    let runs: Vec<_> = [MUSEUM].iter().chain(&OTHER_KEYS).filter_map(|name| results.scene(name)).collect();
    let first = runs.first().filter(|_| runs.len() > 1)?;
    let frames = first.facts.frames;
    let line = |(i, scene): (usize, &&SceneRun)| {
        let point = |row: &&Row| ((row.round * frames + row.frame) as f64, row.sah_cost);
        let points = scene.of(SPEED_STRATEGY).iter().map(point).collect();
        Line { class: format!("key-{i}"), name: scene.facts.label.clone(), points, off: false }
    };
    Some(Panel {
        title: "bart-museum, started from each key frame".to_owned(),
        x_label: "frame",
        y_label: "SAH cost with rotations",
        lines: runs.iter().enumerate().map(line).collect(),
        rules: Vec::new(),
    })
}

/// All figures as files: figure 4 and 6 with the paper's strategies and with all, figure 5.
pub(crate) fn files(results: &Results) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (which, name) in [(Which::Paper, "fig4"), (Which::All, "fig4-all")] {
        if let Some(bars) = update_times(results, which).filter(|_| wanted(results, "fig4")) {
            let bars = bars.all_on();
            let (width, height) = bars.size();
            figures.push(file(name, width, height, &bar_keys(results, which), |y| bars.svg((0.0, y))));
        }
    }
    if wanted(results, "fig6") {
        let panels =
            |which| results.main_scenes().filter_map(move |s| Some((s, over_frames(results, s, which)?)));
        let keys = line_keys(results, Which::All);
        for (scene, panels) in panels(Which::All) {
            figures.push(pair(&format!("fig6-{}", scene.facts.slug), &[&panels], &keys));
        }
        let rows: Vec<_> = panels(Which::Paper).map(|(_, panels)| panels).collect();
        if !rows.is_empty() {
            figures.push(pair("fig6", &rows.iter().collect::<Vec<_>>(), &line_keys(results, Which::Paper)));
        }
    }
    for scene in &results.scenes {
        if let Some(panels) = over_loops(scene) {
            let keys: Vec<_> = scene.speeds.iter().map(|(frames, _)| speed_key(*frames)).collect();
            figures.push(pair(&format!("fig5-{}", scene.facts.slug), &[&panels], &keys));
        }
    }
    figures.extend(accuracy::figures(results));
    figures
}

/// Whether an experiment, or the claims that rest on it, were asked for.
pub(crate) fn wanted(results: &Results, experiment: &str) -> bool {
    results.settings.experiments.iter().any(|e| e == experiment || e == "claims")
}

/// Height of a row of a legend above a figure.
const LEGEND_ROW: f64 = 18.0;

/// Pairs of panels below one another.
fn pair(name: &str, rows: &[&[Panel<'_>; 2]], keys: &[Key]) -> Figure {
    let (width, height) = PANEL_SIZE;
    file(name, 2.0 * width, rows.len() as f64 * height, keys, |legend| {
        html! {
            @for (i, [a, b]) in rows.iter().enumerate() {
                @let y = legend + i as f64 * height;
                (a.svg((0.0, y)))
                (b.svg((width, y)))
            }
        }
    })
}

/// A file with a legend; `content` is told where it ends.
fn file(name: &str, width: f64, height: f64, keys: &[Key], content: impl Fn(f64) -> Markup) -> Figure {
    let (mut x, mut y) = (12.0, 16.0);
    let places: Vec<_> = keys
        .iter()
        .map(|(_, name)| {
            let needed = 40.0 + 6.6 * name.chars().count() as f64;
            if x + needed > width && x > 12.0 {
                (x, y) = (12.0, y + LEGEND_ROW);
            }
            x += needed;
            (x - needed, y)
        })
        .collect();
    let legend = y + LEGEND_ROW;
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height + legend)
            viewBox=(format!("0 0 {width} {}", height + legend)) {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="var(--paper)" {}
            g class="chart" {
                @for ((class, name), (x, y)) in keys.iter().zip(places) {
                    path class={ "line " (class) } d=(format!("M{x} {y}h22")) {}
                    text x=(x + 28.0) y=(y + 4.0) { (name) }
                }
            }
            (content(legend))
        }
    };
    // In a file of its own nothing can be switched on.
    Figure { name: name.to_owned(), svg: svg.into_string().replace(" data-off", "") }
}
