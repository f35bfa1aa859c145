//! What a run says in two sentences: whether rotations pay, and which strategy to use.

use crate::reproduce::claims::{Claim, Table, Verdict, frame_time};
use crate::reproduce::contestants::Contestant;
use crate::reproduce::record::mean_frame_ms;
use crate::reproduce::results::{Results, SceneRun, Spread};

/// Frame times that differ by less are equal, as in the rules of the claims.
const NOISE: f64 = 1.05;
/// The strategy that chooses among the others. It is advised if no other is better by more than
/// [`NOISE`].
const CHOOSES: &str = "auto";

/// How many times as fast frames are with rotations as with refitting alone, on the frames that
/// both were measured on.
pub(super) fn speedup(scene: &SceneRun) -> Option<f64> {
    frame_time(scene, "refit", "refit+rotate").filter(|ratio| ratio.is_finite())
}

/// Whether rotations pay, in which scenes, by how much.
pub(super) fn headline(results: &Results) -> String {
    let mut ratios = Table::of(results.moving(), speedup);
    for (name, ratio) in ratios.rows.iter_mut().filter(|row| row.1 < 1.0 / NOISE) {
        *name += &format!(" (frames take {:.2} times as long)", 1.0 / *ratio);
    }
    let pays = |ratio: f64| ratio > NOISE;
    match Spread::of(ratios.rows.iter().map(|row| row.1).filter(|&ratio| pays(ratio))) {
        None if ratios.rows.is_empty() => {
            "This run does not compare rotations with refitting alone.".to_owned()
        }
        None => ratios.scenes_where("Rotations pay", pays) + ".",
        Some(Spread { min, max, .. }) => {
            let [least, most] = [min, max].map(|ratio| format!("{ratio:.*}", usize::from(ratio < 9.95)));
            let range = if least == most { most } else { format!("{least} to {most}") };
            let fast = format!("frames are {range} times as fast as with refitting alone");
            let (some, all) = (ratios.count(pays), ratios.len());
            if 2 * some < all {
                let except = ratios.except(pays);
                return format!(
                    "Rotations do not pay in {} of {all} scenes: {except}. Elsewhere {fast}.",
                    all - some
                );
            }
            ratios.scenes_where(&format!("Rotations pay: {fast}"), pays) + "."
        }
    }
}

impl Results {
    /// Tally of verdicts, headline and advice, for the terminal.
    pub(crate) fn answer(&self, claims: &[Claim]) -> String {
        let count = |verdict| claims.iter().filter(|claim| claim.verdict == verdict).count();
        let kinds = [Verdict::Holds, Verdict::HoldsInPart, Verdict::DoesNotHoldHere, Verdict::NotRun];
        let [hold, part, fail, rest] = kinds.map(count);
        let is_quick = self.settings.preset == "quick";
        let quick = if is_quick { " (hints, not results: quick measures little)" } else { "" };
        let advice = advice(self).map_or(String::new(), |(name, how)| format!("\nUse {name}: {how}"));
        let tally = format!("{hold} hold, {part} in part, {fail} do not, {rest} were not run{quick}");
        format!("Of the paper's claims {tally}.\n{}{advice}", headline(self))
    }
}

/// How a strategy does over all scenes: frame time over that of the fastest strategy of each.
#[derive(Debug)]
struct Standing<'a> {
    strategy: &'a str,
    /// Geometric mean over the scenes.
    mean: f64,
    worst: (f64, &'a str),
}

/// Every strategy whose time is simply measured, on every scene that moves; the best comes first.
fn standings<'a>(results: &'a Results) -> Vec<Standing<'a>> {
    let scenes: Vec<_> = results.moving().collect();
    let is_usable = |name: &&String| Contestant::from_name(name).is_ok_and(|c| c.accounting().is_none());
    let usable: Vec<&String> = results.settings.strategies.iter().filter(is_usable).collect();
    let time = |scene: &SceneRun, name: &str| mean_frame_ms(&scene.of(name));
    let over_fastest = |scene: &SceneRun, strategy: &str| {
        let fastest = usable.iter().map(|name| time(scene, name)).fold(f64::INFINITY, f64::min);
        time(scene, strategy) / fastest
    };
    let standing = |strategy: &&'a String| {
        let over = scenes.iter().map(|scene| (over_fastest(scene, strategy), scene.label.as_str()));
        let over: Vec<_> = over.collect();
        let mean = (over.iter().map(|o| o.0.ln()).sum::<f64>() / over.len() as f64).exp();
        let worst = over.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        (mean.is_finite() && worst.0.is_finite()).then_some(Standing { strategy, mean, worst })
    };
    let mut all: Vec<_> = usable.iter().filter_map(standing).collect();
    all.sort_by(|a, b| a.mean.total_cmp(&b.mean));
    all
}

/// The strategy to use, and how it does; nothing if fewer than two can be compared.
pub(super) fn advice(results: &Results) -> Option<(&str, String)> {
    let all = standings(results);
    let (best, second) = (all.first()?, all.get(1)?);
    let chooses = all.iter().find(|s| s.strategy == CHOOSES);
    let pick = chooses.filter(|c| c.mean <= NOISE * best.mean).unwrap_or(best);
    let other = if pick.strategy == best.strategy { second } else { best };
    let is_one = results.moving().count() == 1;
    let worst = |s: &Standing<'_>| {
        if is_one { String::new() } else { format!(" (at worst {:.2}, on {})", s.worst.0, s.worst.1) }
    };
    let mut text = format!(
        "its frames take {:.2} times as long as those of the fastest strategy of each scene{}. {} {}, {:.2}{}.",
        pick.mean,
        worst(pick),
        if other.mean <= NOISE * pick.mean { "No clear winner; within 5 % is" } else { "Next best:" },
        other.strategy,
        other.mean,
        worst(other),
    );
    if let Some(chooses) = chooses.filter(|c| c.strategy != pick.strategy && c.strategy != other.strategy) {
        text += &format!(" What chooses by itself, {CHOOSES}: {:.2}{}.", chooses.mean, worst(chooses));
    }
    Some((pick.strategy, text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::claims::tests::{results, scene};

    fn two(refit: f64, rotate: f64, auto: f64) -> [(&'static str, f64, f64, f64); 4] {
        let ideal = ("ideal", 0.0, 1.0, 1.0);
        [("refit", 1.0, refit, 9.0), ("refit+rotate", 1.0, rotate, 9.0), ("auto", 1.0, auto, 9.0), ideal]
    }

    #[test]
    fn headlines_say_in_which_scenes_rotations_pay() {
        let run = |scenes: &[f64]| {
            let scenes =
                scenes.iter().zip(["a", "b", "c"]).map(|(&rotate, name)| scene(name, &two(9.0, rotate, 3.0)));
            headline(&results(scenes.collect()))
        };
        assert_eq!(
            run(&[4.0]),
            "Rotations pay: frames are 2.0 times as fast as with refitting alone in the only scene."
        );
        assert_eq!(
            run(&[4.0, 1.0]),
            "Rotations pay: frames are 2.0 to 5.0 times as fast as with refitting alone in every scene."
        );
        let mixed = run(&[4.0, 9.0, 19.0]);
        assert!(
            mixed
                .starts_with("Rotations do not pay in 2 of 3 scenes: b, c (frames take 2.00 times as long)."),
            "{mixed}"
        );
        assert!(
            mixed.ends_with("Elsewhere frames are 2.0 times as fast as with refitting alone."),
            "{mixed}"
        );
        assert!(
            run(&[4.0, 3.0, 19.0]).contains("as with refitting alone in 2 of 3 scenes; not in c (frames")
        );
        assert!(run(&[4.0, 9.0]).contains("in 1 of 2 scenes; not in b"));
        assert_eq!(run(&[9.0, 9.1]), "Rotations pay in no scene: a, b.");
        assert!(run(&[]).contains("does not compare"));
    }

    #[test]
    fn advice_is_auto_unless_another_is_better_by_more_than_noise() {
        let run = |auto: f64| {
            let scenes = vec![scene("a", &two(9.0, 3.0, auto)), scene("b", &two(3.0, 9.0, auto))];
            let results = results(scenes);
            let (strategy, how) = advice(&results).unwrap();
            (strategy.to_owned(), how)
        };
        let (close, how) = run(3.1);
        assert!(
            close == "auto" && how.contains("1.02 times") && how.contains("(at worst 1.02, on "),
            "{how}"
        );
        // The two others take 1 and 10/4 of the fastest, auto 9/4 on both scenes.
        let (far, how) = run(8.0);
        assert!(
            far == "refit" && how.contains("1.58 times") && how.contains("(at worst 2.50, on b)"),
            "{how}"
        );
        assert!(how.contains("auto: 2.25 ("), "{how}");
        assert!(!how.contains("ideal"), "what is not simply measured is no advice");
        let close = results(vec![scene("a", &two(9.0, 3.1, 3.0))]);
        assert!(advice(&close).unwrap().1.contains("No clear winner; within 5 % is refit+rotate, 1.0"));
        assert_eq!(advice(&results(Vec::new())), None);
    }
}
