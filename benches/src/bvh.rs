//! The crate bvh: SAH rebuilds, and removing and adding shapes that moved.

use ::bvh::aabb::{Aabb, Bounded};
use ::bvh::bounding_hierarchy::BHShape;
use ::bvh::bvh::{Bvh, BvhNode, rayon_executor};
use bvh_core::{Ray, Triangles, Vec3};
use nalgebra::Point3;
use rt_cpu::Hit;

use crate::contest::{Contest, Entry};
use crate::mesh::{Mesh, intersect};
use crate::sah::sah;
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// A triangle as the library knows it.
#[derive(Clone, Copy)]
struct Shape {
    aabb: Aabb<f32, 3>,
    node: usize,
}

impl Bounded<f32, 3> for Shape {
    fn aabb(&self) -> Aabb<f32, 3> {
        self.aabb
    }
}

impl BHShape<f32, 3> for Shape {
    fn set_bh_node_index(&mut self, node: usize) {
        self.node = node;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

struct Contender {
    mesh: Mesh,
    shapes: Vec<Shape>,
    tree: Bvh<f32, 3>,
}

fn boxed(b: bvh_core::Aabb) -> Aabb<f32, 3> {
    Aabb::with_bounds(Point3::from(b.min.to_array()), Point3::from(b.max.to_array()))
}

fn unboxed(b: &Aabb<f32, 3>) -> bvh_core::Aabb {
    bvh_core::Aabb::new(Vec3::from_slice(b.min.coords.as_slice()), Vec3::from_slice(b.max.coords.as_slice()))
}

impl Contender {
    /// The closest hit, or with `ANY` the first that is found, near children first. The library's
    /// own traversals list all boxes along a ray and do not get shorter with a hit, so its tree is
    /// walked here, with a stack that is made once for many rays.
    fn hit<const ANY: bool>(&self, stack: &mut Vec<(f32, usize)>, ray: &Ray, mut t_max: f32) -> Option<Hit> {
        let (triangles, mut best) = (self.mesh.triangles(), None);
        stack.clear();
        stack.push((0.0, 0));
        while let Some((near, mut n)) = stack.pop() {
            if near > t_max {
                continue;
            }
            loop {
                match self.tree.nodes.get(n) {
                    None => return best,
                    Some(BvhNode::Leaf { shape_index: p, .. }) => {
                        let (origin, direction) = (ray.origin(), ray.direction());
                        let hit = intersect(triangles.corners(*p), origin, direction, t_max, *p as u32);
                        if let Some(hit) = hit {
                            (best, t_max) = (Some(hit), hit.t);
                            if ANY {
                                return best;
                            }
                        }
                        break;
                    }
                    Some(BvhNode::Node {
                        child_l_index, child_l_aabb, child_r_index, child_r_aabb, ..
                    }) => {
                        let l = ray.enters(&unboxed(child_l_aabb), t_max);
                        let r = ray.enters(&unboxed(child_r_aabb), t_max);
                        match (l, r) {
                            (Some(l), Some(r)) if r < l => {
                                stack.push((l, *child_l_index));
                                n = *child_r_index;
                            }
                            (Some(_), Some(r)) => {
                                stack.push((r, *child_r_index));
                                n = *child_l_index;
                            }
                            (Some(_), None) => n = *child_l_index,
                            (None, Some(_)) => n = *child_r_index,
                            (None, None) => break,
                        }
                    }
                }
            }
        }
        best
    }
}

impl Contestant for Contender {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        self.mesh.boxes_into(&mut self.shapes, |b, _| Shape { aabb: boxed(b), node: 0 });
        self.tree = if rayon::current_num_threads() == 1 {
            Bvh::build(&mut self.shapes)
        } else {
            Bvh::build_with_executor(&mut self.shapes, rayon_executor)
        };
        Ok(())
    }

    fn sah_cost(&self) -> Option<f64> {
        let all = self.shapes.iter().map(|s| unboxed(&s.aabb));
        let root = all.fold(bvh_core::Aabb::EMPTY, bvh_core::Aabb::union);
        let mut nodes = vec![(root, usize::from(self.shapes.len() == 1))];
        for node in &self.tree.nodes {
            if let BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } = node {
                for (child, aabb) in [(*child_l_index, child_l_aabb), (*child_r_index, child_r_aabb)] {
                    nodes.push((unboxed(aabb), usize::from(self.tree.nodes[child].is_leaf())));
                }
            }
        }
        sah(root, nodes)
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let mut stack = Vec::with_capacity(64);
        for i in 0..rays.len() {
            hits.set(i, self.hit::<false>(&mut stack, &rays.ray(i), rays.t_max[i]));
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let mut stack = Vec::with_capacity(64);
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            *blocked = self.hit::<true>(&mut stack, &rays.ray(i), rays.t_max[i]).is_some();
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }
}

/// Adds this library's contestant. There is one way to build; its updates remove and add shapes one
/// by one, which is meant for scenes where few move.
pub(crate) fn enter(contest: Contest, entries: &mut Vec<Entry>) {
    let name = if contest == Contest::Update { "bvh rebuild" } else { "bvh" };
    if contest == Contest::Frame {
        return;
    }
    entries.push(Entry::new(name, false, |triangles| {
        let tree = Bvh { nodes: Vec::new() };
        Ok(Box::new(Contender { mesh: Mesh::new(triangles), shapes: Vec::new(), tree }))
    }));
}
