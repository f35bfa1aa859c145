//! The same scenes beside other libraries: updates, and whole frames, as `cargo xtask compare`
//! measures them.

use maud::{Markup, html};

use super::chart::number;
use super::report::{cell, table};
use super::results::Results;
use crate::compare::Row;

const HEADS: [&str; 9] = [
    "Contestant",
    "What",
    "Median ms",
    "Least",
    "Most",
    "SAH × sweep, mean",
    "Different",
    "of rays",
    "Frames",
];

/// The section of the report, if there is something to show.
pub(super) fn html(results: &Results) -> Option<Markup> {
    let scenes: Vec<_> = results.main_scenes().filter(|scene| !scene.peers.is_empty()).collect();
    let section = html! {
        section id="peers" {
            p {
                "The same motion and the same rays; contestants take turns frame by frame. An update is the time from \
                 new positions to a tree that can be traced. A frame is update and trace. “Different” counts rays \
                 whose answer differs from the reference’s."
            }
            @for scene in &scenes {
                details open {
                    summary { b { (scene.facts.label) } }
                    (table(&HEADS, 2, scene.peers.iter().map(|row| (None, cells(row)))))
                }
            }
        }
    };
    (!scenes.is_empty()).then_some(section)
}

fn cells(row: &Row) -> Vec<Markup> {
    let name = html! { (row.contestant) @if !row.agrees { div.soft.light { "not the same hits" } } };
    let times = [row.median_ms, row.min_ms, row.max_ms].map(|ms| cell(number(ms)));
    let cost = cell(row.sah_over_sweep.map_or("–".to_owned(), number));
    let counts = [cell(row.different), cell(row.rays), cell(row.frames)];
    [vec![name, cell(&row.what)], times.to_vec(), vec![cost], counts.to_vec()].concat()
}
