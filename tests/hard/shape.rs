//! Hard meshes, standing still.

use bvh_build::{BuildOptions, BuildScratch, Builder, build, rebuild};
use bvh_core::{Bvh, Ray, Triangles, Vec3};
use bvh_update::{Strategy, Updater};
use pivot_tests::{Motion, Soup, noise, pool};
use rt_cpu::{Bvh8, TriangleTest, closest_hit};

use crate::check::{Case, hold, hold_hit_or_not};

/// `n` small triangles around places; the corners of one are `size` apart or less.
fn around(places: impl Iterator<Item = Vec3>, size: f32) -> Vec<Vec3> {
    places.enumerate().flat_map(|(i, p)| [0, 1, 2].map(|c| p + (noise(77, 3 * i + c) - 0.5) * size)).collect()
}

fn soup(positions: Vec<Vec3>) -> Case {
    Case::soup(vec![positions; 3])
}

#[test]
fn no_primitive() {
    hold_hit_or_not(&Case::still(vec![], vec![]));
}

#[test]
fn one_primitive() {
    hold(&Case::still(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]));
}

#[test]
fn two_primitives() {
    hold(&Case::still(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z], vec![[0, 1, 2], [3, 2, 1]]));
}

#[test]
fn all_primitives_identical() {
    hold(&Case::still(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; 700]));
}

/// More than 16 bits can count, in one place, by each builder and each strategy.
#[test]
fn a_hundred_thousand_identical_primitives() {
    const N: usize = 100_000;
    let (positions, moved) = ([Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::Z, Vec3::ONE, Vec3::new(0.0, 2.0, 1.0)]);
    let indices = vec![[0, 1, 2]; N];
    let [start, end] = [&positions, &moved].map(|positions| Triangles { positions, indices: &indices });
    let (mut updater, mut wide) = (Updater::default(), Bvh8::default());
    let down = Ray::new(Vec3::new(0.2, 1.0, 3.0), Vec3::NEG_Z);
    for strategy in Strategy::all() {
        let builder = if let Strategy::Rebuild(builder, _) = strategy { builder } else { Builder::Binned };
        let mut bvh = build(&start, builder).expect("few enough");
        updater.set_strategy(strategy).update(&mut bvh, &end).expect("same count");
        bvh.validate(&end).unwrap_or_else(|e| panic!("{}: {e}", strategy.name()));
        let mut held = 0;
        bvh.visit(|_, node, _| held += if node.is_leaf() { node.count() } else { 0 });
        assert_eq!(held, N, "{}", strategy.name());
        assert!(bvh.height() <= 2 * N.ilog2(), "{}: {} high", strategy.name(), bvh.height());
        wide.update(&bvh, &end);
        let found = closest_hit(&bvh, &end, &down, f32::INFINITY, TriangleTest::Watertight);
        assert!(found.is_some_and(|hit| hit.primitive == 0 && hit.t == 2.0), "{}", strategy.name());
        assert_eq!(wide.closest_hit(&down, f32::INFINITY, TriangleTest::Watertight), found);
    }
}

/// One tree, one updater and one view, for scenes of other sizes one after the other.
#[test]
fn none_then_some_then_none_in_the_same_memory() {
    let (mut bvh, mut build_memory) = (Bvh::default(), BuildScratch::default());
    let (mut updater, mut wide) = (Updater::default(), Bvh8::default());
    let down = Ray::new(Vec3::new(4.0, 6.0, 20.0), Vec3::new(0.01, 0.02, -1.0));
    for strategy in Strategy::all() {
        let mut hits = 0;
        for (turn, n) in [0, 3000, 0, 1, 700, 2, 0].into_iter().enumerate() {
            let builder = Builder::PER_FRAME[turn % Builder::PER_FRAME.len()];
            let soup = Soup::new(n, 5);
            let [start, end] = [turn, turn + 1].map(|frame| soup.pose(Motion::PartlyNonFinite, frame));
            let [start, end] =
                [&start, &end].map(|positions| Triangles { positions, indices: &soup.triangles });
            rebuild(&mut bvh, &start, builder, &BuildOptions::default(), &mut build_memory)
                .expect("few enough");
            bvh.validate(&start).unwrap_or_else(|e| panic!("{} of {n}: {e}", builder.name()));
            updater.set_strategy(strategy).update(&mut bvh, &end).expect("same count");
            bvh.validate(&end).unwrap_or_else(|e| panic!("{} of {n}: {e}", strategy.name()));
            wide.update(&bvh, &end);
            for test in TriangleTest::ALL {
                let brute = rt_cpu::closest_hit_brute(&end, &down, f32::INFINITY, test);
                assert_eq!(closest_hit(&bvh, &end, &down, f32::INFINITY, test), brute, "{n}");
                assert_eq!(wide.closest_hit(&down, f32::INFINITY, test), brute, "{n}");
                hits += usize::from(brute.is_some());
            }
        }
        assert!(hits > 0, "a test of hits needs some");
    }
}

#[test]
fn all_centroids_equal() {
    let nested = (1..300).flat_map(|i| {
        let r = i as f32;
        [Vec3::new(-r, -r, -r), Vec3::new(r, r, 0.0), Vec3::new(0.0, 0.0, r)]
    });
    hold(&soup(nested.collect()));
}

#[test]
fn triangles_without_area() {
    let degenerate = (0..300).flat_map(|i| {
        let (a, b) = (noise(1, i), noise(2, i));
        match i % 3 {
            0 => [a, a, a],
            1 => [a, b, b],
            _ => [a, (a + b) * 0.5, b],
        }
    });
    hold_hit_or_not(&soup(degenerate.collect()));
}

#[test]
fn needles_of_aspect_1e7() {
    let needles = (0..300).flat_map(|i| {
        let (a, along) = (noise(1, i) * 10.0, (noise(2, i) - 0.5) * 10.0);
        [a, a + along, a + along * 0.5 + (noise(3, i) - 0.5) * 1e-6]
    });
    hold_hit_or_not(&soup(needles.collect()));
}

#[test]
fn far_from_the_origin() {
    // At 1e12 no detail is left.
    for (offset, check) in [(1e6, hold as fn(&Case)), (1e12, hold_hit_or_not)] {
        let places = (0..300).map(|i| noise(1, i) * 10.0 + Vec3::new(offset, -offset, offset * 0.5));
        check(&soup(around(places, 1.0)));
    }
}

/// Far out numbers are far apart: the same detail as near the origin is lost there, or is some of
/// the last bits.
#[test]
fn coordinates_of_1e30_and_1e38() {
    for offset in [1e30, 1e38] {
        for detail in [offset * 1e-6, offset] {
            let places = (0..100).map(|i| noise(1, i) * detail + Vec3::new(offset, -offset, offset * 0.5));
            hold_hit_or_not(&soup(around(places, detail * 0.1)));
        }
    }
}

#[test]
fn extents_of_1e18_and_more() {
    // At 1e25 areas, at 3e38 the extents themselves are beyond `f32`.
    for scale in [1e18, 1e25, 3e38] {
        let places = (0..200).map(|i| (noise(1, i) - 0.5) * scale);
        hold(&soup(around(places, scale * 0.05)));
    }
}

#[test]
fn extents_that_are_denormal() {
    // The last are whole multiples of the least number there is, a hundred at most. Rays of this
    // length have no inverse.
    for scale in [1e-38, 1e-40, 1e-43] {
        let places = (0..200).map(|i| noise(1, i) * scale);
        hold_hit_or_not(&soup(around(places, scale * 0.1)));
    }
}

#[test]
fn one_huge_triangle_among_tiny_ones() {
    let mut positions = around((0..300).map(|i| noise(1, i)), 0.01);
    positions.extend([Vec3::new(-1e9, -1e9, 0.5), Vec3::new(1e9, -1e9, 0.5), Vec3::new(0.0, 1e9, 0.5)]);
    hold(&soup(positions));
}

#[test]
fn flat_along_each_axis() {
    for axis in 0..3 {
        let mut positions = around((0..300).map(|i| noise(1, i) * 10.0), 1.0);
        positions.iter_mut().for_each(|p| p[axis] = -3.0);
        hold(&soup(positions));
    }
}

#[test]
fn all_on_a_line() {
    let positions = (0..600).map(|i| Vec3::new(noise(1, i).x * 10.0, 1.0, 2.0));
    hold_hit_or_not(&soup(positions.collect()));
}

#[test]
fn exponentially_spaced() {
    let places = (0..250).map(|i| Vec3::new((i as f32 - 125.0).exp2(), 0.0, 0.0));
    let positions: Vec<_> = places.flat_map(|p| [p, p * 1.01, p + Vec3::Y * p.x * 0.01]).collect();
    hold(&soup(positions));
}

#[test]
fn more_subtrees_than_threads_could_want() {
    let positions = around((0..6000).map(|i| noise(1, i) * 100.0), 1.0);
    pool(64).install(|| hold(&Case::soup(vec![positions.clone(), positions])));
}
