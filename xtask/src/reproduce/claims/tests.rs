//! The rules, on made-up measurements.

use super::*;
use crate::machine::{Machine, Revision};
use crate::reproduce::check::Checks;
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneFacts, SceneRun, Settings};

/// Three frames of a scene: update time, trace time and cost of each strategy.
fn scene(label: &str, strategies: &[(&'static str, f64, f64, f64)]) -> SceneRun {
    let row =
        |frame: usize, &(strategy, update_ms, trace_ms, sah_cost): &(&'static str, f64, f64, f64)| Row {
            scene: label.to_owned(),
            strategy,
            threads: 2,
            round: frame / 2,
            frame: frame % 2,
            update_ms,
            trace_ms,
            frame_ms: update_ms + trace_ms,
            sah_cost,
            height: 9,
            frames_per_loop: 2,
            ..Row::default()
        };
    SceneRun {
        facts: SceneFacts {
            label: label.to_owned(),
            slug: label.to_owned(),
            triangles: 10,
            moving: 10,
            frames: 2,
            rebuild_every: 1,
            build_ms: 1.0,
            candidates: 0.25,
            ..SceneFacts::default()
        },
        pictures: Vec::new(),
        rows: (0..3).flat_map(|frame| strategies.iter().map(move |s| row(frame, s))).collect(),
        speeds: Vec::new(),
        accuracy: Vec::new(),
        checks: Checks::default(),
    }
}

fn results(scenes: Vec<SceneRun>) -> Results {
    let settings = Settings {
        preset: "quick",
        experiments: Vec::new(),
        strategies: Vec::new(),
        loops: 1.5,
        size: 1,
        threads: 2,
        seed: 0,
        reductions: Vec::new(),
        command: String::new(),
    };
    let (machine, revision) = (Machine::read(), Revision::read());
    Results { machine, revision, settings, scenes, interrupted: false }
}

fn verdict(results: &Results, words: &str) -> Verdict {
    let claims = judge(results);
    claims.iter().find(|c| c.claim.contains(words)).expect("a claim").verdict
}

#[test]
fn what_the_paper_saw_holds() {
    let all = results(vec![
        scene(
            "n-body",
            &[
                ("refit", 1.0, 50.0, 500.0),
                ("refit+rotate", 1.8, 12.0, 60.0),
                ("ideal", 0.0, 11.0, 40.0),
                ("ideal-parallel-binned", 18.0, 11.5, 42.0),
            ],
        ),
        scene(
            "fairy-forest",
            &[
                ("refit", 1.0, 10.5, 31.0),
                ("refit+rotate", 1.8, 9.0, 29.0),
                ("ideal", 0.0, 10.0, 30.0),
                ("ideal-parallel-binned", 20.0, 10.0, 30.0),
            ],
        ),
    ]);
    for words in [
        "add little",
        "order of magnitude",
        "as fast as with refitting",
        "Never faster",
        "slight",
        "explodes",
        "below the cost of a fresh",
        "a quarter of all",
        "stable over loops",
    ] {
        assert_eq!(verdict(&all, words), Verdict::Holds, "{words}");
    }
    for words in ["utter chaos", "largest scene", "speed of the animation", "annealed"] {
        assert_eq!(verdict(&all, words), Verdict::NotTested, "{words}");
    }
}

#[test]
fn the_contrary_does_not() {
    let all = results(vec![
        scene(
            "lion",
            &[
                ("refit", 1.0, 10.0, 30.0),
                ("refit+rotate", 3.0, 12.0, 600.0),
                ("ideal", 0.0, 20.0, 30.0),
                ("ideal-parallel-binned", 0.5, 2.0, 30.0),
            ],
        ),
        scene(
            "bart-museum",
            &[("refit", 1.0, 1.0, 9.0), ("refit+rotate", 2.0, 1.0, 9.0), ("binned", 9.0, 1.0, 9.0)],
        ),
    ]);
    for words in
        ["order of magnitude", "as fast as with refitting", "explodes", "largest scene", "utter chaos"]
    {
        assert_eq!(verdict(&all, words), Verdict::DoesNotHoldHere, "{words}");
    }
    assert_eq!(verdict(&all, "add little"), Verdict::HoldsInPart, "in one of two scenes");
    assert_eq!(verdict(&all, "Never faster"), Verdict::HoldsInPart, "close, but below");
}

#[test]
fn nothing_measured_decides_nothing() {
    assert!(judge(&results(Vec::new())).iter().all(|c| c.verdict == Verdict::NotTested));
    let still = SceneRun { facts: SceneFacts { moving: 0, ..scene("x", &[]).facts }, ..scene("x", &[]) };
    assert_eq!(verdict(&results(vec![still]), "add little"), Verdict::NotTested);
}
