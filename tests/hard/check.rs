//! What must hold of a case, whatever it is.

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Bvh, Ray, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Update, Updater};
use pivot_tests::{noise, sah_cost};
use rt_cpu::{Bvh8, Camera, Pixel, PointLight, RenderOptions, Traversal, TriangleTest};

/// A mesh in motion.
pub(crate) struct Case {
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Positions in each frame; the tree is built over the first.
    pub(crate) frames: Vec<Vec<Vec3>>,
}

impl Case {
    /// A mesh that stands still, which strategies update all the same.
    pub(crate) fn still(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self { triangles, frames: vec![positions; 3] }
    }

    /// Triangles that share no vertices, three positions each, in every frame.
    pub(crate) fn soup(frames: Vec<Vec<Vec3>>) -> Self {
        let n = frames[0].len() as u32 / 3;
        Self { triangles: (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), frames }
    }

    fn at(&self, frame: usize) -> Triangles<'_> {
        Triangles { positions: &self.frames[frame], indices: &self.triangles }
    }
}

pub(crate) fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// Whether all three corners are finite.
fn has_box(positions: &[Vec3], triangle: &[u32; 3]) -> bool {
    triangle.iter().all(|&v| positions[v as usize].is_finite())
}

/// Checks everything that must hold of the case; gives the report of the last update of each
/// strategy.
pub(crate) fn hold(case: &Case) -> Vec<(Strategy, Update)> {
    let mut reported = Vec::new();
    for (turn, (threads, max_leaf_size)) in [(1, 1), (3, 1), (2, 4)].into_iter().enumerate() {
        reported = pool(threads).install(|| hold_here(case, max_leaf_size, turn));
    }
    reported
}

fn hold_here(case: &Case, max_leaf_size: u32, turn: usize) -> Vec<(Strategy, Update)> {
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    let mut reported = Vec::new();
    for (number, strategy) in Strategy::all().into_iter().enumerate() {
        let builder = if let Strategy::Rebuild(builder, _) = strategy { builder } else { Builder::Sweep };
        let built = build_with(&case.at(0), builder, &options).expect("few enough");
        built.validate(&case.at(0)).unwrap_or_else(|e| panic!("built by {}: {e}", builder.name()));
        // Each level plays the whole case; the trees must be the same.
        let mut hashes = Vec::new();
        for level in SimdLevel::available() {
            let (mut bvh, mut updater) = (built.clone(), Updater::with_level(Strategy::default(), level));
            let mut last = Update::default();
            for frame in 1..case.frames.len() {
                last = updater.set_strategy(strategy).update(&mut bvh, &case.at(frame)).expect("same count");
                check_tree(&bvh, case, frame, &strategy, &last);
            }
            hashes.push(bvh.fingerprint());
            if level == SimdLevel::best() {
                let triangles = case.at(case.frames.len() - 1);
                check_rays(&bvh, &triangles, strategy.name());
                // Each strategy comes to all three tests, in turn.
                let test = TriangleTest::ALL[(number + turn) % TriangleTest::ALL.len()];
                check_image(&bvh, &triangles, strategy.name(), test);
                reported.push((strategy, last));
            }
        }
        // What comes from the background depends on time.
        let same = hashes.iter().all(|&hash| hash == hashes[0]);
        assert!(same || matches!(strategy, Strategy::Background(_)), "{strategy:?} at other SIMD levels");
    }
    reported
}

fn check_tree(bvh: &Bvh, case: &Case, frame: usize, strategy: &Strategy, reported: &Update) {
    let name = strategy.name();
    bvh.validate(&case.at(frame)).unwrap_or_else(|e| panic!("{name}, frame {frame}: {e}"));
    let positions = &case.frames[frame];
    let real = sah_cost(bvh, positions, &case.triangles);
    let cost = reported.sah_cost.unwrap_or_else(|| bvh_core::sah_cost(bvh));
    // Sums of areas from `f32` coordinates; where extents are denormal, so are areas, and nothing
    // is promised.
    let extent = bvh.root().aabb().extent().max_element();
    if extent == 0.0 || extent > 1e-15 {
        assert!((cost - real).abs() <= 1e-4 * real, "{name}, frame {frame}: reported {cost}, is {real}");
    }
    assert!(cost.is_finite() && cost >= 0.0, "{name}, frame {frame}: cost {cost}");
    let dropped = case.triangles.iter().filter(|t| !has_box(positions, t)).count();
    assert_eq!(reported.dropped, dropped as u64, "{name}, frame {frame}: dropped");
}

/// The middle and the extent of what is in a tree; the extent is nowhere zero.
fn bounds(bvh: &Bvh) -> (Vec3, Vec3) {
    let bounds = bvh.root().aabb();
    if bounds.is_empty() {
        (Vec3::ZERO, Vec3::ONE)
    } else {
        (bounds.center(), bounds.extent().max(Vec3::splat(f32::MIN_POSITIVE)))
    }
}

/// Rays from around the scene and from within, some along axes and with zero components, by every
/// triangle test.
fn check_rays(bvh: &Bvh, triangles: &Triangles<'_>, name: &str) {
    let (center, extent) = bounds(bvh);
    let mut wide = Bvh8::new();
    wide.update(bvh, triangles);
    for i in 0..24 {
        let from = center + (noise(5, i) - 0.5) * extent * [3.0, 0.9][i % 2];
        let mut along = center + (noise(6, i) - 0.5) * extent - from;
        match i % 6 {
            0 => along.x = 0.0,
            1 => along = Vec3::new(-0.0, along.y, -0.0),
            2 => along = along.normalize_or_zero(),
            _ => {}
        }
        let ray = Ray::new(from, along);
        for test in TriangleTest::ALL {
            for t_max in [f32::INFINITY, 0.75, 0.0] {
                let found = rt_cpu::closest_hit(bvh, triangles, &ray, t_max, test);
                let brute = rt_cpu::closest_hit_brute(triangles, &ray, t_max, test);
                assert_eq!(found, brute, "{name}, {}: ray {i} from {from} along {along}", test.name());
                let any = rt_cpu::any_hit(bvh, triangles, &ray, t_max, test);
                assert_eq!(any, rt_cpu::any_hit_brute(triangles, &ray, t_max, test), "{name}: any, ray {i}");
                assert_eq!(wide.closest_hit(&ray, t_max, test), brute, "{name}: wide, ray {i} from {from}");
                assert_eq!(wide.any_hit(&ray, t_max, test), any, "{name}: wide, any, ray {i}");
                if let Some(hit) = found {
                    assert!(
                        hit.t >= 0.0
                            && hit.t <= t_max
                            && has_box(triangles.positions, &triangles.indices[hit.primitive as usize])
                    );
                }
            }
        }
    }
}

/// An image by every traversal at every SIMD level.
fn check_image(bvh: &Bvh, triangles: &Triangles<'_>, name: &str, triangle_test: TriangleTest) {
    let (center, extent) = bounds(bvh);
    let eye = center + extent * Vec3::new(0.3, 0.9, 1.7);
    let camera = Camera::look_at(eye, center, Vec3::Y, 0.8, 24, 24);
    let light = PointLight { position: center + extent * Vec3::new(1.0, 2.0, 0.5), color: [1.0; 3] };
    let image = |traversal, simd| {
        let options = RenderOptions { traversal, simd, triangle_test, ..RenderOptions::default() };
        let mut pixels = vec![Pixel::default(); 24 * 24];
        rt_cpu::cast(bvh, triangles, &camera, Some(&light), &options, &mut pixels);
        pixels
    };
    let single = image(Traversal::Single, SimdLevel::Baseline);
    for traversal in Traversal::ALL {
        for level in SimdLevel::available() {
            assert!(image(traversal, level) == single, "{name}: {} at {level:?}", traversal.name());
        }
    }
}
