//! What must hold of a case, whatever it is.

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Bvh, Primitives, Ray, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Update, Updater};
use pivot_tests::{noise, pool, sah_cost};
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

    pub(crate) fn at(&self, frame: usize) -> Triangles<'_> {
        Triangles { positions: &self.frames[frame], indices: &self.triangles }
    }
}

/// Whether all three corners are finite.
fn has_box(positions: &[Vec3], triangle: &[u32; 3]) -> bool {
    triangle.iter().all(|&v| positions[v as usize].is_finite())
}

/// Checks everything that must hold of the case, and that rays and pixels hit something.
pub(crate) fn hold(case: &Case) {
    let hits = check(case);
    assert!(hits.into_iter().all(|hits| hits > 0), "hits of rays and pixels: {hits:?}");
}

/// As [`hold`], where there may be nothing to hit.
pub(crate) fn hold_hit_or_not(case: &Case) {
    check(case);
}

/// Checks everything that must hold of the case; gives the number of hits of rays and of pixels.
fn check(case: &Case) -> [usize; 2] {
    let mut hits = [0; 2];
    for (turn, (threads, max_leaf_size)) in [(1, 1), (3, 1), (2, 4)].into_iter().enumerate() {
        let found = pool(threads).install(|| check_here(case, max_leaf_size, turn));
        hits = [hits[0] + found[0], hits[1] + found[1]];
    }
    hits
}

fn check_here(case: &Case, max_leaf_size: u32, turn: usize) -> [usize; 2] {
    let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
    let mut hits = [0; 2];
    for (number, strategy) in Strategy::all().into_iter().enumerate() {
        let builder = if let Strategy::Rebuild(builder, _) = strategy { builder } else { Builder::Sweep };
        let built = build_with(&case.at(0), builder, &options).expect("few enough");
        built.validate(&case.at(0)).unwrap_or_else(|e| panic!("built by {}: {e}", builder.name()));
        // Each level plays the whole case; the trees must be the same.
        let mut hashes = Vec::new();
        for level in SimdLevel::available() {
            let (mut bvh, mut updater) = (built.clone(), Updater::with_level(Strategy::default(), level));
            for frame in 1..case.frames.len() {
                let done =
                    updater.set_strategy(strategy).update(&mut bvh, &case.at(frame)).expect("same count");
                check_tree(&bvh, case, frame, &strategy, &done);
            }
            hashes.push(bvh.fingerprint());
            if level == SimdLevel::best() {
                let triangles = case.at(case.frames.len() - 1);
                hits[0] += check_rays(&bvh, &triangles, strategy.name());
                // Each strategy comes to all three tests, in turn.
                let test = TriangleTest::ALL[(number + turn) % TriangleTest::ALL.len()];
                hits[1] += check_image(&bvh, &triangles, strategy.name(), test, number + turn);
            }
        }
        // What comes from the background depends on time.
        let same = hashes.iter().all(|&hash| hash == hashes[0]);
        assert!(same || matches!(strategy, Strategy::Background(_)), "{strategy:?} at other SIMD levels");
    }
    hits
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

/// The middle and the extent of what is in a tree. The extent along an axis is at least a tenth of
/// the greatest, so that rays begin outside the plane of a flat scene.
fn bounds(bvh: &Bvh) -> (Vec3, Vec3) {
    let bounds = bvh.root().aabb();
    if bounds.is_empty() {
        return (Vec3::ZERO, Vec3::ONE);
    }
    let extent = bounds.extent();
    let least = match extent.max_element() {
        0.0 => f32::MIN_POSITIVE,
        greatest => 0.1 * greatest,
    };
    (bounds.center(), extent.max(Vec3::splat(least)))
}

/// The middle and the size of one of the triangles; of the scene if that triangle is not finite.
fn target(bvh: &Bvh, triangles: &Triangles<'_>, i: usize) -> (Vec3, Vec3) {
    let (center, extent) = bounds(bvh);
    let one = (i * 97).checked_rem(triangles.len()).map(|i| (triangles.corners(i), triangles.aabb(i)));
    match one {
        Some(([a, b, c], aabb)) if !aabb.is_empty() => {
            (a / 3.0 + b / 3.0 + c / 3.0, Vec3::splat(aabb.extent().max_element()))
        }
        _ => (center, extent),
    }
}

/// Rays from around the scene and from within, half of them aimed at triangles, some along axes and
/// with zero components, by every triangle test; gives the number of hits.
fn check_rays(bvh: &Bvh, triangles: &Triangles<'_>, name: &str) -> usize {
    let mut hits = 0;
    let (center, extent) = bounds(bvh);
    let mut wide = Bvh8::default();
    wide.update(bvh, triangles);
    for i in 0..24 {
        let from = center + (noise(5, i) - 0.5) * extent * [3.0, 0.9][i % 2];
        let to = if i < 12 { center + (noise(6, i) - 0.5) * extent } else { target(bvh, triangles, i).0 };
        let mut along = to - from;
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
                assert_eq!(any, brute.is_some(), "{name}: any, ray {i}");
                assert_eq!(wide.closest_hit(&ray, t_max, test), brute, "{name}: wide, ray {i} from {from}");
                assert_eq!(wide.any_hit(&ray, t_max, test), any, "{name}: wide, any, ray {i}");
                if let Some(hit) = found {
                    hits += 1;
                    assert!(
                        hit.t >= 0.0
                            && hit.t <= t_max
                            && has_box(triangles.positions, &triangles.indices[hit.primitive as usize])
                    );
                }
            }
        }
    }
    hits
}

/// An image by every traversal at every SIMD level, of the whole scene in even turns and of one
/// triangle in odd ones; gives the number of pixels that show something.
fn check_image(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    name: &str,
    triangle_test: TriangleTest,
    turn: usize,
) -> usize {
    let (center, extent) = bounds(bvh);
    let (middle, size) = if turn.is_multiple_of(2) { (center, extent) } else { target(bvh, triangles, turn) };
    let eye = middle + size * Vec3::new(0.3, 0.9, 1.7);
    let camera = Camera::look_at(eye, middle, Vec3::Y, 0.8, 24, 24);
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
    single.iter().filter(|pixel| pixel.hit().is_some()).count()
}
