//! Motion decomposition (Günther, Friedrich, Wald, Seidel, Slusallek 2006, "Ray tracing animated
//! scenes using motion decomposition"), from its abstract and from memory.
//!
//! ```text
//! in advance   clusters of triangles that move alike (clusters.rs)
//!              for each cluster and pose the motion of the cluster: its local frame
//!              fuzzy box of a triangle: of its corners in all poses, each in the cluster's frame
//!              fuzzy tree of a cluster: a sweep over the fuzzy boxes
//! frame        refit; a sweep over the roots of the clusters, above the fuzzy trees
//! ```
//!
//! Departures: the trees are bounding volume hierarchies, not kd-trees. The renderer has one space,
//! so a ray is not taken to each cluster's frame: a fuzzy tree gives the structure, and its boxes
//! are refitted in world space, tighter than fuzzy boxes. Motions are rigid, not affine. Clusters
//! come from splits in two instead of seeds. A cluster in several places is one tree in each.

use bvh_build::{BuildError, Builder, build};
use bvh_core::{Aabb, Branch, Bvh, Node, Primitives, Triangles};
use bvh_update::refit;
use rayon::prelude::*;

use crate::clusters::Paths;
use crate::part::tree_over;

/// What is kept from one update to the next.
#[derive(Debug)]
pub(crate) struct Decomposition {
    /// Slots of the roots of the fuzzy trees.
    roots: Vec<usize>,
}

impl Decomposition {
    /// The system for an animation, and its tree with the boxes of the first pose.
    pub(crate) fn new(poses: &[Triangles<'_>]) -> Result<(Self, Bvh), BuildError> {
        let first = poses.first().ok_or(BuildError::NoPoses)?;
        for (pose, triangles) in poses.iter().enumerate() {
            if triangles.len() != first.len() {
                return Err(BuildError::PoseLength { pose, found: triangles.len(), expected: first.len() });
            }
        }
        let paths = Paths::new(poses);
        let mut clusters = paths.clusters();
        let mut is_in = vec![false; first.len()];
        clusters.iter().flatten().for_each(|&p| is_in[p as usize] = true);
        clusters.push((0..first.len() as u32).filter(|&p| !is_in[p as usize]).collect());
        clusters.retain(|cluster| !cluster.is_empty());
        let trees = clusters.par_iter().map(|cluster| fuzzy_tree(cluster, &paths, poses));
        let trees = trees.collect::<Result<Vec<_>, _>>()?;
        let parts: Vec<Part> =
            trees.iter().zip(&clusters).flat_map(|(tree, cluster)| places(tree, cluster)).collect();
        let boxes: Vec<Aabb> = parts.iter().map(|part| part.tree.nodes()[part.root].aabb()).collect();
        let (nodes, order, roots) = graft(&build(&boxes, Builder::Sweep)?, &parts);
        // Only a tree that would be too high is refused.
        let (mut bvh, roots) = match Bvh::new(&nodes, order) {
            Ok(bvh) => (bvh, roots),
            Err(_) => (build(first, Builder::Sweep)?, vec![0]),
        };
        // As many triangles as the tree was made of.
        let refitted = refit(&mut bvh, first);
        debug_assert!(refitted.is_ok());
        Ok((Self { roots }, bvh))
    }

    /// Rebuilds the tree over the roots of a refitted tree; gives how many there are.
    pub(crate) fn update(&mut self, bvh: &mut Bvh) -> Result<usize, BuildError> {
        // Another tree may have fewer nodes.
        if self.roots.len() < 2 || self.roots.iter().any(|&root| root >= bvh.nodes().len()) {
            return Ok(0);
        }
        let shape = tree_over(bvh, &self.roots, Builder::Sweep)?;
        // Only a tree that would be too high is refused.
        let Ok(slots) = bvh.rewire(&[0], &shape) else { return Ok(0) };
        self.roots.clear();
        let kept = shape.iter().zip(slots).filter(|(branch, _)| matches!(branch, Branch::Kept(_)));
        self.roots.extend(kept.map(|(_, slot)| slot));
        Ok(self.roots.len())
    }
}

/// A subtree of a cluster's fuzzy tree.
struct Part<'a> {
    tree: &'a Bvh,
    root: usize,
    cluster: &'a [u32],
}

/// A tree over the fuzzy boxes of a cluster, in its local frame.
fn fuzzy_tree(cluster: &[u32], paths: &Paths, poses: &[Triangles<'_>]) -> Result<Bvh, BuildError> {
    let motions = paths.fit(cluster);
    let fuzzy = |&p: &u32| {
        let boxes = poses.iter().zip(&motions).map(|(pose, motion)| {
            let local = pose.corners(p as usize).map(|corner| motion.undo(corner.as_dvec3()).as_vec3());
            Aabb::around(&local).sanitized()
        });
        boxes.fold(Aabb::EMPTY, Aabb::union)
    };
    build(&cluster.iter().map(fuzzy).collect::<Vec<_>>(), Builder::Sweep)
}

/// The places that a cluster is in: it is split where two subtrees have together less area than
/// their parent.
fn places<'a>(tree: &'a Bvh, cluster: &'a [u32]) -> Vec<Part<'a>> {
    let (mut parts, mut todo) = (Vec::new(), vec![0]);
    while let Some(root) = todo.pop() {
        let node = &tree.nodes()[root];
        let area = |node: &Node| node.aabb().half_area_f64();
        match tree.children(node) {
            Some([l, r]) if area(l) + area(r) < area(node) => todo.extend([node.first() + 1, node.first()]),
            _ => parts.push(Part { tree, root, cluster }),
        }
    }
    parts
}

/// Puts each part in the place of its leaf in `top`; gives nodes, order and the slots of the roots.
fn graft(top: &Bvh, parts: &[Part<'_>]) -> (Vec<Node>, Vec<u32>, Vec<usize>) {
    let (mut nodes, mut order, mut roots) = (vec![Node::NOTHING; 2], Vec::new(), Vec::new());
    let mut todo = vec![(top, None, 0, 0)];
    while let Some((tree, part, from, to)) = todo.pop() {
        let node = tree.nodes()[from];
        match (tree.primitives(&node), part) {
            (&[leaf], None) => {
                let part = &parts[leaf as usize];
                roots.push(to);
                todo.push((part.tree, Some(part.cluster), part.root, to));
            }
            (&[leaf], Some(cluster)) => {
                nodes[to] = Node::leaf(node.aabb(), order.len() as u32, 1);
                order.push(cluster[leaf as usize]);
            }
            // The tree over no triangles.
            _ if node.is_leaf() => {}
            _ => {
                let pair = nodes.len();
                nodes.extend([Node::NOTHING; 2]);
                nodes[to] = Node::inner(node.aabb(), pair as u32);
                todo.extend([1, 0].map(|i| (tree, part, node.first() + i, pair + i)));
            }
        }
    }
    (nodes, order, roots)
}

#[cfg(test)]
mod tests {
    use bvh_core::{Vec3, sah_cost};

    use super::*;
    use crate::tests::random;

    /// Bodies of 40 triangles that turn and fly off in all directions, interleaved in number.
    fn burst(bodies: usize, time: f32) -> Vec<Vec3> {
        let place = |i: usize| {
            let body = i / 3 % bodies;
            let point = |i: usize| Vec3::new(random(i, 1), random(i, 2), random(i, 3));
            let p = point(i / 3) * 2.0 + point(i);
            let home = Vec3::new(random(body, 4), random(body, 5), random(body, 6)) * 6.0;
            let (sin, cos) = (random(body, 7) * 6.0 * time).sin_cos();
            let turned = Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z);
            home * (1.0 + 9.0 * time) + turned
        };
        (0..120 * bodies).map(place).collect()
    }

    fn with_triangles<T>(positions: &[Vec<Vec3>], f: impl FnOnce(&[Triangles<'_>]) -> T) -> T {
        let indices: Vec<[u32; 3]> =
            (0..positions[0].len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let poses: Vec<_> = positions.iter().map(|p| Triangles { positions: p, indices: &indices }).collect();
        f(&poses)
    }

    /// Each body becomes a subtree, and the tree above is as good as new in a frame that is no
    /// pose: a refitted tree of any one pose is neither.
    #[test]
    fn bodies_become_subtrees_under_a_new_top_in_each_frame() {
        const BODIES: usize = 30;
        let positions: Vec<_> = [0.0, 0.5, 1.0, 0.8].map(|time| burst(BODIES, time)).into();
        with_triangles(&positions, |poses| {
            let (mut system, mut bvh) = Decomposition::new(&poses[..3]).expect("poses");
            bvh.validate(&poses[0]).expect("valid");
            assert!((BODIES..8 * BODIES).contains(&system.roots.len()), "{}", system.roots.len());
            for &root in &system.roots {
                let (mut bodies, mut todo) = (Vec::new(), vec![bvh.nodes()[root]]);
                while let Some(node) = todo.pop() {
                    bodies.extend(bvh.primitives(&node).iter().map(|p| *p as usize % BODIES));
                    todo.extend(bvh.children(&node).into_iter().flatten());
                }
                assert!(bodies.iter().all(|body| *body == bodies[0]));
            }
            for frame in [3, 0] {
                refit(&mut bvh, &poses[frame]).expect("as many");
                let refitted = sah_cost(&bvh);
                assert_eq!(system.update(&mut bvh), Ok(system.roots.len()));
                bvh.validate(&poses[frame]).expect("valid");
                let fresh = sah_cost(&build(&poses[frame], Builder::Sweep).expect("few"));
                assert!(sah_cost(&bvh) <= refitted);
                // Bodies overlap in the first frame.
                let bound = if frame == 3 { 1.1 } else { 2.0 };
                assert!(sah_cost(&bvh) < bound * fresh, "{frame}: {} {fresh}", sah_cost(&bvh));
            }
        });
    }

    /// A body turns and flies, and meanwhile its odd and even triangles part: where they will be is
    /// known only in the body's frame, over all poses.
    #[test]
    fn fuzzy_trees_know_residual_motion_in_the_frame_of_the_cluster() {
        let positions: Vec<_> = [0.0, 0.5, 1.0]
            .map(|time: f32| {
                let (sin, cos) = (2.0 * time).sin_cos();
                let part = |i: usize| if (i / 3).is_multiple_of(2) { 4.0 * time } else { -4.0 * time };
                let local = burst(1, 0.0).repeat(8).into_iter().enumerate();
                let local = local.map(|(i, p)| p + Vec3::new((i / 120) as f32, part(i), (i / 360) as f32));
                local
                    .map(|p| Vec3::new(cos * p.x - sin * p.y + 90.0 * time, sin * p.x + cos * p.y, p.z))
                    .collect()
            })
            .into();
        with_triangles(&positions, |poses| {
            let (paths, all) = (Paths::new(poses), (0..poses[0].len() as u32).collect::<Vec<_>>());
            let cost = |mut tree: Bvh| -> f64 {
                let at = |pose: &Triangles<'_>| {
                    refit(&mut tree, pose).expect("as many");
                    sah_cost(&tree)
                };
                poses.iter().map(at).sum()
            };
            let fuzzy = cost(fuzzy_tree(&all, &paths, poses).expect("few"));
            let first = cost(build(&poses[0], Builder::Sweep).expect("few"));
            let world =
                all.iter().map(|&p| poses.iter().fold(Aabb::EMPTY, |b, pose| b.union(pose.aabb(p as usize))));
            let world = cost(build(&world.collect::<Vec<_>>(), Builder::Sweep).expect("few"));
            assert!(
                fuzzy < 0.8 * first && fuzzy < 0.9 * world,
                "{fuzzy}; first pose {first}, in the world {world}"
            );
        });
    }

    #[test]
    fn hard_input_gives_valid_trees() {
        let mut broken = burst(4, 1.0);
        broken[30..60].fill(Vec3::NAN);
        let points = vec![Vec3::ONE; broken.len()];
        let huge: Vec<_> = broken.iter().map(|p| *p * 1e30).collect();
        for positions in [
            vec![vec![], vec![]],
            vec![burst(1, 0.0)[..3].to_vec(), burst(1, 1.0)[..3].to_vec()],
            vec![burst(4, 0.0), broken.clone()],
            vec![broken, burst(4, 0.0), huge],
            vec![points.clone(), points],
        ] {
            with_triangles(&positions, |poses| {
                let (mut system, mut bvh) = Decomposition::new(poses).expect("poses");
                for pose in poses {
                    refit(&mut bvh, pose).expect("as many");
                    system.update(&mut bvh).expect("few");
                    bvh.validate(pose).expect("valid");
                }
            });
        }
        assert!(Decomposition::new(&[]).is_err());
    }
}
