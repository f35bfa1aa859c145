//! Hard rays.

use bvh_build::{Builder, build};
use bvh_core::glam::Vec3Swizzles;
use bvh_core::{Bvh, Ray, Triangles, Vec3};
use rt_cpu::{Bvh8, TriangleTest, any_hit, closest_hit, closest_hit_brute};

/// A checked floor of 2 x 20 x 20 triangles at z = 0.
fn floor() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..21 * 21).map(|i| Vec3::new((i % 21) as f32, (i / 21) as f32, 0.0)).collect();
    let triangles = (0..20 * 20).flat_map(|i| {
        let a = i / 20 * 21 + i % 20;
        [[a, a + 1, a + 22], [a, a + 22, a + 21]]
    });
    (positions, triangles.collect())
}

fn with_floor(check: impl Fn(&Bvh, &Triangles<'_>, TriangleTest)) {
    let (positions, indices) = floor();
    let triangles = Triangles { positions: &positions, indices: &indices };
    for builder in Builder::ALL {
        let bvh = build(&triangles, builder).expect("few enough");
        TriangleTest::ALL.into_iter().for_each(|test| check(&bvh, &triangles, test));
    }
}

/// Asserts that tree and brute force agree, and gives the distance.
fn cast(bvh: &Bvh, triangles: &Triangles<'_>, ray: &Ray, t_max: f32, test: TriangleTest) -> Option<f32> {
    let found = closest_hit(bvh, triangles, ray, t_max, test);
    assert_eq!(
        found,
        closest_hit_brute(triangles, ray, t_max, test),
        "{ray:?} up to {t_max}, {}",
        test.name()
    );
    assert_eq!(any_hit(bvh, triangles, ray, t_max, test), found.is_some());
    let mut wide = Bvh8::default();
    wide.update(bvh, triangles);
    assert_eq!(wide.closest_hit(ray, t_max, test), found, "{ray:?} up to {t_max}, {}", test.name());
    assert_eq!(wide.any_hit(ray, t_max, test), found.is_some());
    found.map(|hit| hit.t)
}

#[test]
fn along_axes_with_zeros_of_either_sign() {
    with_floor(|bvh, triangles, test| {
        for zeros in [[0.0, 0.0], [-0.0, 0.0], [0.0, -0.0], [-0.0, -0.0]] {
            let down = Ray::new(Vec3::new(3.3, 4.7, 2.0), Vec3::new(zeros[0], zeros[1], -1.0));
            assert_eq!(cast(bvh, triangles, &down, f32::INFINITY, test), Some(2.0));
            let up = Ray::new(Vec3::new(3.3, 4.7, 2.0), Vec3::new(zeros[0], zeros[1], 1.0));
            assert_eq!(cast(bvh, triangles, &up, f32::INFINITY, test), None);
        }
    });
}

#[test]
fn through_shared_edges_and_vertices() {
    with_floor(|bvh, triangles, test| {
        if test == TriangleTest::MollerTrumbore {
            return; // May slip through; `watertight.rs` measures how often.
        }
        for i in 1..20 {
            for place in [
                Vec3::new(i as f32, i as f32, 1.0),
                Vec3::new(i as f32, 7.5, 1.0),
                Vec3::new(7.25, 7.25, 1.0),
            ] {
                let straight = Ray::new(place, -Vec3::Z);
                assert_eq!(cast(bvh, triangles, &straight, f32::INFINITY, test), Some(1.0), "{place}");
            }
        }
    });
}

#[test]
fn grazing_and_within_the_plane() {
    with_floor(|bvh, triangles, test| {
        for height in [1e-30, 1e-6, 1e-3] {
            let ray = Ray::new(Vec3::new(-5.0, 10.3, height), Vec3::new(25.0, 0.01, -height * 1.5));
            cast(bvh, triangles, &ray, f32::INFINITY, test);
        }
        let within = Ray::new(Vec3::new(-5.0, 10.3, 0.0), Vec3::X);
        assert_eq!(cast(bvh, triangles, &within, f32::INFINITY, test), None, "a triangle has no thickness");
    });
}

#[test]
fn starting_on_a_surface() {
    with_floor(|bvh, triangles, test| {
        let ray = Ray::new(Vec3::new(3.3, 4.7, 0.0), Vec3::new(0.1, 0.2, -1.0));
        assert_eq!(cast(bvh, triangles, &ray, f32::INFINITY, test), Some(0.0));
    });
}

#[test]
fn t_max_of_zero_infinity_and_not_a_number() {
    with_floor(|bvh, triangles, test| {
        let ray = Ray::new(Vec3::new(3.3, 4.7, 2.0), -Vec3::Z);
        assert_eq!(cast(bvh, triangles, &ray, 0.0, test), None);
        assert_eq!(cast(bvh, triangles, &ray, 2.0, test), Some(2.0));
        assert_eq!(cast(bvh, triangles, &ray, f32::INFINITY, test), Some(2.0));
        assert_eq!(cast(bvh, triangles, &ray, -1.0, test), None);
        assert_eq!(cast(bvh, triangles, &ray, f32::NAN, test), None);
    });
}

#[test]
fn rays_that_are_not_finite_hit_nothing() {
    with_floor(|bvh, triangles, test| {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let (mut from, mut along) = (Vec3::new(3.3, 4.7, 2.0), -Vec3::Z);
                from[axis] = bad;
                assert_eq!(cast(bvh, triangles, &Ray::new(from, -Vec3::Z), f32::INFINITY, test), None);
                along[axis] = bad;
                assert_eq!(
                    cast(bvh, triangles, &Ray::new(Vec3::new(3.3, 4.7, 2.0), along), f32::INFINITY, test),
                    None
                );
            }
        }
        assert_eq!(cast(bvh, triangles, &Ray::new(Vec3::ONE, Vec3::ZERO), f32::INFINITY, test), None);
    });
}

#[test]
fn directions_of_extreme_length() {
    with_floor(|bvh, triangles, test| {
        for length in [1e-30, 1e-10, 1e10, 1e30] {
            let ray = Ray::new(Vec3::new(3.3, 4.7, 2.0), Vec3::new(0.0, 0.0, -length));
            let t = cast(bvh, triangles, &ray, f32::INFINITY, test);
            assert!(t.is_some_and(|t| (t * length - 2.0).abs() < 1e-5), "{t:?} at {length}, {}", test.name());
        }
    });
}

/// Corners farther away, in lengths of the direction, than `f32` can tell, around a hit that is
/// not.
#[test]
fn corners_beyond_the_range_of_distances() {
    for (z, origin, length) in [(1e9, -1e8, 1e-30), (9.0, -1.0, 2e-38)] {
        let positions = [Vec3::new(-1.0, -1.0, -z), Vec3::new(1.0, -1.0, -z), Vec3::new(0.0, 1.0, z)];
        let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2]] };
        let bvh = build(&triangles, Builder::Sweep).expect("few enough");
        let ray = Ray::new(Vec3::new(0.0, 0.0, origin), Vec3::new(0.0, 0.0, length));
        for test in [TriangleTest::Watertight, TriangleTest::Double] {
            let t = cast(&bvh, &triangles, &ray, f32::INFINITY, test).expect("a hit");
            assert!((t * length + origin).abs() < 1e-6 * -origin, "{t} by {}", test.name());
        }
    }
}

/// Directions so short that one over them is infinite, and origins so near zero that products
/// vanish: nothing is promised of what is hit, but that the tree hits what brute force hits, at a
/// finite distance.
#[test]
fn subnormal_directions_and_origins() {
    with_floor(|bvh, triangles, test| {
        for tiny in [f32::MIN_POSITIVE, 1e-39, 1e-42, f32::from_bits(1)] {
            for along in [Vec3::NEG_Z, Vec3::new(1.0, 0.5, -1.0), Vec3::new(1.0, 0.0, 0.0), Vec3::ONE] {
                for from in [Vec3::new(3.3, 4.7, 2.0), Vec3::splat(tiny), Vec3::new(3.3, 4.7, tiny)] {
                    let t = cast(bvh, triangles, &Ray::new(from, along * tiny), f32::INFINITY, test);
                    assert!(t.is_none_or(f32::is_finite), "{t:?} from {from} along {along} * {tiny}");
                    cast(bvh, triangles, &Ray::new(from, along + along.zxy() * tiny), f32::INFINITY, test);
                }
            }
        }
    });
}

/// A floor of subnormal size: as ever, the tree hits what brute force hits.
#[test]
fn rays_at_a_floor_of_subnormal_size() {
    let (positions, indices) = floor();
    for scale in [1e-39, 1e-42, f32::from_bits(1)] {
        let positions: Vec<Vec3> = positions.iter().map(|&p| p * scale).collect();
        let triangles = Triangles { positions: &positions, indices: &indices };
        for builder in Builder::ALL {
            let bvh = build(&triangles, builder).expect("few enough");
            for test in TriangleTest::ALL {
                for length in [1.0, scale] {
                    for (x, y) in [(3.3, 4.7), (7.0, 7.0), (0.0, 0.0)] {
                        let from = Vec3::new(x, y, 2.0) * scale;
                        cast(&bvh, &triangles, &Ray::new(from, Vec3::NEG_Z * length), f32::INFINITY, test);
                    }
                }
            }
        }
    }
}
