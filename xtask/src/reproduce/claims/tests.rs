//! The rules, on made-up measurements.

use super::*;
use crate::machine::{Machine, Revision};
use crate::reproduce::record::Row;
use crate::reproduce::results::{Results, SceneFacts, SceneRun, Settings};

/// Three frames of a scene: update time, trace time and cost of each strategy.
pub(crate) fn scene(label: &str, strategies: &[(&'static str, f64, f64, f64)]) -> SceneRun {
    let row =
        |frame: usize, &(strategy, update_ms, trace_ms, sah_cost): &(&'static str, f64, f64, f64)| Row {
            scene: label.to_owned(),
            strategy: strategy.to_owned(),
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
    let facts = SceneFacts {
        label: label.to_owned(),
        slug: label.to_owned(),
        triangles: 10,
        moving: 10,
        frames: 2,
        measure_every: 1,
        build_ms: 1.0,
        candidates: 0.25,
        ..SceneFacts::default()
    };
    let rows = (0..3).flat_map(|frame| strategies.iter().map(move |s| row(frame, s))).collect();
    SceneRun { rows, ..SceneRun::new(facts) }
}

pub(crate) fn results(scenes: Vec<SceneRun>) -> Results {
    let labels = scenes.iter().flat_map(|s| &s.rows).map(|row| row.strategy.clone());
    let strategies = labels.collect::<std::collections::BTreeSet<_>>().into_iter().collect();
    let settings = Settings { preset: "quick".to_owned(), strategies, threads: 2, ..Settings::default() };
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
    for words in ["utter chaos", "largest scene", "speed of the animation", "Annealed"] {
        assert_eq!(verdict(&all, words), Verdict::NotRun, "{words}");
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
    assert!(judge(&results(Vec::new())).iter().all(|c| c.verdict == Verdict::NotRun));
    let still = SceneRun::new(SceneFacts { moving: 0, ..scene("x", &[]).facts });
    assert_eq!(verdict(&results(vec![still]), "add little"), Verdict::NotRun);
}

#[test]
fn the_museum_is_judged_apart() {
    let museum = |cost| {
        scene(
            "bart-museum",
            &[
                ("refit", 1.0, 90.0, 900.0),
                ("refit+rotate", 2.0, 40.0, cost),
                ("refit+rotate+rebuild", 5.0, 12.0, 50.0),
                ("binned", 8.0, 12.0, 40.0),
                ("binned-parallel", 6.0, 12.0, 40.0),
                ("paper-binned", 60.0, 12.0, 40.0),
            ],
        )
    };
    let other = |cost| {
        let run = scene("bart-museum:2", &[("refit+rotate", 2.0, 15.0, cost)]);
        SceneRun { facts: SceneFacts { supplement: true, ..run.facts }, ..run }
    };
    let all = results(vec![museum(400.0), other(80.0)]);
    for words in ["utter chaos", "first tree that is bad", "rebuild when quality is poor"] {
        assert_eq!(verdict(&all, words), Verdict::Holds, "{words}");
    }
    assert!(judge(&all).iter().any(|c| c.why.contains("as the paper’s code had it")));
    assert_eq!(verdict(&results(vec![museum(400.0), other(399.0)]), "first tree"), Verdict::DoesNotHoldHere);
    assert_eq!(verdict(&results(vec![museum(400.0)]), "first tree"), Verdict::NotRun);
}

#[test]
fn annealing_is_judged_by_paths() {
    use crate::reproduce::offline::OfflineTree;
    let tree = |builder: &str, path_ms| OfflineTree {
        builder: builder.to_owned(),
        build_ms: 1.0,
        sah_cost: 9.0,
        path_ms,
    };
    let built = |name, annealed| {
        let run = scene(name, &[("refit", 1.0, 1.0, 1.0)]);
        SceneRun { offline: vec![tree("sweep", 100.0), tree("annealed", annealed)], ..run }
    };
    let all = |museum, lion| results(vec![built("bart-museum", museum), built("lion", lion)]);
    for (museum, lion, expected) in [
        (85.0, 99.0, Verdict::Holds),
        (85.0, 85.0, Verdict::HoldsInPart),
        (99.0, 99.0, Verdict::DoesNotHoldHere),
    ] {
        assert_eq!(verdict(&all(museum, lion), "static tree"), expected, "{museum} {lion}");
    }
}

#[test]
fn what_is_near_a_bound_is_named() {
    let update = |ms| scene("lion", &[("refit", 1.0, 9.0, 9.0), ("refit+rotate", ms, 9.0, 9.0)]);
    let why = |ms| judge(&results(vec![update(ms)]))[0].why.clone();
    assert!(why(2.12).contains("near the bound: lion") && !why(1.7).contains("near"));
    let found = |ms| judge(&results(vec![update(ms)]))[0].verdict;
    let verdicts = [1.7, 2.08, 2.12].map(found);
    assert_eq!(verdicts, [Verdict::Holds, Verdict::HoldsInPart, Verdict::HoldsInPart]);
}

/// Figure 5 with some frames of each loop measured, and a last loop that is cut short.
#[test]
fn the_speed_is_judged_by_whole_loops() {
    let rows = |frames: usize, costs: [f64; 3]| -> Vec<Row> {
        let row = |round: usize, frame| Row {
            round,
            frame,
            frames_per_loop: frames,
            sah_cost: costs[round],
            ..Row::default()
        };
        (0..3)
            .flat_map(|round| (0..4 - usize::from(round == 2)).map(move |i| (round, i)))
            .map(|(round, i)| row(round, i * frames / 4))
            .collect()
    };
    let mut dragon = scene("exploding-dragon", &[("refit+rotate", 1.8, 12.0, 60.0)]);
    let speeds = |last_of_20| {
        vec![(20, rows(20, [3.0, last_of_20, 99.0])), (100, rows(100, [1.1; 3])), (500, rows(500, [1.0; 3]))]
    };
    for (last_of_20, expected) in [(1.2, Verdict::Holds), (2.0, Verdict::HoldsInPart)] {
        let all =
            results(vec![SceneRun { speeds: speeds(last_of_20), ..SceneRun::new(dragon.facts.clone()) }]);
        assert_eq!(verdict(&all, "speed of the animation"), expected, "{last_of_20}");
    }
    dragon.speeds = vec![(20, rows(20, [1.0; 3]))];
    assert_eq!(verdict(&results(vec![dragon]), "speed of the animation"), Verdict::NotRun);
}
