//! A pinhole camera.

use bvh_core::{Ray, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::simd::load;

/// A pinhole camera over an image of `width` by `height` pixels.
///
/// The ray through the centre of pixel `x`, `y`, counted from the top left, goes from `eye` along
/// `corner + right (x + 0.5) + down (y + 0.5)`. All these directions must be of lengths between
/// 1e-18 and 1e18; pictures through others are not defined. Beyond 2^23 pixels a side, halves of a
/// pixel are rounded, and pictures differ from [`ray`](Self::ray) in last bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands.
    pub eye: Vec3,
    /// Direction from the eye through the outer corner of the top left pixel.
    pub corner: Vec3,
    /// Change of direction from one pixel to the next on its right.
    pub right: Vec3,
    /// Change of direction from one pixel to the next below.
    pub down: Vec3,
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

/// A vector of length 1 that points the same way, whatever the length of `v`: its square may be
/// beyond `f32`, or 0. `None` if `v` itself is 0 or not finite.
fn direction(v: Vec3) -> Option<Vec3> {
    (v / v.abs().max_element()).try_normalize()
}

impl Camera {
    /// Makes a camera at `eye` that has `target` in the middle of its image and sees `fov_y`
    /// radians from the lower to the upper edge, between 0 and pi. The part of `up` across the view
    /// points up in the image; coordinates are right-handed.
    ///
    /// Looks along -z if `target` is `eye`, and takes another vector if `up` is parallel to the
    /// view. With NaN or infinite input its rays hit nothing.
    #[must_use]
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, width: u32, height: u32) -> Self {
        let way = if (target - eye).is_finite() { target - eye } else { target * 0.5 - eye * 0.5 };
        let is_finite = target.is_finite() && up.is_finite();
        let forward = if is_finite { direction(way).unwrap_or(Vec3::NEG_Z) } else { Vec3::NAN };
        let side = forward.cross(direction(up).unwrap_or(Vec3::ZERO));
        let side = if side.length_squared() > 1e-12 { side } else { forward.any_orthogonal_vector() };
        let side = side.normalize_or_zero();
        let up = side.cross(forward);
        let pixel = 2.0 * libm::tanf(0.5 * fov_y) / height.max(1) as f32;
        let (right, down) = (side * pixel, up * -pixel);
        let corner = forward - right * (0.5 * width as f32) - down * (0.5 * height as f32);
        Self { eye, corner, right, down, width, height }
    }

    /// Returns the ray through the centre of pixel `x`, `y`, counted from the top left. With
    /// [`look_at`](Self::look_at) its direction has length 1 along the middle of the view, so that
    /// `t` is depth.
    #[must_use]
    #[inline]
    pub fn ray(&self, x: u32, y: u32) -> Ray {
        let direction = self.corner + self.right * (x as f32 + 0.5) + self.down * (y as f32 + 0.5);
        Ray::new(self.eye, direction)
    }

    /// Sets the directions through the points `inside` pixels `left + columns[i]`, `top + rows[i]`;
    /// in the middle with the bits of [`ray`](Self::ray), since sums of halves are exact up to 2^23
    /// pixels.
    #[inline(always)]
    pub(crate) fn directions<S: Simd, const N: usize>(
        &self,
        simd: S,
        (left, top): (u32, u32),
        inside: [f32; 2],
        (columns, rows): (&[f32; N], &[f32; N]),
        directions: &mut [[f32; N]; 3],
    ) {
        for at in (0..N).step_by(S::f32s::LEN) {
            let x: S::f32s = load(simd, columns, at);
            let y: S::f32s = load(simd, rows, at);
            let (x, y) = (x + (left as f32 + inside[0]), y + (top as f32 + inside[1]));
            for (k, to) in directions.iter_mut().enumerate() {
                let d = x * self.right[k] + self.corner[k] + y * self.down[k];
                d.store_slice(&mut to[at..at + S::f32s::LEN]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_is_upright_and_not_mirrored() {
        let camera = Camera::look_at(Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, Vec3::Y, 1.0, 3, 3);
        assert!((camera.ray(1, 1).direction() - Vec3::NEG_Z).length() < 1e-6);
        assert!(camera.ray(2, 1).direction().x > 0.1);
        assert!(camera.ray(1, 0).direction().y > 0.1);
        let edge = camera.ray(1, 0).direction() - camera.down * 0.5;
        assert!((edge.y - 0.5f32.tan()).abs() < 1e-6);
    }

    #[test]
    fn views_of_any_length_look_at_the_target() {
        for length in [1e-44, 1e-30, 1.0, 1e20, 3e38] {
            for up in [1e-40, 1.0, 1e30] {
                let eye = Vec3::new(length, 0.0, 0.0);
                for (eye, target) in [(eye, Vec3::ZERO), (eye, -eye)] {
                    let camera = Camera::look_at(eye, target, Vec3::Y * up, 1.0, 3, 3);
                    assert!(
                        (camera.ray(1, 1).direction() - Vec3::NEG_X).length() < 1e-6,
                        "{length}, up {up}"
                    );
                    assert!(camera.ray(1, 0).direction().y > 0.1, "{length}, up {up}");
                }
            }
        }
    }

    #[test]
    fn degenerate_views_have_finite_rays_and_broken_ones_invalid_rays() {
        let up = Camera::look_at(Vec3::ZERO, Vec3::Y, Vec3::Y, 1.0, 2, 2);
        let still = Camera::look_at(Vec3::ONE, Vec3::ONE, Vec3::ZERO, 1.0, 2, 2);
        assert!(up.ray(0, 1).is_valid() && still.ray(1, 0).is_valid());
        let (nan, infinite) = (Vec3::NAN, Vec3::X * f32::INFINITY);
        for broken in [nan, infinite] {
            for [eye, target, up] in
                [[broken, Vec3::ZERO, Vec3::Y], [Vec3::ONE, broken, Vec3::Y], [Vec3::ONE, Vec3::ZERO, broken]]
            {
                assert!(!Camera::look_at(eye, target, up, 1.0, 2, 2).ray(0, 0).is_valid());
            }
        }
        assert!(!Camera::look_at(Vec3::ONE, Vec3::ZERO, Vec3::Y, f32::NAN, 2, 2).ray(0, 0).is_valid());
    }
}
