//! The crate parry3d: refitting, incremental optimisation, binned and PLOC rebuilds.

use bvh_core::{Triangles, Vec3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace, TraversalAction};
use parry3d::query::Ray;

use crate::contest::{Contest, Entry};
use crate::mesh::{Mesh, intersect};
use crate::sah::sah;
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// What happens to the tree; all but the last keep the tree.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    /// Leaves written one by one, then `refit`, which also lays out the nodes again.
    Refit,
    /// The same with `refit_without_opt`, which leaves nodes where they are: what
    /// `TriMesh::update_vertices` does.
    RefitInPlace,
    /// `refit`, then `optimize_incremental`, which rebuilds a few subtrees.
    Optimize,
    /// A new tree.
    Rebuild(BvhBuildStrategy),
}

struct Parry {
    mesh: Mesh,
    mode: Mode,
    boxes: Vec<Aabb>,
    updates: Vec<(Aabb, u32, f32)>,
    statuses: Vec<parry3d::partitioning::BvhLeafUpdateStatus>,
    workspace: BvhWorkspace,
    tree: Bvh,
}

fn vector(v: Vec3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn boxed(b: bvh_core::Aabb) -> Aabb {
    Aabb::new(vector(b.min), vector(b.max))
}

fn unboxed(b: Aabb) -> bvh_core::Aabb {
    bvh_core::Aabb::new(Vec3::from_array(b.mins.into()), Vec3::from_array(b.maxs.into()))
}

impl Parry {
    fn build(&mut self, strategy: BvhBuildStrategy) {
        self.mesh.boxes_into(&mut self.boxes, |b, _| boxed(b));
        self.tree = Bvh::from_leaves(strategy, &self.boxes);
    }

    fn refit(&mut self) {
        let is_serial = rayon::current_num_threads() == 1;
        if is_serial {
            for i in 0..self.mesh.indices.len() {
                let aabb = boxed(self.mesh.aabb(i));
                self.tree.insert_or_update_partially(aabb, i as u32, 0.0);
            }
        } else {
            self.mesh.boxes_into(&mut self.updates, |b, i| (boxed(b), i, 0.0));
            self.tree.insert_or_update_batch_partially_parallel(&self.updates, &mut self.statuses);
        }
        match (self.mode, is_serial) {
            (Mode::RefitInPlace, _) => self.tree.refit_without_opt(),
            (_, true) => self.tree.refit(&mut self.workspace),
            (_, false) => self.tree.refit_parallel(&mut self.workspace),
        }
        if self.mode == Mode::Optimize {
            self.tree.optimize_incremental(&mut self.workspace);
        }
    }
}

impl Contestant for Parry {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        match self.mode {
            Mode::Rebuild(strategy) => self.build(strategy),
            _ if self.tree.is_empty() => self.build(BvhBuildStrategy::Binned),
            _ => self.refit(),
        }
        Ok(())
    }

    fn sah_cost(&self) -> Option<f64> {
        let root = unboxed(self.tree.root_aabb());
        // The root itself is not visited.
        let mut nodes = vec![(root, usize::from(self.tree.leaf_count() == 1))];
        self.tree.traverse(|node| {
            nodes.push((unboxed(node.aabb()), usize::from(node.is_leaf())));
            TraversalAction::Continue
        });
        sah(root, nodes)
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let triangles = self.mesh.triangles();
        for i in 0..rays.len() {
            let (origin, direction) = (rays.origin(i), rays.direction(i));
            let ray = Ray::new(vector(origin), vector(direction));
            let test = |primitive: u32, t_max: f32| {
                intersect(triangles.corners(primitive as usize), origin, direction, t_max, primitive)
            };
            let found = self.tree.cast_ray(&ray, rays.t_max[i].min(f32::MAX), |p, t| Some(test(p, t)?.t));
            // The library keeps only `t` and the number.
            hits.set(i, found.and_then(|(primitive, _)| test(primitive, rays.t_max[i])));
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let triangles = self.mesh.triangles();
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            let (origin, direction) = (rays.origin(i), rays.direction(i));
            let ray = Ray::new(vector(origin), vector(direction));
            // There is no query for any hit; a hit at 0 makes all that is left too far.
            let hit = self.tree.cast_ray(&ray, rays.t_max[i].min(f32::MAX), |p, t| {
                intersect(triangles.corners(p as usize), origin, direction, t, p).map(|_| 0.0)
            });
            *blocked = hit.is_some();
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }
}

/// Adds this library's contestants.
pub(crate) fn enter(contest: Contest, entries: &mut Vec<Entry>) {
    let mut add = |name: &str, mode: Mode| {
        let keeps_tree = !matches!(mode, Mode::Rebuild(_));
        entries.push(Entry::new(format!("parry {name}"), keeps_tree, move |triangles| {
            Ok(Box::new(Parry {
                mesh: Mesh::new(triangles),
                mode,
                boxes: Vec::new(),
                updates: Vec::new(),
                statuses: Vec::new(),
                workspace: BvhWorkspace::default(),
                tree: Bvh::new(),
            }))
        }));
    };
    let (binned, ploc) = (Mode::Rebuild(BvhBuildStrategy::Binned), Mode::Rebuild(BvhBuildStrategy::Ploc));
    match contest {
        Contest::Update => {
            add("refit", Mode::Refit);
            add("refit in place", Mode::RefitInPlace);
            add("optimise", Mode::Optimize);
            add("binned", binned);
        }
        Contest::Build => {
            add("binned", binned);
            add("ploc", ploc);
        }
        Contest::Trace | Contest::Incoherent => add("ploc", ploc),
        Contest::Frame => {}
    }
}
