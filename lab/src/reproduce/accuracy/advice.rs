//! What to choose: one sentence for each family of curves, worked out from its points.

use super::curve::{Family, pareto_front};
use crate::reproduce::chart::precise;

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

    pub(super) fn axis(self) -> &'static str {
        if self == Self::Megabytes { "memory, MB" } else { "time, ms" }
    }
}

/// The settings on the Pareto front of mean cost and greatest error over all conditions, and
/// whether the default is one.
pub(super) fn sentence(family: &Family<'_>) -> String {
    let cost = Cost::of(family);
    let mut choices: Vec<(&str, bool, f64, f64)> = Vec::new();
    for &point in family.curves.iter().flat_map(|curve| &curve.points) {
        let share = cost.at(point) / family.curves.len() as f64;
        match choices.iter_mut().find(|choice| choice.0 == point.setting) {
            Some(choice) => (choice.2, choice.3) = (choice.2 + share, choice.3.max(point.error)),
            None => choices.push((&point.setting, point.is_default, share, point.error)),
        }
    }
    choices.sort_by(|a, b| a.2.total_cmp(&b.2));
    let places: Vec<_> = choices.iter().map(|choice| (choice.2, choice.3)).collect();
    let front = pareto_front(&places, family.noise());
    let unit = if cost == Cost::Megabytes { "MB" } else { "ms" };
    let shown = |(name, _, cost, error): &(&str, bool, f64, f64)| {
        format!("{name} ({} {unit}, error {})", precise(*cost), precise(*error))
    };
    let best: Vec<_> = choices.iter().zip(&front).filter(|(_, on)| **on).map(|(c, _)| shown(c)).collect();
    let beaten = choices.iter().zip(&front).filter(|(choice, on)| choice.1 && !**on);
    let beaten: Vec<_> =
        beaten.map(|(choice, _)| format!("The default {} is beaten.", shown(choice))).collect();
    [vec![format!("Nothing beats {}.", best.join(", "))], beaten].concat().join(" ")
}

#[cfg(test)]
mod tests {
    use super::super::curve::families;
    use super::super::point::Point;
    use super::*;

    fn said(of: &[(&str, f64, f64)], default: &str, noise: f64) -> String {
        let point = |&(setting, time_ms, error): &(&str, f64, f64)| Point {
            knob: "knob".to_owned(),
            setting: setting.to_owned(),
            is_default: setting == default,
            error,
            time_ms,
            noise: Some(noise),
            ..Point::default()
        };
        let points: Vec<Point> = of.iter().map(point).collect();
        sentence(&families(&points)[0])
    }

    #[test]
    fn the_sentence_names_the_front_and_a_beaten_default() {
        let of = [("a", 1.0, 8.0), ("b", 2.0, 0.1), ("d", 11.0, 0.2)];
        let front = "Nothing beats a (1.00 ms, error 8.00), b (2.00 ms, error 0.100).";
        assert_eq!(said(&of, "b", 1.0), front);
        assert_eq!(said(&of, "d", 1.0), format!("{front} The default d (11.0 ms, error 0.200) is beaten."));
    }

    #[test]
    fn differences_below_the_noise_decide_nothing() {
        let of = [("16 bins", 1.0, 1.1), ("32 bins", 1.2, 1.0)];
        assert_eq!(said(&of, "", 1.3), "Nothing beats 16 bins (1.00 ms, error 1.10).");
    }
}
