//! The only file of these tests that calls the crates: a tree with everything that can be asked of
//! it, as plain numbers.

use std::ops::ControlFlow::Continue;

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Aabb, Bvh, Primitives, Ray, SimdLevel, Triangles, Vec3};
use bvh_update::{Strategy, Update, Updater};
use rt_cpu::{Bvh8, Camera, Pixel, PointLight, RenderOptions, Traversal, TriangleTest};

use crate::arithmetic::Point;

/// A triangle test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Test {
    Fast,
    Watertight,
    Double,
}

impl Test {
    pub(crate) const ALL: [Self; 3] = [Self::Fast, Self::Watertight, Self::Double];

    fn of_crate(self) -> TriangleTest {
        match self {
            Self::Fast => TriangleTest::MollerTrumbore,
            Self::Watertight => TriangleTest::Watertight,
            Self::Double => TriangleTest::Double,
        }
    }
}

/// An updater that reports the cost of every tree.
fn reporting(level: SimdLevel) -> Updater {
    let mut updater = Updater::with_level(Strategy::default(), level);
    updater.report_cost(true);
    updater
}

/// How a ray asks for a hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    /// The tree, one ray.
    Tree,
    /// The eight-wide view, one ray.
    Wide,
    /// The eight-wide view, many rays in one call.
    Stream,
}

impl Way {
    pub(crate) const ALL: [Self; 3] = [Self::Tree, Self::Wide, Self::Stream];
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    pub(crate) t: f32,
    pub(crate) primitive: usize,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) origin: Point,
    pub(crate) direction: Point,
    pub(crate) t_max: f32,
}

/// A node as plain numbers: its box, and either two children or a run of slots.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlainNode {
    pub(crate) min: Point,
    pub(crate) max: Point,
    pub(crate) first: usize,
    /// Primitives of a leaf; `None` for an inner node, whose children are `first` and `first + 1`.
    pub(crate) count: Option<usize>,
}

/// A tree as plain numbers.
#[derive(Clone, Debug)]
pub(crate) struct PlainTree {
    pub(crate) nodes: Vec<PlainNode>,
    pub(crate) order: Vec<usize>,
    /// As the tree says.
    pub(crate) height: u32,
}

/// What an update said.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Report {
    pub(crate) dropped: u64,
    pub(crate) cost: Option<f64>,
    pub(crate) height: Option<u32>,
}

/// An image of what the pixels hit, and the rays of the pixels.
pub(crate) struct Picture {
    pub(crate) name: String,
    pub(crate) lines: Vec<Line>,
    pub(crate) hits: Vec<Option<Hit>>,
    /// Where on its triangle each hit is, as weights of the second and the third corner.
    pub(crate) places: Vec<[f32; 2]>,
    /// Whether light arrives there.
    pub(crate) lit: Vec<bool>,
}

/// What can be asked. Seeded defects change single answers.
pub(crate) trait Subject {
    fn tree(&self) -> PlainTree;
    fn report(&self) -> Report;
    fn closest(&self, way: Way, test: Test, lines: &[Line]) -> Vec<Option<Hit>>;
    fn any(&self, way: Way, test: Test, line: &Line) -> bool;
    /// Primitives whose leaves a ray enters.
    fn visited(&self, line: &Line) -> Vec<usize>;
    fn overlaps(&self, min: Point, max: Point) -> Vec<usize>;
    fn pairs(&self) -> Vec<(usize, usize)>;
    /// The primitive whose box is nearest to a point, with the square of its distance, if that is
    /// below `max`.
    fn nearest(&self, point: Point, max: f32) -> Option<(usize, f32)>;
    /// Views from an eye towards a target, with a light.
    fn pictures(&self, test: Test, places: [Point; 3], width: u32) -> Vec<Picture>;
}

/// A mesh as plain numbers; corners out of range do not occur.
#[derive(Clone, Debug)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Point>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    pub(crate) fn corners(&self, i: usize) -> [Point; 3] {
        self.triangles[i].map(|v| self.positions[v as usize])
    }

    /// Whether the triangle has a box at all.
    pub(crate) fn is_finite(&self, i: usize) -> bool {
        self.corners(i).iter().flatten().all(|x| x.is_finite())
    }

    fn of_crate<T>(&self, f: impl FnOnce(&Triangles<'_>) -> T) -> T {
        let positions: Vec<Vec3> = self.positions.iter().map(|&p| p.into()).collect();
        f(&Triangles { positions: &positions, indices: &self.triangles })
    }
}

/// Names of all strategies.
pub(crate) fn strategies() -> Vec<String> {
    Strategy::all().iter().map(|strategy| strategy.name().to_owned()).collect()
}

/// SIMD levels of this machine, lowest first.
pub(crate) fn levels() -> Vec<SimdLevel> {
    SimdLevel::available().collect()
}

/// The real thing.
pub(crate) struct Real {
    bvh: Bvh,
    updater: Updater,
    wide: Bvh8,
    update: Update,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Real {
    pub(crate) fn new(mesh: &Mesh, max_leaf_size: u32, level: SimdLevel) -> Self {
        let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
        let bvh = mesh.of_crate(|t| build_with(t, Builder::Binned, &options)).expect("few enough");
        let mut real = Self {
            bvh,
            updater: reporting(level),
            wide: Bvh8::with_level(level),
            update: Update::default(),
            positions: Vec::new(),
            triangles: Vec::new(),
        };
        real.show(mesh);
        real.update.height = real.bvh.height();
        real.update.dropped = (0..mesh.triangles.len()).filter(|&i| !mesh.is_finite(i)).count() as u64;
        real
    }

    pub(crate) fn update(&mut self, mesh: &Mesh, strategy: &str) {
        let strategy: Strategy = strategy.parse().expect("a strategy");
        let updater = &mut self.updater;
        let bvh = &mut self.bvh;
        self.update = mesh.of_crate(|t| updater.set_strategy(strategy).update(bvh, t)).expect("same count");
        self.show(mesh);
    }

    fn show(&mut self, mesh: &Mesh) {
        self.positions = mesh.positions.iter().map(|&p| p.into()).collect();
        self.triangles.clone_from(&mesh.triangles);
        let triangles = Triangles { positions: &self.positions, indices: &self.triangles };
        self.wide.update(&self.bvh, &triangles);
    }

    /// The square of the distance from a point to the box of primitive `p`.
    pub(crate) fn distance(&self, p: usize, point: Point) -> f32 {
        self.triangles().aabb(p).distance_squared(point.into())
    }

    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.triangles }
    }
}

fn ray(line: &Line) -> Ray {
    Ray::new(line.origin.into(), line.direction.into())
}

fn hit(hit: rt_cpu::Hit) -> Hit {
    Hit { t: hit.t, primitive: hit.primitive as usize }
}

impl Subject for Real {
    fn tree(&self) -> PlainTree {
        let plain = |node: &bvh_core::Node| PlainNode {
            min: node.aabb().min.into(),
            max: node.aabb().max.into(),
            first: node.first(),
            count: node.is_leaf().then(|| node.count()),
        };
        PlainTree {
            nodes: self.bvh.nodes().iter().map(plain).collect(),
            order: self.bvh.order().iter().map(|&p| p as usize).collect(),
            height: self.bvh.height(),
        }
    }

    fn report(&self) -> Report {
        let Update { dropped, sah_cost, height, rebuilt, .. } = self.update;
        Report { dropped, cost: sah_cost, height: (!rebuilt).then_some(height) }
    }

    fn closest(&self, way: Way, test: Test, lines: &[Line]) -> Vec<Option<Hit>> {
        let (triangles, test) = (self.triangles(), test.of_crate());
        let one = |line: &Line| match way {
            Way::Tree => rt_cpu::closest_hit(&self.bvh, &triangles, &ray(line), line.t_max, test),
            _ => self.wide.closest_hit(&ray(line), line.t_max, test),
        };
        if way != Way::Stream {
            return lines.iter().map(|line| one(line).map(hit)).collect();
        }
        let rays: Vec<Ray> = lines.iter().map(ray).collect();
        let t_max: Vec<f32> = lines.iter().map(|line| line.t_max).collect();
        let mut hits = vec![None; rays.len()];
        self.wide.closest_hits(&rays, &t_max, test, &mut hits);
        hits.into_iter().map(|h| h.map(hit)).collect()
    }

    fn any(&self, way: Way, test: Test, line: &Line) -> bool {
        match way {
            Way::Tree => {
                rt_cpu::any_hit(&self.bvh, &self.triangles(), &ray(line), line.t_max, test.of_crate())
            }
            _ => self.wide.any_hit(&ray(line), line.t_max, test.of_crate()),
        }
    }

    fn visited(&self, line: &Line) -> Vec<usize> {
        let mut visited = Vec::new();
        self.bvh.cast_ray(&ray(line), line.t_max, |p, t_max| {
            visited.push(p);
            Continue(t_max)
        });
        visited
    }

    fn overlaps(&self, min: Point, max: Point) -> Vec<usize> {
        let mut found = Vec::new();
        self.bvh.for_each_overlap(&self.triangles(), &Aabb::new(min.into(), max.into()), |p| {
            found.push(p);
            Continue(())
        });
        found
    }

    fn pairs(&self) -> Vec<(usize, usize)> {
        let mut found = Vec::new();
        self.bvh.for_each_pair(&self.triangles(), |a, b| {
            found.push((a, b));
            Continue(())
        });
        found
    }

    fn nearest(&self, point: Point, max: f32) -> Option<(usize, f32)> {
        let to_box = |aabb: &Aabb| aabb.distance_squared(point.into());
        self.bvh.nearest(max, to_box, |p, _| self.distance(p, point)).0
    }

    fn pictures(&self, test: Test, [eye, target, light]: [Point; 3], width: u32) -> Vec<Picture> {
        let light = PointLight { position: light.into(), color: [1.0; 3] };
        let camera = Camera::look_at(eye.into(), target.into(), Vec3::Y, 0.9, width, width);
        let line = |i: u32| {
            let ray = camera.ray(i % width, i / width);
            Line { origin: ray.origin().into(), direction: ray.direction().into(), t_max: f32::INFINITY }
        };
        let lines: Vec<Line> = (0..width * width).map(line).collect();
        let mut pictures = Vec::new();
        for traversal in Traversal::ALL {
            for simd in SimdLevel::available() {
                let options =
                    RenderOptions { traversal, simd, triangle_test: test.of_crate(), ..Default::default() };
                let mut pixels = vec![Pixel::default(); lines.len()];
                rt_cpu::cast(&self.bvh, &self.triangles(), &camera, Some(&light), &options, &mut pixels);
                pictures.push(Picture {
                    name: format!("{} at {simd}", traversal.name()),
                    lines: lines.clone(),
                    hits: pixels.iter().map(|pixel| pixel.hit().map(hit)).collect(),
                    places: pixels.iter().map(|p| p.hit().map_or([0.0; 2], |h| [h.u, h.v])).collect(),
                    lit: pixels.iter().map(Pixel::is_lit).collect(),
                });
            }
        }
        pictures
    }
}
