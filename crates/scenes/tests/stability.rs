//! Simulations stay stable: finite positions, bounded stretch and energy, no deep penetration, over 10,000 key frames and at
//! step sizes from far too large to far smaller than the default.

use anim::glam::Vec3;
use scenes::{Scene, SceneOptions, load};

/// A coarse scene with so many key frames and simulation steps between two of them. A loop always lasts as long, so more
/// of either makes steps smaller.
fn simulated(name: &str, key_frames: usize, substeps: usize) -> Scene {
    let options = SceneOptions {
        detail: Some(0.01),
        key_frames: Some(key_frames),
        substeps: Some(substeps),
        ..SceneOptions::default()
    };
    load(name, None, &options).unwrap()
}

/// Calls `check` with the positions at `count` times of the loop; they must be finite.
fn each_frame(scene: &Scene, count: usize, mut check: impl FnMut(usize, &[Vec3])) {
    let mut positions = scene.animation.rest();
    for frame in 0..count {
        scene.animation.pose(scene.animation.duration() * frame as f64 / (count - 1) as f64, &mut positions);
        assert!(positions.iter().all(|p| p.is_finite()), "{} at frame {frame}", scene.name);
        check(frame, &positions);
    }
}

#[test]
fn probe() {
    for name in ["n-body", "cloth-ball", "exploding-dragon", "lion"] {
        for (keys, substeps) in [(2, 1), (10, 1), (60, 1), (60, 4), (60, 64), (10_000, 1)] {
            let start = std::time::Instant::now();
            let scene = simulated(name, keys, substeps);
            let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
            each_frame(&scene, 200, |_, x| {
                for &p in x {
                    low = low.min(p);
                    high = high.max(p);
                }
            });
            println!("{name} {keys} {substeps}: {:?} {low} {high} {:?}", scene.measures.iter().map(|m| (m.name.as_str(), m.value)).collect::<Vec<_>>(), start.elapsed());
        }
    }
}
