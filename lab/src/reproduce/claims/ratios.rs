//! Ratios of times and costs, and the ways to count a parallel rebuild.

use super::table::Table;
use crate::pool::PAPER_THREADS;
use crate::reproduce::contestants::{IDEAL, IDEAL_PARALLEL_BINNED, PAPER_BINNED};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};

pub(super) const REFIT: &str = "refit";
pub(super) const ROTATE: &str = "refit+rotate";
pub(super) const REBUILD: &str = "refit+rotate+rebuild";
pub(super) const BINNED_PARALLEL: &str = "binned-parallel";

/// A strategy, and what its update times are multiplied by: 1 as they stand in the rows.
#[derive(Clone, Copy)]
pub(crate) struct Timed {
    strategy: &'static str,
    factor: f64,
}

impl From<&'static str> for Timed {
    fn from(strategy: &'static str) -> Self {
        Self { strategy, factor: 1.0 }
    }
}

impl Timed {
    fn update(self, row: &Row) -> f64 {
        self.factor * row.update_ms
    }

    fn frame(self, row: &Row) -> f64 {
        self.update(row) + row.trace_ms
    }
}

/// Sum over sum, on the frames that both were measured on.
fn over(scene: &SceneRun, a: Timed, b: Timed, time: fn(Timed, &Row) -> f64) -> Option<f64> {
    let pairs = scene.pairs(a.strategy, b.strategy);
    let sums =
        pairs.iter().fold((0.0, 0.0), |sums, rows| (sums.0 + time(a, rows.0), sums.1 + time(b, rows.1)));
    (!pairs.is_empty()).then(|| sums.0 / sums.1)
}

/// Time of updates and rendering of `a` over that of `b`.
pub(crate) fn frame_time(scene: &SceneRun, a: impl Into<Timed>, b: impl Into<Timed>) -> Option<f64> {
    over(scene, a.into(), b.into(), Timed::frame)
}

/// Time of updates of `a` over that of `b`.
pub(super) fn update_time(scene: &SceneRun, a: impl Into<Timed>, b: impl Into<Timed>) -> Option<f64> {
    over(scene, a.into(), b.into(), Timed::update)
}

/// The frame time of `a` over that of `b`, on the median frame.
pub(super) fn median_frame_time(scene: &SceneRun, a: &str, b: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(a, b).iter().map(|(a, b)| a.frame_ms / b.frame_ms))?.median)
}

/// SAH cost over that of a fresh sweep build, frame by frame; the worst.
pub(super) fn worst_cost(scene: &SceneRun, strategy: &str) -> Option<f64> {
    Some(Spread::of(scene.pairs(strategy, IDEAL).iter().map(|(a, b)| a.sah_cost / b.sah_cost))?.max)
}

/// SAH cost over the first loop, on average.
pub(super) fn mean_cost(scene: &SceneRun, strategy: &str) -> Option<f64> {
    let first = scene.of(strategy).into_iter().filter(|row| row.round == 0);
    Some(Spread::of(first.map(|row| row.sah_cost))?.mean)
}

/// What decides where the ideally parallel rebuild is compared with, and the figures were it
/// counted otherwise: divided by the threads that the run had, with bins along one axis, and
/// really parallel. `table` is given the rebuild.
pub(super) fn other_views(results: &Results, table: impl Fn(Timed) -> Table) -> String {
    let threads = results.settings.threads;
    let mut text =
        format!("; the verdict is by the serial rebuild’s time / {PAPER_THREADS}, as in the paper");
    if threads < PAPER_THREADS {
        text += &format!(", which is generous to the rebuild, since all else had {threads} threads");
    }
    let paper = PAPER_THREADS as f64;
    let mut views = Vec::new();
    if threads != PAPER_THREADS {
        let divided = Timed { strategy: IDEAL_PARALLEL_BINNED, factor: paper / threads as f64 };
        views.push((format!("its time / {threads}, the threads of this run"), divided));
    }
    let as_published = Timed { strategy: PAPER_BINNED, factor: 1.0 / paper };
    views.push((format!("the serial rebuild with bins along one axis / {PAPER_THREADS}"), as_published));
    views.push(("the parallel rebuild as measured".to_owned(), BINNED_PARALLEL.into()));
    let tables = views.into_iter().map(|(words, rebuild)| (words, table(rebuild)));
    let measured = tables.filter(|(_, table)| table.len() > 0);
    let lines: Vec<_> = measured.map(|(words, table)| format!("with {words}: {}", table.text())).collect();
    if !lines.is_empty() {
        text += &format!("; other views, which decide nothing, {}", lines.join("; "));
    }
    text
}
