//! The same scenes beside other libraries: updates, and whole frames, as `cargo xtask compare` measures them.

use anyhow::Result;
use maud::{Markup, html};
use pivot_benches::embree::Device;
use serde::{Deserialize, Serialize};

use super::chart::number;
use super::journal::{Journal, Line};
use super::results::Results;
use crate::compare;
use crate::stage::Stage;

/// One contestant on one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Peer {
    pub(crate) scene: String,
    /// `update`, `limit` (what the memory takes for an update's bytes), or `frame`.
    pub(crate) what: String,
    pub(crate) contestant: String,
    pub(crate) threads: usize,
    /// Frames measured.
    pub(crate) frames: usize,
    pub(crate) median_ms: f64,
    pub(crate) min_ms: f64,
    pub(crate) max_ms: f64,
    pub(crate) mean_ms: f64,
    /// Mean SAH cost over that of a fresh sweep build; nothing where the tree cannot be read.
    pub(crate) sah_over_sweep: Option<f64>,
    pub(crate) hits: u64,
    /// Rays with another answer than the reference's.
    pub(crate) different: u64,
    /// Rays compared.
    pub(crate) rays: u64,
    /// Whether the number of hits is the reference's within 0.01 %.
    pub(crate) agrees: bool,
}

impl Line for Peer {
    const COLUMNS: &[&str] = &[
        "scene",
        "what",
        "contestant",
        "threads",
        "frames",
        "median_ms",
        "min_ms",
        "max_ms",
        "mean_ms",
        "sah_over_sweep",
        "hits",
        "different",
        "rays",
        "agrees",
    ];
}

/// How the others are measured.
pub(super) struct Terms {
    pub(super) threads: usize,
    /// Frames of a loop.
    pub(super) frames: usize,
    /// Pixels on each side.
    pub(super) size: u32,
    /// Embree on as many threads, if there is one.
    pub(super) embree: Option<Device>,
}

/// Measures updates and whole frames of every contestant on a scene.
pub(super) fn measure(
    label: &str,
    stage: &mut Stage,
    terms: Terms,
    journal: &mut Journal<Peer>,
) -> Result<Vec<Peer>> {
    let Terms { threads, frames, size, embree } = terms;
    let rows: Vec<Peer> = compare::beside(label, stage, threads, frames, size, embree)?
        .into_iter()
        .map(|row| Peer {
            scene: row.scene,
            what: row.what.to_owned(),
            contestant: row.contestant,
            threads: row.threads,
            frames: row.frames,
            median_ms: row.median_ms,
            min_ms: row.min_ms,
            max_ms: row.max_ms,
            mean_ms: row.mean_ms,
            sah_over_sweep: row.sah_over_sweep,
            hits: row.hits,
            different: row.different,
            rays: row.rays,
            agrees: row.agrees,
        })
        .collect();
    journal.append(&rows)?;
    Ok(rows)
}

/// The section of the report.
pub(super) fn html(results: &Results) -> Markup {
    let scenes = || results.main_scenes().filter(|scene| !scene.peers.is_empty());
    html! {
        @if scenes().next().is_some() {
            section id="peers" {
                h2 { "Beside other libraries" }
                p {
                    "The same motion and the same rays, contestants taking turns frame by frame. An update is the time from \
                     new positions to a tree that can be traced; a frame is update and trace. “Different” counts rays \
                     whose answer is not that of the reference."
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

fn table(rows: &[Peer]) -> Markup {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("peers.csv");
        let row = Peer {
            scene: "a, b".to_owned(),
            what: "frame".to_owned(),
            contestant: "pivot refit".to_owned(),
            threads: 2,
            median_ms: 1.5,
            agrees: true,
            ..Peer::default()
        };
        let rows = [row.clone(), Peer { sah_over_sweep: Some(1.25), ..row }];
        Journal::create(&path, []).unwrap().append(&rows).unwrap();
        assert_eq!(super::super::journal::read::<Peer>(&path).unwrap(), rows);
    }
}
