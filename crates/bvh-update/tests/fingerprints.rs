//! Trees after a few frames of every strategy that does not depend on time, as recorded
//! fingerprints: a change of the pass that changes a bit of any tree fails here.
//!
//! After a change that is meant to change trees, print new ones: `PRINT=1 cargo test -p bvh-update
//! --test fingerprints -- --nocapture`.

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Bvh, Primitives, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
// Those of the systems differ in the last bits.
use libm::{cosf, sinf};

const SIDE: usize = 90;

/// How a sheet of triangles moves.
#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Waves run through it.
    Waves,
    /// It tears into pieces that fly apart.
    Pieces,
    /// Waves, but only in a quarter of it.
    Corner,
    /// Waves, with a few vertices that are not finite now and then.
    Holes,
    /// Every vertex is elsewhere in each frame.
    Chaos,
}

fn positions(motion: Motion, frame: usize) -> Vec<Vec3> {
    let t = frame as f32;
    (0..SIDE * SIDE)
        .map(|i| {
            let (x, y) = ((i % SIDE) as f32, (i / SIDE) as f32);
            let wave = Vec3::new(x, y, 6.0 * sinf(0.21 * x + 0.4 * t) * cosf(0.17 * y - 0.3 * t));
            match motion {
                Motion::Waves => wave,
                Motion::Pieces => {
                    let piece = (i % SIDE / 7 + 13 * (i / SIDE / 5)) as f32;
                    wave + Vec3::new(sinf(piece * 1.7), cosf(piece * 2.3), sinf(piece * 3.1)) * 4.0 * t
                }
                Motion::Corner if x > 45.0 || y > 45.0 => Vec3::new(x, y, 0.0),
                Motion::Corner => wave,
                Motion::Holes if (i + 31 * frame).is_multiple_of(911) => Vec3::new(x, f32::NAN, t),
                Motion::Holes => wave,
                Motion::Chaos => {
                    let at = |k: usize| (i * k * (frame + 1) % 8191) as f32;
                    Vec3::new(at(31), at(57), at(73))
                }
            }
        })
        .collect()
}

fn indices() -> Vec<[u32; 3]> {
    let corners = (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE < SIDE - 1).map(|i| i as u32);
    let side = SIDE as u32;
    corners.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]).collect()
}

/// A fingerprint of the trees of all frames, and how many of them were rebuilt as a whole.
fn play(motion: Motion, strategy: &Strategy, leaf: u32, level: SimdLevel, threads: usize) -> (u64, u32) {
    let indices = indices();
    let options = BuildOptions::default().with_max_leaf_size(leaf);
    let start = positions(motion, 0);
    let triangles = Triangles { positions: &start, indices: &indices };
    let mut bvh: Bvh = build_with(&triangles, Builder::BinnedParallel, &options).expect("few enough");
    if matches!(motion, Motion::Corner) {
        let moves = |p: usize| indices[p].iter().any(|&v| v as usize % SIDE < 46 && v as usize / SIDE < 46);
        bvh.set_dynamic(moves);
    }
    let mut updater = Updater::with_level(Strategy::default(), level);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    (1..8).fold((0, 0), |(sum, rebuilt): (u64, u32), frame| {
        let now = positions(motion, frame);
        let triangles = Triangles { positions: &now, indices: &indices };
        assert_eq!(triangles.len(), bvh.len());
        let update = || updater.set_strategy(*strategy).update(&mut bvh, &triangles);
        let update = pool.install(update).expect("same count");
        (sum.rotate_left(9) ^ bvh.fingerprint(), rebuilt + u32::from(update.rebuilt))
    })
}

const RECORDED: &str = include_str!("fingerprints.txt");

#[test]
fn trees_have_their_recorded_bits() {
    let mut lines = String::new();
    for motion in [Motion::Waves, Motion::Pieces, Motion::Corner, Motion::Holes, Motion::Chaos] {
        for leaf in [1, 4] {
            for mut strategy in Strategy::all() {
                if matches!(strategy, Strategy::Background(_)) {
                    continue;
                }
                let is_chaos = matches!(motion, Motion::Chaos);
                if let Strategy::Degraded(degraded) = &mut strategy
                    && is_chaos
                {
                    // Rotations keep the ratio of areas below the default.
                    degraded.threshold = 0.05;
                }
                let (print, rebuilt) = play(motion, &strategy, leaf, SimdLevel::best(), 1);
                let rebuilds = match strategy {
                    Strategy::Rebuild(..) => true,
                    Strategy::Degraded(_) | Strategy::PartialRebuild(_) | Strategy::Auto(_) => is_chaos,
                    _ => false,
                };
                assert!(rebuilt > 0 || !rebuilds, "{motion:?} {strategy}: no rebuild");
                for (level, threads) in SimdLevel::available().map(|level| (level, 3)) {
                    let (same, _) = play(motion, &strategy, leaf, level, threads);
                    assert_eq!(same, print, "{motion:?} {leaf} {strategy} {level}, {threads} threads");
                }
                // What it decides may change; that it is the same on all levels and threads may
                // not.
                if !matches!(strategy, Strategy::Auto(_)) {
                    lines += &format!("{motion:?} {leaf} {strategy} {print:016x}\n");
                }
            }
        }
    }
    if std::env::var_os("PRINT").is_some() {
        print!("{lines}");
    }
    for (now, recorded) in lines.lines().zip(RECORDED.lines()) {
        assert_eq!(now, recorded);
    }
    assert_eq!(lines.lines().count(), RECORDED.lines().count());
}
