//! A figure for each scene.

use super::{Finding, Verdict};
use crate::reproduce::results::SceneRun;

/// Values by scene.
pub(super) struct Table(pub(super) Vec<(String, f64)>);

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

    pub(super) fn text(&self) -> String {
        self.0.iter().map(|(name, v)| format!("{name} {v:.2}")).collect::<Vec<_>>().join(", ")
    }

    /// Names of those for which `holds` is false.
    pub(super) fn except(&self, holds: impl Fn(f64) -> bool) -> String {
        let names = self.0.iter().filter(|(_, v)| !holds(*v)).map(|(name, _)| name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }

    /// A finding where each scene passes or not: holds in all; in part in at least `part` of them.
    pub(super) fn finding(&self, what: &str, passes: impl Fn(f64) -> bool + Copy, part: usize) -> Finding {
        let (all, passed) = (self.len(), self.count(passes));
        if all == 0 {
            return Finding::not_tested("no scene that moves was run with all the strategies it compares");
        }
        let (verdict, why) = if passed == all {
            (Verdict::Holds, format!("{what} in {}", if all == 1 { "the only scene" } else { "every scene" }))
        } else {
            let verdict = if passed >= part { Verdict::HoldsInPart } else { Verdict::DoesNotHoldHere };
            (verdict, format!("{what} in {passed} of {all} scenes; not in {}", self.except(passes)))
        };
        Finding(self.text(), verdict, why)
    }
}

/// More than half of `n`.
pub(super) fn most(n: usize) -> usize {
    n / 2 + 1
}
