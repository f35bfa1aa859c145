//! A figure for each scene, and verdicts from them.

use super::Verdict;
use crate::reproduce::results::SceneRun;

/// Values by scene, or by whatever else has a name.
#[derive(Clone)]
pub(super) struct Table(pub(super) Vec<(String, f64)>);

/// By how much a time may differ from one run to the next on the same machine.
pub(super) const BAND: f64 = 0.05;

impl Table {
    pub(super) fn of<'a>(
        scenes: impl IntoIterator<Item = &'a SceneRun>,
        value: impl Fn(&SceneRun) -> Option<f64>,
    ) -> Self {
        let rows = scenes.into_iter().filter_map(|s| Some((s.facts.label.clone(), value(s)?)));
        Self(rows.filter(|(_, v)| v.is_finite()).collect())
    }

    /// One value.
    pub(super) fn single((name, value): (&str, f64)) -> Self {
        Self(vec![(name.to_owned(), value)])
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn count(&self, holds: impl Fn(f64) -> bool) -> usize {
        self.0.iter().filter(|(_, v)| holds(*v)).count()
    }

    pub(super) fn all(&self, holds: impl Fn(f64) -> bool) -> bool {
        self.count(holds) == self.len()
    }

    pub(super) fn most(&self, holds: impl Fn(f64) -> bool) -> bool {
        2 * self.count(holds) > self.len()
    }

    pub(super) fn text(&self) -> String {
        self.text_to(2)
    }

    pub(super) fn text_to(&self, digits: usize) -> String {
        self.0.iter().map(|(name, v)| format!("{name} {v:.digits$}")).collect::<Vec<_>>().join(", ")
    }

    /// Names of those for which `holds` is false.
    pub(super) fn except(&self, holds: impl Fn(f64) -> bool) -> String {
        let names = self.0.iter().filter(|(_, v)| !holds(*v)).map(|(name, _)| name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }

    /// In how many scenes something holds, which `what` has in words, and where not.
    pub(super) fn scenes_where(&self, what: &str, holds: impl Fn(f64) -> bool) -> String {
        match (self.count(&holds), self.len()) {
            (1, 1) => format!("{what} in the only scene"),
            (n, all) if n == all => format!("{what} in every scene"),
            (n, all) => format!("{what} in {n} of {all} scenes; not in {}", self.except(holds)),
        }
    }
}

/// The three verdicts on what was run.
pub(super) fn graded(holds: bool, in_part: bool) -> Verdict {
    match (holds, in_part) {
        (true, _) => Verdict::Holds,
        (false, true) => Verdict::HoldsInPart,
        (false, false) => Verdict::DoesNotHoldHere,
    }
}

/// The verdict that a rule gives on tables of times, and in words which values are near a bound
/// that decides: those that would change the verdict, were they alone [`BAND`] more or less.
pub(super) fn by_times<const N: usize>(
    tables: [&Table; N],
    rule: impl Fn([&Table; N]) -> Verdict,
) -> (Verdict, String) {
    let verdict = rule(tables);
    let mut near: Vec<&str> = Vec::new();
    for (at, table) in tables.iter().enumerate() {
        for (row, (name, value)) in table.0.iter().enumerate() {
            let turns = [value * (1.0 + BAND), value / (1.0 + BAND)].into_iter().any(|other| {
                let mut changed = Table::clone(table);
                changed.0[row].1 = other;
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
