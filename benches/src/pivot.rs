//! This project.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use bvh_build::{BuildOptions, Builder};
use bvh_core::{Bvh, Ray, SimdLevel, Triangles, Vec3, sah_cost};
use bvh_update::{Load, Rotate, Strategy, Updater};
use rt_cpu::{Bvh8, Pixel, PointLight, RenderOptions, Traversal, TriangleTest, any_hit, cast, closest_hit};

use crate::field::{Contest, Entry};
use crate::mesh::Mesh;
use crate::{Contestant, Failure, Hits, RAYS, Rays, View, view};

const WHO: &str = "pivot";

/// A tree kept by one strategy.
struct Pivot {
    mesh: Mesh,
    tree: Bvh,
    is_built: bool,
    strategy: Strategy,
    /// Most primitives in a leaf of a tree that is kept.
    max_leaf_size: u32,
    updater: Updater,
    options: RenderOptions,
    rays: RayKind,
    wide: Bvh8,
    /// Whether updates learn from the pictures cast.
    learns: bool,
    /// Nodes that the packets of the last picture visited, if so.
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
    fn new(triangles: &Triangles<'_>, strategy: Strategy, traversal: Traversal, simd: SimdLevel) -> Self {
        Self {
            mesh: Mesh::new(triangles),
            tree: Bvh::default(),
            is_built: false,
            strategy,
            max_leaf_size: 1,
            updater: Updater::default(),
            options: RenderOptions { traversal, simd, ..RenderOptions::default() },
            rays: RayKind::Single,
            wide: Bvh8::new(),
            learns: false,
            visited: Default::default(),
        }
    }

    /// The first tree: the strategy's own where it builds one. Refitting starts from a full sweep,
    /// with the triangles in the order of its leaves, and keeps them so.
    fn build(&mut self) -> Result<(), Failure> {
        let (builder, options) = match &self.strategy {
            Strategy::Rebuild(builder, options) => (*builder, *options),
            _ => (Builder::Sweep, leaves_of(self.max_leaf_size)),
        };
        self.tree = bvh_build::build_with(&self.mesh.triangles(), builder, &options).map_err(failure)?;
        if !matches!(self.strategy, Strategy::Rebuild(..)) {
            let order = self.tree.reorder_primitives();
            self.mesh.indices = order.iter().map(|&p| self.mesh.indices[p as usize]).collect();
        }
        self.is_built = true;
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
        if self.is_built {
            let triangles = self.mesh.triangles();
            self.updater.set_strategy(self.strategy).update(&mut self.tree, &triangles).map_err(failure)?;
        } else {
            self.build()?;
        }
        if self.rays != RayKind::Single {
            self.wide.update(&self.tree, &self.mesh.triangles());
        }
        Ok(())
    }

    fn learns(&self) -> bool {
        self.learns
    }

    fn sah_cost(&self) -> Option<f64> {
        Some(sah_cost(&self.tree))
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let (triangles, test) = (self.mesh.triangles(), TriangleTest::default());
        match self.rays {
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
        let (triangles, test) = (self.mesh.triangles(), TriangleTest::default());
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            let (ray, t_max) = (rays.ray(i), rays.t_max[i]);
            *blocked = match self.rays {
                RayKind::Single => any_hit(&self.tree, &triangles, &ray, t_max, test),
                RayKind::Wide | RayKind::Batch => self.wide.any_hit(&ray, t_max, test),
            };
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }

    fn cast(&self, view: &View, pixels: &mut [Pixel]) {
        if self.rays != RayKind::Single {
            return view::cast(self, view, pixels);
        }
        let light = view.light.map(|position| PointLight { position, color: [1.0; 3] });
        let stats =
            cast(&self.tree, &self.mesh.triangles(), &view.camera, light.as_ref(), &self.options, pixels);
        if self.learns {
            self.visited.store(stats.nodes_visited, Relaxed);
        }
    }
}

/// Adds this project's contestants.
pub(crate) fn enter(contest: Contest, entries: &mut Vec<Entry>) {
    match contest {
        Contest::Incoherent => {
            let all = [("single", RayKind::Single), ("wide", RayKind::Wide), ("wide, batch", RayKind::Batch)];
            return all.into_iter().for_each(|(name, rays)| entries.push(of_rays(name, rays)));
        }
        Contest::Trace => entries.push(of_rays("wide", RayKind::Wide)),
        _ => {}
    }
    let rebuild = |builder| Strategy::Rebuild(builder, BuildOptions::default());
    let mut add = |name: &str, strategy: Strategy, traversal, simd| {
        let keeps_tree = !matches!(strategy, Strategy::Rebuild(..));
        // Pictures beside updates are a check, and no load.
        let learns = contest == Contest::Frame && matches!(strategy, Strategy::Auto(_));
        entries.push(Entry::new(format!("{WHO} {name}"), keeps_tree, move |triangles| {
            Ok(Box::new(Pivot { learns, ..Pivot::new(triangles, strategy, traversal, simd) }))
        }));
    };
    let best = SimdLevel::best();
    if matches!(contest, Contest::Update | Contest::Frame) {
        for strategy in strategies() {
            add(strategy.name(), strategy, Traversal::Tile, best);
        }
    }
    match contest {
        Contest::Update => {
            for period in [2, 4, 8] {
                let name = format!("{} every {period}", Strategy::RefitRotate(Rotate::default()).name());
                add(&name, Strategy::RefitRotate(Rotate { period }), Traversal::Tile, best);
            }
            for strategy in [Strategy::Refit, Strategy::RefitRotate(Rotate::default())] {
                let name = format!("{WHO} {}, leaves of 2", strategy.name());
                entries.push(Entry::new(name, true, move |triangles| {
                    let plain = Pivot::new(triangles, strategy, Traversal::Tile, best);
                    Ok(Box::new(Pivot { max_leaf_size: 2, ..plain }))
                }));
            }
        }
        Contest::Build => {
            for builder in Builder::PER_FRAME {
                add(builder.name(), rebuild(builder), Traversal::Tile, best);
            }
        }
        Contest::Trace => {
            let tree = |options| Strategy::Rebuild(Builder::Sweep, options);
            for simd in SimdLevel::available() {
                add(simd.name(), tree(leaves_of(1)), Traversal::Tile, simd);
            }
            add("leaves of 2", tree(leaves_of(2)), Traversal::Tile, best);
            add("leaves of 4", tree(leaves_of(4)), Traversal::Tile, best);
            add("published packets", tree(leaves_of(1)), Traversal::Packet, best);
            add("single", tree(leaves_of(1)), Traversal::Single, best);
        }
        Contest::Incoherent | Contest::Frame => {}
    }
}

/// One that traces rays as they come.
fn of_rays(name: &str, rays: RayKind) -> Entry {
    Entry::new(format!("{WHO} {name}"), false, move |triangles| {
        let strategy = Strategy::Rebuild(Builder::Sweep, BuildOptions::default());
        let plain = Pivot::new(triangles, strategy, Traversal::Single, SimdLevel::best());
        Ok(Box::new(Pivot { rays, ..plain }))
    })
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
