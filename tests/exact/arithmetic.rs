//! Exact arithmetic on single precision coordinates: signs of determinants, and the exact answer of
//! one ray and one triangle. Shares no code with the crates.
//!
//! ```text
//! a, b, c   corners less the origin of the ray          d   direction of the ray
//! wa = det(d, b, c)   wb = det(d, c, a)   wc = det(d, a, b)   sum = wa + wb + wc   v = det(a, b, c)
//! the line meets the triangle, borders included, if no two of wa, wb, wc have opposite signs and sum != 0
//! the point is (wa A + wb B + wc C) / sum, at distance t = v / sum
//! ```

use num_bigint::{BigInt, Sign};
use robust::{Coord3D, orient3d};

pub(crate) type Point = [f32; 3];

/// Where the exact ray passes an exact triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passes {
    /// Through its inside, at `t >= 0`.
    Inside,
    /// Through an edge or a corner, at `t >= 0`.
    Border,
    /// Not at all, or behind the origin. A ray within the plane of a triangle hits nothing.
    Outside,
}

/// The sign of the determinant of three vectors, each the exact difference of two points: -1, 0 or
/// 1.
pub(crate) fn sign([p, q, r]: [(Point, Point); 3]) -> i32 {
    let (rows, errors): (Vec<_>, Vec<_>) = [p, q, r].iter().map(|v| difference(*v)).unzip();
    if errors.iter().all(|&error| error) {
        let [p, q, r] = [rows[0], rows[1], rows[2]];
        let at = |[x, y, z]: [f64; 3]| Coord3D { x, y, z };
        let det = orient3d(at(p), at(q), at(r), at([0.0; 3]));
        return i32::from(det > 0.0) - i32::from(det < 0.0);
    }
    match determinant([p, q, r]).sign() {
        Sign::Minus => -1,
        Sign::NoSign => 0,
        Sign::Plus => 1,
    }
}

/// The difference in double precision, and whether it is exact.
fn difference((a, b): (Point, Point)) -> ([f64; 3], bool) {
    let mut exact = true;
    let axis = |k: usize| {
        let (a, b) = (f64::from(a[k]), f64::from(b[k]));
        let x = a - b;
        // Knuth's two-difference.
        let virtual_b = a - x;
        let virtual_a = x + virtual_b;
        exact &= (virtual_b - b) + (a - virtual_a) == 0.0;
        x
    };
    ([0, 1, 2].map(axis), exact)
}

/// A number as an integer, in units of 2^-149.
fn integer(x: f32) -> BigInt {
    let bits = x.to_bits();
    let (exponent, fraction) = (bits >> 23 & 0xff, bits & 0x007f_ffff);
    let magnitude = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x0080_0000) << (exponent - 1),
    };
    if x.is_sign_negative() { -magnitude } else { magnitude }
}

/// The determinant in units of 2^-447.
fn determinant(rows: [(Point, Point); 3]) -> BigInt {
    let [p, q, r] = rows.map(|(a, b)| [0, 1, 2].map(|k| integer(a[k]) - integer(b[k])));
    let minor = |i: usize, j: usize| &q[i] * &r[j] - &q[j] * &r[i];
    &p[0] * minor(1, 2) + &p[1] * minor(2, 0) + &p[2] * minor(0, 1)
}

/// The exact answer. Everything must be finite.
pub(crate) fn passes(origin: Point, direction: Point, [a, b, c]: [Point; 3]) -> Passes {
    let (d, a, b, c) = ((direction, [0.0; 3]), (a, origin), (b, origin), (c, origin));
    let wa = sign([d, b, c]);
    let wb = sign([d, c, a]);
    if wa * wb < 0 {
        return Passes::Outside;
    }
    let wc = sign([d, a, b]);
    let side = if wa != 0 {
        wa
    } else if wb != 0 {
        wb
    } else {
        wc
    };
    if side == 0 || wa * wc < 0 || wb * wc < 0 || sign([a, b, c]) * side < 0 {
        Passes::Outside
    } else if wa * wb * wc == 0 {
        Passes::Border
    } else {
        Passes::Inside
    }
}

/// The distance of the plane along the ray, to a few units in the last place; NaN if they are
/// parallel.
pub(crate) fn distance(origin: Point, direction: Point, [a, b, c]: [Point; 3]) -> f64 {
    let d = (direction, [0.0; 3]);
    let v = determinant([(a, origin), (b, origin), (c, origin)]);
    let sum = determinant([d, (b, a), (c, a)]);
    let signs = if (v.sign() == Sign::Minus) == (sum.sign() == Sign::Minus) { 1.0 } else { -1.0 };
    let (v, v_shift) = leading(&v);
    let (sum, sum_shift) = leading(&sum);
    signs * (v / sum) * 2f64.powi(v_shift - sum_shift)
}

/// The magnitude as a double precision number times a power of two.
fn leading(x: &BigInt) -> (f64, i32) {
    let magnitude = x.magnitude();
    let shift = magnitude.bits().saturating_sub(64);
    let top = (magnitude >> shift).iter_u64_digits().next().unwrap_or(0);
    (top as f64, shift as i32)
}

/// Both ways to a sign agree, and both know what a sign is: on random input of all magnitudes, and
/// on determinants that are zero.
#[test]
fn two_exact_ways_to_a_sign_agree() {
    let mut random = fastrand::Rng::with_seed(1);
    let mut by_integers = 0;
    for round in 0..20_000 {
        let spread = [0, 4, 40, 120][round % 4];
        let mut number = || {
            let exponent = 127 + random.u32(..=2 * spread) - spread;
            f32::from_bits(
                random.u32(..2) << 31
                    | exponent << 23
                    | random.u32(..) & [0x007f_ffff, 0x0070_0000][round / 4 % 2],
            )
        };
        let mut point = || [number(), number(), number()];
        let [o, p, q, r] = [point(), point(), point(), point()];
        let mut rows = [(p, o), (q, o), (r, o)];
        if round % 3 == 0 {
            rows[2] = rows[0];
        }
        let exact = match determinant(rows).sign() {
            Sign::Minus => -1,
            Sign::NoSign => 0,
            Sign::Plus => 1,
        };
        by_integers += usize::from(rows.iter().any(|&row| !difference(row).1));
        assert_eq!(sign(rows), exact, "{rows:?}");
        assert!(round % 3 > 0 || exact == 0);
    }
    assert!(by_integers > 2000 && by_integers < 18_000, "{by_integers}");
}

#[test]
fn exact_answers_of_rays_that_are_easy_to_see() {
    let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
    let down = |x: f32, y: f32| passes([x, y, 3.0], [0.0, 0.0, -2.0], triangle);
    assert_eq!(down(1.0, 1.0), Passes::Inside);
    assert_eq!(down(2.0, 2.0), Passes::Border);
    assert_eq!(down(0.0, 0.0), Passes::Border);
    assert_eq!(down(f32::from_bits(1), f32::from_bits(1)), Passes::Inside);
    assert_eq!(down(-f32::from_bits(1), 1.0), Passes::Outside);
    assert_eq!(down(2.0, 2.0f32.next_up()), Passes::Outside);
    assert_eq!(passes([1.0, 1.0, -3.0], [0.0, 0.0, -2.0], triangle), Passes::Outside);
    assert_eq!(passes([1.0, 1.0, 0.0], [0.0, 0.0, -2.0], triangle), Passes::Inside);
    assert_eq!(passes([-1.0, 1.0, 0.0], [1.0, 0.0, 0.0], triangle), Passes::Outside, "within the plane");
    assert_eq!(distance([1.0, 1.0, 3.0], [0.0, 0.0, -2.0], triangle), 1.5);
    assert_eq!(distance([1.0, 1.0, -3.0], [0.0, 0.0, -2.0], triangle), -1.5);
}
