//! Rotations, the same on every machine: `glam` computes with quaternions of `f32` by whatever SIMD
//! there is, and with those of `f64` without; sines are those of `libm`.

use glam::{DQuat, DVec3};

/// Exponential of half a rotation vector.
pub(crate) fn exp(v: DVec3) -> DQuat {
    let angle = v.length();
    let (sin, cos) = libm::sincos(angle);
    let xyz = if angle > 0.0 { v * (sin / angle) } else { v };
    DQuat::from_xyzw(xyz.x, xyz.y, xyz.z, cos)
}

/// Logarithm of the way from one unit quaternion to another: its axis times half its angle.
pub(crate) fn step(from: DQuat, to: DQuat) -> DVec3 {
    let way = from.conjugate() * to;
    let sine = way.xyz().length();
    if sine > 0.0 { way.xyz() * (libm::atan2(sine, way.w) / sine) } else { DVec3::ZERO }
}

/// Along the arc from one unit quaternion to another as it comes, which may be the long way round.
pub(crate) fn slerp(from: DQuat, to: DQuat, u: f64) -> DQuat {
    from * exp(u * step(from, to))
}

/// The rotation about a unit axis by an angle in radians.
pub(crate) fn about(axis: DVec3, angle: f64) -> DQuat {
    exp(0.5 * angle * axis)
}
