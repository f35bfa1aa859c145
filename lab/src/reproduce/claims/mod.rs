//! The paper's claims, each judged by a stated rule from what was measured.
//!
//! A ratio of times is that of their sums over the frames that both strategies were measured on.
//! Bounds stand in one file, [`bounds`], as they are and as they were first; a
//! value of a time that alone would change the verdict, were it [`table::BAND`] more or less, is
//! named as near the bound. SAH costs do not depend on the machine and are the same in every run.
//! `docs/PAPER.md` lists the rules.

mod bounds;
mod findings;
mod further;
mod museum;
mod ratios;
mod table;
#[cfg(test)]
pub(crate) mod tests;

use serde::Serialize;

use self::bounds::{Both, Bounds};
use super::results::Results;

/// A claim with what was found.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Claim {
    pub(crate) claim: &'static str,
    /// Where the paper makes it.
    pub(crate) source: &'static str,
    /// The paper's figure.
    pub(crate) paper: &'static str,
    /// What was measured, scene by scene.
    pub(crate) ours: String,
    pub(crate) verdict: Verdict,
    /// The verdict by the bounds that were written first.
    pub(crate) first_verdict: Verdict,
    /// When it holds, and when in part.
    pub(crate) rule: &'static str,
    /// What decided, or why nothing could.
    pub(crate) why: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Verdict {
    Holds,
    HoldsInPart,
    DoesNotHoldHere,
    NotRun,
}

impl Verdict {
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::HoldsInPart => "holds in part",
            Self::DoesNotHoldHere => "does not hold here",
            Self::NotRun => "not run",
        }
    }

    /// What `count` claims do.
    pub(crate) fn counted(self, count: usize) -> String {
        let words = match (self, count) {
            (Self::NotRun, 1) => "was not run",
            (Self::NotRun, _) => "were not run",
            (_, 1) => self.words(),
            (Self::Holds, _) => "hold",
            (Self::HoldsInPart, _) => "hold in part",
            (Self::DoesNotHoldHere, _) => "do not hold here",
        };
        format!("{count} {words}")
    }
}

/// What a claim comes to: ours, verdict, why.
struct Finding(String, Verdict, String);

impl Finding {
    fn not_run(why: impl Into<String>) -> Self {
        Self("–".to_owned(), Verdict::NotRun, why.into())
    }
}

/// A claim of the paper, and how it is judged.
struct Rule {
    claim: &'static str,
    source: &'static str,
    paper: &'static str,
    rule: &'static str,
    judge: fn(&Results, &Bounds) -> Finding,
}

/// All claims, in the paper's order.
const RULES: [Rule; 24] = [
    findings::ROTATION_OVERHEAD,
    findings::ROTATION_AGAINST_REBUILD,
    findings::FRAMES_AGAINST_REFIT,
    findings::FRAMES_AGAINST_IDEAL,
    findings::FRAMES_AGAINST_REBUILD,
    findings::GENTLE_SCENES,
    findings::DEFORMING_SCENES,
    museum::CHAOS,
    museum::OTHER_KEY_FRAMES,
    museum::WITH_REBUILDS,
    findings::LION,
    findings::SPEEDS,
    findings::BELOW_SWEEP,
    findings::CANDIDATES,
    findings::STABILITY,
    findings::ANNEALING,
    further::WORST_FRAME,
    further::INSENSITIVE,
    further::MUSEUM_CAUSE,
    further::SETTLING,
    further::MEMORY,
    further::FEWER_CORES,
    further::HLBVH,
    further::FAST_MOTION,
];

/// Judges all claims.
pub(crate) fn judge(results: &Results) -> Vec<Claim> {
    let Both { first, present, .. } = Both::read();
    let judged = |&Rule { claim, source, paper, rule, judge }: &Rule| {
        let Finding(ours, verdict, why) = judge(results, &present);
        let Finding(_, first_verdict, _) = judge(results, &first);
        Claim { claim, source, paper, ours, verdict, first_verdict, rule, why }
    };
    RULES.iter().map(judged).collect()
}
