//! What the paper says of its exception, the chaotic museum.

use super::bounds::Bounds;
use super::findings::missing;
use super::ratios::{BINNED_PARALLEL, REBUILD, REFIT, ROTATE, frame_time, mean_cost};
use super::table::{Table, by_times, graded};
use super::{Finding, Rule};
use crate::reproduce::contestants::{IDEAL, PAPER_BINNED};
use crate::reproduce::results::Results;
use crate::reproduce::{MUSEUM, OTHER_KEYS};

/// The frame time of a strategy over that of another, if both were run.
fn over(results: &Results, strategy: &'static str, other: &'static str) -> Option<f64> {
    results.scene(MUSEUM).and_then(|scene| frame_time(scene, strategy, other))
}

pub(super) const CHAOS: Rule = Rule {
    claim: "In utter chaos rotations beat refitting but lose to rebuilding, even serially",
    source: "section 3, bart-museum",
    paper: "better than refit, worse than a serial binned rebuild",
    rule: "Sum of the frame times on bart-museum. Holds if refit's is at least 1.05 of it, and it is at least 1.05 of binned's; in \
           part if one of the two.",
    judge: chaos,
};

fn chaos(results: &Results, b: &Bounds) -> Finding {
    let (Some(refit), Some(binned)) = (over(results, ROTATE, REFIT), over(results, ROTATE, "binned")) else {
        return missing(&[MUSEUM]);
    };
    let tables = [("against refit", refit), ("against binned", binned)].map(Table::single);
    let (verdict, near) = by_times(tables.each_ref(), |[refit, binned]| {
        let (beats, loses) = (refit.all(|r| b.faster(r)), binned.all(|r| b.slower_than(r)));
        graded(beats && loses, beats || loses)
    });
    let ours = format!("{refit:.2} of refit, {binned:.2} of a serial binned rebuild");
    let mut why = format!(
        "{} against refit, {} against the serial rebuild{near}",
        b.in_words(refit),
        b.in_words(binned)
    );
    if let Some(paper) = over(results, ROTATE, PAPER_BINNED) {
        why += &format!("; {paper:.2} of a serial rebuild with bins along one axis");
    }
    Finding(ours, verdict, why)
}

pub(super) const OTHER_KEY_FRAMES: Rule = Rule {
    claim: "In the museum it is the first tree that is bad: starting from another key frame mends it",
    source: "section 3, bart-museum",
    paper: "drastically better results",
    rule: "Mean SAH cost over the first loop with rotations, started from the best other key frame, over that from the \
           first. Holds if at most 0.5; in part if at most 0.9.",
    judge: other_keys,
};

fn other_keys(results: &Results, b: &Bounds) -> Finding {
    let cost = |label: &str| results.scene(label).and_then(|s| mean_cost(s, ROTATE));
    let Some(first) = cost(MUSEUM) else { return missing(&[MUSEUM]) };
    let others = OTHER_KEYS.iter().filter_map(|&key| results.scene(key));
    let table = Table::of(others, |s| Some(mean_cost(s, ROTATE)? / first));
    if table.is_empty() {
        return Finding::not_run("bart-museum was not run from its other key frames");
    }
    let best = table.0.iter().map(|(_, ratio)| *ratio).fold(f64::INFINITY, f64::min);
    let ideal = results.scene(MUSEUM).and_then(|s| mean_cost(s, IDEAL));
    let ideal = ideal.map(|cost| format!("; a fresh tree on every frame {:.2}", cost / first));
    let why = format!("the best other start has {best:.2} of the cost{}", ideal.unwrap_or_default());
    Finding(table.text(), graded(best <= b.key_frames, best <= b.key_frames_in_part), why)
}

pub(super) const WITH_REBUILDS: Rule = Rule {
    claim: "In the museum, rotations with a rebuild when quality is poor beat rebuilding every frame",
    source: "section 3, after Lauterbach et al. 2006",
    paper: "likely better frame rates than per frame rebuilds",
    rule: "Sum of the frame times of refit+rotate+rebuild on bart-museum. Holds if binned-parallel's and refit+rotate's are each at \
           least 1.05 of it; in part if one of the two.",
    judge: with_rebuilds,
};

fn with_rebuilds(results: &Results, b: &Bounds) -> Finding {
    let found = (over(results, REBUILD, BINNED_PARALLEL), over(results, REBUILD, ROTATE));
    let (Some(rebuilt), Some(rotated)) = found else { return missing(&[MUSEUM]) };
    let tables = [("against binned-parallel", rebuilt), ("against refit+rotate", rotated)].map(Table::single);
    let (verdict, near) = by_times(tables.each_ref(), |[rebuilt, rotated]| {
        let (beats_rebuilds, beats_rotations) = (rebuilt.all(|r| b.faster(r)), rotated.all(|r| b.faster(r)));
        graded(beats_rebuilds && beats_rotations, beats_rebuilds || beats_rotations)
    });
    let rows = results.scene(MUSEUM).map(|scene| scene.of(REBUILD)).unwrap_or_default();
    let rebuilds = rows.iter().filter(|row| row.decision.contains("buil")).count();
    let ours =
        format!("{rebuilt:.2} of a rebuild on all threads every frame, {rotated:.2} of rotations alone");
    let why = format!(
        "{} against the rebuild, {} against rotations alone; the tree was rebuilt on {rebuilds} of {} frames \
         measured{near}",
        b.in_words(rebuilt),
        b.in_words(rotated),
        rows.len()
    );
    Finding(ours, verdict, why)
}
