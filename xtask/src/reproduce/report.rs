//! `report.html`: one page with everything in it, readable offline, on a phone, on paper, by day and by night.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::accuracy;
use super::chart::{Panel, count, number};
use super::claims::{Claim, Verdict};
use super::figures::{self, Key};
use super::results::{Results, SceneRun, Spread};
use super::summary::{StrategySummary, checks_in_words, strategies};

/// The whole page.
pub(crate) fn html(results: &Results, claims: &[Claim]) -> String {
    let title = "Tree rotations on this machine";
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(figures::STYLE)) (PreEscaped(include_str!("report.css"))) }
            }
            body {
                header {
                    h1 { (title) }
                    p {
                        "What " cite { "Fast, Effective BVH Updates for Dynamic Ray-Traced Scenes Using Tree Rotations" }
                        " (Kopta, Ize, Spjut, Brunvand, Davis and Kensler, 2012) claims, and what was measured here: "
                        (plural(results.scenes.len(), "scene")) ", preset " b { (results.settings.preset) } ", "
                        (plural(results.settings.threads, "thread")) ", " (results.machine.started.get(..10).unwrap_or_default())
                        ", " (results.revision.short()) "."
                    }
                    @if results.interrupted {
                        p.notice { "The run was interrupted. What follows is made from the rows measured until then." }
                    }
                    (check_line(results))
                }
                main {
                    (claims_table(results, claims))
                    (figure_4(results))
                    (figure_6(results))
                    (figure_5(results))
                    (accuracy::html(results))
                    (scene_sections(results))
                    (colophon(results))
                }
            }
        }
    }
    .into_string()
}

fn check_line(results: &Results) -> Markup {
    let checks = results.checks();
    html! {
        p class=[(checks.differences > 0).then_some("notice")] {
            "All strategies must see the same. " (capital(&checks_in_words(&checks))) "."
            @if let Some(first) = &checks.first_difference { " The first: " (first) "." }
        }
    }
}

fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |c| c.to_uppercase().chain(chars).collect())
}

fn plural(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

fn claims_table(results: &Results, claims: &[Claim]) -> Markup {
    html! {
        section {
            h2 { "The paper’s claims" }
            @if results.settings.preset == "quick" {
                p.soft { "Few frames and small pictures were measured (preset quick): the verdicts are hints." }
            }
            table.claims {
                thead { tr { th { "Claim" } th { "In the paper" } th { "Here" } th { "Verdict" } } }
                tbody {
                    @for claim in claims {
                        tr {
                            td {
                                (claim.claim) span.soft { ", " (claim.source) }
                                details { summary { "Rule" } (claim.rule) }
                            }
                            td data-name="Paper" { (claim.paper) }
                            td data-name="Here" { (claim.ours) }
                            td {
                                span class={ "verdict " (verdict_class(claim.verdict)) } { (claim.verdict.words()) }
                                div.soft { (claim.why) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn verdict_class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::HoldsInPart => "in-part",
        Verdict::DoesNotHoldHere => "not-here",
        Verdict::NotTested => "untested",
    }
}

fn figure_4(results: &Results) -> Markup {
    let Some(bars) = figures::update_times(results).filter(|_| figures::wanted(results, "fig4")) else {
        return Markup::default();
    };
    html! {
        section {
            h2 { "Time to update (figure 4)" }
            (legend(&figures::bar_keys(results)))
            figure {
                div.scroll { (bars.svg((0.0, 0.0))) }
                figcaption {
                    "Median over frames; thin lines span the middle 80 %. The scale is logarithmic. The paper’s figure \
                     shows means of refit, refit+rotate and ideal-parallel-binned."
                }
            }
        }
    }
}

fn figure_6(results: &Results) -> Markup {
    let scenes: Vec<_> = results.scenes.iter().filter_map(|s| figures::over_frames(results, s)).collect();
    if scenes.is_empty() || !figures::wanted(results, "fig6") {
        return Markup::default();
    }
    html! {
        section {
            h2 { "Frame time and cost over frames (figure 6)" }
            p {
                "Left the time to update and render, right the SAH cost of the tree rendered. Dotted lines mark the jump \
                 from the end of the animation back to its start. Posing the scene is not counted, as in the paper."
            }
            (legend(&figures::line_keys(results)))
            @for panels in &scenes { (side_by_side(panels)) }
        }
    }
}

fn figure_5(results: &Results) -> Markup {
    let scenes: Vec<_> = results.scenes.iter().filter_map(|s| Some((s, figures::over_loops(s)?))).collect();
    if scenes.is_empty() {
        return Markup::default();
    }
    html! {
        section {
            h2 { "Speed of the animation (figure 5)" }
            p { "Refitting with rotations, the same motion in fewer or more frames, loop after loop." }
            @for (scene, panels) in &scenes {
                (legend(&scene.speeds.iter().map(|(n, _)| figures::speed_key(*n)).collect::<Vec<_>>()))
                (side_by_side(panels))
            }
        }
    }
}

fn side_by_side(panels: &[Panel<'_>; 2]) -> Markup {
    html! { div.panels { @for panel in panels { figure { (panel.svg((0.0, 0.0))) } } } }
}

fn legend(keys: &[Key]) -> Markup {
    html! {
        ul.legend {
            @for (class, name) in keys {
                li class=(class) {
                    svg.chart viewBox="0 0 26 8" aria-hidden="true" { path class={ "line " (class) } d="M0 4h26" {} }
                    span { (name) }
                }
            }
        }
    }
}

fn scene_sections(results: &Results) -> Markup {
    html! {
        section {
            h2 { "Scenes" }
            p {
                "Times are medians over the frames measured, with the middle 80 % beside them, in milliseconds; the mark "
                "×" " compares the SAH cost with that of a fresh sweep build on the same frame."
            }
            @for scene in &results.scenes { (scene_section(results, scene)) }
        }
    }
}

fn scene_section(results: &Results, scene: &SceneRun) -> Markup {
    let facts = &scene.facts;
    let effects = if facts.effects.is_empty() { "nothing".to_owned() } else { facts.effects.join(", ") };
    html! {
        h3 { (facts.label) }
        p {
            (capital(&facts.about)) ". " (count(facts.triangles as u64)) " triangles, "
            (count(facts.moving as u64)) " of them can move. Calls for " (effects)
            "; a frame runs " (facts.plan.join(", ")) ". First tree built in "
            (number(facts.build_ms)) " ms."
            @if facts.rebuild_every > 1 {
                " Rebuilds measured on one frame in " (facts.rebuild_every) "."
            }
        }
        @for note in &facts.notes { p.soft { (capital(note)) } }
        @if !scene.pictures.is_empty() {
            div.film {
                @for picture in &scene.pictures {
                    figure {
                        img src={ "data:image/png;base64," (STANDARD.encode(&picture.png)) }
                            alt={ (facts.label) ", frame " (picture.frame) };
                        figcaption { "frame " (picture.frame) }
                    }
                }
            }
        }
        @let rows = strategies(scene, &results.settings);
        @if !rows.is_empty() { (scene_table(&rows)) }
    }
}

fn scene_table(rows: &[StrategySummary]) -> Markup {
    html! {
        div.scroll {
            table {
                thead {
                    tr {
                        th { "Strategy" } th.n { "Update" } th.n { "Trace" } th.n { "Frame" } th.n { "Worst frame" }
                        th.n { "SAH cost, last" } th.n { "× sweep, worst" } th.n { "Rotations a frame" }
                        th.n { "Height" } th.n { "Frames" }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            th scope="row" {
                                (row.strategy)
                                @if let Some(accounting) = &row.accounting {
                                    div.soft style="font-weight: 400" { (accounting) }
                                }
                            }
                            td.n { (with_range(&row.update_ms)) }
                            td.n { (with_range(&row.trace_ms)) }
                            td.n { (with_range(&row.frame_ms)) }
                            td.n { (number(row.frame_ms.max)) }
                            td.n { (number(row.last_cost)) }
                            td.n {
                                @if let Some(over) = &row.sah_over_sweep { (number(over.max)) } @else { "–" }
                            }
                            td.n { (number(row.rotations as f64 / row.samples as f64)) }
                            td.n { (row.greatest_height) }
                            td.n { (row.samples) }
                        }
                    }
                }
            }
        }
    }
}

fn with_range(spread: &Spread) -> Markup {
    html! {
        (number(spread.median))
        @if spread.max > 0.0 {
            br; span.soft { (number(spread.p10)) " – " (number(spread.p90)) }
        }
    }
}

fn colophon(results: &Results) -> Markup {
    let (machine, settings) = (&results.machine, &results.settings);
    html! {
        section {
            h2 { "How it was measured" }
            p {
                "The tree is built once, over the first frame, by the sweep builder with one triangle a leaf; every \
                 strategy starts from a copy of it. Frame by frame the scene is posed once; then each strategy in turn, a \
                 different one first each time, updates its tree and renders the frame with primary rays and shadow rays \
                 from a point light. Each strategy runs once before the first frame, uncounted. Checks, costs and \
                 pictures are made outside of what is timed. A frame’s time is that of update and rendering."
            }
            p {
                b { "ideal" } " is the rebuild by the sweep builder with its time not counted; " b { "ideal-parallel-binned" }
                " is the serial binned rebuild with its time divided by 8, as if it scaled perfectly on the paper’s 8 \
                 threads, whatever number of threads the others had. Both are accounting, not measurement. "
                b { "sweep" } " and " b { "binned-parallel" } " rebuild on all threads, " b { "binned" } " on one."
            }
            @if !settings.reductions.is_empty() {
                p { "Less than the paper’s protocol: " (settings.reductions.join("; ")) "." }
            }
            dl {
                dt { "Processor" } dd { (machine.cpu) ", " (machine.cores) " hardware threads, " (machine.simd) }
                @if let Some(memory) = machine.memory_gib { dt { "Memory" } dd { (number(memory)) " GiB" } }
                dt { "System" } dd { (machine.os) }
                @if let Some(rustc) = &machine.rustc { dt { "Compiler" } dd { (rustc) } }
                @if let Some(load) = machine.load {
                    dt { "Load before" } dd { (load) " processes wanted to run in the minute before" }
                }
                dt { "Started" } dd { (machine.started) }
                dt { "Revision" } dd {
                    (results.revision.commit.as_deref().unwrap_or("unknown"))
                    @if results.revision.dirty { ", with uncommitted changes" }
                }
                dt { "Settings" } dd {
                    "preset " (settings.preset) ", " (settings.loops) " loops, " (settings.size) " × " (settings.size)
                    " pixels, " (plural(settings.threads, "thread")) ", seed " (settings.seed)
                }
            }
            h3 { "Again" }
            pre { (settings.command) }
            p.soft {
                "Every row is in " code { "frames.csv" } ", the summary for programs in " code { "summary.json" }
                ", figures and pictures as files beside this page."
            }
        }
    }
}
