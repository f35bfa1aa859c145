//! What strategies that decide have decided, counted.

use serde::{Deserialize, Serialize};

use super::chart::count;
use super::results::SceneRun;

/// A decision, with how often it was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Decided {
    /// In words; where the words hold a number that differs from frame to frame, its range.
    pub(crate) decision: String,
    pub(crate) frames: usize,
    /// The first frame, counted through all loops.
    pub(crate) first: usize,
}

/// What does the same in every frame decides this.
pub(super) const ALWAYS: &str = "as always";

/// The decisions of a strategy on a scene, most frequent first; none if it does the same in every
/// frame.
pub(crate) fn decisions(scene: &SceneRun, strategy: &str) -> Vec<Decided> {
    // With the least and the greatest number in the place of `#`.
    let mut kinds: Vec<(Decided, [u64; 2])> = Vec::new();
    for row in scene.of(strategy) {
        let (decision, n) = without_number(&row.decision);
        if let Some((kind, [least, most])) = kinds.iter_mut().find(|(kind, _)| kind.decision == decision) {
            kind.frames += 1;
            (*least, *most) = (n.min(*least), n.max(*most));
        } else {
            let first = row.round * scene.facts.frames + row.frame;
            kinds.push((Decided { decision, frames: 1, first }, [n; 2]));
        }
    }
    if kinds.iter().all(|(kind, _)| kind.decision == ALWAYS || kind.decision.is_empty()) {
        return Vec::new();
    }
    kinds.sort_by_key(|(kind, _)| (std::cmp::Reverse(kind.frames), kind.first));
    let with_numbers = |(kind, [least, most]): (Decided, [u64; 2])| {
        let numbers =
            if least == most { count(least) } else { format!("{} to {}", count(least), count(most)) };
        Decided { decision: kind.decision.replace('#', &numbers), ..kind }
    };
    kinds.into_iter().map(with_numbers).collect()
}

/// The words with `#` for the first number in them, and that number.
fn without_number(words: &str) -> (String, u64) {
    let Some(start) = words.find(|c: char| c.is_ascii_digit()) else { return (words.to_owned(), 0) };
    let rest = words[start..].trim_start_matches(|c: char| c.is_ascii_digit());
    let number = &words[start..words.len() - rest.len()];
    (format!("{}#{rest}", &words[..start]), number.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::record::Row;

    #[test]
    fn like_decisions_are_counted_together() {
        let row = |(frame, decision): (usize, &&str)| Row {
            strategy: "auto".to_owned(),
            frame,
            decision: (*decision).to_owned(),
            ..Row::default()
        };
        let run = |decisions: &[&str]| SceneRun {
            rows: decisions.iter().enumerate().map(row).collect(),
            ..SceneRun::default()
        };
        let decided =
            decisions(&run(&["refit", "regrown above 12 trees: x", "regrown above 4000 trees: x"]), "auto");
        let words = |d: &Decided| format!("{} {} {}", d.decision.replace('\u{202f}', " "), d.frames, d.first);
        assert_eq!(
            decided.iter().map(words).collect::<Vec<_>>(),
            ["regrown above 12 to 4 000 trees: x 2 1", "refit 1 0"]
        );
        assert_eq!(decisions(&run(&[ALWAYS, ALWAYS]), "auto"), []);
        assert_eq!(decisions(&run(&["refit"]), "refit"), []);
    }
}
