//! The paper's claims, each judged by a stated rule from what was measured.
//!
//! `claims.json` has the paper's words and the rule of each claim; a function of the name it gives
//! judges. A ratio of times is that of their sums over the frames that both strategies were
//! measured on. Bounds stand in one file, `bounds.json`, as they are and as they were first; a
//! value of a time that alone would change the verdict, were it [`table::BAND`] more or less, is
//! named as near the bound. SAH costs do not depend on the machine and are the same in every run.

mod findings;
mod further;
mod table;
#[cfg(test)]
pub(crate) mod tests;

use serde::{Deserialize, Serialize};

pub(crate) use self::findings::judges_annealing;
pub(crate) use self::table::{Table, frame_time};
use super::results::Results;

/// The bounds of all verdicts, from one file that is never changed.
const FILE: &str = include_str!("bounds.json");

/// Where each claim holds; the file has the paper's words for each.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Bounds {
    equal: f64,
    overhead: f64,
    overhead_in_part: f64,
    magnitude: f64,
    refit_scenes: f64,
    ideal_close: f64,
    very_close: f64,
    #[serde(rename = "match")]
    matches: f64,
    slower: f64,
    first_rules: bool,
    explodes: f64,
    key_frames: f64,
    key_frames_in_part: f64,
    stable: f64,
    annealed: f64,
    quarter_low: f64,
    quarter_high: f64,
    worst_frame: f64,
    insensitive: f64,
    as_poor: f64,
    hlbvh: f64,
    fewer_cores: f64,
    settles: f64,
    fast_motion: f64,
    memory: f64,
}

/// Both sets: as they were first, and as they are.
#[derive(Clone, Debug, Deserialize)]
struct Both {
    first: Bounds,
    present: Bounds,
}

impl Both {
    fn read() -> Self {
        serde_json::from_str(FILE).expect("a file that a test reads")
    }
}

impl Bounds {
    /// Beyond noise.
    fn faster(&self, ratio: f64) -> bool {
        ratio <= 1.0 / self.equal
    }

    /// Beyond noise.
    fn slower_than(&self, ratio: f64) -> bool {
        ratio >= self.equal
    }

    /// What a ratio of times says of its numerator.
    fn in_words(&self, ratio: f64) -> &'static str {
        if self.faster(ratio) {
            "faster"
        } else if self.slower_than(ratio) {
            "slower"
        } else {
            "as fast"
        }
    }
}

/// A claim with what was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Claim {
    /// The name of the function that judges it.
    #[serde(skip_serializing)]
    judge: String,
    pub(crate) claim: String,
    /// Where the paper makes it.
    pub(crate) source: String,
    /// The paper's figure.
    pub(crate) paper: String,
    /// What was measured, scene by scene.
    #[serde(skip_deserializing)]
    pub(crate) ours: String,
    #[serde(skip_deserializing)]
    pub(crate) verdict: Verdict,
    /// The verdict by the bounds that were written first.
    #[serde(skip_deserializing)]
    pub(crate) first_verdict: Verdict,
    /// When it holds, and when in part.
    pub(crate) rule: String,
    /// What decided, or why nothing could.
    #[serde(skip_deserializing)]
    pub(crate) why: String,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Verdict {
    Holds,
    HoldsInPart,
    DoesNotHoldHere,
    #[default]
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
}

/// What a claim comes to: ours, verdict, why; or else why nothing could be judged.
type Finding = Result<(String, Verdict, String), String>;
type Judge = fn(&Results, &Bounds) -> Finding;

/// The functions that judge, by the names in `claims.json`.
const JUDGES: [(&str, Judge); 24] = [
    ("rotation_overhead", findings::rotation_overhead),
    ("rotation_against_rebuild", findings::rotation_against_rebuild),
    ("frames_against_refit", findings::frames_against_refit),
    ("frames_against_ideal", findings::frames_against_ideal),
    ("frames_against_rebuild", findings::frames_against_rebuild),
    ("gentle_scenes", findings::gentle_scenes),
    ("deforming_scenes", findings::deforming_scenes),
    ("chaos", findings::chaos),
    ("other_keys", findings::other_keys),
    ("with_rebuilds", findings::with_rebuilds),
    ("lion", findings::lion),
    ("speeds", findings::speeds),
    ("below_sweep", findings::below_sweep),
    ("candidates", findings::candidates),
    ("stability", findings::stability),
    ("annealing", findings::annealing),
    ("worst_frame", further::worst_frame),
    ("insensitive", further::insensitive),
    ("museum_cause", further::museum_cause),
    ("settling", further::settling),
    ("memory", further::memory),
    ("fewer_cores", further::fewer_cores),
    ("hlbvh", further::hlbvh),
    ("fast_motion", further::fast_motion),
];

/// Judges all claims, in the paper's order.
pub(crate) fn judge(results: &Results) -> Vec<Claim> {
    let Both { first, present, .. } = Both::read();
    let mut claims: Vec<Claim> =
        serde_json::from_str(include_str!("claims.json")).expect("a file that a test reads");
    for claim in &mut claims {
        let judge = JUDGES.into_iter().find(|(name, _)| *name == claim.judge);
        let (_, judge) = judge.expect("a name that a test looks up");
        let found = |bounds: &Bounds| {
            judge(results, bounds).unwrap_or_else(|why| ("–".to_owned(), Verdict::NotRun, why))
        };
        (claim.ours, claim.verdict, claim.why) = found(&present);
        (_, claim.first_verdict, _) = found(&first);
    }
    claims
}
