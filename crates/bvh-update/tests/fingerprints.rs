//! The trees of all strategies after a few motions, bit for bit as they were recorded.
//!
//! A change of a strategy on purpose records its line again: the failing test prints the table as it should stand.

use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Aabb, Bvh, Vec3};
use bvh_update::{Scratch, Strategy, update};

const N: usize = 12_000;
const FRAMES: usize = 8;

/// Three numbers between 0 and 1.
fn noise(i: usize) -> Vec3 {
    let at = |k: usize| {
        let h = (i * 3 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
    };
    Vec3::new(at(0), at(1), at(2))
}

fn boxes(corner: impl Fn(usize) -> Vec3) -> Vec<Aabb> {
    (0..N).map(corner).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

/// A sheet that waves.
fn wave(frame: usize) -> Vec<Aabb> {
    boxes(|i| {
        let (x, y) = ((i % 120) as f32, (i / 120) as f32);
        let turn = (i.wrapping_mul(7) + 9 * frame) % 64;
        Vec3::new(x, y, 0.1 * (turn as f32 - 32.0).abs())
    })
}

/// A sheet that bursts into pieces.
fn burst(frame: usize) -> Vec<Aabb> {
    boxes(|i| {
        let at = Vec3::new((i % 120) as f32, (i / 120) as f32, 0.0);
        at + (noise(i / 60) - 0.5) * 50.0 * frame as f32
    })
}

/// Everything jumps.
fn chaos(frame: usize) -> Vec<Aabb> {
    boxes(|i| noise(i + 7919 * frame) * 80.0)
}

type Motion = fn(usize) -> Vec<Aabb>;
const MOTIONS: [(&str, Motion); 3] = [("wave", wave), ("burst", burst), ("chaos", chaos)];

/// The tree of a strategy after some frames; a third of the primitives stand still in the second half.
fn play(strategy: &Strategy, motion: Motion, max_leaf_size: u32) -> Bvh {
    let options = BuildOptions { max_leaf_size, ..BuildOptions::default() };
    let mut bvh = build(&motion(0), Builder::Sweep, &options, None).expect("few boxes");
    let mut scratch = Scratch::new();
    let mut now = motion(0);
    for frame in 1..=FRAMES {
        let moved = motion(frame);
        let half_still = frame > FRAMES / 2;
        if frame == FRAMES / 2 + 1 {
            bvh.set_moving(|p| p % 300 < 200);
        }
        for (p, aabb) in moved.into_iter().enumerate() {
            if !half_still || p % 300 < 200 {
                now[p] = aabb;
            }
        }
        update(&mut bvh, &now, strategy, &mut scratch).expect("as many boxes");
    }
    bvh
}

/// Strategies whose trees depend on nothing but the motion.
fn strategies() -> impl Iterator<Item = Strategy> {
    let is_fixed = |s: &Strategy| !matches!(s, Strategy::Auto(_) | Strategy::Background(_));
    Strategy::all().into_iter().filter(is_fixed)
}

#[test]
fn every_strategy_leaves_the_recorded_trees() {
    let mut lines = String::new();
    for strategy in strategies() {
        let of = |(_, motion): (&str, Motion), leaves| format!("{:016x}", play(&strategy, motion, leaves).hash());
        let row: Vec<String> = MOTIONS.into_iter().map(|m| of(m, 1)).chain([of(MOTIONS[1], 4)]).collect();
        lines += &format!("{} {}\n", strategy.name(), row.join(" "));
    }
    assert!(lines == include_str!("fingerprints.txt"), "these trees were made:\n{lines}");
}
