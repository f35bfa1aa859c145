//! The same scenes beside other libraries: updates, and whole frames, as `cargo xtask compare`
//! measures them.

use maud::{Markup, html};

use super::chart::number;
use super::results::Results;
use crate::compare::Row;

/// The section of the report.
pub(super) fn html(results: &Results) -> Markup {
    let scenes = || results.main_scenes().filter(|scene| !scene.peers.is_empty());
    html! {
        @if scenes().next().is_some() {
            section id="peers" {
                p {
                    "The same motion and the same rays; contestants take turns frame by frame. An update is the time from \
                     new positions to a tree that can be traced. A frame is update and trace. “Different” counts rays \
                     whose answer differs from the reference’s."
                }
                @for scene in scenes() {
                    details open {
                        summary { b { (scene.facts.label) } }
                        (table(&scene.peers))
                    }
                }
            }
        }
    }
}

fn table(rows: &[Row]) -> Markup {
    html! {
        div.scroll {
            table {
                thead {
                    tr {
                        th { "Contestant" } th { "What" } th.n { "Median ms" } th.n { "Least" } th.n { "Most" }
                        th.n { "SAH × sweep, mean" } th.n { "Different" } th.n { "of rays" } th.n { "Frames" }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            th scope="row" {
                                (row.contestant)
                                @if !row.agrees { div.soft.light { "not the same hits" } }
                            }
                            td { (row.what) }
                            td.n { (number(row.median_ms)) } td.n { (number(row.min_ms)) } td.n { (number(row.max_ms)) }
                            td.n { (row.sah_over_sweep.map_or_else(|| "–".to_owned(), number)) }
                            td.n { (row.different) } td.n { (row.rays) } td.n { (row.frames) }
                        }
                    }
                }
            }
        }
    }
}
