//! Geometry, rays and pictures that the tests share.

use bvh_core::{Aabb, Bvh, Node, Primitives, Ray, Triangles, Vec3};

use crate::bvh8;
use crate::cast::{place, trace};
use crate::packet;
use crate::scene::{Scene, Work, with_test};
use crate::simd::{detected, dispatch};
use crate::tile::Scratch;
use crate::times::Tally;
use crate::wave::{PACKET, RAYS, Wave, set};
use bvh_core::triangle::Watertight;
use bytemuck::zeroed_box;

use crate::random::splitmix;
use crate::{
    Bvh8, Camera, Image, Material, Mesh, Output, PointLight, RenderOptions, SimdLevel, Traversal, render,
};
use crate::{Effects, any_hit, closest_hit, closest_hit_brute};
use crate::{Hit, TriangleTest};

mod absent;
mod effects;
mod hits;
mod images;
mod views;

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

/// Makes the rays of a wave those from `origin` to `targets`, no more than it has room for.
fn aim(wave: &mut Wave, origin: Vec3, t_max: f32, targets: &[Vec3]) {
    wave.start(origin, t_max);
    wave.count = targets.len();
    for (i, &target) in targets.iter().enumerate() {
        set(&mut wave.direction, i, target - origin);
    }
}

/// Small and well mixed; the same on every machine.
struct Random(u64, u64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(seed, 0)
    }

    fn bits(&mut self) -> u64 {
        self.1 += 1;
        splitmix(self.0, self.1 - 1)
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
    let (mut random, mut soup) = (Random::new(7), Soup::default());
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

/// Rays from `origin` through every vertex, the middles of all edges and triangles, and a little
/// beside.
fn rays_at_features(soup: &Soup, origin: Vec3) -> Vec<Ray> {
    let mut targets: Vec<Vec3> = soup.positions.clone();
    for &t in &soup.indices {
        let [a, b, c] = t.map(|v| soup.positions[v as usize]);
        targets.extend([a.midpoint(b), b.midpoint(c), c.midpoint(a), a + (b - a) / 3.0, (a + b + c) / 3.0]);
    }
    targets.iter().map(|&t| Ray::new(origin, t - origin)).collect()
}

/// Rays along axes and in coordinate planes, with zeros of both signs, through a grid that the
/// cube's corners, edges and diagonals lie on.
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
    let mut random = Random::new(99);
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

/// The closest hit, and whether there is any.
fn wide_hits(
    wide: &Bvh8,
    ray: &Ray,
    t_max: f32,
    test: TriangleTest,
    level: SimdLevel,
) -> (Option<Hit>, bool) {
    let work = &mut Work::default();
    with_test!(test, T => dispatch!(detected(level), simd => (
        bvh8::hit::<_, T, false>(simd, wide, ray, t_max, work, |_| true),
        bvh8::hit::<_, T, true>(simd, wide, ray, t_max, work, |_| true).is_some(),
    )))
}

/// All traversals at all SIMD levels.
fn ways() -> Vec<RenderOptions> {
    let all = Traversal::ALL.into_iter().flat_map(|t| SimdLevel::available().map(move |l| (t, l)));
    all.map(|(traversal, simd)| RenderOptions { traversal, simd, ..RenderOptions::default() }).collect()
}

/// Points on a plane, in the order in which a camera's tile would see them.
fn grid(center: Vec3, right: Vec3, up: Vec3) -> Vec<Vec3> {
    let at = |i: usize| (i as f32 - 15.5) / 16.0;
    (0..1024).map(place).map(|(x, y)| center + right * at(x) + up * at(y)).collect()
}

/// A camera, a mesh and a light that together show shadows, edges of the image and both sides of
/// surfaces.
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
