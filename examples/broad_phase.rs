//! The broad phase of a physics loop: balls fly about in a box, and every step asks which of their
//! bounding boxes overlap. The balls mix, so a tree that is only refitted gets worse. The updater
//! chooses what to do about that: it is given what the step asked of the tree.

use std::error::Error;
use std::ops::ControlFlow;

use pivot_bvh::{Aabb, Builder, Load, Updater, Vec3, build};

const BALLS: usize = 20_000;
const RADIUS: f32 = 0.2;
const ROOM: f32 = 30.0;

fn main() -> Result<(), Box<dyn Error>> {
    // A prime above the number of balls, so that no two balls start in one place.
    let scatter = |i: usize, k: usize| ((i * k) % 99_991) as f32 / 99_991.0;
    let mut centers: Vec<Vec3> =
        (0..BALLS).map(|i| Vec3::new(scatter(i, 7919), scatter(i, 5167), scatter(i, 3571)) * ROOM).collect();
    let mut speeds: Vec<Vec3> =
        (0..BALLS).map(|i| Vec3::new(scatter(i, 2741), scatter(i, 6133), scatter(i, 4409)) - 0.5).collect();
    let boxes = |centers: &[Vec3]| -> Vec<Aabb> {
        centers.iter().map(|&c| Aabb::new(c - RADIUS, c + RADIUS)).collect()
    };

    let mut bvh = build(&boxes(&centers), Builder::BinnedParallel)?;
    let mut updater = Updater::default();
    for step in 0..60 {
        for (center, speed) in centers.iter_mut().zip(&mut speeds) {
            *center += *speed * 0.2;
            for axis in 0..3 {
                if center[axis].clamp(0.0, ROOM) != center[axis] {
                    speed[axis] = -speed[axis];
                }
            }
        }
        let boxes = boxes(&centers);
        let done = updater.update(&mut bvh, boxes.as_slice())?;

        let (mut pairs, mut contacts) = (0, 0);
        bvh.for_each_pair(boxes.as_slice(), |a, b| {
            pairs += 1;
            // The narrow phase: balls that overlap and approach each other bounce like equal
            // masses.
            let (apart, closing) = (centers[b] - centers[a], speeds[b] - speeds[a]);
            if apart.length_squared() < 4.0 * RADIUS * RADIUS && apart.dot(closing) < 0.0 {
                let normal = apart.normalize_or_zero();
                let impulse = normal * closing.dot(normal);
                speeds[a] += impulse;
                speeds[b] -= impulse;
                contacts += 1;
            }
            ControlFlow::Continue(())
        });
        updater.report(Load::Pairs);
        if step % 10 == 0 {
            println!("step {step:2}: {pairs:6} overlapping pairs, {contacts:5} contacts; {}", done.decision);
        }
    }
    Ok(())
}
