//! Every way to find hits against testing every triangle, on geometry that is easy to get wrong.

use super::*;

const T_MAX: [f32; 5] = [f32::INFINITY, 1.0, 0.0, -1.0, f32::NAN];

/// Single rays against brute force, in all tests, with small and large leaves. Gives the number of
/// hits.
fn check_rays(soup: &Soup, rays: &[Ray]) -> usize {
    let t = soup.triangles();
    let mut hits = 0;
    let mut wide = Bvh8::default();
    for leaf in [1, 5, 40] {
        let bvh = tree(soup, leaf);
        wide.update(&bvh, &t);
        for test in TriangleTest::ALL {
            for (i, ray) in rays.iter().enumerate() {
                for &t_max in &T_MAX[..if i % 8 == 0 { 5 } else { 1 }] {
                    let truth = closest_hit_brute(&t, ray, t_max, test);
                    let found = closest_hit(&bvh, &t, ray, t_max, test);
                    assert_eq!(bits(found), bits(truth), "{test:?} {t_max} {ray:?}");
                    assert_eq!(any_hit(&bvh, &t, ray, t_max, test), truth.is_some());
                    for level in SimdLevel::available() {
                        let (found, any) = wide_hits(&wide, ray, t_max, test, level);
                        assert_eq!(bits(found), bits(truth), "{level:?} {test:?} {t_max} {ray:?}");
                        assert_eq!(any, truth.is_some(), "{level:?} {test:?} {t_max} {ray:?}");
                    }
                    if let Some(h) = truth {
                        assert!(h.t >= 0.0 && h.t <= t_max && h.t.is_finite(), "{h:?}");
                        hits += 1;
                    }
                }
            }
        }
    }
    hits
}

/// Rays that share their origin, traced in all ways, against brute force, in all tests.
fn check_packets(soup: &Soup, origin: Vec3, targets: &[Vec3], t_max: f32) -> usize {
    check_packets_in(&[&tree(soup, 1), &tree(soup, 5)], soup, origin, targets, t_max)
}

/// The same through `trees` of the soup.
fn check_packets_in(trees: &[&Bvh], soup: &Soup, origin: Vec3, targets: &[Vec3], t_max: f32) -> usize {
    let triangles = soup.triangles();
    let mut found = 0;
    let (mut wave, mut scratch): (Box<Wave>, Box<Scratch>) = (zeroed_box(), zeroed_box());
    for test in TriangleTest::ALL {
        for targets in targets.chunks(RAYS) {
            let rays: Vec<Ray> = targets.iter().map(|&t| Ray::new(origin, t - origin)).collect();
            let truth: Vec<_> =
                rays.iter().map(|ray| closest_hit_brute(&triangles, ray, t_max, test)).collect();
            found += truth.iter().flatten().count();
            for bvh in trees {
                let scene = Scene { bvh, triangles: &triangles };
                for options in ways() {
                    for any in [false, true] {
                        aim(&mut wave, origin, t_max, targets);
                        let (way, tally) = (options.traversal, &mut Tally::default());
                        with_test!(test, T => dispatch!(detected(options.simd), simd => {
                            if any {
                                trace::<_, T, true>(simd, scene, way, &mut wave, &mut scratch, tally);
                            } else {
                                trace::<_, T, false>(simd, scene, way, &mut wave, &mut scratch, tally);
                            }
                        }));
                        for (i, truth) in truth.iter().enumerate() {
                            let hit = wave.hit(i);
                            let way = (test, options.traversal, options.simd, rays[i]);
                            if any {
                                assert_eq!(hit.is_some(), truth.is_some(), "{way:?}");
                            } else {
                                assert_eq!(bits(hit), bits(*truth), "{way:?}");
                            }
                        }
                    }
                }
            }
        }
    }
    found
}

/// A published packet with rays absent from it.
#[test]
fn packets_with_gaps() {
    let soup = random_soup(100, 0.7);
    let (t, bvh) = (soup.triangles(), tree(&soup, 2));
    let origin = Vec3::new(0.1, 0.2, 3.0);
    let mut random = Random::new(5);
    let rays: [Ray; PACKET] = std::array::from_fn(|_| Ray::new(origin, random.vec() - origin));
    let limits = std::array::from_fn(|i| if i % 7 == 3 || i < 5 { -1.0 } else { 9.0 });
    let work = &mut Work::default();
    let hits = packet::trace::<Watertight, false>(Scene { bvh: &bvh, triangles: &t }, &rays, limits, work);
    for i in 0..PACKET {
        let truth = closest_hit_brute(&t, &rays[i], limits[i], TriangleTest::Watertight);
        assert_eq!(bits(hits[i]), bits(truth));
    }
    assert!(hits.iter().flatten().count() > 10);
}

#[test]
fn hits_in_random_soups_are_those_of_brute_force() {
    for size in [0.05, 0.5, 3.0] {
        let soup = random_soup(300, size);
        assert!(check_rays(&soup, &random_rays(600)) > 60);
        let targets = grid(Vec3::ZERO, Vec3::X, Vec3::Y);
        assert!(check_packets(&soup, Vec3::new(0.3, 0.2, 2.0), &targets, f32::INFINITY) > 60);
        // From inside, so that directions of all signs share packets.
        let targets: Vec<Vec3> = random_rays(256).iter().map(Ray::origin).collect();
        assert!(check_packets(&soup, Vec3::splat(0.1), &targets, 1.0) > 5);
    }
}

#[test]
fn closed_meshes_through_vertices_and_edges() {
    let sphere = icosphere(2);
    for origin in [Vec3::ZERO, Vec3::new(0.1, -0.2, 0.05), Vec3::new(3.0, 1.0, 2.0), Vec3::new(0.0, 0.0, 4.0)]
    {
        assert!(check_rays(&sphere, &rays_at_features(&sphere, origin)) > 1000);
        assert!(check_packets(&sphere, origin, &sphere.positions, f32::INFINITY) > 100);
    }
}

#[test]
fn packets_look_no_farther_than_t_max() {
    let sphere = icosphere(2);
    let targets = grid(Vec3::ZERO, Vec3::X, Vec3::Y);
    // The first of these are away from it, the last is on it. From there it begins at 2/3 and 0.
    for origin in [Vec3::new(0.1, 0.2, 3.0), Vec3::Z * 3.0, Vec3::Z] {
        for t_max in T_MAX.into_iter().chain([2.0 / 3.0, 0.5]) {
            let found = check_packets(&sphere, origin, &targets, t_max);
            assert!(found > 100 || t_max.is_nan() || t_max < 1.0, "{origin} up to {t_max}");
        }
    }
}

#[test]
fn axes_planes_of_boxes_and_signed_zeros() {
    for soup in [cube(), icosphere(1)] {
        assert!(check_rays(&soup, &axis_rays()) > 100);
    }
    let mut flat = Soup::default();
    for y in [0.0, -0.0, 1.0] {
        flat.push([Vec3::new(-1.0, y, -1.0), Vec3::new(1.0, y, -1.0), Vec3::new(0.0, y, 1.0)]);
    }
    assert!(check_rays(&flat, &axis_rays()) > 10);
    for z in [0.0, -0.0, 3.0] {
        let points = grid(Vec3::ZERO, Vec3::X, Vec3::Y);
        check_packets(&cube(), Vec3::new(z, z, 3.0), &points, f32::INFINITY);
        check_packets(&cube(), Vec3::new(1.0, 1.0, z), &points, 1.0);
    }
}

#[test]
fn zero_area_nan_and_infinite_triangles() {
    let mut soup = random_soup(60, 0.8);
    for i in 0..60 {
        let [a, b, c] = soup.indices[i];
        let p = &mut soup.positions;
        match i % 6 {
            0 => p[a as usize].x = f32::NAN,
            1 => p[b as usize].z = f32::INFINITY,
            2 => p[c as usize] = p[b as usize],
            3 => p[c as usize] = p[a as usize].midpoint(p[b as usize]),
            _ => {}
        }
    }
    soup.indices.push([0, 1, 4_000_000_000]);
    let sound = |h: Hit| matches!(h.primitive % 6, 3..6) && h.primitive < 60;
    for ray in random_rays(400) {
        let hit = closest_hit_brute(&soup.triangles(), &ray, f32::INFINITY, TriangleTest::Watertight);
        assert!(hit.is_none_or(sound), "{hit:?}");
    }
    assert!(check_rays(&soup, &random_rays(400)) > 100);
    assert!(check_packets(&soup, Vec3::Z * 2.0, &grid(Vec3::ZERO, Vec3::X, Vec3::Y), f32::INFINITY) > 100);
}

#[test]
fn packets_may_be_longest_along_several_axes() {
    // Many rays on either side of where |x| = |z|, |y| = |z| and all three are as long.
    let soup = icosphere(4);
    let (edge, corner) = (Vec3::new(1.0, 0.0, 1.0), Vec3::ONE);
    for (center, right, up) in [
        (edge, Vec3::new(1.0, 0.0, -1.0), Vec3::Y),
        (Vec3::new(0.0, -1.0, 1.0), Vec3::X, Vec3::new(0.0, 1.0, 1.0)),
        (corner, Vec3::new(1.0, -1.0, 0.0), Vec3::new(-1.0, -1.0, 2.0)),
    ] {
        for side in [-1.0, 1.0] {
            let origin = center * (-2.0 * side);
            let targets = grid(origin + center * side, right * 0.3, up * 0.3);
            assert!(check_packets(&soup, origin, &targets, f32::INFINITY) > 200);
        }
    }
}

#[test]
fn equal_distances_go_to_the_lowest_number() {
    let one = icosphere(1);
    let mut twice = one.clone();
    twice.indices.extend_from_within(..);
    twice.indices.rotate_left(17);
    assert!(check_rays(&twice, &rays_at_features(&one, Vec3::splat(0.1))) > 100);
    assert!(check_packets(&twice, Vec3::splat(0.1), &one.positions, f32::INFINITY) > 10);
}

#[test]
fn coordinates_from_tiny_to_huge() {
    let sphere = icosphere(1);
    for scale in [1e-30, 1e-18, 1e-13, 1e-3, 1e6, 1e18, 1e30] {
        let scaled = sphere.map(|p| p * scale);
        for from in [Vec3::ZERO, Vec3::new(0.5, -2.0, 1.5)] {
            let rays = rays_at_features(&scaled, from * scale);
            assert!(check_rays(&scaled, &rays) > 100, "scale {scale}");
        }
        let points = grid(Vec3::ZERO, Vec3::X * scale, Vec3::Y * scale);
        let hits = check_packets(&scaled, Vec3::Z * (3.0 * scale), &points, f32::INFINITY);
        assert!(hits > 100, "scale {scale}");
    }
    for far in [1e3, 1e6] {
        let moved = sphere.map(|p| p + Vec3::splat(far));
        assert!(check_rays(&moved, &rays_at_features(&moved, Vec3::new(far - 3.0, far, far + 0.5))) > 100);
    }
    let extremes = sphere.map(|p| p * f32::MAX);
    check_rays(&extremes, &rays_at_features(&extremes, Vec3::ZERO));
    check_rays(&extremes, &random_rays(50));
}

/// Over a direction so short, or so nearly along a plane, that one over it is infinite, boxes are
/// entered at infinity.
#[test]
fn no_hit_is_infinitely_far() {
    let mut ground = Soup::default();
    for i in 0..40 {
        let at = Vec3::new((i % 5) as f32 - 2.5, (i / 5) as f32 - 4.0, 0.0);
        ground.push([at, at + Vec3::X, at + Vec3::Y]);
        ground.push([at + Vec3::X, at + Vec3::ONE.with_z(0.0), at + Vec3::Y]);
    }
    for (tiny, origin) in [(1e-39, Vec3::new(0.3, 0.4, 1e-39)), (1e-42, Vec3::new(0.3, -1e-42, 1e-42))] {
        let mut targets = grid(origin - Vec3::Z * tiny, Vec3::X * tiny, Vec3::Y * tiny);
        targets.truncate(256);
        targets.extend(&grid(origin - Vec3::Z * tiny, Vec3::X, Vec3::Y * tiny)[..256]);
        let rays: Vec<Ray> = targets.iter().map(|&target| Ray::new(origin, target - origin)).collect();
        check_rays(&ground, &rays);
        check_packets(&ground, origin, &targets, f32::INFINITY);
    }
}

#[test]
fn broken_rays_and_empty_trees_hit_nothing() {
    let soup = cube();
    let inside = Vec3::splat(0.5);
    let broken = [
        Ray::new(inside, Vec3::ZERO),
        Ray::new(inside, Vec3::new(1.0, f32::NAN, 0.0)),
        Ray::new(inside, Vec3::splat(f32::INFINITY)),
        Ray::new(Vec3::new(0.0, f32::INFINITY, 0.0), Vec3::X),
    ];
    assert_eq!(check_rays(&soup, &broken), 0);
    assert_eq!(check_rays(&Soup::default(), &random_rays(20)), 0);
    let wrong = Triangles { positions: &soup.positions, indices: &soup.indices[..3] };
    let bvh = tree(&soup, 2);
    for ray in random_rays(100) {
        let truth = closest_hit_brute(&wrong, &ray, 9.0, TriangleTest::Watertight);
        assert_eq!(bits(closest_hit(&bvh, &wrong, &ray, 9.0, TriangleTest::Watertight)), bits(truth));
    }
}

#[test]
fn nothing_leaks_out_of_a_closed_sphere() {
    let sphere = icosphere(4);
    let mut random = Random::new(3);
    for offset in [0.0, 10.0, 1000.0] {
        let sphere = sphere.map(|p| p + Vec3::splat(offset));
        let (t, bvh) = (sphere.triangles(), tree(&sphere, 1));
        for origin in [Vec3::ZERO, random.vec() * 0.4, random.vec() * 0.4, random.vec() * 0.4] {
            for ray in rays_at_features(&sphere, origin + Vec3::splat(offset)) {
                for test in [TriangleTest::Watertight, TriangleTest::Double] {
                    assert!(any_hit(&bvh, &t, &ray, f32::INFINITY, test), "{test:?} at {offset}: {ray:?}");
                }
            }
        }
    }
}

/// A tree as high as trees may be, with boxes one in the other, and one that is a single leaf.
#[test]
fn deep_trees_and_large_leaves() {
    let n = bvh_core::MAX_HEIGHT as usize + 1;
    let mut soup = Soup::default();
    for i in 0..n {
        let size = 1.2f32.powi(i as i32 - 48);
        let at = Vec3::new(size, 0.3 * size, 0.1 * size);
        soup.push([Vec3::ZERO - at, at, Vec3::new(-0.2, 1.0, 0.5) * size]);
    }
    let t = soup.triangles();
    let mut nodes = vec![Node::NOTHING; 2 * n];
    let mut below = Aabb::EMPTY;
    for i in 0..n {
        below = below.union(t.aabb(i));
        // The largest triangle is the left child of the root, and so on.
        let (depth, inner) = (n - 1 - i, i > 0);
        let place = if depth == 0 { 0 } else { 2 * depth + 1 };
        nodes[place] =
            if inner { Node::inner(below, 2 * depth as u32 + 2) } else { Node::leaf(below, i as u32, 1) };
        if inner {
            nodes[2 * depth + 2] = Node::leaf(t.aabb(i), i as u32, 1);
        }
    }
    let deep = Bvh::new(&nodes, (0..n as u32).collect()).expect("just low enough");
    assert_eq!(deep.height(), bvh_core::MAX_HEIGHT);
    let flat = tree(&soup, n);
    assert!(flat.root().is_leaf());
    let grid: Vec<_> =
        (0..256).map(|i| Vec3::new((i % 16) as f32 - 8.0, (i / 16) as f32 - 8.0, 0.0) * 0.3).collect();
    for origin in [Vec3::Z * 5.0, Vec3::new(0.1, -0.2, -1e-3)] {
        assert!(check_packets_in(&[&deep, &flat], &soup, origin, &grid, f32::INFINITY) > 100);
    }
    let mut wide = Bvh8::default();
    let mut hits = 0;
    for bvh in [&deep, &flat] {
        wide.update(bvh, &t);
        for ray in random_rays(300).iter().chain(&rays_at_features(&soup, Vec3::new(0.0, -3.0, 0.1))) {
            for test in TriangleTest::ALL {
                let truth = closest_hit_brute(&t, ray, f32::INFINITY, test);
                hits += usize::from(truth.is_some());
                assert_eq!(bits(closest_hit(bvh, &t, ray, f32::INFINITY, test)), bits(truth));
                for level in SimdLevel::available() {
                    let (found, any) = wide_hits(&wide, ray, f32::INFINITY, test, level);
                    assert_eq!((bits(found), any), (bits(truth), truth.is_some()), "{level:?} {ray:?}");
                }
            }
        }
    }
    assert!(hits > 1000, "{hits}");
}
