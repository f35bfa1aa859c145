//! What must hold of the cloth: it keeps its area and stays out of ball and floor.

use anim::glam::Vec3;
use scenes::{Scene, SceneOptions, load};

const CENTER: Vec3 = Vec3::new(0.0, 6.68, 0.0);
const RADIUS: f32 = 5.0;

fn cloth_triangles(scene: &Scene) -> &[[u32; 3]] {
    let part = &scene.animation.topology().parts[0];
    assert_eq!(part.name, "cloth");
    &scene.animation.topology().triangles[part.triangles.start as usize..part.triangles.end as usize]
}

/// The point of a triangle nearest to a point (Ericson, Real-Time Collision Detection, 5.1.5).
fn nearest([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let on_edge =
        |a: Vec3, b: Vec3| a + (b - a) * ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    let normal = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| normal.dot((e - s).cross(p - s)) >= 0.0);
    if inside && normal != Vec3::ZERO {
        return p - normal * ((p - a).dot(normal) / normal.length_squared());
    }
    let candidates = [on_edge(a, b), on_edge(b, c), on_edge(c, a)];
    candidates.into_iter().min_by(|x, y| x.distance(p).total_cmp(&y.distance(p))).unwrap()
}

#[test]
fn cloth_keeps_its_area_and_never_enters_ball_or_floor() {
    let options = SceneOptions { detail: Some(0.1), substeps: Some(40), ..SceneOptions::default() };
    let scene = load("cloth-ball", None, &options).unwrap();
    let mut positions = scene.animation.rest();
    let area = |x: &[Vec3]| -> f64 {
        let twice = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| x[v as usize]);
            f64::from((b - a).cross(c - a).length())
        };
        cloth_triangles(&scene).iter().map(|t| 0.5 * twice(t)).sum()
    };
    let first = area(&positions);
    let (mut least, mut most, mut near) = (1.0_f64, 1.0_f64, f32::MAX);
    for step in 0..=2 * (scene.frames - 1) {
        let time = scene.animation.duration() * step as f64 / (2 * (scene.frames - 1)) as f64;
        scene.animation.pose(time, &mut positions);
        let ratio = area(&positions) / first;
        (least, most) = (least.min(ratio), most.max(ratio));
        for t in cloth_triangles(&scene) {
            let corners = t.map(|v| positions[v as usize]);
            assert!(corners.iter().all(|p| p.y >= 0.0), "below the floor at {time}");
            near = near.min(nearest(corners, CENTER).distance(CENTER));
        }
    }
    println!("area {least:.4} to {most:.4} of the first, nearest to the ball's centre {near:.4}");
    assert!(least > 0.95 && most < 1.02, "{least} {most}");
    assert!(near > RADIUS, "{near}");
}
