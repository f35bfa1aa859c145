//! A sheet that bursts into pieces, and how good a tree over it is.

use bvh_build::{Builder, build};
use bvh_core::{Aabb, Bvh, Vec3, sah_cost};

/// A point of the unit cube. Not from a crate: a bound of `baselines.rs` fails with other numbers.
pub(crate) fn noise(i: usize) -> Vec3 {
    let hash = |k: usize| {
        let h = (i * 3 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (i << 7);
        ((h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
    };
    Vec3::new(hash(0), hash(1), hash(2))
}

/// `n` boxes in pieces of 50 neighbours. Each piece of the first `moving` boxes flies off as one.
pub(crate) fn burst(n: usize, moving: usize, time: f32) -> Vec<Aabb> {
    let place = |i: usize| {
        let away = if i < moving { (noise(i / 50) - 0.5) * 400.0 * time } else { Vec3::ZERO };
        Vec3::new((i / 50) as f32, (i % 50) as f32, 0.0) + away
    };
    (0..n).map(place).map(|corner| Aabb::new(corner, corner + 0.8)).collect()
}

pub(crate) fn tree(boxes: &[Aabb]) -> Bvh {
    build(boxes, Builder::Sweep).expect("built")
}

/// The cost of a tree over that of a new one.
pub(crate) fn over_fresh(bvh: &Bvh, boxes: &[Aabb]) -> f64 {
    sah_cost(bvh) / sah_cost(&tree(boxes))
}
