//! Points as curves: one for each knob, error and condition; and which of them nothing beats.

use super::point::Point;

/// One error of one knob, on all scenes and under all conditions.
pub(super) struct Family<'a> {
    pub(super) knob: &'a str,
    pub(super) error_name: &'a str,
    pub(super) unit: &'a str,
    pub(super) curves: Vec<Curve<'a>>,
}

/// The settings of a knob on one scene under one condition.
pub(super) struct Curve<'a> {
    pub(super) scene: &'a str,
    /// Empty if there is but one.
    pub(super) condition: &'a str,
    pub(super) points: Vec<&'a Point>,
}

/// Sorts points into families, in the order of their first points.
pub(super) fn families(points: &[Point]) -> Vec<Family<'_>> {
    let mut families: Vec<Family<'_>> = Vec::new();
    for point in points {
        let (knob, condition) = point.knob.split_once(" at ").unwrap_or((&point.knob, ""));
        let same = |f: &Family<'_>| f.knob == knob && f.error_name == point.error_name;
        let at = families.iter().position(same).unwrap_or_else(|| {
            let (error_name, unit) = (&point.error_name, &point.unit);
            families.push(Family { knob, error_name, unit, curves: Vec::new() });
            families.len() - 1
        });
        let (curves, scene) = (&mut families[at].curves, point.scene.as_str());
        match curves.iter_mut().find(|curve| (curve.scene, curve.condition) == (scene, condition)) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { scene, condition, points: vec![point] }),
        }
    }
    families
}

impl<'a> Curve<'a> {
    /// The scene and the condition.
    pub(super) fn name(&self) -> String {
        let parts = [self.scene, self.condition].into_iter().filter(|part| !part.is_empty());
        parts.collect::<Vec<_>>().join(", ")
    }

    pub(super) fn get(&self, setting: &str) -> Option<&'a Point> {
        self.points.iter().copied().find(|point| point.setting == setting)
    }

    /// The order of convergence, where settings are numbers of steps: the slope p of the line
    /// through the logarithms of error = c / number^p that fits best.
    pub(super) fn order(&self) -> Option<f64> {
        let place = |point: &&Point| {
            let number: f64 = point.setting.split(' ').next()?.parse().ok()?;
            Some((number.ln(), point.error.ln()))
        };
        let places: Vec<_> =
            self.points.iter().filter(|p| p.error > 0.0).map(place).collect::<Option<_>>()?;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| places.iter().map(of).sum::<f64>() / places.len() as f64;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        let slope = mean(&|p| (p.0 - x) * (p.1 - y)) / mean(&|p| (p.0 - x).powi(2));
        (places.len() > 2 && slope.is_finite()).then_some(-slope)
    }
}

impl Family<'_> {
    /// The factor within which errors are equal: 1 where they are exact.
    pub(super) fn noise(&self) -> f64 {
        let points = self.curves.iter().flat_map(|curve| &curve.points);
        points.filter_map(|point| point.noise).fold(1.0, f64::max)
    }
}

/// Of points (cost, error), less of either being better: whether each is on the Pareto front, that
/// is, none is at least as good in both and better in one, where errors that differ by no more than
/// a factor `noise` are equal. Points that are not numbers never are. O(n log n).
pub(super) fn pareto_front(points: &[(f64, f64)], noise: f64) -> Vec<bool> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| !points[i].0.is_nan() && !points[i].1.is_nan()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut front = vec![false; points.len()];
    let mut last: Option<(f64, f64)> = None;
    for i in order {
        // Twins stay together.
        front[i] = last.is_none_or(|last| noise * points[i].1 < last.1 || points[i] == last);
        if front[i] {
            last = Some(points[i]);
        }
    }
    front
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [
            (1.0, 9.0),
            (2.0, 4.0),
            // As slow as the one before, and worse; as accurate, and slower.
            (2.0, 5.0),
            (3.0, 4.0),
            (4.0, 1.0),
            // Twins stay together.
            (5.0, 0.0),
            (5.0, 0.0),
            (6.0, 0.5),
            (f64::NAN, 0.0),
            (0.0, f64::NAN),
            (f64::INFINITY, -1.0),
        ];
        let front = pareto_front(&points, 1.0);
        let expected = [true, true, false, false, true, true, true, false, false, false, true];
        assert_eq!(front, expected);
        assert!(pareto_front(&[], 1.0).is_empty());
        // Of equal errors the cheapest is on it; step by step they lead to one that is not equal.
        let points = [(1.0, 1.08), (2.0, 1.04), (3.0, 1.0), (4.0, 0.98)];
        assert_eq!(pareto_front(&points, 1.05), [true, false, true, false]);
        // Against the definition by another way: sorted by cost, the front goes strictly down.
        let mut random = fastrand::Rng::with_seed(3);
        let points: Vec<(f64, f64)> = (0..200).map(|_| (random.f64(), random.f64())).collect();
        let mut sorted = points.clone();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut least = f64::INFINITY;
        let down: Vec<_> = sorted
            .into_iter()
            .filter(|p| {
                p.1 < least && {
                    least = p.1;
                    true
                }
            })
            .collect();
        let mut front: Vec<_> =
            points.iter().zip(pareto_front(&points, 1.0)).filter_map(|(p, on)| on.then_some(*p)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert_eq!(front, down);
    }

    #[test]
    fn points_are_sorted_by_knob_error_and_condition() {
        let point = |knob: &str, error_name: &str| Point {
            knob: knob.to_owned(),
            error_name: error_name.to_owned(),
            ..Point::default()
        };
        let points = [
            point("test at near", "leaks"),
            point("test at near", "distance"),
            point("test at far", "leaks"),
            point("test at far", "leaks"),
            point("bins", "cost"),
        ];
        let families = families(&points);
        let shape: Vec<_> = families
            .iter()
            .map(|f| (f.knob, f.error_name, f.curves.iter().map(|c| c.points.len()).collect::<Vec<_>>()))
            .collect();
        let expected =
            [("test", "leaks", vec![1, 2]), ("test", "distance", vec![1]), ("bins", "cost", vec![1])];
        assert_eq!(shape, expected);
        assert_eq!(families[0].curves[1].name(), "far");
    }

    #[test]
    fn the_order_is_the_slope_of_the_logarithms() {
        let point = |n: u32| Point {
            error: 3.0 / f64::from(n * n),
            ..Point::new("step", &format!("{n} steps"), false, 0.0)
        };
        let points = [point(4), point(8), point(64)];
        let order = |points: &[Point]| families(points)[0].curves[0].order();
        assert!((order(&points).unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(
            order(&[point(4), point(8), Point::new("step", "sweep", false, 0.0).with("", 1.0, "")]),
            None
        );
        assert_eq!(order(&points[..2]), None);
    }
}
