//! The paper's claims, each judged by a stated rule from what was measured.
//!
//! A ratio of times is that of their sums over the frames that both strategies were measured on.
//! Times that differ by less than [`ratios::NOISE`] count as equal, and every bound is plain; a
//! value of a time that alone would change the verdict, were it [`table::BAND`] more or less, is
//! named as near the bound. SAH costs do not depend on the machine and are the same in every run.
//! `docs/PAPER.md` lists the rules.

mod findings;
mod museum;
mod ratios;
mod table;
#[cfg(test)]
pub(crate) mod tests;

use serde::Serialize;

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

/// All claims, in the paper's order.
pub(crate) fn judge(results: &Results) -> Vec<Claim> {
    let claim = |claim, source, paper, rule, Finding(ours, verdict, why)| Claim {
        claim,
        source,
        paper,
        ours,
        verdict,
        rule,
        why,
    };
    vec![
        claim(
            "Rotations add little to the time of refitting",
            "section 3, figure 4",
            "1.6 to 2 times refit",
            "Sum of the update times over refit's. Holds if at most 2.1 in every scene that moves; in part if at most 3 in more than \
             half of them.",
            findings::rotation_overhead(results),
        ),
        claim(
            "An update with rotations costs an order of magnitude less than an ideally parallel rebuild",
            "section 3, figure 4",
            "usually about 10 times cheaper",
            "Sum of the update times of ideal-parallel-binned over refit+rotate's. Holds if at least 5 in more than half of the scenes \
             that move; in part if at least 1.05 in as many.",
            findings::rotation_against_rebuild(results),
        ),
        claim(
            "With rotations frames are almost always as fast as with refitting, or faster",
            "section 3, figure 6a",
            "almost always better",
            "Sum of the frame times over refit's. Holds if at most 1.05 in at least five sixths (\"almost always\") of the \
             scenes that move; in part if in more than half of them.",
            findings::frames_against_refit(results),
        ),
        claim(
            "Never faster than the ideal update, often close to it",
            "section 3, figure 6a",
            "never; often fairly close",
            "Sum of the frame times over ideal's. Holds if at least 0.952 (1/1.05) in every scene that moves and at most 1.5 (\"fairly \
             close\") in half of them; in part if one of the two.",
            findings::frames_against_ideal(results),
        ),
        claim(
            "Rotations match or beat even an ideally parallel rebuild, but for the museum",
            "section 5",
            "on all but the BART scene",
            "Sum of the frame times over ideal-parallel-binned's. Holds if at most 1.1 (not \"significantly slower\") in every \
             scene that moves other than bart-museum; in part if in more than half of them.",
            findings::frames_against_rebuild(results),
        ),
        claim(
            "Where deformation is slight, rotations track the ideal and the parallel rebuild is slower",
            "section 3, figure 6a",
            "cloth ball, fairy forest: very close to ideal",
            "Sum of the frame times on cloth-ball and fairy-forest. Holds if on both at most 1.25 of ideal's, and \
             ideal-parallel-binned's on both at least 1.1 of it (\"significantly slower\"); in part if one of the two.",
            findings::gentle_scenes(results),
        ),
        claim(
            "Under large deformation the cost of refitting explodes, with rotations it does not",
            "section 3, figure 6b",
            "orders of magnitude against far less",
            "Worst SAH cost over that of a fresh sweep build on the same frame, on exploding-dragon, lion and n-body. \
             Holds if 10 or more for refit and below 10 with rotations on each; in part if on one of them.",
            findings::deforming_scenes(results),
        ),
        claim(
            "In utter chaos rotations beat refitting but lose to rebuilding, even serially",
            "section 3, bart-museum",
            "better than refit, worse than a serial binned rebuild",
            "Sum of the frame times on bart-museum. Holds if refit's is at least 1.05 of it, and it is at least 1.05 of binned's; in \
             part if one of the two.",
            museum::chaos(results),
        ),
        claim(
            "In the museum it is the first tree that is bad: starting from another key frame mends it",
            "section 3, bart-museum",
            "drastically better results",
            "Mean SAH cost over the first loop with rotations, started from the best other key frame, over that from the \
             first. Holds if at most 0.5; in part if at most 0.9.",
            museum::other_keys(results),
        ),
        claim(
            "In the museum, rotations with a rebuild when quality is poor beat rebuilding every frame",
            "section 3, after Lauterbach et al. 2006",
            "likely better frame rates than per frame rebuilds",
            "Sum of the frame times of refit+rotate+rebuild on bart-museum. Holds if binned-parallel's and refit+rotate's are each at \
             least 1.05 of it; in part if one of the two.",
            museum::with_rebuilds(results),
        ),
        claim(
            "On the largest scene even refitting beats the ideally parallel rebuild",
            "section 3, lion",
            "refit faster than ideal parallel binned",
            "Sum of the frame times on lion. Holds if ideal-parallel-binned's is at least 1.05 of refit's; in part if it is on half of \
             the frames measured (their median). refit+rotate is judged with the other scenes, above.",
            findings::lion(results),
        ),
        claim(
            "The speed of the animation matters little, and loops heal what fast motion does",
            "section 3, figure 5",
            "100 and 500 frames a loop alike; 20 worse at first, nearly as good after a few loops",
            "Mean SAH cost with rotations. Holds if 100 frames a loop are within 1.25 of 500 in the last loop, and 20 \
             frames a loop are worse in the first loop and within 1.25 of 500 in the last; in part if one of these.",
            findings::speeds(results),
        ),
        claim(
            "Rotations can end below the cost of a fresh sweep build",
            "section 4, fairy-forest",
            "a higher quality tree than a sweeping rebuild",
            "SAH cost over a fresh sweep build's on the same frame of fairy-forest. Holds if below 1 on the last \
             frame measured; in part if on any frame after the first.",
            findings::below_sweep(results),
        ),
        claim(
            "Only nodes with grandchildren can be rotated, a quarter of all",
            "section 3",
            "about one quarter",
            "Nodes of the first tree with grandchildren, as a part of all. Holds if between 0.2 and 0.3 in every \
             scene; in part if in more than half.",
            findings::candidates(results),
        ),
        claim(
            "Quality is stable over loops, although the jump from the last frame to the first is large",
            "section 3, figure 6b",
            "stable over 2.3 loops",
            "Mean SAH cost with rotations in later loops over that on the same frames of the first. Holds if at most \
             1.1 in every scene that moves; in part if in more than half.",
            findings::stability(results),
        ),
        claim(
            "Annealed rotations improve a static tree, where triangles are heterogeneous",
            "section 1.1, after Kensler 2008",
            "up to 18 % with path tracing",
            "Time of a path-traced picture of the first frame through the annealed tree over that through the swept one. \
             Holds if at most 0.93 on bart-museum or fairy-forest (heterogeneous), and above that on exploding-dragon and \
             lion (as if scanned), or on the one of them that was measured; in part if the first alone.",
            findings::annealing(results),
        ),
    ]
}
