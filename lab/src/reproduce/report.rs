//! `report.html`: one page with everything in it, readable offline, on a phone and on paper. The first
//! screen has the answer; the rest is folded below it.

mod answer;
mod first;
mod scene;

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

use super::accuracy::sentences;
use super::baseline::Comparison;
use super::chart::number;
use super::claims::{Claim, Verdict};
use super::figures::Figure;
use super::peers;
use super::results::Results;
use super::summary::checks_in_words;

/// The whole page.
pub(crate) fn html(
    results: &Results,
    claims: &[Claim],
    figures: &[Figure],
    comparison: Option<&Comparison>,
) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { "Tree rotations on this machine" }
                style { (PreEscaped(include_str!("report.css"))) }
            }
            body {
                (first::screen(results, claims))
                main {
                    @if let Some(comparison) = comparison { (comparison.section()) }
                    (folded("The paper’s claims", &claims_table(claims)))
                    @let sentences = sentences(&results.accuracy);
                    @if !sentences.is_empty() {
                        // The charts are among the figures.
                        (folded("What accuracy costs", &html! { ul { @for line in &sentences { li { (line) } } } }))
                    }
                    (folded("Scenes", &scene::sections(results)))
                    (folded("Figures", &drawn(figures)))
                    @let peers = peers::html(results);
                    @if let Some(peers) = peers { (folded("Beside other libraries", &peers)) }
                    (folded("How it was measured", &colophon(results)))
                }
                script { (PreEscaped(include_str!("report.js"))) }
            }
        }
    }
    .into_string()
}

/// A part of the page that is closed until it is asked for.
fn folded(title: &str, content: &Markup) -> Markup {
    html! {
        details.part {
            summary { h2 { (title) } }
            (content)
        }
    }
}

/// A table, sorted as it comes until a reader sorts it: `words` columns of words, then numbers. A row
/// may have a strategy's name, by which the page finds it.
pub(super) fn table<'a>(
    heads: &[&str],
    words: usize,
    rows: impl IntoIterator<Item = (Option<&'a str>, Vec<Markup>)>,
) -> Markup {
    let class = |i: usize| (i >= words).then_some("n");
    html! {
        div.scroll {
            table {
                thead { tr { @for (i, head) in heads.iter().enumerate() { th class=[class(i)] { (head) } } } }
                tbody {
                    @for (strategy, cells) in rows {
                        tr data-strategy=[strategy] {
                            @for (i, cell) in cells.iter().enumerate() {
                                @if i == 0 { th scope="row" { (cell) } } @else { td class=[class(i)] { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A cell with nothing but text.
pub(super) fn cell(text: impl Render) -> Markup {
    html! { (text) }
}

fn check_line(results: &Results) -> Markup {
    let checks = results.checks();
    html! {
        span class=[(checks.differences > 0).then_some("fails")] {
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

fn claims_table(claims: &[Claim]) -> Markup {
    html! {
        section {
            p {
                (tally(claims)) ". Each row says by which rule. Of times measured the sums over the frames that both sides \
                were measured on are compared; where a rule speaks of faster, slower or equal, differences of less than 5 % \
                count as none, and where the paper says how much, its words set the bound. Where a value that is 5 % \
                more or less would alone change a verdict, the row says that it is near the bound. SAH costs are the \
                same in every run."
            }
            table.claims {
                thead { tr { th { "Claim" } th { "In the paper" } th { "Here" } th { "Verdict" } } }
                tbody {
                    @for (i, claim) in claims.iter().enumerate() {
                        tr id={ "claim-" (i + 1) } {
                            td {
                                (claim.claim) span.soft { ", " (claim.source) }
                                details { summary { "Rule" } (claim.rule) }
                            }
                            td data-name="Paper" { (claim.paper) }
                            td data-name="Here" { (claim.ours) }
                            td {
                                span class={ "verdict " (verdict_class(claim.verdict)) } { (claim.verdict.words()) }
                                @if claim.first_verdict != claim.verdict {
                                    div.soft { "by the bounds written first: " (claim.first_verdict.words()) }
                                }
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

/// All figures, each with a caption.
fn drawn(figures: &[Figure]) -> Markup {
    html! {
        section id="figures" {
            @for Figure { name, title, caption, svg } in figures {
                h3 id=(name) { (title) }
                figure data-x=[name.starts_with("fig6").then_some("frame")] {
                    div.scroll tabindex="0" role="img" aria-label=(title) { (PreEscaped(svg)) }
                    figcaption { (caption) }
                }
            }
        }
    }
}

fn colophon(results: &Results) -> Markup {
    let (machine, settings) = (&results.machine, &results.settings);
    html! {
        section {
            p {
                "The sweep builder makes one tree over the first frame, with one triangle a leaf. Every strategy starts from \
                 a copy of it. On every frame the scene is posed once; then each strategy in turn, a different one first \
                 each time, updates its tree and renders the frame with primary and shadow rays from a point light. \
                 Each strategy runs once before the first frame, uncounted. Checks, costs and pictures are not timed. A \
                 frame’s time is that of update and rendering."
            }
            p {
                b { "ideal" } " is the rebuild by the sweep builder with its time not counted; " b { "ideal-parallel-binned" }
                " is the serial binned rebuild with its time divided by 8, as if it scaled perfectly on the paper’s 8 \
                 threads, whatever number of threads the others had. Both are accounting, not measurement. "
                b { "sweep" } ", " b { "binned-parallel" } ", " b { "lbvh" } " and " b { "ploc" }
                " rebuild on all threads, " b { "binned" } " on one. " b { "paper-binned" }
                " is a serial binned rebuild with bins along the longest axis only, as was common in 2012. It decides no verdict."
            }
            @if !settings.reductions.is_empty() {
                p { "Other than in the paper’s protocol: " (settings.reductions.join("; ")) "." }
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
            p { (check_line(results)) }
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
