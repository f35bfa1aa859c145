//! What the paper says of its exception, the chaotic museum.

use super::findings::{
    NOISE, REBUILD, REFIT, ROTATE, faster, frame_time, mean_cost, missing, pair_verdict, slower,
    total_frame_time,
};
use super::table::Table;
use super::{Finding, Verdict};
use crate::reproduce::contestants::{IDEAL, PAPER_BINNED};
use crate::reproduce::results::Results;
use crate::reproduce::{MUSEUM, OTHER_KEYS};

pub(super) fn chaos(results: &Results) -> Finding {
    let found = results
        .scene(MUSEUM)
        .and_then(|s| Some((s, frame_time(s, ROTATE, REFIT)?, frame_time(s, ROTATE, "binned")?)));
    let Some((scene, refit, binned)) = found else { return missing(&[MUSEUM]) };
    let ours = format!("{refit:.2} of refit, {binned:.2} of a serial binned rebuild");
    let words = |r: f64| {
        if faster(r) {
            "faster"
        } else if slower(r) {
            "slower"
        } else {
            "no faster or slower"
        }
    };
    let mut why = format!("{} than refit, {} than the serial rebuild", words(refit), words(binned));
    if let Some(paper) = frame_time(scene, ROTATE, PAPER_BINNED) {
        why += &format!("; {paper:.2} of a serial rebuild as the paper’s code had it");
    }
    Finding(ours, pair_verdict(faster(refit), slower(binned)), why)
}

pub(super) fn other_keys(results: &Results) -> Finding {
    let cost = |label: &str| results.scene(label).and_then(|s| mean_cost(s, ROTATE));
    let others = OTHER_KEYS.iter().filter_map(|&key| results.scene(key));
    let (Some(first), table) = (cost(MUSEUM), Table::of(others, |s| mean_cost(s, ROTATE))) else {
        return missing(&[MUSEUM]);
    };
    let best = table.0.iter().map(|(_, cost)| cost / first).fold(f64::INFINITY, f64::min);
    if table.len() == 0 {
        return Finding::not_run("bart-museum was not run from its other key frames");
    }
    let verdict = match best {
        ..=0.5 => Verdict::Holds,
        ..=0.9 => Verdict::HoldsInPart,
        _ => Verdict::DoesNotHoldHere,
    };
    let over = Table(table.0.iter().map(|(name, cost)| (name.clone(), cost / first)).collect());
    let ideal = results.scene(MUSEUM).and_then(|s| mean_cost(s, IDEAL));
    let ideal = ideal.map(|cost| format!("; a fresh tree on every frame {:.2}", cost / first));
    let why = format!("the best other start has {best:.2} of the cost{}", ideal.unwrap_or_default());
    Finding(over.text(), verdict, why + &over.near(&[0.5, 0.9]))
}

pub(super) fn with_rebuilds(results: &Results) -> Finding {
    let found = results.scene(MUSEUM).and_then(|s| {
        Some((s, total_frame_time(s, REBUILD, "binned-parallel")?, total_frame_time(s, REBUILD, ROTATE)?))
    });
    let Some((scene, rebuilt, rotated)) = found else { return missing(&[MUSEUM]) };
    let rows = scene.of(REBUILD);
    let rebuilds = rows.iter().filter(|row| row.decision.starts_with("built anew")).count();
    let ours =
        format!("{rebuilt:.2} of a rebuild on all threads every frame, {rotated:.2} of rotations alone");
    let why = format!("the tree was built anew on {rebuilds} of {} frames", rows.len());
    Finding(ours, pair_verdict(rebuilt <= NOISE, faster(rotated)), why)
}
