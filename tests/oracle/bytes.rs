//! Tests driven by bytes, for fuzzing and for its corpus: whatever the bytes, nothing panics and
//! every promise holds.

use std::path::Path;

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::glam::{Vec3, Vec3Swizzles};
use bvh_core::{Ray, SimdLevel, Triangles};
use bvh_update::{Strategy, Updater};
use rt_cpu::{Bvh8, TriangleTest};

use crate::{noise, sah_cost};

/// Plays a sequence of updates, at the lowest and the highest SIMD level side by side. The first
/// bytes give the size, the leaves and the builder; then each update takes one byte for its
/// strategy, one for what happens, and one for how much.
///
/// # Panics
/// If anything does not hold: that is what it is for.
pub fn play_bytes(bytes: &[u8]) {
    let mut bytes = bytes.iter().copied();
    let mut next = || bytes.next();
    let (Some(n), Some(leaf), Some(builder)) = (next(), next(), next()) else { return };
    // Few enough to be played often, but for the last numbers: threads share out a pass from a
    // thousand pairs on.
    let n = if n < 240 { usize::from(n % 96) } else { usize::from(n - 239) * 160 };
    let options = BuildOptions::default().with_max_leaf_size(u32::from(leaf % 5));
    let builder = Builder::ALL[usize::from(builder) % Builder::ALL.len()];
    let mut positions: Vec<Vec3> = (0..3 * n).map(|i| noise(1, i / 3) * 10.0 + noise(2, i)).collect();
    let mut indices: Vec<[u32; 3]> = (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mut bvh = build_with(&Triangles { positions: &positions, indices: &indices }, builder, &options)
        .expect("few enough");
    let mut twin = bvh.clone();
    let mut updaters =
        [SimdLevel::best(), SimdLevel::Baseline].map(|level| Updater::with_level(Strategy::default(), level));
    let mut wide = Bvh8::default();
    let mut moving = vec![true; n];
    // What comes from the background comes when it likes, and could not be played again.
    let mut strategies: Vec<_> =
        Strategy::all().into_iter().filter(|s| !matches!(s, Strategy::Background(_))).collect();
    // A strategy of before stood here: so bytes that were saved mean the others still.
    strategies.insert(8, Strategy::default());
    while let (Some(strategy), Some(what)) = (next(), next()) {
        if what & 0x80 != 0 {
            let (period, phase) = (usize::from(what >> 4 & 7) + 1, usize::from(what & 15));
            moving.iter_mut().enumerate().for_each(|(i, moves)| *moves = (i + phase) % period == 0);
            bvh.set_dynamic(|p| moving[p]);
            twin.set_dynamic(|p| moving[p]);
        } else if what & 15 == 15 {
            let was = bvh.reorder_primitives();
            assert_eq!(was, twin.reorder_primitives());
            indices = was.iter().map(|&p| indices[p as usize]).collect();
            moving = was.iter().map(|&p| moving[p as usize]).collect();
        } else {
            let amount = next().unwrap_or(0);
            for triangle in
                indices.iter().zip(&moving).filter(|(_, moves)| **moves).map(|(triangle, _)| triangle)
            {
                for i in triangle.map(|v| v as usize) {
                    move_vertex(&mut positions[i], i, what, f32::from(amount));
                }
            }
        }
        let triangles = Triangles { positions: &positions, indices: &indices };
        let strategy = match strategies[usize::from(strategy) % strategies.len()] {
            Strategy::Rebuild(builder, _) if strategy & 0x80 != 0 => Strategy::Rebuild(builder, options),
            as_it_is => as_it_is,
        };
        let reported = updaters[0].set_strategy(strategy).update(&mut bvh, &triangles).expect("same count");
        let twins = updaters[1].set_strategy(strategy).update(&mut twin, &triangles).expect("same count");
        assert_eq!(
            (reported, bvh.fingerprint()),
            (twins, twin.fingerprint()),
            "{}: another SIMD level",
            strategy.name()
        );
        bvh.validate(&triangles).unwrap_or_else(|e| panic!("{}: {e}", strategy.name()));
        let cost = reported.sah_cost.unwrap_or_else(|| bvh_core::sah_cost(&bvh));
        assert!(cost.is_finite() && cost >= 0.0, "{}: cost {cost}", strategy.name());
        let extent = bvh.root().aabb().extent().max_element();
        let real = sah_cost(&bvh, &positions, &indices);
        assert!(
            extent <= 1e-12 || (cost - real).abs() <= 1e-3 * real,
            "{}: {cost} for {real}",
            strategy.name()
        );
        wide.update(&bvh, &triangles);
        let (from, to) = (noise(3, usize::from(what)) * 30.0 - 10.0, noise(4, usize::from(what)) * 10.0);
        let ray = Ray::new(from, to - from);
        for test in TriangleTest::ALL {
            let found = rt_cpu::closest_hit(&bvh, &triangles, &ray, f32::INFINITY, test);
            let brute = rt_cpu::closest_hit_brute(&triangles, &ray, f32::INFINITY, test);
            assert_eq!(found, brute, "{}, {}", strategy.name(), test.name());
            let found = wide.closest_hit(&ray, f32::INFINITY, test);
            assert_eq!(found, brute, "{}, {}, eight wide", strategy.name(), test.name());
        }
    }
}

fn move_vertex(p: &mut Vec3, i: usize, what: u8, amount: f32) {
    let selected = i / 3 % 7 == usize::from(what >> 4);
    match what & 15 {
        0 => *p += (noise(5, i / 3) - 0.5) * amount,
        1 => *p = p.yzx(),
        2 => *p *= 0.0,
        3 => *p *= amount,
        4 if selected => *p = Vec3::NAN,
        5 if selected => p.x = f32::INFINITY,
        6 if selected => p.y = -f32::MAX,
        7 => *p += Vec3::splat((amount - 128.0).exp2()),
        8 => p.z = amount,
        9 => *p = noise(6, i / 3) * 10.0 + noise(7, i),
        10 if selected => *p = Vec3::splat(-0.0),
        11 => *p /= amount,
        12 => *p = noise(8, i / 3 / 8) * amount + noise(7, i),
        _ => {}
    }
}

/// Loads bytes as a file of that name, and poses what comes of it. Whether they are such a file.
///
/// # Panics
/// If a loader does, or if it gives an animation that does not keep what animations promise.
pub fn load_bytes(name: &str, bytes: &[u8]) -> bool {
    let path = Path::new(name);
    let options = anim::LoadOptions::default();
    let loaded = match path.extension().and_then(|e| e.to_str()) {
        Some("aff") => {
            let thread = std::thread::current().id();
            let place = std::env::temp_dir().join(format!("pivot-{}-{thread:?}.aff", std::process::id()));
            std::fs::write(&place, bytes).expect("a temporary file");
            let loaded = anim::load(&place, &options);
            std::fs::remove_file(&place).expect("the temporary file");
            loaded
        }
        _ => anim::parse(path, bytes, &options),
    };
    let Ok(animation) = loaded else { return false };
    let topology = animation.topology();
    let count = topology.vertex_count as u32;
    assert!(topology.triangles.iter().flatten().all(|&v| v < count), "a vertex out of range");
    assert_eq!(topology.moves.len(), topology.triangles.len());
    let duration = animation.duration();
    assert!(duration.is_finite() && duration >= 0.0, "duration {duration}");
    let mut positions = animation.rest();
    let mut at = |time: f64| {
        animation.pose(time, &mut positions);
        let _ = (animation.view(time), animation.light(time));
        positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    let [start, end] = [0.0, duration].map(&mut at);
    for before in [-0.0, -1.0, -f64::MAX, f64::NEG_INFINITY, f64::NAN] {
        at(duration / 3.0);
        assert!(at(before) == start, "at {before}");
    }
    for after in [duration * 2.0, duration.next_up(), f64::MAX, f64::INFINITY] {
        assert!(at(after) == end, "at {after}");
    }
    at(f64::MIN_POSITIVE.min(duration));
    true
}
