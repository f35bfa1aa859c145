//! The camera: where the scene has it, or wherever the mouse and the keys have taken it.

use anim::View;
use bvh_core::Vec3;
use bvh_core::glam::Quat;

/// Least angle between the line of sight and the vertical, in radians.
const POLE: f32 = 0.05;

/// A view that can be moved.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Eye {
    /// The view since it was moved; before, the scene's counts.
    moved: Option<View>,
}

impl Eye {
    /// The view, where the scene has `scenes`.
    pub(crate) fn view(&self, scenes: View) -> View {
        self.moved.unwrap_or(scenes)
    }

    /// Turns about the target, by angles in radians to the right and down.
    pub(crate) fn orbit(&mut self, scenes: View, right: f32, down: f32) {
        let view = self.view(scenes);
        let back = turned(view.eye - view.target, view.up, -right, down);
        self.moved = Some(View { eye: view.target + back, ..view });
    }

    /// Turns the line of sight, by angles in radians to the right and down.
    pub(crate) fn look(&mut self, scenes: View, right: f32, down: f32) {
        let view = self.view(scenes);
        let ahead = turned(view.target - view.eye, view.up, -right, -down);
        self.moved = Some(View { target: view.eye + ahead, ..view });
    }

    /// Multiplies the distance to the target.
    pub(crate) fn zoom(&mut self, scenes: View, factor: f32) {
        let view = self.view(scenes);
        self.moved = Some(View { eye: view.target + (view.eye - view.target) * factor, ..view });
    }

    /// Moves by parts of the distance to the target: to the right, up and ahead.
    pub(crate) fn fly(&mut self, scenes: View, [right, up, ahead]: [f32; 3]) {
        let view = self.view(scenes);
        let forward = view.target - view.eye;
        let side = forward.cross(view.up).normalize_or_zero() * forward.length();
        let top = view.up.normalize_or_zero() * forward.length();
        let by = side * right + top * up + forward * ahead;
        self.moved = Some(View { eye: view.eye + by, target: view.target + by, ..view });
    }

    /// Goes back to the scene's view.
    pub(crate) fn reset(&mut self) {
        self.moved = None;
    }
}

/// A direction turned about `up` to the left, and away from the horizon downwards, but never to the
/// poles.
fn turned(direction: Vec3, up: Vec3, left: f32, down: f32) -> Vec3 {
    let up = up.normalize_or(Vec3::Y);
    let from_up = direction.angle_between(up);
    let down = (from_up - down).clamp(POLE, std::f32::consts::PI - POLE) - from_up;
    let Some(axis) = up.cross(direction).try_normalize() else { return direction };
    Quat::from_axis_angle(up, left) * (Quat::from_axis_angle(axis, down) * direction)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View =
        View { eye: Vec3::new(0.0, 1.0, 5.0), target: Vec3::new(0.0, 1.0, 0.0), up: Vec3::Y, fov_y: 1.0 };

    #[test]
    fn orbits_keep_the_distance_and_avoid_the_poles() {
        let mut eye = Eye::default();
        eye.orbit(VIEW, 0.5, 0.0);
        assert!(eye.view(VIEW).eye.x < -1.0, "the scene follows the mouse to the right");
        for _ in 0..50 {
            eye.orbit(VIEW, 0.3, 0.4);
            let back = eye.view(VIEW).eye - VIEW.target;
            assert!((back.length() - 5.0).abs() < 1e-3 && back.angle_between(Vec3::Y) > 0.9 * POLE);
        }
        assert!(eye.view(VIEW).eye.y > 5.0, "dragged down, the view is from above");
        eye.reset();
        assert_eq!(eye.view(VIEW), VIEW);
    }

    #[test]
    fn flying_moves_eye_and_target_alike() {
        let mut eye = Eye::default();
        eye.fly(VIEW, [0.2, 0.0, 0.4]);
        let View { eye: at, target, .. } = eye.view(VIEW);
        assert!(
            (at - Vec3::new(1.0, 1.0, 3.0)).length() < 1e-5
                && (target - Vec3::new(1.0, 1.0, -2.0)).length() < 1e-5
        );
        let mut eye = Eye::default();
        eye.look(VIEW, 0.3, 0.0);
        assert!(eye.view(VIEW).target.x > 1.0 && eye.view(VIEW).eye == VIEW.eye);
        eye.look(VIEW, 0.0, 0.3);
        assert!(eye.view(VIEW).target.y < 1.0);
    }
}
