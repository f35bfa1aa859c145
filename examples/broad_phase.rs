//! The broad phase of a physics loop: balls fly about in a box, and every step asks which of their
//! bounding boxes overlap. Refitting and rotating keeps the tree good for many steps. As the balls
//! mix, the tree gets worse, so this program rebuilds it whenever its cost has doubled.
//! `Strategy::Auto` would decide this itself.

use std::error::Error;
use std::ops::ControlFlow;

use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Aabb, Vec3, sah_cost};
use bvh_update::{Rotate, Strategy, Updater};

const BALLS: usize = 20_000;
const RADIUS: f32 = 0.2;
const ROOM: f32 = 30.0;

fn main() -> Result<(), Box<dyn Error>> {
    let scatter = |i: usize, k: usize| ((i * k) % 9973) as f32 / 9973.0;
    let mut centers: Vec<Vec3> =
        (0..BALLS).map(|i| Vec3::new(scatter(i, 7919), scatter(i, 5167), scatter(i, 3571)) * ROOM).collect();
    let mut speeds: Vec<Vec3> =
        (0..BALLS).map(|i| Vec3::new(scatter(i, 2741), scatter(i, 6133), scatter(i, 4409)) - 0.5).collect();
    let boxes = |centers: &[Vec3]| -> Vec<Aabb> {
        centers.iter().map(|&c| Aabb::new(c - RADIUS, c + RADIUS)).collect()
    };

    let mut bvh = build(&boxes(&centers), Builder::BinnedParallel)?;
    let mut fresh_cost = sah_cost(&bvh);
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
        let done = updater
            .set_strategy(Strategy::RefitRotate(Rotate::default()))
            .update(&mut bvh, boxes.as_slice())?;
        let cost = done.sah_cost.unwrap_or_default();
        if cost > 2.0 * fresh_cost {
            let rebuild = Strategy::Rebuild(Builder::BinnedParallel, BuildOptions::default());
            updater.set_strategy(rebuild).update(&mut bvh, boxes.as_slice())?;
            fresh_cost = sah_cost(&bvh);
            println!("step {step:2}: the cost had doubled to {cost:.1}; rebuilt at {fresh_cost:.1}");
        }

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
        if step % 10 == 0 {
            println!(
                "step {step:2}: {pairs:6} overlapping pairs, {contacts:5} contacts, {:5} rotations, SAH cost {cost:.1}",
                done.rotations_applied()
            );
        }
    }
    Ok(())
}
