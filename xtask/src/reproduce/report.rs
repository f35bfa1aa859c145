//! `report.html`: one page with everything in it, readable offline, on a phone, on paper, by day and by night. Without
//! its script it shows the same, but nothing can be switched.

mod scene;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::accuracy;
use super::baseline::Comparison;
use super::chart::{Panel, number};
use super::claims::{Claim, Verdict};
use super::contestants::PAPER;
use super::figures::{self, Key, Which};
use super::peers;
use super::results::Results;
use super::summary::checks_in_words;

/// The whole page.
pub(crate) fn html(results: &Results, claims: &[Claim], comparison: Option<&Comparison>) -> String {
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
                        (plural(results.main_scenes().count(), "scene")) ", preset " b { (results.settings.preset) } ", "
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
                    @if let Some(comparison) = comparison { (comparison.section()) }
                    (switches(results))
                    (figure_4(results))
                    (figure_6(results))
                    (figure_5(results))
                    (accuracy::html(results))
                    (peers::html(results))
                    (museum(results))
                    (scene::sections(results))
                    (colophon(results))
                }
                script { (PreEscaped(include_str!("report.js"))) }
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
            p {
                (tally(claims)) ". Each row says by which rule. Of times measured the sums over the frames that both sides \
                were measured on are compared; where a rule speaks of faster, slower or equal, differences of less than 5 % \
                count as none, and where the paper says how much, its words set the bound. Where a value that is 5 % \
                more or less would alone change a verdict, the row says that it is near the bound. SAH costs are the \
                same in every run."
            }
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

/// How many claims have each verdict.
fn tally(claims: &[Claim]) -> String {
    let verdicts = [Verdict::Holds, Verdict::HoldsInPart, Verdict::DoesNotHoldHere, Verdict::NotRun];
    let counts = verdicts.map(|v| (v, claims.iter().filter(|c| c.verdict == v).count()));
    let named: Vec<_> = counts.iter().filter(|(_, n)| *n > 0).map(|(v, n)| v.counted(*n)).collect();
    format!("Of {} {}", plural(claims.len(), "claim"), named.join(", "))
}

fn verdict_class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::HoldsInPart => "in-part",
        Verdict::DoesNotHoldHere => "not-here",
        Verdict::NotRun => "untested",
    }
}

/// What can be switched: scenes and strategies, for all figures and films at once.
fn switches(results: &Results) -> Markup {
    let scenes: Vec<_> = results.main_scenes().map(|s| s.facts.label.as_str()).collect();
    let has_rows = results.main_scenes().any(|s| !s.rows.is_empty());
    html! {
        @if has_rows {
            section.switches id="switches" {
                h2 { "Figures" }
                @if scenes.len() > 1 {
                    div role="group" aria-label="Scenes" {
                        button type="button" data-show="all" aria-pressed="true" { "all scenes" }
                        @for label in scenes {
                            button type="button" data-show=(label) aria-pressed="false" { (label) }
                        }
                    }
                }
                div.legend role="group" aria-label="Strategies" {
                    @for name in &results.settings.strategies {
                        @let class = figures::class(name);
                        button type="button" class=(class) data-toggle=(name)
                            aria-pressed=(if figures::is_off(results, name) { "false" } else { "true" }) {
                            (swatch(&class)) span { (name) }
                        }
                    }
                    button.plain type="button" data-only=(PAPER.join(",")) { "as in the paper" }
                    button.plain type="button" data-only="*" { "every strategy" }
                }
                p.soft.hint {
                    "Touch a figure, or move over it, for values; with the keyboard, the arrow keys do it. The address \
                     keeps what is switched."
                }
            }
        }
    }
}

fn figure_4(results: &Results) -> Markup {
    let Some(bars) = figures::update_times(results, Which::All).filter(|_| figures::wanted(results, "fig4"))
    else {
        return Markup::default();
    };
    html! {
        section id="fig4" {
            h3 { "Time to update (figure 4)" }
            figure {
                div.scroll { (bars.svg((0.0, 0.0))) }
                figcaption {
                    "Mean over frames; thin lines span the middle 80 %. The scale is logarithmic. The paper’s figure \
                     shows refit, refit+rotate and ideal-parallel-binned."
                }
            }
        }
    }
}

fn figure_6(results: &Results) -> Markup {
    let panels = |s| Some((s, figures::over_frames(results, s, Which::All)?));
    let scenes: Vec<_> = results.main_scenes().filter_map(panels).collect();
    if scenes.is_empty() || !figures::wanted(results, "fig6") {
        return Markup::default();
    }
    html! {
        section id="fig6" {
            h3 { "Frame time and cost over frames (figure 6)" }
            p {
                "Left (a) the time to update and render, right (b) the SAH cost of the tree rendered. Dotted lines mark \
                 the jump from the end of the animation back to its start. Posing the scene is not counted, as in the \
                 paper. The slow rebuild of the paper’s code is in figure 4 and the tables only."
            }
            @for (scene, panels) in &scenes { (side_by_side(panels, Some(&scene.facts.label))) }
        }
    }
}

fn figure_5(results: &Results) -> Markup {
    let scenes: Vec<_> = results.scenes.iter().filter_map(|s| Some((s, figures::over_loops(s)?))).collect();
    if scenes.is_empty() {
        return Markup::default();
    }
    html! {
        section id="fig5" {
            h3 { "Speed of the animation (figure 5)" }
            p { "Refitting with rotations, the same motion in fewer or more frames, loop after loop." }
            @for (scene, panels) in &scenes {
                (legend(&scene.speeds.iter().map(|(n, _)| figures::speed_key(*n)).collect::<Vec<_>>()))
                (side_by_side(panels, None))
            }
        }
    }
}

fn museum(results: &Results) -> Markup {
    let Some(panel) = figures::from_other_keys(results) else { return Markup::default() };
    let keys: Vec<_> = panel.lines.iter().map(|line| (line.class.clone(), line.name.clone())).collect();
    html! {
        section id="museum" {
            h3 { "The museum from its other key frames" }
            p {
                "The paper puts its exception down to the first frame, which makes a poor first tree. The same loop \
                 started from each of the five shapes, each time with the tree of its own first frame:"
            }
            (legend(&keys))
            div.panels.one { figure { div.scroll { (panel.svg((0.0, 0.0))) } } }
        }
    }
}

fn side_by_side(panels: &[Panel<'_>; 2], scene: Option<&str>) -> Markup {
    html! { div.panels data-scene=[scene] { @for panel in panels { figure { div.scroll { (panel.svg((0.0, 0.0))) } } } } }
}

fn legend(keys: &[Key]) -> Markup {
    html! { ul.legend { @for (class, name) in keys { li class=(class) { (swatch(class)) span { (name) } } } } }
}

fn swatch(class: &str) -> Markup {
    html! {
        svg.chart viewBox="0 0 26 8" aria-hidden="true" { path class={ "line " (class) } d="M0 4h26" {} }
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
                b { "sweep" } ", " b { "binned-parallel" } ", " b { "lbvh" } " and " b { "ploc" }
                " rebuild on all threads, " b { "binned" } " on one. " b { "paper-binned" }
                " is a serial binned rebuild as the paper’s code had it (bins along the longest axis only, a sort at \
                 every node); it explains verdicts and decides none. Whatever is projected to 8 threads is labelled so."
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
                    "preset " (settings.preset) ", " (settings.loops) " loops"
                    @if let Some(loops) = settings.speed_loops { " (of figure 5 " (loops) ")" }
                    ", " (settings.size) " × " (settings.size)
                    " pixels, " (plural(settings.threads, "thread")) ", seed " (settings.seed)
                }
            }
            h3 { "Again" }
            pre { (settings.command) }
            p.soft {
                "Every row is in " code { "frames.csv" } ", the summary for programs in " code { "summary.json" }
                ", figures and pictures as files beside this page. " code { "cargo xtask reproduce --from DIR" }
                " draws this page again, " code { "--baseline DIR" } " lays it over another run, " code { "--resume" }
                " goes on after an interrupt."
            }
        }
    }
}
