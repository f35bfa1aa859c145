//! Rigid motions: the rotation and shift that take points nearest to others, by least squares.

use bvh_core::glam::{DMat3, DMat4, DQuat, DVec3, DVec4};

/// `p` goes to `turn * (p - from) + to`.
#[derive(Clone, Copy)]
pub(crate) struct Motion {
    from: DVec3,
    to: DVec3,
    turn: DMat3,
}

impl Motion {
    /// The motion that takes the first of each pair nearest to the second.
    pub(crate) fn fit<I: Iterator<Item = (DVec3, DVec3)>>(pairs: impl Fn() -> I) -> Self {
        let (mut from, mut to, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (a, b) in pairs() {
            (from, to, count) = (from + a, to + b, count + 1.0);
        }
        if count == 0.0 {
            return Self { from, to, turn: DMat3::IDENTITY };
        }
        let (from, to) = (from / count, to / count);
        let products = pairs().fold(DMat3::ZERO, |sum, (a, b)| sum + outer(a - from, b - to));
        Self { from, to, turn: DMat3::from_quat(rotation(products)) }
    }

    pub(crate) fn apply(&self, p: DVec3) -> DVec3 {
        self.turn * (p - self.from) + self.to
    }

    /// Where a point was before the motion.
    pub(crate) fn undo(&self, p: DVec3) -> DVec3 {
        self.turn.transpose() * (p - self.to) + self.from
    }
}

/// `a` times `b` transposed.
pub(crate) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The rotation that turns the points `a` nearest to the points `b`, from the sum of the products
/// of `a` and `b` transposed: the dominant eigenvector of a matrix of quaternions (Horn 1987), by
/// repeated squaring.
fn rotation(products: DMat3) -> DQuat {
    let [x, y, z] = products.to_cols_array_2d();
    let row = |w: f64, x: f64, y: f64, z: f64| DVec4::new(w, x, y, z);
    let [xy, yz, zx] = [y[0], z[1], x[2]];
    let [yx, zy, xz] = [x[1], y[2], z[0]];
    let [xx, yy, zz] = [x[0], y[1], z[2]];
    let matrix = DMat4::from_cols(
        row(xx + yy + zz, yz - zy, zx - xz, xy - yx),
        row(yz - zy, xx - yy - zz, xy + yx, zx + xz),
        row(zx - xz, xy + yx, yy - xx - zz, yz + zy),
        row(xy - yx, zx + xz, yz + zy, zz - xx - yy),
    );
    let norm = |m: &DMat4| m.to_cols_array().iter().map(|e| e * e).sum::<f64>().sqrt();
    let size = norm(&matrix);
    // All eigenvalues above zero, so that the greatest is the dominant one.
    let mut power = matrix * size.recip() + DMat4::IDENTITY;
    for _ in 0..12 {
        power = power * power;
        power *= norm(&power).recip();
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis, power.w_axis];
    let longest = columns.into_iter().fold(DVec4::ZERO, |a, b| if b.length() > a.length() { b } else { a });
    let DVec4 { x: w, y: x, z: y, w: z } = longest;
    let turn = DQuat::from_xyzw(x, y, z, w).normalize();
    // Points that are all in one place.
    if turn.is_finite() { turn } else { DQuat::IDENTITY }
}

/// The direction in which a symmetric matrix stretches most, by power iteration.
pub(crate) fn widest(matrix: DMat3) -> DVec3 {
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let longest = columns.into_iter().fold(DVec3::ZERO, |a, b| if b.length() > a.length() { b } else { a });
    let mut axis = longest.normalize_or(DVec3::X);
    for _ in 0..16 {
        axis = (matrix * axis).normalize_or(axis);
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_found() {
        for (axis, angle) in [(DVec3::X, 3.0), (DVec3::new(0.6, 0.0, 0.8), -1.0), (DVec3::Z, 0.0)] {
            let turn = DQuat::from_axis_angle(axis, angle);
            let points = [DVec3::X, DVec3::new(0.0, 2.0, 1.0), DVec3::new(-3.0, 1.0, 0.5)];
            let found = rotation(points.iter().fold(DMat3::ZERO, |sum, &p| sum + outer(p, turn * p)));
            assert!(points.iter().all(|&p| (found * p - turn * p).length() < 1e-6), "{found} for {turn}");
            let motion = Motion { from: DVec3::ONE, to: DVec3::X, turn: DMat3::from_quat(turn) };
            assert!(points.iter().all(|&p| (motion.undo(motion.apply(p)) - p).length() < 1e-12));
        }
        assert_eq!(rotation(DMat3::ZERO), DQuat::IDENTITY);
    }
}
