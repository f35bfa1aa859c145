//! What rounding may change: for each triangle test a bound, in formulas, within which its answer
//! for one triangle may differ from the exact one. Outside of it every difference is an error.
//!
//! `u` is the unit roundoff of the test: 2^-24 for `fast` and `watertight`, 2^-53 for `f64`. All
//! formulas are evaluated in double precision.
//!
//! *Projection* (`watertight`, `f64`). `z` is the first axis along which the direction is longest,
//! `P` a corner less the origin, `s = d / dz`, and `(x, y) = P - s Pz` the corner projected along
//! the ray. Four roundings move a projected corner by at most
//!
//! ```text
//! e = u (|Px| + 3 |s Pz| + |x|) on each axis
//! ```
//!
//! The sign of an edge function `w = xa yb - ya xb` of the moved corners is computed exactly, or as
//! zero, which counts as inside. So the side of an edge may be wrong only if
//!
//! ```text
//! |w| <= exa |yb| + |xa| eyb + eya |xb| + |ya| exb + exa eyb + eya exb
//! ```
//!
//! The distance is a mean of those of the corners, `zi = Pz / dz`, weighted by `w`, so it is wrong
//! by at most
//!
//! ```text
//! min(max zi - min zi, sum of |error of wi| |zi - t| / (|sum of w| - sum of errors)) + 8 u max |zi| + 8 * 2^-24 |t|
//! ```
//!
//! *Möller and Trumbore* (`fast`). Each of the determinants behind `u`, `v`, `t` and their
//! denominator takes seven roundings, so each is wrong by at most `8 u` times the sum of the
//! magnitudes of its products.
//!
//! *No rounding*. Where all numbers are whole and small, the ray goes along an axis by one and
//! meets the triangle's plane at a right angle, and the determinant is a power of two, every
//! operation of every test is exact: the distance has no error.
//!
//! In all tests the last term of the distance is the entry into the triangle's own box, to which a
//! hit's distance is raised.

use crate::adaptor::Test;
use crate::arithmetic::{Passes, Point, distance, passes};

const U: f64 = 1.0 / (1u64 << 24) as f64;
const U_DOUBLE: f64 = f64::EPSILON / 2.0;

/// What a test may say of one ray and one triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Verdict {
    /// It has to be a hit: exactly so, and beyond rounding.
    pub(crate) must: bool,
    /// It may be a hit: exactly so, or within rounding.
    pub(crate) may: bool,
    /// The exact distance, if it may be one, and how much rounding may move it.
    pub(crate) t: f64,
    pub(crate) t_error: f64,
}

impl Verdict {
    const NEVER: Self = Self { must: false, may: false, t: f64::NAN, t_error: 0.0 };

    pub(crate) fn nearest(&self) -> f64 {
        self.t - self.t_error
    }

    pub(crate) fn farthest(&self) -> f64 {
        self.t + self.t_error
    }
}

type Vector = [f64; 3];

fn wide(p: Point) -> Vector {
    p.map(f64::from)
}

fn less(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A determinant, and the sum of the magnitudes of its products.
fn determinant(p: Vector, q: Vector, r: Vector) -> (f64, f64) {
    let (mut sum, mut size) = (0.0, 0.0);
    for [i, j, k] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        sum += p[i] * (q[j] * r[k] - q[k] * r[j]);
        size += p[i].abs() * ((q[j] * r[k]).abs() + (q[k] * r[j]).abs());
    }
    (sum, size)
}

/// Whether the ray is on the inner side of an edge, or may be, and by how much rounding may move
/// that.
struct Weight {
    w: f64,
    error: f64,
}

/// The exact answer, and what each of the three tests may say. Everything must be finite, far from
/// overflow and underflow.
pub(crate) fn judge(origin: Point, direction: Point, corners: [Point; 3]) -> (Passes, [Verdict; 3]) {
    let exact = passes(origin, direction, corners);
    let answers = [
        moller_trumbore(origin, direction, corners),
        projected(origin, direction, corners, Test::Watertight),
        projected(origin, direction, corners, Test::Double),
    ];
    let t = if answers.iter().all(|answer| matches!(answer, Answer::Miss)) {
        f64::NAN
    } else {
        distance(origin, direction, corners)
    };
    let verdicts = answers.map(|answer| {
        let wrong =
            || format!("bounds of rounding: {exact:?} {answer:?} {origin:?} {direction:?} {corners:?}");
        match answer {
            Answer::Miss => {
                assert!(exact == Passes::Outside, "{}", wrong());
                Verdict::NEVER
            }
            Answer::Near { certain, t_error } => {
                assert!(!certain || exact == Passes::Inside || t <= t_error, "{}", wrong());
                let t_error = if is_exact(origin, direction, corners) { 0.0 } else { t_error };
                let must = certain && exact == Passes::Inside && t > t_error;
                let may = exact != Passes::Outside || !certain || t.abs() <= t_error;
                Verdict { must, may: may && (t.is_nan() || t >= -t_error), t, t_error }
            }
        }
    });
    (exact, verdicts)
}

/// Whether no test rounds, as above.
fn is_exact(origin: Point, direction: Point, corners: [Point; 3]) -> bool {
    let is_small = |x: &f32| x.fract() == 0.0 && x.abs() < 256.0;
    let Some(k) = (0..3).find(|&k| direction[k].abs() == 1.0) else { return false };
    let is_along = (0..3).all(|i| i == k || direction[i] == 0.0);
    let is_across = corners.iter().all(|corner| corner[k] == corners[0][k]);
    let [a, b, c] = corners.map(wide);
    let (det, _) = determinant(less(b, a), wide(direction), less(c, a));
    let is_power = det != 0.0 && det.abs().log2().fract() == 0.0;
    origin.iter().chain(corners.iter().flatten()).all(is_small) && is_along && is_across && is_power
}

/// What double precision says, with the bounds above.
#[derive(Clone, Copy, Debug)]
enum Answer {
    /// Beyond rounding.
    Miss,
    /// The line passes the triangle: beyond rounding, if it is certain. The distance may be so far
    /// off.
    Near { certain: bool, t_error: f64 },
}

fn projected(origin: Point, direction: Point, corners: [Point; 3], test: Test) -> Answer {
    let u = if test == Test::Double { U_DOUBLE } else { U };
    let d = wide(direction);
    let length = |k: usize| d[k].abs();
    let kz = if length(0) >= length(1) && length(0) >= length(2) {
        0
    } else if length(1) >= length(2) {
        1
    } else {
        2
    };
    let axes = [(kz + 1) % 3, (kz + 2) % 3];
    let p = corners.map(|corner| less(wide(corner), wide(origin)));
    let flat = p.map(|p| axes.map(|k| p[k] - d[k] / d[kz] * p[kz]));
    let error = |i: usize, axis: usize| {
        let (k, x) = (axes[axis], flat[i][axis]);
        // One percent for what the formula leaves out, and for double precision itself.
        1.01 * (u * (p[i][k].abs() + 3.0 * (d[k] / d[kz] * p[i][kz]).abs() + x.abs()))
            + 4.0 * U_DOUBLE * p[i][k].abs()
    };
    let weight = |i: usize, j: usize| {
        let ([xi, yi], [xj, yj]) = (flat[i], flat[j]);
        let ([exi, eyi], [exj, eyj]) = ([error(i, 0), error(i, 1)], [error(j, 0), error(j, 1)]);
        let moved = exi * yj.abs() + xi.abs() * eyj + eyi * xj.abs() + yi.abs() * exj + exi * eyj + eyi * exj;
        Weight { w: xi * yj - yi * xj, error: moved + 4.0 * U_DOUBLE * ((xi * yj).abs() + (yi * xj).abs()) }
    };
    let weights = [weight(1, 2), weight(2, 0), weight(0, 1)];
    let is_above = weights.iter().any(|w| w.w > w.error);
    let is_below = weights.iter().any(|w| w.w < -w.error);
    if is_above && is_below {
        return Answer::Miss;
    }
    let certain = weights.iter().all(|w| w.w.abs() > w.error);
    let z = p.map(|p| p[kz] / d[kz]);
    let most = z.iter().fold(0.0f64, |most, z| most.max(z.abs()));
    let range = z.iter().fold(f64::MIN, |m, &z| m.max(z)) - z.iter().fold(f64::MAX, |m, &z| m.min(z));
    let sum: f64 = weights.iter().map(|w| w.w).sum();
    let t = weights.iter().zip(z).map(|(w, z)| w.w * z).sum::<f64>() / sum;
    // The weights that a distance is computed from are rounded once more.
    let rounded = |w: &Weight| w.error + 3.0 * u * w.w.abs();
    let errors: f64 = weights.iter().map(rounded).sum();
    let moved = weights.iter().zip(z).map(|(w, z)| rounded(w) * (z - t).abs()).sum::<f64>();
    let moved = if sum.abs() > errors { (moved / (sum.abs() - errors)).min(range) } else { range };
    Answer::Near {
        certain,
        t_error: moved + 8.0 * u * most + 8.0 * U * if t.is_finite() { t.abs() } else { most },
    }
}

fn moller_trumbore(origin: Point, direction: Point, corners: [Point; 3]) -> Answer {
    let [a, b, c] = corners.map(wide);
    let (d, s, e1, e2) = (wide(direction), less(wide(origin), a), less(b, a), less(c, a));
    let bounded = |(det, size): (f64, f64)| (det, 8.0 * U * size);
    let (det, det_error) = bounded(determinant(e1, d, e2));
    let (wb, wb_error) = bounded(determinant(s, d, e2));
    let (wc, wc_error) = bounded(determinant(d, s, e1));
    let (t, t_error) = bounded(determinant(e2, s, e1));
    if det.abs() <= det_error {
        return Answer::Near { certain: false, t_error: f64::INFINITY };
    }
    let side = det.signum();
    let (wa, wa_error) =
        (det - wb - wc, det_error + wb_error + wc_error + 4.0 * U * (wb.abs() + wc.abs() + det.abs()));
    let weights = [(wa, wa_error), (wb, wb_error), (wc, wc_error)];
    if weights.iter().any(|(w, error)| w * side < -error) {
        return Answer::Miss;
    }
    let certain = weights.iter().all(|(w, error)| w * side > *error);
    let moved = (t_error + (t / det).abs() * det_error) / (det.abs() - det_error);
    Answer::Near { certain, t_error: moved + 12.0 * U * (t / det).abs() }
}
