//! What must hold of the statues that break: shards keep their shape, fall, and stay above the
//! ground.

use anim::glam::Vec3;
use scenes::{Scene, SceneOptions, load};

fn small(name: &str) -> Scene {
    load(name, None, &SceneOptions { detail: Some(0.05), ..SceneOptions::default() }).unwrap()
}

#[test]
fn shards_keep_their_shape_and_end_on_the_ground() {
    for name in ["exploding-dragon", "lion"] {
        let scene = small(name);
        let topology = scene.animation.topology();
        let shards = topology.parts.iter().filter(|p| p.name == "shard").count();
        assert!(shards > 100, "{name}: {shards} shards");
        let rest = scene.animation.rest();
        let mut positions = rest.clone();
        let mut deepest = 0.0_f32;
        for frame in 0..=50 {
            scene.animation.pose(scene.animation.duration() * f64::from(frame) / 50.0, &mut positions);
            for &[a, b, c] in &topology.triangles {
                for (i, j) in [(a, b), (b, c), (c, a)].map(|(i, j)| (i as usize, j as usize)) {
                    let (before, now) = (rest[i].distance(rest[j]), positions[i].distance(positions[j]));
                    assert!((before - now).abs() < 1e-4, "{name}: an edge of {before} became {now}");
                }
            }
            deepest = positions.iter().map(|p| -p.y).fold(deepest, f32::max);
        }
        let mean_height = |x: &[Vec3]| x.iter().map(|p| p.y).sum::<f32>() / x.len() as f32;
        let (first, last) = (mean_height(&rest), mean_height(&positions));
        println!("{name}: mean height {first:.2} at first, {last:.2} at last; deepest {deepest:.3}");
        assert!(last < 0.4 * first, "{name} does not collapse");
        assert!(deepest < 0.2, "{name}: {deepest} below the ground");
    }
}

#[test]
fn statues_stand_until_the_stone_hits_and_the_lion_breaks_gradually() {
    let broken = |scene: &Scene, fraction: f64| {
        let rest = scene.animation.rest();
        let mut positions = rest.clone();
        scene.animation.pose(scene.animation.duration() * fraction, &mut positions);
        let parts = scene.animation.topology().parts.iter().filter(|p| p.name == "shard");
        let moved = |v: u32| positions[v as usize].distance(rest[v as usize]) > 0.01;
        let moves: Vec<bool> = parts.map(|p| moved(p.vertices.start)).collect();
        moves.iter().filter(|&&m| m).count() as f32 / moves.len() as f32
    };
    let (dragon, lion) = (small("exploding-dragon"), small("lion"));
    assert_eq!((broken(&dragon, 0.05), broken(&lion, 0.05)), (0.0, 0.0));
    let [quarter, half, end] = [0.25, 0.5, 1.0].map(|t| broken(&lion, t));
    println!("lion: broken {quarter:.2} at a quarter, {half:.2} at half, {end:.2} at the end");
    assert!(quarter > 0.02 && quarter < 0.5 && half > quarter + 0.1 && end > 0.95);
    assert!(broken(&dragon, 0.6) > 0.95);
}
