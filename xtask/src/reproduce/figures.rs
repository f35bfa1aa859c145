//! The paper's figures, drawn so that they can be laid beside it.

use maud::{Markup, PreEscaped, html};

use super::accuracy;
use super::chart::{Bar, Bars, Line, PANEL_SIZE, Panel};
use super::contestants::{IDEAL, IDEAL_PARALLEL_BINNED};
use super::record::Row;
use super::results::{Results, SceneRun, Spread};

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

/// What lines are drawn of: the accounting rows of the paper stand for the rebuilds they are made of.
fn drawn<'a>(results: &'a Results) -> impl Iterator<Item = &'static str> + 'a {
    let all = &results.settings.strategies;
    let stands_for = |name: &str| match name {
        "sweep" => Some(IDEAL),
        "binned" => Some(IDEAL_PARALLEL_BINNED),
        _ => None,
    };
    all.iter().copied().filter(move |name| stands_for(name).is_none_or(|other| !all.contains(&other)))
}

/// Strategies drawn as lines.
pub(crate) fn line_keys(results: &Results) -> Vec<Key> {
    drawn(results).map(|name| (class(name), name.to_owned())).collect()
}

/// Strategies drawn as bars: all whose time counts.
pub(crate) fn bar_keys(results: &Results) -> Vec<Key> {
    let all = results.settings.strategies.iter().filter(|&&name| name != IDEAL);
    all.map(|&name| (class(name), name.to_owned())).collect()
}

/// Figure 4: time to update by scene and strategy, median over frames.
pub(crate) fn update_times(results: &Results) -> Option<Bars<'static>> {
    let bar = |scene: &SceneRun, (class, name): Key| {
        let spread = Spread::of(scene.of(&name).iter().map(|row| row.update_ms))?;
        Some(Bar { class, name, value: spread.median, low: spread.p10, high: spread.p90 })
    };
    let groups: Vec<_> = results
        .scenes
        .iter()
        .map(|scene| {
            let bars = bar_keys(results).into_iter().filter_map(|key| bar(scene, key)).collect();
            (scene.facts.label.clone(), bars)
        })
        .filter(|(_, bars): &(_, Vec<_>)| !bars.is_empty())
        .collect();
    (!groups.is_empty()).then_some(Bars { y_label: "update time, ms", groups })
}

/// Figure 6 for one scene: (a) frame time, (b) SAH cost, over all loops.
pub(crate) fn over_frames(results: &Results, scene: &SceneRun) -> Option<[Panel<'static>; 2]> {
    if scene.rows.is_empty() {
        return None;
    }
    let frames = scene.facts.frames;
    let last = scene.rows.last().map_or(0, |row| row.round * frames + row.frame);
    let panel = |title: &str, y_label, value: fn(&Row) -> f64| Panel {
        title: format!("{}: {title}", scene.facts.label),
        x_label: "frame",
        y_label,
        lines: line_keys(results)
            .into_iter()
            .map(|(class, name)| {
                let point = |row: &Row| ((row.round * frames + row.frame) as f64, value(row));
                Line { points: scene.of(&name).into_iter().map(point).collect(), class, name }
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
                Line { points: rows.iter().map(|row| (x(row), value(row))).collect(), class, name }
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

/// All figures as files: figure 4, figure 6 as a whole and scene by scene, figure 5.
pub(crate) fn files(results: &Results) -> Vec<Figure> {
    let mut figures = Vec::new();
    if let Some(bars) = update_times(results).filter(|_| wanted(results, "fig4")) {
        let (width, height) = bars.size();
        figures.push(file("fig4", width, height, &bar_keys(results), &bars.svg((0.0, LEGEND))));
    }
    if wanted(results, "fig6") {
        let scenes: Vec<_> = results
            .scenes
            .iter()
            .filter_map(|scene| Some((format!("fig6-{}", scene.facts.slug), over_frames(results, scene)?)))
            .collect();
        let keys = line_keys(results);
        figures.extend(scenes.iter().map(|(name, panels)| pair(name, &[panels], &keys)));
        let rows: Vec<_> = scenes.iter().map(|(_, panels)| panels).collect();
        if rows.len() > 1 {
            figures.push(pair("fig6", &rows, &keys));
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
    results.settings.experiments.iter().any(|&e| e == experiment || e == "claims")
}

/// Height of a legend above a figure.
const LEGEND: f64 = 30.0;

/// Pairs of panels below one another.
fn pair(name: &str, rows: &[&[Panel<'_>; 2]], keys: &[Key]) -> Figure {
    let (width, height) = PANEL_SIZE;
    let content = html! {
        @for (i, [a, b]) in rows.iter().enumerate() {
            @let y = LEGEND + i as f64 * height;
            (a.svg((0.0, y)))
            (b.svg((width, y)))
        }
    };
    file(name, 2.0 * width, rows.len() as f64 * height, keys, &content)
}

fn file(name: &str, width: f64, height: f64, keys: &[Key], content: &Markup) -> Figure {
    let height = height + LEGEND;
    let starts = keys.iter().scan(12.0, |x, (_, name)| {
        let start = *x;
        *x += 40.0 + 6.6 * name.chars().count() as f64;
        Some(start)
    });
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height)
            viewBox=(format!("0 0 {width} {height}")) {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="var(--paper)" {}
            g class="chart" {
                @for ((class, name), x) in keys.iter().zip(starts) {
                    path class={ "line " (class) } d=(format!("M{x} 16h22")) {}
                    text x=(x + 28.0) y="20" { (name) }
                }
            }
            (content)
        }
    };
    Figure { name: name.to_owned(), svg: svg.into_string() }
}
