//! A figure for each scene.

use super::{Finding, Verdict};
use crate::reproduce::results::SceneRun;

/// Values by scene.
pub(super) struct Table(pub(super) Vec<(String, f64)>);

/// How near to a bound a value is named: another run might find it on the other side.
const NEAR: f64 = 0.03;
const SLACK: f64 = 1.0 + NEAR;

impl Table {
    pub(super) fn of<'a>(
        scenes: impl IntoIterator<Item = &'a SceneRun>,
        value: impl Fn(&SceneRun) -> Option<f64>,
    ) -> Self {
        let rows = scenes.into_iter().filter_map(|s| Some((s.facts.label.clone(), value(s)?)));
        Self(rows.filter(|(_, v)| v.is_finite()).collect())
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn count(&self, holds: impl Fn(f64) -> bool) -> usize {
        self.0.iter().filter(|(_, v)| holds(*v)).count()
    }

    pub(super) fn all(&self, holds: impl Fn(f64) -> bool) -> bool {
        self.count(holds) == self.len()
    }

    pub(super) fn text(&self) -> String {
        self.0.iter().map(|(name, v)| format!("{name} {v:.2}")).collect::<Vec<_>>().join(", ")
    }

    /// Names of those for which `holds` is false.
    pub(super) fn except(&self, holds: impl Fn(f64) -> bool) -> String {
        let names = self.0.iter().filter(|(_, v)| !holds(*v)).map(|(name, _)| name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }

    /// Says which values are so near to a bound that another run might find them on the other side.
    pub(super) fn near(&self, bounds: &[f64]) -> String {
        let is_far = |v: f64| bounds.iter().all(|bound| (v / bound - 1.0).abs() > NEAR);
        let names = self.except(is_far);
        if names.is_empty() { names } else { format!("; near the bound: {names}") }
    }

    /// A finding where each scene passes or not: holds if all are at most `bound`, and none is near it; in part if at least
    /// `part` of them are at most that, or all are at most near it.
    pub(super) fn at_most(&self, bound: f64, part: usize) -> Finding {
        if self.len() == 0 {
            return Finding::not_run("no scene that moves was run with all the strategies it compares");
        }
        let passes = |v: f64| v <= bound;
        let (all, passed) = (self.len(), self.count(passes));
        let (clear, at_most_near) = (self.all(|v| v < bound / SLACK), self.all(|v| v <= bound * SLACK));
        let (verdict, why) = if clear {
            let scenes = if all == 1 { "the only scene" } else { "every scene" };
            (Verdict::Holds, format!("at most {bound} in {scenes}"))
        } else {
            let in_part = passed >= part || at_most_near;
            let verdict = if in_part { Verdict::HoldsInPart } else { Verdict::DoesNotHoldHere };
            let others = self.except(passes);
            let others = if others.is_empty() { others } else { format!("; not in {others}") };
            (verdict, format!("at most {bound} in {passed} of {all} scenes{others}"))
        };
        Finding(self.text(), verdict, why + &self.near(&[bound]))
    }
}

/// More than half of `n`.
pub(super) fn most(n: usize) -> usize {
    n / 2 + 1
}
