//! Motion of a named transform: splines through keys of position, rotation and scale, and
//! visibility.
//!
//! Positions and scales follow D. Kochanek and R. Bartels, "Interpolating Splines with Local
//! Tension, Continuity, and Bias Control" (SIGGRAPH 1984). Rotations take the same tangents between
//! the logarithms of quaternions, and go along them by K. Shoemake's squad ("Quaternion Calculus
//! and Fast Animation", SIGGRAPH course notes 1987).

use glam::{DAffine3, DQuat, DVec3};

use crate::key_frames::segment;
use crate::rotation::{self, slerp};

/// Keys a spline needs: the first and the last are never reached, they only shape the ends.
pub(super) const FEWEST_KEYS: usize = 4;

/// How one transform moves, as T R S; what has no keys is the identity.
#[derive(Default)]
pub(super) struct Track {
    pub(super) translation: Option<Spline<DVec3>>,
    pub(super) rotation: Option<Spline<DQuat>>,
    pub(super) scale: Option<Spline<DVec3>>,
    /// Times, in order, from which the object is visible or not; before them it is visible.
    pub(super) visibility: Vec<(f64, bool)>,
}

impl Track {
    pub(super) fn transform(&self, time: f64) -> DAffine3 {
        let begun = self.visibility.partition_point(|key| key.0 <= time);
        let scale = match self.visibility[..begun].last() {
            Some((_, false)) => DVec3::ZERO,
            _ => self.scale.as_ref().map_or(DVec3::ONE, |scale| scale.at(time)),
        };
        let rotation = self.rotation.as_ref().map_or(DQuat::IDENTITY, |rotation| rotation.at(time));
        let translation = self.translation.as_ref().map_or(DVec3::ZERO, |translation| translation.at(time));
        DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    }

    pub(super) fn is_identity(&self) -> bool {
        self.translation.is_none()
            && self.rotation.is_none()
            && self.scale.is_none()
            && self.visibility.iter().all(|key| key.1)
    }

    /// The times between which the splines run, and keys of visibility stand.
    pub(super) fn spans(&self) -> impl Iterator<Item = (f64, f64)> {
        let vectors = [&self.translation, &self.scale].into_iter().flatten().map(Spline::span);
        let visibility = self.visibility.first().zip(self.visibility.last());
        let visibility = visibility.map(|(first, last)| (first.0, last.0));
        vectors.chain(self.rotation.as_ref().map(Spline::span)).chain(visibility)
    }
}

/// A value to be at `time`, and how to pass through it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Key<T> {
    pub(super) time: f64,
    pub(super) value: T,
    /// Tension, continuity and bias: all three 0 for a Catmull-Rom spline.
    pub(super) shape: [f64; 3],
}

/// At least [`FEWEST_KEYS`] keys in order of time.
pub(super) struct Spline<T>(pub(super) Vec<Key<T>>);

/// What splines go through: anything with differences, which are vectors.
pub(super) trait Value: Copy {
    /// The way from `self` to `next`.
    fn step(self, next: Self) -> DVec3;

    /// The value at `u` (0 to 1) between `self` and `next`, left and reached along the tangents
    /// (per unit of `u`).
    fn between(self, next: Self, leaving: DVec3, arriving: DVec3, u: f64) -> Self;
}

impl Value for DVec3 {
    fn step(self, next: Self) -> DVec3 {
        next - self
    }

    fn between(self, next: Self, leaving: DVec3, arriving: DVec3, u: f64) -> Self {
        // The cubic Hermite polynomial.
        let way = next - self;
        let square = 3.0 * way - 2.0 * leaving - arriving;
        let cube = leaving + arriving - 2.0 * way;
        self + u * (leaving + u * (square + u * cube))
    }
}

impl Value for DQuat {
    fn step(self, next: Self) -> DVec3 {
        rotation::step(self, next)
    }

    fn between(self, next: Self, leaving: DVec3, arriving: DVec3, u: f64) -> Self {
        let way = self.step(next);
        // The inner quaternions that give squad these derivatives at its ends.
        let inner = self * rotation::exp(0.5 * (leaving - way));
        let next_inner = next * rotation::exp(0.5 * (way - arriving));
        // The long way round, too: squad would jump if one of its three took the other way.
        slerp(slerp(self, next, u), slerp(inner, next_inner, u), 2.0 * u * (1.0 - u)).normalize()
    }
}

impl Spline<DQuat> {
    /// A spline that goes the short way from key to key.
    pub(super) fn of_rotations(mut keys: Vec<Key<DQuat>>) -> Self {
        for i in 1..keys.len() {
            if keys[i].value.dot(keys[i - 1].value) < 0.0 {
                keys[i].value = -keys[i].value;
            }
        }
        Self(keys)
    }
}

impl<T: Value> Spline<T> {
    /// Times of the second key and of the last but one.
    fn span(&self) -> (f64, f64) {
        (self.0[1].time, self.0[self.0.len() - 2].time)
    }

    /// The value at `time`, clamped to the [`span`](Self::span).
    pub(super) fn at(&self, time: f64) -> T {
        let time = time.max(self.span().0);
        let (before, _, length) = segment(&self.0[1..self.0.len() - 1], time, |key| key.time);
        let (i, key, next) = (before + 1, &self.0[before + 1], &self.0[before + 2]);
        let u = if length > 0.0 { (time - key.time) / length } else { 0.0 };
        match u {
            0.0 => key.value,
            1.0 => next.value,
            _ => key.value.between(next.value, self.tangents(i).1, self.tangents(i + 1).0, u),
        }
    }

    /// The tangents with which key `i`, neither the first nor the last, is reached and left
    /// (Kochanek and Bartels, section 4): each per length of the interval on its side, so that
    /// equal ones are equal speeds.
    fn tangents(&self, i: usize) -> (DVec3, DVec3) {
        let [previous, key, next] = [&self.0[i - 1], &self.0[i], &self.0[i + 1]];
        let (way_in, way_out) = (previous.value.step(key.value), key.value.step(next.value));
        let [tension, continuity, bias] = key.shape;
        let tangent = |continuity: f64| {
            let before = 0.5 * (1.0 - tension) * (1.0 + continuity) * (1.0 + bias);
            let after = 0.5 * (1.0 - tension) * (1.0 - continuity) * (1.0 - bias);
            before * way_in + after * way_out
        };
        let (before, after) = (key.time - previous.time, next.time - key.time);
        let share = |length: f64| {
            if before + after > 0.0 { 2.0 * length / (before + after) } else { 1.0 }
        };
        (tangent(-continuity) * share(before), tangent(continuity) * share(after))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    fn key<T>(time: f64, value: T) -> Key<T> {
        Key { time, value, shape: [0.0; 3] }
    }

    fn spline(values: &[(f64, f64)]) -> Spline<DVec3> {
        Spline(values.iter().map(|&(time, x)| key(time, DVec3::new(x, 0.0, 1.0))).collect())
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn hits_its_keys_and_stays_at_the_ends() {
        let spline = spline(&[(-1.0, 9.0), (0.0, 2.0), (1.5, 5.0), (2.0, -1.0), (3.0, 4.0)]);
        for (time, x) in
            [(-7.0, 2.0), (-0.5, 2.0), (0.0, 2.0), (1.5, 5.0), (2.0, -1.0), (2.5, -1.0), (9.0, -1.0)]
        {
            assert_eq!(spline.at(time), DVec3::new(x, 0.0, 1.0), "at {time}");
        }
    }

    #[test]
    fn values_by_hand() {
        // Uniform, all parameters 0: tangents (3 - 0) / 2 and (3 - 1) / 2, so x(0.5) = 0.5 (1 + 3)
        // + (1.5 - 1) / 8.
        let mut catmull_rom = spline(&[(0.0, 0.0), (1.0, 1.0), (2.0, 3.0), (3.0, 3.0)]);
        assert!(close(catmull_rom.at(1.5).x, 2.0625));
        assert_eq!(catmull_rom.tangents(1), (DVec3::X * 1.5, DVec3::X * 1.5));
        // Tension 0.5, continuity 0.5, bias 0.5 at the second key; ways 1 and 2. By the paper's
        // equations: arriving 0.5 * (0.5 * 0.5 * 1.5 * 1 + 0.5 * 1.5 * 0.5 * 2) = 0.5625, leaving
        // 0.5 * (0.5 * 1.5 * 1.5 * 1 + 0.5 * 0.5 * 0.5 * 2) = 0.6875.
        catmull_rom.0[1] = Key { shape: [0.5; 3], ..catmull_rom.0[1] };
        let (arriving, leaving) = catmull_rom.tangents(1);
        assert!(close(arriving.x, 0.5625) && close(leaving.x, 0.6875));
        // Uneven: 1 before and 3 after the key, ways 1 and 2. The plain tangent 1.5 is shared out 1
        // : 3.
        let uneven = spline(&[(0.0, 0.0), (1.0, 1.0), (4.0, 3.0), (5.0, 3.0)]);
        assert_eq!(uneven.tangents(1), (DVec3::X * 0.75, DVec3::X * 2.25));
    }

    #[test]
    fn full_tension_has_no_tangents() {
        let mut tight = spline(&[(0.0, 0.0), (1.0, 1.0), (2.0, 3.0), (3.0, 7.0)]);
        for key in &mut tight.0 {
            key.shape[0] = 1.0;
        }
        assert_eq!(tight.tangents(1), (DVec3::ZERO, DVec3::ZERO));
        assert!(close(tight.at(1.5).x, 2.0));
        // Smooth start: 3 u^2 - 2 u^3.
        assert!(close(tight.at(1.25).x, 1.0 + 2.0 * (3.0 / 16.0 - 2.0 / 64.0)));
    }

    #[test]
    fn continuous_in_place_and_speed() {
        let smooth = spline(&[(0.0, 0.0), (1.0, 1.0), (2.5, 3.0), (3.0, -2.0), (5.0, 1.0), (6.0, 0.0)]);
        let step = 1e-6;
        for time in [2.5, 3.0] {
            let [before, at, after] = [-step, 0.0, step].map(|offset| smooth.at(time + offset).x);
            assert!((before - at).abs() < 1e-4 && (after - at).abs() < 1e-4);
            assert!(((at - before) - (after - at)).abs() / step < 1e-3, "the speed jumps at {time}");
        }
    }

    #[test]
    fn keys_at_the_same_time_jump() {
        let jump = spline(&[(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (2.0, 5.0), (3.0, 6.0), (4.0, 7.0)]);
        assert!(jump.at(2.0 - 1e-9).x < 2.001);
        assert_eq!(jump.at(2.0).x, 5.0);
        let at_once = spline(&[(1.0, 0.0), (1.0, 1.0), (1.0, 2.0), (1.0, 3.0)]);
        assert_eq!(at_once.at(1.0).x, 2.0);
    }

    fn about_y(keys: &[(f64, f64)]) -> Spline<DQuat> {
        Spline::of_rotations(
            keys.iter().map(|&(time, angle)| key(time, DQuat::from_rotation_y(angle))).collect(),
        )
    }

    #[test]
    fn steady_rotation_is_steady_over_many_turns() {
        let keys: Vec<_> = (0..20).map(|i| (f64::from(i), f64::from(i) * FRAC_PI_2)).collect();
        let wheel = about_y(&keys);
        for step in 0..170 {
            let time = 1.0 + 0.1 * f64::from(step);
            let expected = DQuat::from_rotation_y(time * FRAC_PI_2);
            assert!(close(wheel.at(time).dot(expected).abs(), 1.0), "at {time}");
        }
    }

    #[test]
    fn rotation_goes_the_short_way_smoothly() {
        // 350 degrees after 10 is 20 degrees back.
        let degrees = PI / 180.0;
        let spline =
            about_y(&[(0.0, 10.0), (1.0, 10.0), (2.0, 350.0), (3.0, 350.0)].map(|(t, a)| (t, a * degrees)));
        assert!(close(spline.at(1.5).dot(DQuat::IDENTITY).abs(), 1.0));
        let mut last = spline.at(1.0);
        for step in 0..=200 {
            let next = spline.at(1.0 + 0.005 * f64::from(step));
            assert!(next.is_normalized() && next.angle_between(last) < 0.02);
            last = next;
        }
    }

    #[test]
    fn the_speed_of_rotation_does_not_jump() {
        let spline = about_y(&[(0.0, 0.0), (1.0, 0.4), (1.5, 1.0), (3.0, 0.7), (4.0, 0.0)]);
        let angle = |time: f64| 2.0 * spline.at(time).y.asin();
        let step = 1e-5;
        let (before, after) = (angle(1.5) - angle(1.5 - step), angle(1.5 + step) - angle(1.5));
        assert!((before - after).abs() / step < 1e-3);
    }

    #[test]
    fn hidden_is_a_point() {
        let track = Track { visibility: vec![(1.0, false), (2.0, true)], ..Track::default() };
        assert_eq!(track.transform(0.0), DAffine3::IDENTITY);
        assert_eq!(track.transform(1.0).transform_point3(DVec3::ONE), DVec3::ZERO);
        assert_eq!(track.transform(2.0), DAffine3::IDENTITY);
    }
}
