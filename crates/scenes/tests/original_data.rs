//! Stand-ins against two consecutive frames each of the originals, where `PIVOT_DATA` names a
//! folder with them.

use std::path::Path;

use anim::glam::Vec3;
use scenes::{SceneOptions, load};

/// The mean displacement from the first to the second key frame of an original of the given part of
/// its vertices.
fn original(folder: &str, wanted: impl Fn(Vec3) -> bool) -> Option<f64> {
    let Some(data) = std::env::var_os("PIVOT_DATA").filter(|d| !d.is_empty()) else {
        println!("PIVOT_DATA is not set: nothing is compared with the original {folder}");
        return None;
    };
    let frames = anim::load(&Path::new(&data).join(folder), &Default::default()).unwrap();
    assert_eq!(frames.duration(), 2.0 * anim::DEFAULT_SECONDS_PER_FRAME, "two frames, back and forth");
    let (before, mut after) = (frames.rest(), frames.rest());
    // The loop goes there and back.
    frames.pose(0.5 * frames.duration(), &mut after);
    Some(mean_displacement(&before, &after, wanted))
}

fn mean_displacement(before: &[Vec3], after: &[Vec3], wanted: impl Fn(Vec3) -> bool) -> f64 {
    let moves: Vec<f64> = before
        .iter()
        .zip(after)
        .filter(|(p, _)| wanted(**p))
        .map(|(p, q)| f64::from(p.distance(*q)))
        .collect();
    moves.iter().sum::<f64>() / moves.len() as f64
}

/// A coarser cloth hangs and slips otherwise; only that of the full scene can be compared.
#[test]
#[ignore = "simulates the whole cloth, a minute"]
fn cloth_moves_like_the_original_from_frame_92_to_93() {
    let off_the_ball = |p: Vec3| p.distance(Vec3::new(0.0, 6.68, 0.0)) > 5.02;
    let scene = load("cloth-ball", None, &SceneOptions::default()).unwrap();
    let (mut before, mut after) = (scene.animation.rest(), scene.animation.rest());
    let per_frame = scene.animation.duration() / (scene.frames - 1) as f64;
    scene.animation.pose(91.0 * per_frame, &mut before);
    scene.animation.pose(92.0 * per_frame, &mut after);
    let ours = mean_displacement(&before, &after, off_the_ball);
    println!("cloth-ball: mean displacement {ours:.3} at frame 92");
    assert!(ours > 0.1 && ours < 1.0);
    if let Some(theirs) = original("unc/cloth-ball", off_the_ball) {
        println!("cloth-ball: {theirs:.3} in the original");
        assert!(ours / theirs > 0.5 && ours / theirs < 2.0, "{ours} here, {theirs} there");
    }
}

#[test]
fn balls_move_like_the_original() {
    let scene = load("n-body", None, &SceneOptions::default()).unwrap();
    let (mut before, mut after) = (scene.animation.rest(), scene.animation.rest());
    let per_frame = scene.animation.duration() / (scene.frames - 1) as f64;
    scene.animation.pose(50.0 * per_frame, &mut before);
    scene.animation.pose(51.0 * per_frame, &mut after);
    let ours = mean_displacement(&before, &after, |_| true);
    println!("n-body: mean displacement {ours:.3}");
    // 0.449 of the original over 76 frames.
    assert!((0.32..0.36).contains(&ours), "{ours}");
    if let Some(theirs) = original("unc/n-body", |_| true) {
        // The loop of the original has 76 frames.
        let over_100 = theirs * 75.0 / 99.0;
        println!("n-body: {theirs:.3} in the original, {over_100:.3} over 100 frames");
        assert!((0.8..1.25).contains(&(ours / over_100)), "{ours} here, {over_100} there");
    }
}
