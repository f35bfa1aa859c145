//! What the report says of each scene: its frame plan, a film with heat maps, a table of
//! strategies, their decisions.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

use super::{capital, cell, plural, table};
use crate::effects::Cost;
use crate::reproduce::chart::{count, number};
use crate::reproduce::decisions::ALWAYS;
use crate::reproduce::offline::OfflineTree;
use crate::reproduce::results::{Picture, Results, SceneFacts, SceneRun, Spread};
use crate::reproduce::stages::StageSummary;
use crate::reproduce::summary::StrategySummary;

/// The strategy whose stages stand for those of a frame.
const TYPICAL: &str = "refit+rotate";

pub(super) fn sections(results: &Results) -> Markup {
    html! {
        section id="scenes" {
            p {
                "Times are means over the frames measured, with the middle 80 % beside them, in milliseconds; × compares \
                 the SAH cost with that of a fresh sweep build on the same frame."
            }
            @for scene in results.main_scenes() {
                div id={ "scene-" (scene.facts.slug) } data-scene=(scene.facts.label) { (section(scene)) }
            }
        }
    }
}

fn section(scene: &SceneRun) -> Markup {
    let facts = &scene.facts;
    let rows = &scene.strategies;
    let typical = rows.iter().find(|row| row.strategy == TYPICAL).or(rows.first());
    html! {
        h3 { (facts.label) }
        p {
            (capital(&facts.about)) ". " (count(facts.triangles as u64)) " triangles, "
            (count(facts.moving as u64)) " of them can move. First tree built in " (number(facts.build_ms)) " ms."
            @if facts.measure_every > 1 { " One frame in " (facts.measure_every) " measured, all updated." }
        }
        @for note in &facts.notes { p.soft { (capital(note)) "." } }
        (film(scene))
        (frame_plan(scene, typical))
        @if !facts.effect_costs.is_empty() { (effects(facts)) }
        @if !rows.is_empty() { (table(&HEADS, 1, rows.iter().map(strategy_row))) }
        @for row in rows.iter().filter(|row| !row.decisions.is_empty()) { (decisions(row)) }
        @if !scene.offline.is_empty() { (offline(scene)) }
    }
}

/// What a frame runs, and what its effects are; what is not called for is not in it.
fn frame_plan(scene: &SceneRun, typical: Option<&StrategySummary>) -> Markup {
    let facts = &scene.facts;
    let effects = if facts.effects.is_empty() { "nothing".to_owned() } else { facts.effects.join(", ") };
    let ran = |name: &str| typical.and_then(|row| row.stages.iter().find(|stage| stage.stage == name));
    let samples = typical.map_or(1, |row| row.samples.max(1)) as f64;
    let cell = |stage: &StageSummary| {
        format!("{} {}, {} ms", number(stage.count as f64 / samples), stage.counts, number(stage.mean_ms))
    };
    html! {
        div.plan {
            p { b { "Calls for " } (effects) ". " b { "A frame runs" } }
            ol {
                @for name in &facts.plan {
                    li { b { (name) } @if let Some(stage) = ran(name) { span.soft { (cell(stage)) } } }
                }
            }
        }
        @if let Some(row) = typical {
            p.soft { "Counts and times a frame, on average, with " (row.strategy) "; no other stage runs." }
        }
    }
}

/// What each effect costs, with all others, without it, and alone.
fn effects(facts: &SceneFacts) -> Markup {
    let row = |cost: &Cost| (None, cost.cells().map(cell).to_vec());
    html! {
        details {
            summary { "What each effect costs" }
            p.soft {
                "At a twentieth of the triangles where the scene can be made coarser. Simulation: a loop; motion and light: a \
                 frame. Counts are those of all frames."
            }
            (table(&Cost::HEADS, 2, facts.effect_costs.iter().map(row)))
        }
    }
}

/// Pictures of some frames, and beneath each heat maps of strategies' trees.
fn film(scene: &SceneRun) -> Markup {
    let plain = scene.pictures.iter().filter(|picture| picture.strategy.is_none());
    let maps = |frame| scene.pictures.iter().filter(move |p| p.frame == frame && p.strategy.is_some());
    html! {
        @if !scene.pictures.is_empty() {
            div.film tabindex="0" role="group" aria-label={ "Frames of " (scene.facts.label) } {
                @for picture in plain {
                    div {
                        (image(picture, &format!("frame {}", picture.frame)))
                        @for map in maps(picture.frame) { (image(map, map.strategy.as_deref().unwrap_or_default())) }
                    }
                }
            }
            p.soft {
                "Below each frame: the nodes that the rays of each pixel visit in the tree of a strategy, from black over \
                 blue, red and yellow to white at " (count(u64::from(scene.facts.hottest))) " or more."
            }
        }
    }
}

pub(super) fn image(picture: &Picture, words: &str) -> Markup {
    let kind = if picture.file.ends_with(".jpg") { "jpeg" } else { "png" };
    let words = if words == "sweep" { "fresh tree" } else { words };
    html! {
        figure {
            img src={ "data:image/" (kind) ";base64," (STANDARD.encode(&picture.bytes)) } loading="lazy" alt=(words);
            figcaption { (words) }
        }
    }
}

const HEADS: [&str; 11] = [
    "Strategy",
    "Update",
    "Trace",
    "Frame",
    "Worst frame",
    "SAH cost, last",
    "× sweep, mean",
    "× sweep, worst",
    "Rotations a frame",
    "Height",
    "Frames",
];

fn strategy_row(row: &StrategySummary) -> (Option<&str>, Vec<Markup>) {
    let over =
        |of: fn(&Spread) -> f64| row.sah_over_sweep.as_ref().map_or("–".to_owned(), |s| number(of(s)));
    let name = html! {
        (row.strategy)
        @if let Some(accounting) = &row.accounting { div.soft.light { (accounting) } }
    };
    let cells = vec![
        name,
        with_range(&row.update_ms),
        with_range(&row.trace_ms),
        with_range(&row.frame_ms),
        cell(number(row.frame_ms.max)),
        cell(number(row.last_cost)),
        cell(over(|s| s.mean)),
        cell(over(|s| s.max)),
        cell(number(row.rotations as f64 / row.samples as f64)),
        cell(row.greatest_height),
        cell(row.samples),
    ];
    (Some(&row.strategy), cells)
}

fn with_range(spread: &Spread) -> Markup {
    html! {
        (number(spread.mean))
        @if spread.max > 0.0 { br; span.soft { (number(spread.p10)) " – " (number(spread.p90)) } }
    }
}

fn decisions(row: &StrategySummary) -> Markup {
    html! {
        p {
            "What " b { (row.strategy) } " decided, on the frames measured"
            @if row.decisions.iter().any(|decided| decided.decision == ALWAYS) {
                " (" (ALWAYS) ": its usual update, and no repair)"
            }
            ":"
        }
        ul.decisions {
            @for decided in &row.decisions {
                li {
                    b { (plural(decided.frames, "frame")) } ", first " (decided.first) ": " (decided.decision)
                }
            }
        }
    }
}

fn offline(scene: &SceneRun) -> Markup {
    let row = |tree: &OfflineTree| {
        let numbers = [tree.build_ms, tree.sah_cost, tree.path_ms].map(|value| cell(number(value)));
        (None, [vec![cell(&tree.builder)], numbers.to_vec()].concat())
    };
    html! {
        p { "Trees built offline over the first frame, and a path-traced picture through each:" }
        (table(&["Builder", "Build, ms", "SAH cost", "Picture, ms"], 1, scene.offline.iter().map(row)))
    }
}
