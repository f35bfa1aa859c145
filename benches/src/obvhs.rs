//! The crate obvhs: PLOC builds with reinsertion, refitting, binary and eight-wide compressed
//! traversal.

use ::obvhs::BvhBuildParams;
use ::obvhs::aabb::Aabb;
use ::obvhs::bvh2::Bvh2;
use ::obvhs::bvh2::builder::build_bvh2_from_tris;
use ::obvhs::bvh2::leaf_collapser::collapse;
use ::obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use ::obvhs::cwbvh::CwBvh;
use ::obvhs::cwbvh::builder::build_cwbvh_from_tris;
use ::obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use ::obvhs::ploc::PlocBuilder;
use ::obvhs::ray::{Ray, RayHit};
use ::obvhs::triangle::Triangle;
use bvh_core::glam::Vec3A;
use bvh_core::{Triangles, Vec3};
use rayon::prelude::*;
use rt_cpu::Hit;

use crate::contest::{Contest, Entry};
use crate::mesh::{Mesh, intersect};
use crate::sah::sah;
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// What happens to the tree.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    /// Built once, then refitted.
    Refit,
    /// Built once, then each triangle is taken out and put where the library finds a place, with
    /// its rotations on the way up.
    Move,
    /// Built each time.
    Rebuild,
    /// Built each time, and converted to eight children a node.
    Wide,
}

struct Obvhs {
    mesh: Mesh,
    mode: Mode,
    params: BvhBuildParams,
    boxes: Vec<Aabb>,
    builder: PlocBuilder,
    reinsertion: ReinsertionOptimizer,
    tree: Bvh2,
    wide: CwBvh,
    /// Corners in the order of the leaves, where tracing is what counts.
    corners: Option<Vec<[Vec3; 3]>>,
}

fn boxed(b: bvh_core::Aabb) -> Aabb {
    Aabb::new(b.min.into(), b.max.into())
}

fn unboxed(b: &Aabb) -> bvh_core::Aabb {
    bvh_core::Aabb::new(b.min.into(), b.max.into())
}

impl Obvhs {
    /// What the library's own `build_bvh2` does, with memory kept from build to build.
    fn build(&mut self) {
        let params = &self.params;
        if params.pre_split {
            let triangles = self.mesh.triangles();
            let all: Vec<Triangle> = (0..self.mesh.indices.len())
                .map(|i| triangles.corners(i).map(Vec3A::from))
                .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
                .collect();
            let mut time = std::time::Duration::default();
            if self.mode == Mode::Wide {
                self.wide = build_cwbvh_from_tris(&all, *params, &mut time);
            } else {
                self.tree = build_bvh2_from_tris(&all, *params, &mut time);
            }
            return;
        }
        self.mesh.boxes_into(&mut self.boxes, |b, _| boxed(b));
        let mut numbers = std::mem::take(&mut self.tree.primitive_indices);
        numbers.clear();
        numbers.extend(0..self.boxes.len() as u32);
        self.builder.build_with_bvh(
            &mut self.tree,
            params.ploc_search_distance,
            &self.boxes,
            numbers,
            params.sort_precision,
            params.search_depth_threshold,
        );
        self.reinsertion.run(&mut self.tree, params.reinsertion_batch_ratio, None);
        if self.mode == Mode::Wide {
            self.wide = bvh2_to_cwbvh(&self.tree, params.max_prims_per_leaf.clamp(1, 3), true, false);
            return;
        }
        collapse(&mut self.tree, params.max_prims_per_leaf.clamp(1, 255), params.collapse_traversal_cost);
        let again = params.reinsertion_batch_ratio * params.post_collapse_reinsertion_batch_ratio_multiplier;
        self.reinsertion.run(&mut self.tree, again, None);
    }

    /// Boxes of the leaves are the user's to write; the rest is the library's.
    fn refit(&mut self) {
        let mesh = &self.mesh;
        let numbers = &self.tree.primitive_indices;
        self.tree.nodes.par_iter_mut().with_min_len(4096).for_each(|node| {
            if node.is_leaf() {
                let first = node.first_index as usize;
                let leaf = &numbers[first..first + node.prim_count as usize];
                let all = leaf.iter().map(|&p| mesh.aabb(p as usize));
                node.set_aabb(boxed(all.fold(bvh_core::Aabb::EMPTY, bvh_core::Aabb::union)));
            }
        });
        self.tree.refit_all();
    }

    fn move_all(&mut self) {
        for i in 0..self.mesh.indices.len() {
            self.tree.move_primitive(boxed(self.mesh.aabb(i)), i as u32);
        }
    }

    fn numbers(&self) -> &[u32] {
        if self.mode == Mode::Wide { &self.wide.primitive_indices } else { &self.tree.primitive_indices }
    }

    /// Number and corners of what is in a leaf's slot.
    #[inline]
    fn slot(&self, slot: usize) -> (u32, [Vec3; 3]) {
        let primitive = self.numbers()[slot];
        match &self.corners {
            Some(corners) => (primitive, corners[slot]),
            None => (primitive, self.mesh.triangles().corners(primitive as usize)),
        }
    }

    fn ray(rays: &Rays, i: usize) -> Ray {
        Ray::new(rays.origin(i).into(), rays.direction(i).into(), 0.0, rays.t_max[i])
    }
}

impl Contestant for Obvhs {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        match self.mode {
            Mode::Refit if !self.tree.nodes.is_empty() => self.refit(),
            Mode::Move if !self.tree.nodes.is_empty() => self.move_all(),
            Mode::Refit => {
                self.build();
                // Refitting is then one sweep, which the library's documentation calls three times
                // as fast.
                self.tree.reorder_in_stack_traversal_order();
            }
            Mode::Move | Mode::Rebuild | Mode::Wide => self.build(),
        }
        if self.corners.is_some() {
            let triangles = self.mesh.triangles();
            let corners = self.numbers().iter().map(|&p| triangles.corners(p as usize)).collect();
            self.corners = Some(corners);
        }
        Ok(())
    }

    fn sah_cost(&self) -> Option<f64> {
        if self.mode == Mode::Wide {
            return None;
        }
        let (nodes, mut todo) = (&self.tree.nodes, vec![0]);
        let reachable = std::iter::from_fn(|| {
            let node = &nodes[todo.pop()?];
            if !node.is_leaf() {
                todo.extend([node.first_index as usize, node.first_index as usize + 1]);
            }
            Some((unboxed(node.aabb()), node.prim_count as usize))
        });
        sah(unboxed(nodes.first()?.aabb()), reachable)
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        for i in 0..rays.len() {
            let (origin, direction) = (rays.origin(i), rays.direction(i));
            let mut best: Option<Hit> = None;
            let test = |ray: &Ray, slot: usize| {
                let (primitive, corners) = self.slot(slot);
                let hit = intersect(corners, origin, direction, ray.tmax, primitive);
                if hit.is_some_and(|hit| best.is_none_or(|b| hit.t < b.t)) {
                    best = hit;
                }
                hit.map_or(f32::INFINITY, |hit| hit.t)
            };
            let mut found = RayHit::none();
            if self.mode == Mode::Wide {
                self.wide.ray_traverse(Self::ray(rays, i), &mut found, test);
            } else {
                self.tree.ray_traverse(Self::ray(rays, i), &mut found, test);
            }
            hits.set(i, best);
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            let (origin, direction) = (rays.origin(i), rays.direction(i));
            let test = |ray: &Ray, slot: usize| {
                let (primitive, corners) = self.slot(slot);
                // The library takes hits strictly before the ray's end.
                let hit = intersect(corners, origin, direction, ray.tmax, primitive);
                hit.map_or(f32::INFINITY, |_| 0.0)
            };
            *blocked = !if self.mode == Mode::Wide {
                self.wide.ray_traverse_miss(Self::ray(rays, i), test)
            } else {
                self.tree.ray_traverse_miss(Self::ray(rays, i), test)
            };
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }
}

/// Adds this library's contestants.
pub(crate) fn enter(contest: Contest, entries: &mut Vec<Entry>) {
    let (fastest, fast) = (BvhBuildParams::fastest_build(), BvhBuildParams::fast_build());
    let (medium, slow) = (BvhBuildParams::medium_build(), BvhBuildParams::slow_build());
    let mut add = |name: &str, mode, params| {
        let keeps_tree = matches!(mode, Mode::Refit | Mode::Move);
        // Corners are gathered where tracing is what counts.
        let gathers = matches!(contest, Contest::Trace | Contest::Incoherent);
        entries.push(Entry::new(format!("obvhs {name}"), keeps_tree, move |triangles| {
            Ok(Box::new(Obvhs {
                mesh: Mesh::new(triangles),
                mode,
                params,
                boxes: Vec::new(),
                builder: PlocBuilder::new(),
                reinsertion: ReinsertionOptimizer::default(),
                tree: Bvh2::default(),
                wide: CwBvh::default(),
                corners: gathers.then(Vec::new),
            }))
        }));
    };
    match contest {
        Contest::Update => {
            add("refit", Mode::Refit, medium);
            add("move", Mode::Move, BvhBuildParams { max_prims_per_leaf: 1, ..medium });
            add("ploc", Mode::Rebuild, fastest);
            add("fast", Mode::Rebuild, fast);
            add("medium", Mode::Rebuild, medium);
        }
        Contest::Build => {
            add("fastest", Mode::Rebuild, fastest);
            add("very fast", Mode::Rebuild, BvhBuildParams::very_fast_build());
            add("fast", Mode::Rebuild, fast);
            add("medium", Mode::Rebuild, medium);
            add("slow", Mode::Rebuild, slow);
        }
        Contest::Trace | Contest::Incoherent => {
            add("binary", Mode::Rebuild, medium);
            add("cwbvh", Mode::Wide, medium);
            add("binary, slow", Mode::Rebuild, slow);
            add("cwbvh, slow", Mode::Wide, slow);
        }
        Contest::Frame => {}
    }
}
