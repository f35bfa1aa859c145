//! This project.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use bvh_build::{BuildOptions, Builder};
use bvh_core::{Bvh, Ray, SimdLevel, Triangles, Vec3, sah_cost};
use bvh_update::{Load, Rotate, Strategy, Updater};
use rt_cpu::{Bvh8, Pixel, PointLight, RenderOptions, Traversal, TriangleTest, any_hit, cast, closest_hit};

use crate::contest::{Contest, Entry};
use crate::mesh::Mesh;
use crate::{Contestant, Failure, Hits, RAYS, Rays, View, view};

const WHO: &str = "pivot";

/// What one contestant of this project is: how it keeps its tree, and traces rays.
#[derive(Clone, Copy)]
struct Variant {
    strategy: Strategy,
    /// Most primitives in a leaf of a tree that is kept.
    max_leaf_size: u32,
    traversal: Traversal,
    simd: SimdLevel,
    rays: RayKind,
    test: TriangleTest,
    /// Whether updates learn from the pictures cast.
    learns: bool,
}

/// A tree kept by one strategy.
struct Pivot {
    variant: Variant,
    mesh: Mesh,
    tree: Bvh,
    updater: Updater,
    wide: Bvh8,
    /// Nodes that the packets of the last picture visited, if updates learn from it.
    visited: AtomicU64,
}

/// How rays are traced that come without a camera.
#[derive(Clone, Copy, PartialEq)]
enum RayKind {
    /// One by one through the tree itself.
    Single,
    /// One by one through its wide view.
    Wide,
    /// Many at a time through its wide view.
    Batch,
}

impl Pivot {
    /// The first tree: the strategy's own where it builds one. Refitting starts from a full sweep,
    /// with the triangles in the order of its leaves, and keeps them so.
    fn build(&mut self) -> Result<(), Failure> {
        let strategy = self.variant.strategy;
        let (builder, options) = match strategy {
            Strategy::Rebuild(builder, options) => (builder, options),
            _ => (Builder::Sweep, leaves_of(self.variant.max_leaf_size)),
        };
        self.tree = bvh_build::build_with(&self.mesh.triangles(), builder, &options).map_err(failure)?;
        if !matches!(strategy, Strategy::Rebuild(..)) {
            let order = self.tree.reorder_primitives();
            self.mesh.indices = order.iter().map(|&p| self.mesh.indices[p as usize]).collect();
        }
        Ok(())
    }
}

fn leaves_of(max_leaf_size: u32) -> BuildOptions {
    BuildOptions::default().with_max_leaf_size(max_leaf_size)
}

fn failure(error: impl std::fmt::Display) -> Failure {
    Failure { who: WHO, what: error.to_string() }
}

impl Contestant for Pivot {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        let nodes = std::mem::take(self.visited.get_mut());
        if nodes > 0 {
            self.updater.report(Load::PacketNodes(nodes));
        }
        if !self.tree.is_empty() {
            let triangles = self.mesh.triangles();
            self.updater
                .set_strategy(self.variant.strategy)
                .update(&mut self.tree, &triangles)
                .map_err(failure)?;
        } else {
            self.build()?;
        }
        if self.variant.rays != RayKind::Single {
            self.wide.update(&self.tree, &self.mesh.triangles());
        }
        Ok(())
    }

    fn learns(&self) -> bool {
        self.variant.learns
    }

    fn sah_cost(&self) -> Option<f64> {
        Some(sah_cost(&self.tree))
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let (triangles, test) = (self.mesh.triangles(), self.variant.test);
        match self.variant.rays {
            RayKind::Single => {
                for i in 0..rays.len() {
                    hits.set(i, closest_hit(&self.tree, &triangles, &rays.ray(i), rays.t_max[i], test));
                }
            }
            RayKind::Wide => {
                for i in 0..rays.len() {
                    hits.set(i, self.wide.closest_hit(&rays.ray(i), rays.t_max[i], test));
                }
            }
            RayKind::Batch => {
                let all: [Ray; RAYS] = std::array::from_fn(|i| rays.ray(i));
                let (mut found, count) = ([None; RAYS], rays.len());
                self.wide.closest_hits(&all[..count], &rays.t_max[..count], test, &mut found[..count]);
                found[..count].iter().enumerate().for_each(|(i, &hit)| hits.set(i, hit));
            }
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let (triangles, test) = (self.mesh.triangles(), self.variant.test);
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            let (ray, t_max) = (rays.ray(i), rays.t_max[i]);
            *blocked = match self.variant.rays {
                RayKind::Single => any_hit(&self.tree, &triangles, &ray, t_max, test),
                RayKind::Wide | RayKind::Batch => self.wide.any_hit(&ray, t_max, test),
            };
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }

    fn cast(&self, view: &View, pixels: &mut [Pixel]) {
        if self.variant.rays != RayKind::Single {
            return view::cast(self, view, pixels);
        }
        let light = view.light.map(|position| PointLight { position, color: [1.0; 3] });
        let Variant { traversal, simd, test, .. } = self.variant;
        let options = RenderOptions { traversal, simd, triangle_test: test, ..RenderOptions::default() };
        let stats = cast(&self.tree, &self.mesh.triangles(), &view.camera, light.as_ref(), &options, pixels);
        if self.variant.learns {
            self.visited.store(stats.nodes_visited, Relaxed);
        }
    }
}

/// Adds this project's contestants.
pub(crate) fn enter(contest: Contest, entries: &mut Vec<Entry>) {
    let plain = Variant {
        strategy: Strategy::Rebuild(Builder::Sweep, leaves_of(1)),
        max_leaf_size: 1,
        traversal: Traversal::Tile,
        simd: SimdLevel::best(),
        rays: RayKind::Single,
        test: TriangleTest::default(),
        learns: false,
    };
    let rotate = Strategy::RefitRotate(Rotate::default());
    let mut add = |name: &str, variant: Variant| {
        let keeps_tree = !matches!(variant.strategy, Strategy::Rebuild(..));
        entries.push(Entry::new(format!("{WHO} {name}"), keeps_tree, move |triangles| {
            Ok(Box::new(Pivot {
                variant,
                mesh: Mesh::new(triangles),
                tree: Bvh::default(),
                updater: Updater::default(),
                wide: Bvh8::default(),
                visited: AtomicU64::default(),
            }))
        }));
    };
    if matches!(contest, Contest::Update | Contest::Frame) {
        for strategy in strategies() {
            // Pictures beside updates are a check, and no load.
            let learns = contest == Contest::Frame && matches!(strategy, Strategy::Auto(_));
            add(strategy.name(), Variant { strategy, learns, ..plain });
        }
    }
    match contest {
        Contest::Update => {
            for period in [2, 4, 8] {
                let strategy = Strategy::RefitRotate(Rotate::default().with_period(period));
                add(&format!("{} every {period}", rotate.name()), Variant { strategy, ..plain });
            }
            for strategy in [Strategy::Refit, rotate] {
                let variant = Variant { strategy, max_leaf_size: 2, ..plain };
                add(&format!("{}, leaves of 2", strategy.name()), variant);
            }
        }
        Contest::Build => {
            for builder in Builder::PER_FRAME {
                let strategy = Strategy::Rebuild(builder, BuildOptions::default());
                add(builder.name(), Variant { strategy, ..plain });
            }
        }
        Contest::Trace => {
            add("wide", Variant { rays: RayKind::Wide, ..plain });
            for simd in SimdLevel::available() {
                add(simd.name(), Variant { simd, ..plain });
            }
            for leaves in [2, 4] {
                let strategy = Strategy::Rebuild(Builder::Sweep, leaves_of(leaves));
                add(&format!("leaves of {leaves}"), Variant { strategy, ..plain });
            }
            add("published packets", Variant { traversal: Traversal::Packet, ..plain });
            add("single", Variant { traversal: Traversal::Single, ..plain });
        }
        Contest::Incoherent => {
            let plain = Variant { traversal: Traversal::Single, ..plain };
            add("single", plain);
            let wide = Variant { rays: RayKind::Wide, ..plain };
            add("wide", wide);
            add("wide, fast", Variant { test: TriangleTest::MollerTrumbore, ..wide });
            add("wide, batch", Variant { rays: RayKind::Batch, ..plain });
        }
        Contest::Frame => {}
    }
}

/// Those that updates are compared by: a sweep every frame is what all are measured by, trees from
/// the background come when they like, and rebuilding on degradation is one or the other of two
/// that are there.
fn strategies() -> impl Iterator<Item = Strategy> {
    Strategy::all().into_iter().filter(|strategy| {
        !matches!(
            strategy,
            Strategy::Rebuild(Builder::Sweep, _) | Strategy::Background(_) | Strategy::Degraded(_)
        )
    })
}
