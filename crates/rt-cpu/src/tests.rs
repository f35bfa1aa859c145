//! Every way to find hits against testing every triangle, on geometry that is easy to get wrong.

use bvh_core::{Aabb, Bvh, Node, Primitives, Ray, Triangles, Vec3};

use crate::bundle::{Bundle, Hits, RAYS};
use crate::bvh8;
use crate::packet::{self, Query, SIZE};
use crate::render::trace;
use crate::simd::at_level;
use crate::single::{Work, with_test};
use crate::tile::{Scene, Scratch};
use crate::triangle::{Double, Hit, MollerTrumbore, TriangleTest, Watertight};
use crate::{
    Bvh8, Camera, Image, Material, Mesh, Output, PointLight, RenderOptions, SimdLevel, Traversal, render,
};
use crate::{any_hit, any_hit_brute, closest_hit, closest_hit_brute};

mod effects;

/// Triangles that own their vertices.
#[derive(Clone, Default)]
struct Soup {
    positions: Vec<Vec3>,
    indices: Vec<[u32; 3]>,
}

impl Soup {
    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.indices }
    }

    fn push(&mut self, corners: [Vec3; 3]) {
        let n = self.positions.len() as u32;
        self.positions.extend(corners);
        self.indices.push([n, n + 1, n + 2]);
    }

    fn map(&self, f: impl Fn(Vec3) -> Vec3) -> Self {
        Self { positions: self.positions.iter().map(|&p| f(p)).collect(), indices: self.indices.clone() }
    }
}

/// A tree by median splits along the longest axis, with up to `leaf` triangles a leaf.
fn tree(soup: &Soup, leaf: usize) -> Bvh {
    fn split(t: &Triangles<'_>, nodes: &mut Vec<Node>, n: usize, order: &mut [u32], first: u32, leaf: usize) {
        let aabb = order.iter().fold(Aabb::EMPTY, |b, &p| b.union(t.aabb(p as usize)));
        if order.len() <= leaf {
            nodes[n] = Node::leaf(aabb, first, order.len() as u32);
            return;
        }
        let pair = nodes.len();
        nodes.extend([Node::NOTHING; 2]);
        nodes[n] = Node::inner(aabb, pair as u32);
        let axis = aabb.extent().max_position();
        order.sort_by(|&a, &b| {
            let at = |p: u32| t.aabb(p as usize).center()[axis];
            at(a).total_cmp(&at(b))
        });
        let (l, r) = order.split_at_mut(order.len() / 2);
        let middle = first + l.len() as u32;
        split(t, nodes, pair, l, first, leaf);
        split(t, nodes, pair + 1, r, middle, leaf);
    }
    let mut order: Vec<u32> = (0..soup.indices.len() as u32).collect();
    let mut nodes = vec![Node::NOTHING; 2];
    split(&soup.triangles(), &mut nodes, 0, &mut order, 0, leaf);
    Bvh::new(&nodes, order).expect("a valid tree")
}

/// Small and well mixed; the same on every machine (SplitMix64).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From -1 to 1.
    fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
}

fn random_soup(n: usize, size: f32) -> Soup {
    let (mut random, mut soup) = (Random(7), Soup::default());
    for _ in 0..n {
        let at = random.vec();
        soup.push([at, at + random.vec() * size, at + random.vec() * size]);
    }
    soup
}

/// A closed sphere of radius 1: an icosahedron with each triangle cut in four, `levels` times.
fn icosphere(levels: u32) -> Soup {
    let g = f32::midpoint(1.0, 5.0f32.sqrt());
    let mut positions = Vec::new();
    for (a, b) in [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)] {
        positions.extend([Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)]);
    }
    // Neighbours among the twelve are 2 apart.
    let near = |a: usize, b: usize| (positions[a].distance(positions[b]) - 2.0).abs() < 1e-3;
    let mut indices = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    indices.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    assert_eq!(indices.len(), 20);
    let mut middles = std::collections::HashMap::new();
    for _ in 0..levels {
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push(positions[a as usize].midpoint(positions[b as usize]));
                positions.len() as u32 - 1
            })
        };
        indices = indices
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let positions = positions.iter().map(|p| p.normalize()).collect();
    Soup { positions, indices }
}

/// A box of twelve triangles from -1 to 1, with coordinates that rays can lie in exactly.
fn cube() -> Soup {
    let positions =
        (0..8).map(|i| Vec3::from([0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 }))).collect();
    let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let indices = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Soup { positions, indices }
}

/// Rays from `origin` through every vertex, the middles of all edges and triangles, and a little beside.
fn rays_at_features(soup: &Soup, origin: Vec3) -> Vec<Ray> {
    let mut targets: Vec<Vec3> = soup.positions.clone();
    for &t in &soup.indices {
        let [a, b, c] = t.map(|v| soup.positions[v as usize]);
        targets.extend([a.midpoint(b), b.midpoint(c), c.midpoint(a), a + (b - a) / 3.0, (a + b + c) / 3.0]);
    }
    targets.iter().map(|&t| Ray::new(origin, t - origin)).collect()
}

/// Rays along axes and in coordinate planes, with zeros of both signs, through a grid that the cube's corners,
/// edges and diagonals lie on.
fn axis_rays() -> Vec<Ray> {
    let mut rays = Vec::new();
    let steps = [-2.0, -1.0, -0.5, -0.0, 0.0, 0.5, 1.0, 1.5];
    for axis in 0..3 {
        for a in steps {
            for b in steps {
                for (zero, far) in [(0.0f32, -3.0f32), (-0.0, 3.0), (0.0, -1.0), (-0.0, 1.0), (0.0, 0.0)] {
                    let mut origin = Vec3::splat(a);
                    origin[(axis + 1) % 3] = b;
                    origin[axis] = far;
                    let mut along = Vec3::splat(zero);
                    along[axis] = if far > 0.0 { -1.0 } else { 1.0 };
                    let mut diagonal = along;
                    diagonal[(axis + 1) % 3] = 1.0;
                    rays.extend([Ray::new(origin, along), Ray::new(origin, diagonal)]);
                }
            }
        }
    }
    rays
}

/// Rays from twice the unit cube towards points in it.
fn random_rays(n: usize) -> Vec<Ray> {
    let mut random = Random(99);
    (0..n)
        .map(|_| {
            let origin = random.vec() * 2.0;
            Ray::new(origin, random.vec() - origin)
        })
        .collect()
}

fn bits(hit: Option<Hit>) -> Option<[u32; 4]> {
    hit.map(|h| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.primitive])
}

const T_MAX: [f32; 5] = [f32::INFINITY, 1.0, 0.0, -1.0, f32::NAN];

/// Single rays against brute force, in all tests, with small and large leaves. Gives the number of hits.
fn check_rays(soup: &Soup, rays: &[Ray]) -> usize {
    let t = soup.triangles();
    let mut hits = 0;
    let mut wide = Bvh8::new();
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
                    assert_eq!(any_hit_brute(&t, ray, t_max, test), truth.is_some());
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

/// The closest hit, and whether there is any.
fn wide_hits(
    wide: &Bvh8,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
    level: SimdLevel,
) -> (Option<Hit>, bool) {
    let work = &mut Work::default();
    with_test!(test, T => at_level!(level, simd => (
        bvh8::closest_where::<_, T>(simd, wide, ray, t_max, work, |_| true),
        bvh8::any_where::<_, T>(simd, wide, ray, t_max, work, |_| true).is_some(),
    )))
}

/// All traversals at all SIMD levels.
fn ways() -> Vec<RenderOptions> {
    let all = Traversal::ALL.into_iter().flat_map(|t| SimdLevel::available().map(move |l| (t, l)));
    all.map(|(traversal, simd)| RenderOptions { traversal, simd, ..RenderOptions::default() }).collect()
}

/// Rays that share their origin, traced in all ways, against brute force, in all tests.
fn check_packets(soup: &Soup, origin: Vec3, targets: &[Vec3], t_max: f32) -> usize {
    let triangles = soup.triangles();
    let mut found = 0;
    let (mut rays_of_tile, mut hits, mut scratch) = (Bundle::new(), Hits::new(), Scratch::new());
    for test in TriangleTest::ALL {
        for targets in targets.chunks(RAYS) {
            let rays: Vec<Ray> = targets.iter().map(|&t| Ray::new(origin, t - origin)).collect();
            let truth: Vec<_> =
                rays.iter().map(|ray| closest_hit_brute(&triangles, ray, t_max, test)).collect();
            found += truth.iter().flatten().count();
            for leaf in [1, 5] {
                let bvh = tree(soup, leaf);
                let scene = Scene { bvh: &bvh, triangles: &triangles };
                for options in ways() {
                    for query in [Query::Closest, Query::Any] {
                        rays_of_tile.start(origin, t_max);
                        targets.iter().for_each(|&t| rays_of_tile.push(t - origin));
                        with_test!(test, T => at_level!(options.simd, simd => trace::<_, T>(
                            simd,
                            scene,
                            options.traversal,
                            query,
                            &mut rays_of_tile,
                            &mut hits,
                            &mut scratch,
                            &mut [0; RAYS],
                            &mut Work::default(),
                        )));
                        for (i, truth) in truth.iter().enumerate() {
                            let hit = hits.get(i);
                            let way = (test, options.traversal, options.simd, rays[i]);
                            match query {
                                Query::Closest => assert_eq!(bits(hit), bits(*truth), "{way:?}"),
                                Query::Any => assert_eq!(hit.is_some(), truth.is_some(), "{way:?}"),
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
    let mut random = Random(5);
    let rays: [Ray; SIZE] = std::array::from_fn(|_| Ray::new(origin, random.vec() - origin));
    let limits = std::array::from_fn(|i| if i % 7 == 3 || i < 5 { -1.0 } else { 9.0 });
    let hits = packet::trace::<Watertight>(&bvh, &t, &rays, limits, Query::Closest, &mut Work::default());
    for i in 0..SIZE {
        let truth = closest_hit_brute(&t, &rays[i], limits[i], TriangleTest::Watertight);
        assert_eq!(bits(hits[i]), bits(truth));
    }
    assert!(hits.iter().flatten().count() > 10);
}

/// Points on a plane of 8 x 8 blocks, as a camera would see them.
fn grid(center: Vec3, right: Vec3, up: Vec3) -> Vec<Vec3> {
    let at = |i: usize| (i as f32 - 15.5) / 16.0;
    let mut points = Vec::new();
    for block in 0..16 {
        for i in 0..64 {
            let (x, y) = (block % 4 * 8 + i % 8, block / 4 * 8 + i / 8);
            points.push(center + right * at(x) + up * at(y));
        }
    }
    points
}

#[test]
fn random_soups() {
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
    for scale in [1e-30, 1e-18, 1e-3, 1e6, 1e18, 1e30] {
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

/// Over a direction so short, or so nearly along a plane, that one over it is infinite, boxes are entered at infinity.
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
    let mut random = Random(3);
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

/// A camera, a mesh and a light that together show shadows, edges of the image and both sides of surfaces.
fn scene() -> (Soup, Camera, PointLight) {
    let mut soup = icosphere(3);
    for t in [[[-4, -1, -4], [4, -1, -4], [4, -1, 4]], [[-4, -1, -4], [4, -1, 4], [-4, -1, 4]]] {
        soup.push(t.map(|c| Vec3::from(c.map(|x| x as f32))));
    }
    let camera = Camera::look_at(Vec3::new(1.0, 1.5, 4.0), Vec3::ZERO, Vec3::Y, 0.8, 133, 71);
    (soup, camera, PointLight { position: Vec3::new(3.0, 5.0, 2.0), color: [0.9, 0.8, 0.7] })
}

fn pixel_bits(image: &Image) -> Vec<u32> {
    image.pixels().iter().flatten().map(|c| c.to_bits()).collect()
}

#[test]
fn images_are_the_same_for_all_threads_traversals_and_simd_levels() {
    let (soup, camera, light) = scene();
    let bvh = tree(&soup, 2);
    let mesh = Mesh { normals: Some(&soup.positions), ..Mesh::new(soup.triangles()) };
    for triangle_test in TriangleTest::ALL {
        let mut images = Vec::new();
        for way in ways() {
            for threads in [1, 2, 3, 8] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let options = RenderOptions { triangle_test, ..way };
                let mut image = Image::new(0, 0);
                let stats = pool.install(|| render(&bvh, &mesh, &camera, Some(&light), &options, &mut image));
                assert_eq!(stats.rays_primary, 133 * 71);
                assert!(stats.rays_shadow > 0 && stats.rays_shadow < stats.hits);
                images.push((pixel_bits(&image), stats.hits, stats.rays_shadow, stats.shadowed));
            }
        }
        assert!(images.iter().all(|i| *i == images[0]), "{triangle_test:?}");
    }
}

#[test]
fn a_lit_sphere_has_no_shadow_on_its_lit_side() {
    for (scale, offset) in [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 300.0)] {
        let sphere = icosphere(4).map(|p| p * scale + Vec3::splat(offset));
        let bvh = tree(&sphere, 1);
        let place = |x, y, z| Vec3::new(x, y, z) * scale + Vec3::splat(offset);
        let camera = Camera::look_at(place(0.0, 0.5, 3.0), place(0.0, 0.0, 0.0), Vec3::Y, 0.8, 200, 200);
        let light = PointLight { position: place(3.0, 2.0, 2.0), color: [1.0; 3] };
        let mut image = Image::new(0, 0);
        let options = RenderOptions::default();
        let mesh = Mesh::new(sphere.triangles());
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        assert!(stats.rays_shadow > 5000, "{stats:?}");
        assert_eq!(stats.shadowed, 0, "scale {scale}, offset {offset}");
    }
}

#[test]
fn shadows_fall_where_they_should() {
    let (soup, _, light) = scene();
    let bvh = tree(&soup, 1);
    let mesh = Mesh::new(soup.triangles());
    // From above, on the floor: the sphere's shadow lies on the far side from the light.
    let camera = Camera::look_at(Vec3::new(0.0, 12.0, 0.0), Vec3::ZERO, Vec3::NEG_Z, 0.6, 64, 64);
    let mut image = Image::new(0, 0);
    let mut shot = |shadows| {
        let options = RenderOptions { shadows, ..RenderOptions::default() };
        let stats = render(&bvh, &mesh, &camera, Some(&light), &options, &mut image);
        let pixel = |p: Vec3| {
            // Height above the floor matters little: the floor is 13 below the eye.
            let at = |x: f32| (32.0 + x / 13.0 / 0.3f32.tan() * 32.0) as usize;
            image.pixels()[at(p.z) * 64 + at(p.x)]
        };
        let behind = Vec3::new(-1.0, -1.0, -0.7);
        (stats, pixel(behind)[0], pixel(-behind * 1.6)[0])
    };
    let (with, dark, lit) = shot(true);
    let (without, plain, _) = shot(false);
    assert!(dark < 0.4 * lit && plain > 0.8 * lit, "{dark} {plain} {lit}");
    assert!(with.rays_shadow > 0 && with.shadowed > 0);
    assert_eq!((without.rays_shadow, without.shadowed), (0, 0));
}

#[test]
fn heat_maps_show_where_the_work_is() {
    let (soup, camera, light) = scene();
    let bvh = tree(&soup, 1);
    let mut image = Image::new(0, 0);
    let output = Output::NodesVisited { most: 60 };
    let options = RenderOptions { output, ..RenderOptions::default() };
    let stats = render(&bvh, &Mesh::new(soup.triangles()), &camera, Some(&light), &options, &mut image);
    let (middle, corner) = (image.pixels()[35 * 133 + 50], image.pixels()[0]);
    assert!(middle != corner && stats.nodes_visited > 133 * 71);
    assert!(image.pixels().iter().flatten().all(|c| (0.0..=1.0).contains(c)));
}

#[test]
fn odd_meshes_and_sizes_render() {
    let soup = cube();
    let bvh = tree(&soup, 1);
    let mesh = Mesh {
        normals: Some(&soup.positions[..2]),
        materials: &[Material { color: [1.0, 0.0, 0.0], texture: Some(3), ..Material::DEFAULT }],
        material_of: &[0, 7],
        ..Mesh::new(soup.triangles())
    };
    for (w, h) in [(0, 0), (0, 5), (5, 0), (1, 1), (33, 1), (1, 65)] {
        let camera = Camera::look_at(Vec3::splat(3.0), Vec3::ZERO, Vec3::Y, 1.0, w, h);
        let mut image = Image::new(9, 9);
        let stats = render(&bvh, &mesh, &camera, None, &RenderOptions::default(), &mut image);
        assert_eq!((image.width(), image.height()), (w, h));
        assert_eq!(stats.rays_primary, u64::from(w) * u64::from(h));
    }
    let broken = Camera::look_at(Vec3::NAN, Vec3::ZERO, Vec3::Y, 1.0, 16, 16);
    let mut image = Image::new(0, 0);
    assert_eq!(render(&bvh, &mesh, &broken, None, &RenderOptions::default(), &mut image).hits, 0);
    assert!(image.pixels().iter().flatten().all(|c| c.is_finite()));
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
    let mut wide = Bvh8::new();
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

/// Views keep nothing of what they were of before.
#[test]
fn views_of_other_trees_and_of_nothing() {
    let (large, small) = (random_soup(300, 0.5), random_soup(3, 2.0));
    let mut wide = Bvh8::new();
    let test = TriangleTest::Watertight;
    let agrees = |wide: &Bvh8, t: &Triangles<'_>| {
        let hits = random_rays(200).into_iter().filter(|ray| {
            let truth = closest_hit_brute(t, ray, f32::INFINITY, test);
            assert_eq!(bits(wide.closest_hit(ray, f32::INFINITY, test)), bits(truth));
            assert_eq!(wide.any_hit(ray, f32::INFINITY, test), truth.is_some());
            truth.is_some()
        });
        hits.count()
    };
    assert_eq!(agrees(&wide, &Soup::default().triangles()), 0);
    for soup in [&large, &small, &large] {
        wide.update(&tree(soup, 2), &soup.triangles());
        assert!(agrees(&wide, &soup.triangles()) > 10);
    }
    // Triangles that are no longer there.
    let fewer = Triangles { indices: &large.indices[..150], ..large.triangles() };
    wide.update(&tree(&large, 2), &fewer);
    assert!(agrees(&wide, &fewer) > 10);
    wide.update(&Bvh::default(), &large.triangles());
    assert_eq!(agrees(&wide, &Soup::default().triangles()), 0);
}

#[test]
fn batches_are_single_rays_in_order_on_any_number_of_threads() {
    let soup = random_soup(200, 0.4);
    let t = soup.triangles();
    let mut wide = Bvh8::new();
    wide.update(&tree(&soup, 3), &t);
    let rays = random_rays(700);
    let t_max: Vec<f32> = (0..700).map(|i| [f32::INFINITY, 0.7, -1.0][i % 3]).collect();
    let mut hits = vec![None; 700];
    for test in TriangleTest::ALL {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| wide.closest_hits(&rays, &t_max, test, &mut hits));
            for i in 0..700 {
                assert_eq!(bits(hits[i]), bits(closest_hit_brute(&t, &rays[i], t_max[i], test)));
            }
            assert!(hits.iter().flatten().count() > 50);
            hits.fill(None);
        }
    }
}

#[test]
fn names_are_read_back_and_unknown_ones_explained() {
    for t in Traversal::ALL {
        assert_eq!(t.name().parse(), Ok(t));
    }
    for t in TriangleTest::ALL {
        assert_eq!(t.name().parse(), Ok(t));
    }
    let error = "exact".parse::<TriangleTest>().expect_err("unknown").to_string();
    assert_eq!(error, "unknown triangle test 'exact'; expected one of fast, watertight, f64");
}
