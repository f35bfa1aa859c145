//! What matters of the points, in sentences: three for a run over scenes, advice for a model of the
//! user's.

use super::Point;
use super::curves::{Curve, families};
use crate::reproduce::chart::{number, precise};

/// The setting that the sentences are about.
const STRATEGY: &str = "refit+rotate";
/// Trace times within this factor are equal for advice, if their noise is as large.
const SAME: f64 = 1.05;

/// The three sentences, or, of points of named scenes alone, advice for each of these. None
/// where nothing was measured.
pub(crate) fn sentences(points: &[Point]) -> Vec<String> {
    if points.iter().any(|point| point.scene.is_empty()) {
        return [triangle_test(points), guards(points), strategy(points)].into_iter().flatten().collect();
    }
    let mut scenes: Vec<&str> = points.iter().map(|point| point.scene.as_str()).collect();
    scenes.dedup();
    scenes.into_iter().flat_map(|scene| advice(points, scene)).collect()
}

/// The curves of a knob and an error.
fn curves<'a>(points: &'a [Point], knob: &str, error: &str) -> Vec<Curve<'a>> {
    let wanted = families(points).into_iter().find(|f| f.knob == knob && f.error_name.starts_with(error));
    wanted.map_or(Vec::new(), |family| family.curves)
}

/// By how much more the ratios are than 1, in per cent: the geometric mean.
fn percent(ratios: impl Iterator<Item = f64>) -> Option<f64> {
    let logs: Vec<f64> = ratios.map(f64::ln).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    mean.is_finite().then(|| 100.0 * (mean.exp() - 1.0))
}

/// By how much more time one setting takes than another, over the curves of a condition.
fn cost_in_percent(curves: &[Curve<'_>], condition: &str, more: &str, less: &str) -> Option<f64> {
    let ratio = |curve: &Curve<'_>| Some(curve.get(more)?.time_ms / curve.get(less)?.time_ms);
    percent(curves.iter().filter(|curve| curve.condition == condition).filter_map(ratio))
}

/// "costs 4.0 %", or "saves" that.
fn costs(percent: f64) -> String {
    format!("{} {:.1} %", if percent < 0.0 { "saves" } else { "costs" }, percent.abs())
}

fn triangle_test(points: &[Point]) -> Option<String> {
    let frames = curves(points, "triangle test", "pixels seen");
    let cost = |condition| cost_in_percent(&frames, condition, "watertight", "fast").map(costs);
    let wall = curves(points, "triangle test on a wall", "rays leaking");
    let leaks = |setting| wall.first().and_then(|curve| Some(curve.get(setting)?.error));
    let (fast, watertight) = (precise(leaks("fast")?), leaks("watertight")?);
    let removed = match watertight {
        0.0 => format!("removes all {fast} leaks"),
        left => format!("leaves {} of {fast} leaks", precise(left)),
    };
    Some(format!(
        "The watertight triangle test {} of a frame in tiles ({} ray by ray) and {removed} in a million rays at edges.",
        cost("tiles")?,
        cost("single rays")?
    ))
}

fn guards(points: &[Point]) -> Option<String> {
    let boxes = curves(points, "conservative boxes", "rays leaking");
    let lost = precise(boxes.first()?.get("off")?.error);
    let cost = |curve: &Curve<'_>| Some(curve.get("on")?.time_ms / curve.get("off")?.time_ms);
    let guards = curves(points, "guards against NaN", "pixels lost");
    let of_strategy = guards.iter().filter(|curve| curve.condition == STRATEGY);
    let broken = of_strategy.filter_map(|curve| Some(curve.get("off")?.error)).fold(0.0, f64::max);
    Some(format!(
        "Conservative boxes: their cost is {:+.1} % of single rays, and they keep {lost} hits in a million at edges. Guards \
         against NaN: {:+.1} % of {STRATEGY}, and they keep up to {} pixels in a million when one vertex in 1000 breaks.",
        percent(boxes.iter().filter_map(cost))?,
        cost_in_percent(&guards, STRATEGY, "on", "off")?,
        number(broken)
    ))
}

fn strategy(points: &[Point]) -> Option<String> {
    let curves = curves(points, "update strategy", "trace time");
    let part = 100.0 + cost_in_percent(&curves, "", STRATEGY, "sweep")?;
    let slower = |curve: &Curve<'_>| Some(curve.get(STRATEGY)?.error / curve.get("sweep")?.error);
    let slower = percent(curves.iter().filter_map(slower))?;
    Some(format!(
        "{STRATEGY} takes {part:.1} % of the time of a sweep build in every frame, and its trees trace {:.1} % {}.",
        slower.abs(),
        if slower < 0.0 { "faster" } else { "slower" }
    ))
}

/// Which settings to use for one scene, and what they cost there.
fn advice(points: &[Point], scene: &str) -> Vec<String> {
    let of = |knob: &str, error: &str, condition: &str| {
        let curves = curves(points, knob, error);
        curves.into_iter().find(|curve| (curve.scene, curve.condition) == (scene, condition))
    };
    let test = of("triangle test", "pixels seen", "tiles").and_then(|curve| {
        let (fast, watertight) = (curve.get("fast")?, curve.get("watertight")?);
        let more = 100.0 * (watertight.time_ms / fast.time_ms - 1.0);
        Some(format!(
            "triangle test: watertight, which {} of a frame of {} ms; fast shows {} pixels in a million otherwise than \
             f64, watertight {}",
            costs(more),
            number(watertight.time_ms),
            precise(fast.error),
            precise(watertight.error)
        ))
    });
    let strategy = of("update strategy", "trace time", "").and_then(|curve| {
        let frame = |point: &&Point| point.time_ms + point.error;
        let best = curve.points.iter().copied().min_by(|a, b| frame(a).total_cmp(&frame(b)))?;
        let default = curve.points.iter().copied().find(|point| point.setting == "auto")?;
        let shown = |point: &Point| {
            let [update, trace] = [point.time_ms, point.error].map(number);
            format!("{} (update {update} ms, trace {trace} ms)", point.setting)
        };
        let noise = best.noise.unwrap_or(1.0);
        Some(match frame(&default) <= noise * frame(&best) {
            true => format!(
                "strategy: {}, which nothing beats by more than the noise; fastest frame: {}",
                shown(default),
                shown(best)
            ),
            false => format!("strategy: {}; the default is {}", shown(best), shown(default)),
        })
    });
    let strategy = strategy.or(Some("strategy: none, for nothing moves".to_owned()));
    let builder = of("builder", "trace time", "").and_then(|curve| {
        let least = curve.points.iter().map(|point| point.error).fold(f64::INFINITY, f64::min);
        let equal =
            curve.points.iter().filter(|point| point.error <= point.noise.unwrap_or(1.0).min(SAME) * least);
        let best = equal.copied().min_by(|a, b| a.time_ms.total_cmp(&b.time_ms))?;
        let sweep = curve.get("sweep")?;
        Some(format!(
            "builder and leaf size: {}, built in {} ms, traced in {} ms; sweep with leaves of one: {} and {}; equal \
             trees differ by up to {:.0} %",
            best.setting,
            number(best.time_ms),
            number(best.error),
            number(sweep.time_ms),
            number(sweep.error),
            100.0 * (best.noise.unwrap_or(1.0) - 1.0)
        ))
    });
    [strategy, builder, test].into_iter().flatten().map(|line| format!("{scene}: {line}.")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(scene: &str, point: Point) -> Point {
        Point { scene: scene.to_owned(), ..point }
    }

    fn of_scene(scene: &str) -> Vec<Point> {
        let test = |cond: &str, setting: &str, ms, error| {
            let point = Point::new(&format!("triangle test at {cond}"), setting, false, ms);
            at(scene, point.with("pixels seen or lit otherwise than with f64", error, "in a million"))
        };
        let tree = |knob: &str, setting: &str, ms, error| {
            let point = Point { noise: Some(1.1), ..Point::new(knob, setting, false, ms) };
            at(scene, point.with("trace time", error, "ms"))
        };
        vec![
            test("tiles", "fast", 10.0, 50.0),
            test("tiles", "watertight", 10.4, 0.0),
            test("single rays", "fast", 100.0, 50.0),
            test("single rays", "watertight", 99.0, 0.0),
            tree("update strategy", "auto", 3.0, 10.0),
            tree("update strategy", "refit+rotate", 2.0, 10.5),
            tree("update strategy", "sweep", 100.0, 10.0),
            tree("builder", "sweep", 100.0, 10.0),
            tree("builder", "16 bins", 5.0, 10.5),
            tree("builder", "lbvh", 2.0, 13.0),
        ]
    }

    #[test]
    fn a_model_gets_advice_from_what_was_measured_on_it() {
        let lines = sentences(&of_scene("fox.glb"));
        assert_eq!(lines.len(), 3);
        assert!(
            lines[0]
                .starts_with("fox.glb: strategy: auto (update 3.00 ms, trace 10.0 ms), which nothing beats")
        );
        assert!(lines[1].contains("16 bins, built in 5.00 ms, traced in 10.5 ms"), "{}", lines[1]);
        assert!(lines[2].contains("watertight, which costs 4.0 % of a frame"), "{}", lines[2]);
    }

    #[test]
    fn a_run_over_scenes_says_what_accuracy_costs() {
        let mut points = [of_scene("a"), of_scene("b")].concat();
        let wall = |setting, error| {
            Point::new("triangle test on a wall at the origin", setting, false, 1.0).with(
                "rays leaking",
                error,
                "",
            )
        };
        points.extend([wall("fast", 312.0), wall("watertight", 0.0)]);
        let lines = sentences(&points);
        assert_eq!(lines.len(), 2, "nothing is said of what was not measured");
        assert!(sentences(&[]).is_empty());
        assert!(
            lines[0].contains(
                "costs 4.0 % of a frame in tiles (saves 1.0 % ray by ray) and removes all 312 leaks"
            )
        );
        assert!(
            lines[1].contains("takes 2.0 % of the time of a sweep build")
                && lines[1].contains("5.0 % slower")
        );
    }
}
