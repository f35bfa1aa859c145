//! Whether a model is a room, and the view from inside it.

use anim::{Animation, Light, View};
use glam::Vec3;

use crate::shape::around;

/// Directions in which it is tried whether walls are there.
const DIRECTIONS: usize = 64;
/// Part of them in which there must be one.
const WALLED: f32 = 0.75;

/// A view from one end of a still room to the other and a light in its middle, or `None` if the
/// model is no room.
///
/// It is one if from the middle of its box, `low` to `high`, the front of a surface is seen almost
/// everywhere; from the middle of a body that would be the back. O(triangles).
pub(crate) fn inside(animation: &dyn Animation, low: Vec3, high: Vec3) -> Option<(View, Light)> {
    if animation.duration() > 0.0 {
        return None;
    }
    let middle = 0.5 * (low + high);
    let positions = animation.rest();
    let triangles = animation.topology().triangles.iter();
    let triangles = triangles.map(|corners| corners.map(|v| positions[v as usize] - middle));
    let triangles: Vec<[Vec3; 3]> = triangles.filter(|t| t.iter().all(|p| p.is_finite())).collect();
    let free = |direction: Vec3| front(&triangles, direction);
    let walls = (0..DIRECTIONS).filter(|&i| free(spread(i, DIRECTIONS)).is_some()).count();
    if (walls as f32) < WALLED * DIRECTIONS as f32 {
        return None;
    }
    // Looked along the axis that leaves most room, from near its end.
    let ends = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(|d| (d, free(d).unwrap_or(0.0)));
    let (back, distance) = ends.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let half = 0.5 * (high.y - low.y);
    let eye = middle + back * (0.85 * distance);
    let light = middle + Vec3::Y * (0.7 * free(Vec3::Y).unwrap_or(half));
    let view = View { eye, target: middle, up: Vec3::Y, fov_y: 65_f32.to_radians() };
    Some((view, Light { position: light, color: [1.0; 3] }))
}

/// Distance from the origin to the nearest triangle in a direction, if its front is seen there.
///
/// The test of Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997.
fn front(triangles: &[[Vec3; 3]], direction: Vec3) -> Option<f32> {
    let (mut nearest, mut seen) = (f32::INFINITY, false);
    for &[a, b, c] in triangles {
        let (ab, ac) = (b - a, c - a);
        let across = direction.cross(ac);
        // Above zero where the front is seen.
        let facing = ab.dot(across);
        let u = -a.dot(across) / facing;
        let along = (-a).cross(ab);
        let v = direction.dot(along) / facing;
        let t = ac.dot(along) / facing;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < nearest {
            (nearest, seen) = (t, facing > 0.0);
        }
    }
    seen.then_some(nearest)
}

/// Direction `i` of `count`, evenly spread over the sphere (on a Fibonacci spiral).
fn spread(i: usize, count: usize) -> Vec3 {
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
    let turn = i as f32 * std::f32::consts::PI * (3.0 - 5_f32.sqrt());
    (around(turn) * (1.0 - y * y).sqrt()).with_y(y)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::vec3;

    use super::*;

    /// A cuboid of 12 triangles, 4 long, 2 high and 2 deep, seen from outside, or turned inside
    /// out.
    fn cuboid(inside_out: bool) -> Box<dyn Animation> {
        let mut text = String::new();
        for i in 0..8 {
            text += &format!("v {} {} {}\n", 4 * (i & 1), i & 2, (i & 4) / 2);
        }
        for [a, b, c, d] in
            [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]]
        {
            text += &if inside_out { format!("f {d} {c} {b} {a}\n") } else { format!("f {a} {b} {c} {d}\n") };
        }
        anim::parse(Path::new("cuboid.obj"), text.as_bytes(), &Default::default()).unwrap()
    }

    #[test]
    fn a_room_is_seen_from_inside_and_a_block_is_not() {
        let (low, high) = (Vec3::ZERO, vec3(4.0, 2.0, 2.0));
        assert!(inside(&*cuboid(false), low, high).is_none());
        let (view, light) = inside(&*cuboid(true), low, high).unwrap();
        for p in [view.eye, view.target, light.position] {
            assert!(p.cmpgt(low).all() && p.cmplt(high).all(), "{p} is in the room");
        }
        assert!((view.eye.x - view.target.x).abs() > 1.5, "along the longest side");
    }
}
