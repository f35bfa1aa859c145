//! Ratios of two contestants on each scene.
//!
//! A table has such a figure for each scene, and gives verdicts on bounds.

use super::Verdict;
use crate::pool::PAPER_THREADS;
use crate::reproduce::contestants::{IDEAL, IDEAL_PARALLEL_BINNED, PAPER_BINNED};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneRun, Spread};

/// Values by scene, or by whatever else has a name.
#[derive(Clone)]
pub(crate) struct Table {
    pub(crate) rows: Vec<(String, f64)>,
    /// Decimals in texts.
    digits: usize,
    /// Whether the values differ from run to run.
    are_times: bool,
}

/// By how much a time may differ from one run to the next on the same machine: `docs/PAPER.md`,
/// claims, has what pairs of runs differed by.
pub(super) const BAND: f64 = 0.1;

impl Table {
    /// Ratios of times, where there is one.
    pub(super) fn new<'a>(rows: impl IntoIterator<Item = (&'a str, Option<f64>)>) -> Self {
        let rows =
            rows.into_iter().filter_map(|(name, v)| Some((name.to_owned(), v.filter(|v| v.is_finite())?)));
        Self { rows: rows.collect(), digits: 2, are_times: true }
    }

    /// Ratios of times, of the scenes that have one.
    pub(crate) fn of<'a>(
        scenes: impl IntoIterator<Item = &'a SceneRun>,
        value: impl Fn(&SceneRun) -> Option<f64>,
    ) -> Self {
        Self::new(scenes.into_iter().map(|s| (s.label.as_str(), value(s))))
    }

    /// The same, of values that are alike in every run, with that many decimals.
    pub(super) fn exact(self, digits: usize) -> Self {
        Self { digits, are_times: false, ..self }
    }

    /// The same; an error if it is empty.
    pub(super) fn or(self, why: impl Into<String>) -> Result<Self, String> {
        if self.rows.is_empty() { Err(why.into()) } else { Ok(self) }
    }

    /// The same; an error if no scene was run with all that is compared.
    pub(super) fn compared(self) -> Result<Self, String> {
        self.or("no scene that moves was run with all the strategies it compares")
    }

    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    pub(crate) fn count(&self, holds: impl Fn(f64) -> bool) -> usize {
        self.rows.iter().filter(|(_, v)| holds(*v)).count()
    }

    pub(super) fn all(&self, holds: impl Fn(f64) -> bool) -> bool {
        self.count(holds) == self.len()
    }

    pub(super) fn most(&self, holds: impl Fn(f64) -> bool) -> bool {
        2 * self.count(holds) > self.len()
    }

    pub(super) fn least(&self) -> f64 {
        self.rows.iter().map(|(_, value)| *value).fold(f64::INFINITY, f64::min)
    }

    pub(super) fn text(&self) -> String {
        let digits = self.digits;
        self.rows.iter().map(|(name, v)| format!("{name} {v:.digits$}")).collect::<Vec<_>>().join(", ")
    }

    /// Names of those for which `holds` is false.
    pub(crate) fn except(&self, holds: impl Fn(f64) -> bool) -> String {
        let names = self.rows.iter().filter(|(_, v)| !holds(*v)).map(|(name, _)| name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }

    /// In how many scenes something holds, which `what` has in words, and where not.
    pub(crate) fn scenes_where(&self, what: &str, holds: impl Fn(f64) -> bool) -> String {
        match (self.count(&holds), self.len()) {
            (1, 1) => format!("{what} in the only scene"),
            (n, all) if n == all => format!("{what} in every scene"),
            (0, _) => format!("{what} in no scene: {}", self.except(holds)),
            (n, all) => format!("{what} in {n} of {all} scenes; not in {}", self.except(holds)),
        }
    }

    /// The finding by the usual rule: holds if something does in every scene, in part if in more
    /// than half of them.
    pub(super) fn everywhere(&self, what: &str, holds: impl Fn(f64) -> bool) -> (String, Verdict, String) {
        let (verdict, near) = by_times([self], |[t]| graded(t.all(&holds), t.most(&holds)));
        (self.text(), verdict, self.scenes_where(what, holds) + &near)
    }

    /// The same of values at most `bound`.
    pub(super) fn at_most(&self, bound: f64) -> (String, Verdict, String) {
        self.everywhere(&format!("at most {bound}"), at_most(bound))
    }
}

pub(super) fn at_most(bound: f64) -> impl Fn(f64) -> bool {
    move |ratio| ratio <= bound
}

pub(super) fn at_least(bound: f64) -> impl Fn(f64) -> bool {
    move |ratio| ratio >= bound
}

/// The three verdicts on what was run.
pub(super) fn graded(holds: bool, in_part: bool) -> Verdict {
    match (holds, in_part) {
        (true, _) => Verdict::Holds,
        (false, true) => Verdict::HoldsInPart,
        (false, false) => Verdict::DoesNotHoldHere,
    }
}

/// Holds if both conditions do, in part if one of them.
pub(super) fn both(a: bool, b: bool) -> Verdict {
    graded(a && b, a || b)
}

/// The verdict that a rule gives on single ratios of times, with the names of those near a bound,
/// as [`by_times`].
pub(super) fn by_ratios<const N: usize>(
    named: [(&str, f64); N],
    rule: impl Fn([f64; N]) -> Verdict,
) -> (Verdict, String) {
    let tables = named.map(|(name, ratio)| Table::new([(name, Some(ratio))]));
    by_times(tables.each_ref(), |tables| rule(tables.map(Table::least)))
}

/// The verdict that a rule gives on tables of times, and in words which values are near a bound
/// that decides: those that would change the verdict, were they alone [`BAND`] more or less.
pub(super) fn by_times<const N: usize>(
    tables: [&Table; N],
    rule: impl Fn([&Table; N]) -> Verdict,
) -> (Verdict, String) {
    let verdict = rule(tables);
    let mut near: Vec<&str> = Vec::new();
    for (at, table) in tables.iter().enumerate().filter(|(_, table)| table.are_times) {
        for (row, (name, value)) in table.rows.iter().enumerate() {
            let turns = [value * (1.0 + BAND), value / (1.0 + BAND)].into_iter().any(|other| {
                let mut changed = Table::clone(table);
                changed.rows[row].1 = other;
                let mut tables = tables;
                tables[at] = &changed;
                rule(tables) != verdict
            });
            if turns && !near.contains(&name.as_str()) {
                near.push(name);
            }
        }
    }
    let words =
        if near.is_empty() { String::new() } else { format!("; near the bound: {}", near.join(", ")) };
    (verdict, words)
}

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

/// Sum over sum, on the frames that both were measured on: the time of updates and what a row has
/// `besides`.
fn over(scene: &SceneRun, a: Timed, b: Timed, besides: fn(&Row) -> f64) -> Option<f64> {
    let pairs = scene.pairs(a.strategy, b.strategy);
    let ms = |of: Timed, row: &Row| of.factor * row.update_ms + besides(row);
    let sum_a: f64 = pairs.iter().map(|(row, _)| ms(a, row)).sum();
    let sum_b: f64 = pairs.iter().map(|(_, row)| ms(b, row)).sum();
    (!pairs.is_empty()).then(|| sum_a / sum_b)
}

/// Time of updates and rendering of `a` over that of `b`.
pub(crate) fn frame_time(scene: &SceneRun, a: impl Into<Timed>, b: impl Into<Timed>) -> Option<f64> {
    over(scene, a.into(), b.into(), |row| row.trace_ms)
}

/// Time of updates of `a` over that of `b`.
pub(super) fn update_time(scene: &SceneRun, a: impl Into<Timed>, b: impl Into<Timed>) -> Option<f64> {
    over(scene, a.into(), b.into(), |_| 0.0)
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
