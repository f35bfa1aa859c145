//! What the paper says of its exception, the chaotic museum.

use super::Finding;
use super::bounds::Bounds;
use super::findings::missing;
use super::ratios::{BINNED_PARALLEL, REBUILD, REFIT, ROTATE, frame_time, mean_cost};
use super::table::{Table, both, by_ratios, graded};
use crate::reproduce::contestants::{IDEAL, PAPER_BINNED};
use crate::reproduce::results::Results;
use crate::reproduce::{MUSEUM, OTHER_KEYS};

/// Of the first rule of the museum with rebuilds (docs/PAPER.md).
const FIRST_MARGIN: f64 = 1.05;

/// The frame time of a strategy over that of another, if both were run.
fn over(results: &Results, strategy: &'static str, other: &'static str) -> Result<f64, String> {
    let ratio = results.scene(MUSEUM).and_then(|scene| frame_time(scene, strategy, other));
    ratio.ok_or_else(|| missing(&[MUSEUM]))
}

pub(super) fn chaos(results: &Results, b: &Bounds) -> Finding {
    let (refit, binned) = (over(results, ROTATE, REFIT)?, over(results, ROTATE, "binned")?);
    let ratios = [("against refit", refit), ("against binned", binned)];
    let (mut verdict, near) =
        by_ratios(ratios, |[refit, binned]| both(b.faster(refit), b.slower_than(binned)));
    if b.first_rules {
        verdict = both(refit < 1.0, binned > 1.0);
    }
    let ours = format!("{refit:.2} of refit, {binned:.2} of a serial binned rebuild");
    let [to_refit, to_rebuild] = [refit, binned].map(|ratio| b.in_words(ratio));
    let mut why = format!("{to_refit} against refit, {to_rebuild} against the serial rebuild{near}");
    if let Ok(paper) = over(results, ROTATE, PAPER_BINNED) {
        why += &format!("; {paper:.2} of a serial rebuild with bins along one axis");
    }
    Ok((ours, verdict, why))
}

pub(super) fn other_keys(results: &Results, b: &Bounds) -> Finding {
    let cost = |label: &str, strategy| results.scene(label).and_then(|s| mean_cost(s, strategy));
    let first = cost(MUSEUM, ROTATE).ok_or_else(|| missing(&[MUSEUM]))?;
    let others = OTHER_KEYS.iter().filter_map(|&key| results.scene(key));
    let table = Table::of(others, |s| Some(mean_cost(s, ROTATE)? / first))
        .or("bart-museum was not run from its other key frames")?;
    let best = table.least();
    let ideal = cost(MUSEUM, IDEAL);
    let ideal = ideal.map(|cost| format!("; a fresh tree on every frame {:.2}", cost / first));
    let why = format!("the best other start has {best:.2} of the cost{}", ideal.unwrap_or_default());
    Ok((table.text(), graded(best <= b.key_frames, best <= b.key_frames_in_part), why))
}

pub(super) fn with_rebuilds(results: &Results, b: &Bounds) -> Finding {
    let (rebuilt, rotated) = (over(results, REBUILD, BINNED_PARALLEL)?, over(results, REBUILD, ROTATE)?);
    let ratios = [("against binned-parallel", rebuilt), ("against refit+rotate", rotated)];
    let (mut verdict, near) =
        by_ratios(ratios, |[rebuilt, rotated]| both(b.faster(rebuilt), b.faster(rotated)));
    if b.first_rules {
        verdict = both(rebuilt <= FIRST_MARGIN, rotated <= 1.0 / FIRST_MARGIN);
    }
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
    Ok((ours, verdict, why))
}
