//! The first screen: the answer, the verdicts as marks, frame times, and a picture strip per scene.

use maud::{Markup, html};

use super::answer::{advice, headline, moving, speedup};
use super::{check_line, plural, scene, tally, verdict_class};
use crate::reproduce::chart::number;
use crate::reproduce::claims::Claim;
use crate::reproduce::results::{Picture, Results, SceneRun};

/// Strategies that the chart shows, each with its class of colour.
const BARS: [(&str, &str); 3] = [("refit", "refit"), ("refit+rotate", "rotate"), ("auto", "auto")];
/// Rebuilds of which the chart shows the one with the fastest frames on each scene.
const REBUILDS: [&str; 6] = ["sweep", "binned", "binned-parallel", "lbvh", "hlbvh", "ploc"];

/// Everything that is seen before anything is unfolded.
pub(super) fn screen(results: &Results, claims: &[Claim]) -> Markup {
    html! {
        header.first {
            p.kicker {
                cite { "Fast, Effective BVH Updates for Dynamic Ray-Traced Scenes Using Tree Rotations" }
                " (Kopta, Ize, Spjut, Brunvand, Davis and Kensler, 2012), rerun on this machine"
            }
            h1 { (headline(results)) }
            @if let Some((strategy, how)) = advice(results) { p.advice { b { "Use " (strategy) } " – " (how) } }
            (what_ran(results))
            (marks(claims))
        }
        div.evidence {
            @if !moving(results).is_empty() { (times(results)) }
            (strips(results))
        }
    }
}

fn what_ran(results: &Results) -> Markup {
    let (machine, settings) = (&results.machine, &results.settings);
    html! {
        p.ran {
            (plural(results.main_scenes().count(), "scene")) ", " (settings.strategies.len()) " strategies, preset "
            (settings.preset)
            @if settings.preset == "quick" { " (few frames and small pictures: hints, not results)" }
            ", " (plural(settings.threads, "thread")) " of " (machine.cpu) ", "
            (machine.started.get(..10).unwrap_or_default()) ", revision " (results.revision.short()) ". "
            @match results.checks().differences {
                0 => "All strategies gave the same pictures, and the same hits as brute force.",
                _ => (check_line(results)),
            }
        }
        @if results.interrupted {
            p.notice { "The run was interrupted. What follows is made from the rows measured until then." }
        }
    }
}

/// A mark for each claim, with the claim and what was found as a tip.
fn marks(claims: &[Claim]) -> Markup {
    html! {
        div.verdicts {
            p { b { "The paper’s claims." } " " (tally(claims)) "." }
            ol.marks {
                @for (i, claim) in claims.iter().enumerate() {
                    li {
                        a class={ "verdict " (verdict_class(claim.verdict)) } href={ "#claim-" (i + 1) }
                            aria-label={ (claim.verdict.words()) ": " (claim.claim) } {
                            span.tip {
                                b { (claim.verdict.words()) } (claim.claim)
                                span.soft { "Paper: " (claim.paper) ". Here: " (short(&claim.ours)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The start of a text, up to the end of a part.
fn short(text: &str) -> &str {
    const MOST: usize = 160;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => text[..end].rfind([',', ';']).map_or(&text[..end], |part| &text[..part]),
        None => text,
    }
}

/// A bar: its strategy, its class of colour, and mean times of update and trace.
struct Bar<'a> {
    strategy: &'a str,
    class: &'static str,
    update: f64,
    trace: f64,
}

fn bars(scene: &SceneRun) -> Vec<Bar<'_>> {
    let bar = |strategy: &'static str, class| {
        let summary = scene.strategies.iter().find(|summary| summary.strategy == strategy)?;
        Some(Bar { strategy, class, update: summary.update_ms.mean, trace: summary.trace_ms.mean })
    };
    let mut bars: Vec<_> = BARS.iter().filter_map(|&(strategy, class)| bar(strategy, class)).collect();
    let rebuilds = REBUILDS.iter().filter_map(|strategy| bar(strategy, "rebuild"));
    bars.extend(rebuilds.min_by(|a, b| (a.update + a.trace).total_cmp(&(b.update + b.trace))));
    bars
}

/// The frame times of all scenes.
fn times(results: &Results) -> Markup {
    html! {
        section.times aria-labelledby="times" {
            h2 id="times" { "Frame time" }
            p.soft {
                "Update, then trace; mean in milliseconds, each scene to its own scale. Gray: the best of the rebuilds."
            }
            div.charts {
                @for scene in moving(results) {
                    @let bars = bars(scene);
                    @let longest = bars.iter().map(|bar| bar.update + bar.trace).fold(1e-9, f64::max);
                    div.chart {
                        h3 {
                            a href={ "#scene-" (scene.facts.slug) } { (scene.facts.label) }
                            @if let Some(speedup) = speedup(scene) {
                                span.soft { " rotations: " (format!("{speedup:.2}")) " × as fast" }
                            }
                        }
                        ul {
                            @for bar in &bars { (drawn(bar, longest)) }
                        }
                    }
                }
            }
        }
    }
}

fn drawn(bar: &Bar<'_>, longest: f64) -> Markup {
    let width = |ms: f64| format!("width:{:.2}%", 100.0 * ms / longest);
    let words = format!("update {} ms, trace {} ms", number(bar.update), number(bar.trace));
    html! {
        li class={ "bar " (bar.class) } data-strategy=(bar.strategy) tabindex="0" title=(words)
            aria-label={ (bar.strategy) ": " (number(bar.update + bar.trace)) " ms, " (words) } {
            span.name { (bar.strategy) }
            span.track { i.update style=(width(bar.update)) {} i.trace style=(width(bar.trace)) {} }
            span.ms { (number(bar.update + bar.trace)) }
        }
    }
}

/// For each scene one frame as it looks, and the nodes visited in the refitted and the rotated tree.
fn strips(results: &Results) -> Markup {
    let with_strips: Vec<_> = results.main_scenes().filter_map(|s| Some((s, strip(s)?))).collect();
    html! {
        @if !with_strips.is_empty() {
            section.strips aria-labelledby="strips" {
                h2 id="strips" { "Nodes that rays visit" }
                p.soft {
                    "Per pixel: darker is better. Of each scene the pictured frame on which refitting fares worst."
                }
                div.charts {
                    @for (scene, pictures) in with_strips {
                        div.strip {
                            h3 { a href={ "#scene-" (scene.facts.slug) } { (scene.facts.label) } }
                            div {
                                @for picture in pictures {
                                    @let words = picture.strategy.clone().unwrap_or(format!("frame {}", picture.frame));
                                    div data-strategy=[picture.strategy.as_deref()] { (scene::image(picture, &words)) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The pictures of a strip: of the frame with both heat maps on which refitting is worst.
fn strip(scene: &SceneRun) -> Option<[&Picture; 3]> {
    let of = |frame: usize, strategy: Option<&str>| {
        scene.pictures.iter().find(|p| p.frame == frame && p.strategy.as_deref() == strategy)
    };
    let excess = |frame: usize| {
        // Not every frame that is pictured is measured.
        let pairs = scene.pairs("refit", "ideal");
        let last = pairs.iter().rfind(|(row, _)| row.round == 0 && row.frame <= frame);
        last.map_or(0.0, |(refit, fresh)| refit.sah_cost / fresh.sah_cost)
    };
    let plain = scene.pictures.iter().filter(|picture| picture.strategy.is_none());
    let strips = plain.filter_map(|plain| {
        Some([plain, of(plain.frame, Some("refit"))?, of(plain.frame, Some("refit+rotate"))?])
    });
    strips.max_by(|a, b| excess(a[0].frame).total_cmp(&excess(b[0].frame)))
}
