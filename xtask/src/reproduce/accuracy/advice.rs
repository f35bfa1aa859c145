//! What to choose when: one sentence for each family of curves, worked out from its points.

use super::curve::{Family, pareto_front};
use crate::reproduce::chart::precise;

/// A setting, over all conditions.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Choice<'a> {
    setting: &'a str,
    is_default: bool,
    /// Mean over conditions.
    cost: f64,
    /// Greatest over conditions.
    error: f64,
}

/// What the settings cost.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Cost {
    Milliseconds,
    Megabytes,
}

impl Cost {
    /// Memory where the setting takes some, time otherwise.
    pub(super) fn of(family: &Family<'_>) -> Self {
        let mut points = family.curves.iter().flat_map(|curve| &curve.points);
        if points.any(|point| point.bytes.is_some()) { Self::Megabytes } else { Self::Milliseconds }
    }

    pub(super) fn at(self, point: &super::Point) -> f64 {
        match self {
            Self::Milliseconds => point.time_ms,
            Self::Megabytes => point.bytes.unwrap_or(0) as f64 * 1e-6,
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Milliseconds => "ms",
            Self::Megabytes => "MB",
        }
    }
}

/// Errors that differ by no more than this factor count as the same in words.
const ALIKE: f64 = 1.01;

/// The sentence.
pub(super) fn sentence(family: &Family<'_>) -> String {
    let choices = choices(family);
    let points: Vec<_> = choices.iter().map(|c| (c.cost, c.error)).collect();
    let on_front = pareto_front(&points);
    let mut front: Vec<_> = choices.iter().zip(on_front).filter_map(|(c, on)| on.then_some(*c)).collect();
    front.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let (Some(cheapest), Some(best)) = (front.first(), front.last()) else { return String::new() };

    let cost_unit = Cost::of(family).unit();
    let error = |c: &Choice<'_>| with_unit(c.error, family.unit);
    let cost = |c: &Choice<'_>| format!("{} {cost_unit}", precise(c.cost));
    let both = |c: &Choice<'_>| format!("{} ({}, {})", c.setting, cost(c), error(c));
    let least = choices.iter().map(|c| c.error).fold(f64::INFINITY, f64::min);
    let most = choices.iter().map(|c| c.error).fold(f64::NEG_INFINITY, f64::max);
    let rule = if most <= ALIKE * least {
        format!(
            "All err alike ({}): take the cheapest, {} ({})",
            error(cheapest),
            cheapest.setting,
            cost(cheapest)
        )
    } else if front.len() == 1 {
        format!("Take {}: nothing is cheaper, nothing more accurate", both(cheapest))
    } else {
        let middle = knee(&front).map(|c| format!(", {} as a compromise", both(&c))).unwrap_or_default();
        format!("Take {} where cost is all{middle}, {} where accuracy is", both(cheapest), both(best))
    };
    let Some(default) = choices.iter().find(|c| c.is_default) else { return format!("{rule}.") };
    if front.contains(default) {
        return format!("{rule}; the default, {}, is on the front.", default.setting);
    }
    let clearly = |c: &&Choice<'_>| {
        let (cost, error) = (NOISE * c.cost, NOISE * c.error);
        (c.cost <= default.cost && error < default.error) || (cost < default.cost && c.error <= default.error)
    };
    match front.iter().rfind(clearly) {
        Some(better) => format!("{rule}; the default, {}, is beaten by {}.", both(default), better.setting),
        None => format!("{rule}; the default, {}, is on the front to within {PERCENT} %.", both(default)),
    }
}

/// A setting is beaten only by what is better by more than this factor: times repeat no better.
const NOISE: f64 = 1.0 + PERCENT / 100.0;
const PERCENT: f64 = 10.0;

/// A fraction needs no unit, and a ratio a sign.
fn with_unit(error: f64, unit: &str) -> String {
    match unit {
        "ratio" => format!("{}×", precise(error)),
        unit if unit.starts_with("fraction") => precise(error),
        unit => format!("{} {unit}", precise(error)),
    }
}

fn choices<'a>(family: &Family<'a>) -> Vec<Choice<'a>> {
    let cost = Cost::of(family);
    let mut choices: Vec<Choice<'a>> = Vec::new();
    let mut counts: Vec<f64> = Vec::new();
    for &point in family.curves.iter().flat_map(|curve| &curve.points) {
        let (setting, is_default) = (point.setting.as_str(), point.is_default);
        let at = choices.iter().position(|c| c.setting == setting).unwrap_or_else(|| {
            choices.push(Choice { setting, is_default, cost: 0.0, error: point.error });
            counts.push(0.0);
            choices.len() - 1
        });
        let choice = &mut choices[at];
        counts[at] += 1.0;
        choice.cost += (cost.at(point) - choice.cost) / counts[at];
        choice.error = choice.error.max(point.error);
    }
    choices
}

/// Of a front in order of cost, the setting between its ends that lies farthest below the straight line between them, both
/// axes taken as the figures have them.
fn knee<'a>(front: &[Choice<'a>]) -> Option<Choice<'a>> {
    let logarithmic = front.iter().all(|c| c.error > 0.0);
    let error = |c: &Choice<'_>| if logarithmic { c.error.ln() } else { c.error };
    let (first, last) = (front.first()?, front.last()?);
    let part = |value: f64, from: f64, to: f64| (value - from) / (to - from);
    let far = |c: &Choice<'_>| {
        part(c.cost.ln(), first.cost.ln(), last.cost.ln()) + part(error(c), error(last), error(first))
    };
    let between = front.get(1..front.len() - 1)?.iter().copied();
    between.filter(|c| far(c) < 0.9).min_by(|a, b| far(a).total_cmp(&far(b)))
}

#[cfg(test)]
mod tests {
    use super::super::curve::families;
    use super::super::point::Point;
    use super::*;

    fn points(of: &[(&str, f64, f64)], default: &str) -> Vec<Point> {
        let point = |&(setting, time_ms, error): &(&str, f64, f64)| Point {
            knob: "knob".to_owned(),
            setting: setting.to_owned(),
            is_default: setting == default,
            unit: "u".to_owned(),
            error,
            time_ms,
            ..Point::default()
        };
        of.iter().map(point).collect()
    }

    fn said(of: &[(&str, f64, f64)], default: &str) -> String {
        let points = points(of, default);
        sentence(&families(&points)[0])
    }

    #[test]
    fn the_sentence_follows_from_the_points() {
        let of = [("a", 1.0, 8.0), ("b", 2.0, 0.1), ("c", 10.0, 0.05), ("d", 11.0, 0.2)];
        assert_eq!(
            said(&of, "b"),
            "Take a (1.00 ms, 8.00 u) where cost is all, b (2.00 ms, 0.100 u) as a compromise, c (10.0 ms, 0.050 u) where \
             accuracy is; the default, b, is on the front."
        );
        let beaten = said(&of, "d");
        assert!(beaten.ends_with("the default, d (11.0 ms, 0.200 u), is beaten by c."), "{beaten}");
        assert_eq!(
            said(&[("x", 2.0, 0.0), ("y", 1.0, 0.0)], "x"),
            "All err alike (0 u): take the cheapest, y (1.00 ms); the default, x (2.00 ms, 0 u), is beaten by y."
        );
        assert_eq!(
            said(&[("x", 1.0, 1.0), ("y", 2.0, 2.0)], ""),
            "Take x (1.00 ms, 1.00 u): nothing is cheaper, nothing more accurate."
        );
        let near = said(&[("x", 1.0, 2.0), ("y", 2.0, 1.0), ("z", 2.05, 1.0)], "z");
        assert!(
            near.ends_with("the default, z (2.05 ms, 1.00 u), is on the front to within 10 %."),
            "{near}"
        );
        assert_eq!([with_unit(1.5, "ratio"), with_unit(1e-7, "fraction of it")], ["1.50×", "1.0e-7"]);
        // A straight line has no knee, and what is no number is no choice.
        let straight = said(&[("a", 1.0, 4.0), ("b", 2.0, 2.0), ("c", 4.0, 1.0), ("n", f64::NAN, 1.0)], "");
        assert!(straight.contains("where cost is all, c (") && !straight.contains(" n "), "{straight}");
    }
}
