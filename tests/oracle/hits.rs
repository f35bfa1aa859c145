//! Hits in single precision against those of the oracle.

use bvh_core::{Bvh, Ray, Triangles, Vec3};
use rt_cpu::TriangleTest;

use crate::{closest_hit, margin};

/// Casts a ray through a tree and compares the hit with those of brute force and of the oracle.
/// Whether the tree and the oracle both have one.
///
/// # Panics
/// If a hit differs by more than rounding near an edge explains.
pub fn check_hit(bvh: &Bvh, triangles: &Triangles<'_>, from: Vec3, along: Vec3) -> bool {
    let (ray, test) = (Ray::new(from, along), TriangleTest::Watertight);
    let found = rt_cpu::closest_hit(bvh, triangles, &ray, f32::INFINITY, test);
    let brute = rt_cpu::closest_hit_brute(triangles, &ray, f32::INFINITY, test);
    assert_eq!(found, brute, "from {from} along {along}: the tree does not find what brute force finds");
    let expected = closest_hit(triangles.positions, triangles.indices, from, along);
    // Single precision may decide otherwise within rounding of an edge; nothing else may differ.
    let inside = found.map(|hit| hit.u.min(hit.v).min(1.0 - hit.u - hit.v));
    match (expected, found) {
        (Some((t, _)), Some(hit)) if (f64::from(hit.t) - t).abs() <= 1e-5 * t.max(1.0) => {}
        (Some((_, lost)), None) => {
            let margin = margin(triangles.positions, triangles.indices[lost], from, along);
            assert!(
                margin < 1e-3,
                "from {from} along {along}: a miss, {margin} inside of what the oracle hits"
            );
        }
        (expected, _) => assert!(
            inside.is_none_or(|margin| margin < 1e-3),
            "from {from} along {along}: {found:?}, but the oracle has {expected:?}"
        ),
    }
    expected.is_some() && found.is_some()
}
