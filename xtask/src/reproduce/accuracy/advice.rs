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

    /// What it is, and the words for less and least of it.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::Milliseconds => ["time", "faster", "fastest"],
            Self::Megabytes => ["memory", "smaller", "smallest"],
        }
    }
}

/// Errors that differ by no more than this factor count as the same in words.
const ALIKE: f64 = 1.01;

/// The sentence, and another on what it counts as equal or as an error.
pub(super) fn sentence(family: &Family<'_>) -> String {
    let (choices, noise) = (choices(family), family.noise());
    let points: Vec<_> = choices.iter().map(|c| (c.cost, c.error)).collect();
    let on_front = pareto_front(&points, noise);
    let mut front: Vec<_> = choices.iter().zip(on_front).filter_map(|(c, on)| on.then_some(*c)).collect();
    front.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let (Some(cheapest), Some(best)) = (front.first(), front.last()) else { return String::new() };

    let unit = Cost::of(family);
    let error = |c: &Choice<'_>| with_unit(c.error, family.unit);
    let cost = |c: &Choice<'_>| format!("{} {}", precise(c.cost), unit.unit());
    let both = |c: &Choice<'_>| format!("{} ({}, {})", c.setting, cost(c), error(c));
    let [what, less, least_of_all] = unit.words();
    let least = choices.iter().map(|c| c.error).fold(f64::INFINITY, f64::min);
    let most = choices.iter().map(|c| c.error).fold(f64::NEG_INFINITY, f64::max);
    let rule = if most <= ALIKE.max(noise) * least {
        let (error, setting, cost) = (error(cheapest), cheapest.setting, cost(cheapest));
        format!("All err alike ({error}): take the {least_of_all}, {setting} ({cost})")
    } else if front.len() == 1 {
        format!("Take {}: nothing is {less}, nothing more accurate", both(cheapest))
    } else {
        let middle = knee(&front).map(|c| format!(", {} as a compromise", both(&c))).unwrap_or_default();
        format!("Take {} where {what} is all{middle}, {} where accuracy is", both(cheapest), both(best))
    };
    let place = |default: &Choice<'_>| {
        if front.contains(default) {
            return format!("{}, is on the front", default.setting);
        }
        let clearly = |c: &&Choice<'_>| {
            let (cost, error) = (NOISE * c.cost, NOISE.max(noise) * c.error);
            (c.cost <= default.cost && error < default.error)
                || (cost < default.cost && c.error <= noise * default.error)
        };
        match front.iter().rfind(clearly) {
            Some(better) => format!("{}, is beaten by {}", both(default), better.setting),
            None => format!("{}, is on the front to within {PERCENT} %", both(default)),
        }
    };
    let defaults: Vec<_> = choices.iter().filter(|c| c.is_default).map(place).collect();
    let of_defaults = match &defaults[..] {
        [] => String::new(),
        [one] => format!("; the default, {one}"),
        all => format!("; of the defaults one, {}", all.join(", another, ")),
    };
    let mut text = format!("{rule}{of_defaults}.");
    if family.curves.len() > 1 {
        text += &format!(" Errors are those at the worst offset, {what} is the mean of all.");
    }
    if noise > 1.0 {
        let percent = 100.0 * (noise - 1.0);
        text += &format!(
            " Errors within {percent:.1} % are equal: by as much the fresh tree's times differ from themselves."
        );
    }
    text
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
            "Take a (1.00 ms, 8.00 u) where time is all, b (2.00 ms, 0.100 u) as a compromise, c (10.0 ms, 0.050 u) where \
             accuracy is; the default, b, is on the front."
        );
        let beaten = said(&of, "d");
        assert!(beaten.ends_with("the default, d (11.0 ms, 0.200 u), is beaten by c."), "{beaten}");
        assert_eq!(
            said(&[("x", 2.0, 0.0), ("y", 1.0, 0.0)], "x"),
            "All err alike (0 u): take the fastest, y (1.00 ms); the default, x (2.00 ms, 0 u), is beaten by y."
        );
        assert_eq!(
            said(&[("x", 1.0, 1.0), ("y", 2.0, 2.0)], ""),
            "Take x (1.00 ms, 1.00 u): nothing is faster, nothing more accurate."
        );
        let near = said(&[("x", 1.0, 2.0), ("y", 2.0, 1.0), ("z", 2.05, 1.0)], "z");
        assert!(
            near.ends_with("the default, z (2.05 ms, 1.00 u), is on the front to within 10 %."),
            "{near}"
        );
        assert_eq!([with_unit(1.5, "ratio"), with_unit(1e-7, "fraction of it")], ["1.50×", "1.0e-7"]);
        // A straight line has no knee, and what is no number is no choice.
        let straight = said(&[("a", 1.0, 4.0), ("b", 2.0, 2.0), ("c", 4.0, 1.0), ("n", f64::NAN, 1.0)], "");
        assert!(straight.contains("where time is all, c (") && !straight.contains(" n "), "{straight}");
    }
    #[test]
    fn what_is_noise_decides_nothing() {
        let said = |noise: f64, of: &[(&str, f64, f64)], default: &str| {
            let mut points = points(of, default);
            points[0].noise = Some(noise);
            sentence(&families(&points)[0])
        };
        let bins = [("16 bins", 1.0, 0.758), ("32 bins", 1.2, 1.01), ("64 bins", 1.5, 1.0)];
        assert!(said(1.0, &bins, "32 bins").contains("32 bins (1.20 ms, 1.01 u), is beaten by 16 bins."));
        assert_eq!(
            said(1.34, &bins, "16 bins"),
            "All err alike (0.758 u): take the fastest, 16 bins (1.00 ms); the default, 16 bins, is on the front. Errors \
             within 34.0 % are equal: by as much the fresh tree's times differ from themselves."
        );
        // Two settings that differ by less than the noise, and a third that does not.
        let three = [("a", 1.0, 2.0), ("b", 1.05, 1.04), ("c", 9.0, 1.0)];
        let text = said(1.05, &three, "c");
        assert!(
            text.starts_with("Take a (1.00 ms, 2.00 u) where time is all, b (1.05 ms, 1.04 u) where"),
            "{text}"
        );
        assert!(text.contains("c (9.00 ms, 1.00 u), is beaten by b."), "{text}");
    }

    #[test]
    fn conditions_and_several_defaults_are_named() {
        let of = |knob: &str, error| {
            let mut points = points(&[("x", 1.0, error), ("y", 2.0, error), ("z", 3.0, error)], "");
            points.iter_mut().for_each(|p| p.knob = format!("test at {knob}"));
            points[0].is_default = true;
            points[1].is_default = true;
            points
        };
        let points = [of("near", 0.1), of("far", 0.2)].concat();
        assert_eq!(
            sentence(&families(&points)[0]),
            "All err alike (0.200 u): take the fastest, x (1.00 ms); of the defaults one, x, is on the front, another, y \
             (2.00 ms, 0.200 u), is beaten by x. Errors are those at the worst offset, time is the mean of all."
        );
        let mut points = points[..3].to_vec();
        points.iter_mut().for_each(|p| p.bytes = Some(1_000_000));
        assert!(sentence(&families(&points)[0]).contains("take the smallest, x (1.00 MB)"));
    }
}
