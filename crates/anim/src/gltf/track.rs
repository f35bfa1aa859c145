//! One animated value of a glTF clip: key times, key values, and the three interpolations between
//! them (glTF 2.0 specification, section 3.11 and appendix C).

use ::gltf::json::animation::Interpolation;
use glam::{DQuat, Quat, Vec3};

use crate::key_frames::segment;
use crate::rotation::slerp;

/// `width` numbers per key, or with cubic splines `3 * width`: in-tangent, value, out-tangent.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) times: Vec<f32>,
    pub(super) values: Vec<f32>,
    pub(super) width: usize,
    pub(super) interpolation: Interpolation,
}

impl Track {
    /// The same numbers at all times.
    pub(super) fn constant(values: Vec<f32>) -> Self {
        Self { times: vec![0.0], width: values.len(), values, interpolation: Interpolation::Step }
    }

    /// Whether the value is the same at all times.
    pub(super) fn is_constant(&self) -> bool {
        let same = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        let first = self.value(0);
        let flat = |key| {
            self.interpolation != Interpolation::CubicSpline
                || self.tangent(key, 0).iter().chain(self.tangent(key, 2)).all(|&tangent| tangent == 0.0)
        };
        self.times.len() == 1 || (0..self.times.len()).all(|key| same(self.value(key), first) && flat(key))
    }

    pub(super) fn vec3(&self, time: f64) -> Vec3 {
        let mut value = [0.0; 3];
        self.sample(time, &mut value);
        Vec3::from_array(value)
    }

    /// A unit quaternion; one whose length is zero or not finite counts as no rotation.
    pub(super) fn rotation(&self, time: f64) -> Quat {
        let (first, u, _) = self.segment(time);
        if self.interpolation == Interpolation::Linear && u > 0.0 {
            let key = |i| unit(self.value(i));
            let (from, to) = (key(first), key(first + 1));
            // The short way.
            let to = if from.dot(to) < 0.0 { -to } else { to };
            return slerp(from, to, u.into()).as_quat();
        }
        let mut value = [0.0; 4];
        self.sample(time, &mut value);
        unit(&value).as_quat()
    }

    /// Writes the `width` numbers at `time`.
    pub(super) fn sample(&self, time: f64, out: &mut [f32]) {
        let (first, u, length) = self.segment(time);
        if u == 0.0 {
            // On a key exactly, also where the next key is not finite.
            return out.copy_from_slice(self.value(first));
        }
        let (a, b, length) = (self.value(first), self.value(first + 1), length as f32);
        match self.interpolation {
            Interpolation::Step => out.copy_from_slice(a),
            Interpolation::Linear => {
                for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
                    *out = a + (b - a) * u;
                }
            }
            Interpolation::CubicSpline => {
                let (leaving, arriving) = (self.tangent(first, 2), self.tangent(first + 1, 0));
                let (u2, u3) = (u * u, u * u * u);
                for (i, out) in out.iter_mut().enumerate() {
                    *out = (2.0 * u3 - 3.0 * u2 + 1.0) * a[i]
                        + length * (u3 - 2.0 * u2 + u) * leaving[i]
                        + (3.0 * u2 - 2.0 * u3) * b[i]
                        + length * (u3 - u2) * arriving[i];
                }
            }
        }
    }

    /// The key before `time`, how far it is to the next, and how many seconds that takes.
    fn segment(&self, time: f64) -> (usize, f32, f64) {
        segment(&self.times, time, |&key| key.into())
    }

    pub(super) fn value(&self, key: usize) -> &[f32] {
        match self.interpolation {
            Interpolation::CubicSpline => self.tangent(key, 1),
            _ => &self.values[key * self.width..][..self.width],
        }
    }

    /// Of a cubic spline's key: 0 the in-tangent, 1 the value, 2 the out-tangent.
    fn tangent(&self, key: usize, which: usize) -> &[f32] {
        &self.values[(key * 3 + which) * self.width..][..self.width]
    }
}

fn unit(value: &[f32]) -> DQuat {
    let quat = Quat::from_slice(value).as_dquat();
    let length = quat.length();
    if length > 0.0 && length.is_finite() { quat / length } else { DQuat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

    fn track(interpolation: Interpolation, width: usize, times: &[f32], values: &[f32]) -> Track {
        Track { times: times.to_vec(), values: values.to_vec(), width, interpolation }
    }

    #[test]
    fn step_holds_until_the_next_key() {
        let t = track(Interpolation::Step, 3, &[1.0, 2.0], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(t.vec3(0.0), Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(t.vec3(1.999), Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(t.vec3(2.0), Vec3::new(4.0, 5.0, 6.0));
        assert_eq!(t.vec3(99.0), Vec3::new(4.0, 5.0, 6.0));
    }

    #[test]
    fn linear_is_clamped_at_both_ends() {
        let t = track(Interpolation::Linear, 3, &[1.0, 3.0], &[0.0, 0.0, 0.0, 4.0, -8.0, 2.0]);
        assert_eq!(t.vec3(0.0), Vec3::ZERO);
        assert_eq!(t.vec3(1.5), Vec3::new(1.0, -2.0, 0.5));
        assert_eq!(t.vec3(3.5), Vec3::new(4.0, -8.0, 2.0));
    }

    #[test]
    fn cubic_spline_against_hand_computed_values() {
        // Keys 0 s and 2 s, values 1 and 5, out-tangent 3, in-tangent -1. At u = 1/2 the Hermite
        // weights are 1/2, 1/8, 1/2, -1/8: 0.5 + 2 * 3/8 + 2.5 + 2 * 1/8 = 4. At u = 1/4: 27/32,
        // 9/64, 5/32, -3/64.
        let t = track(Interpolation::CubicSpline, 1, &[0.0, 2.0], &[9.0, 1.0, 3.0, -1.0, 5.0, 9.0]);
        let at = |time| {
            let mut out = [0.0];
            t.sample(time, &mut out);
            out[0]
        };
        assert_eq!(at(0.0), 1.0);
        assert_eq!(at(1.0), 4.0);
        let quarter = 27.0 / 32.0 + 2.0 * 3.0 * 9.0 / 64.0 + 5.0 * 5.0 / 32.0 + 2.0 * 3.0 / 64.0;
        assert!((at(0.5) - quarter).abs() < 1e-6);
        assert_eq!(at(2.0), 5.0);
    }

    #[test]
    fn rotation_takes_the_short_way_whatever_the_sign() {
        let end = Quat::from_rotation_z(FRAC_PI_2);
        for sign in [1.0, -1.0] {
            let mut values = Quat::IDENTITY.to_array().to_vec();
            values.extend((end * sign).to_array());
            let t = track(Interpolation::Linear, 4, &[0.0, 1.0], &values);
            let x = t.rotation(0.5) * Vec3::X;
            assert!(x.abs_diff_eq(Vec3::new(FRAC_PI_4.cos(), FRAC_PI_4.sin(), 0.0), 1e-6), "{x}");
            let third = t.rotation(1.0 / 3.0) * Vec3::X;
            assert!(
                third.abs_diff_eq(Vec3::new((FRAC_PI_2 / 3.0).cos(), 0.5, 0.0), 1e-6),
                "constant speed: {third}"
            );
        }
    }

    #[test]
    fn cubic_rotation_is_a_unit_quaternion() {
        let (zero, a, b) = ([0.0; 4], Quat::IDENTITY.to_array(), Quat::from_rotation_x(2.0).to_array());
        let values: Vec<f32> = [zero, a, zero, zero, b, zero].concat();
        let t = track(Interpolation::CubicSpline, 4, &[0.0, 1.0], &values);
        let middle = t.rotation(0.5);
        assert!((middle.length() - 1.0).abs() < 1e-6);
        assert!(middle.dot(Quat::from_rotation_x(1.0)) > 1.0 - 1e-6);
    }

    #[test]
    fn odd_keys_have_defined_results() {
        let t = track(Interpolation::Linear, 4, &[0.0, 1.0], &[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 1.0]);
        for time in [0.0, 0.5, 1.0] {
            assert_eq!(t.rotation(time), Quat::IDENTITY);
        }
        // A jump: of two keys at one time the later counts from then on, and an infinite key spoils
        // only its segments.
        let t =
            track(Interpolation::Linear, 1, &[0.0, 1.0, 1.0, 2.0, 3.0], &[0.0, 1.0, 7.0, f32::INFINITY, 5.0]);
        let at = |time| {
            let mut out = [0.0];
            t.sample(time, &mut out);
            out[0]
        };
        assert_eq!((at(0.5), at(1.0), at(3.0)), (0.5, 7.0, 5.0));
        assert!(!at(1.5).is_finite());
    }

    #[test]
    fn constant_tracks_are_recognised() {
        assert!(track(Interpolation::Linear, 1, &[0.0, 1.0], &[2.0, 2.0]).is_constant());
        assert!(!track(Interpolation::Linear, 1, &[0.0, 1.0], &[2.0, 2.5]).is_constant());
        assert!(
            track(Interpolation::CubicSpline, 1, &[0.0, 1.0], &[0.0, 2.0, 0.0, 0.0, 2.0, 0.0]).is_constant()
        );
        assert!(
            !track(Interpolation::CubicSpline, 1, &[0.0, 1.0], &[0.0, 2.0, 1.0, 0.0, 2.0, 0.0]).is_constant()
        );
    }
}
