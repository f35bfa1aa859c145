//! Boxes of a tree: which to draw, in what colour, and where they are in a picture.

use bvh_core::glam::Mat3;
use bvh_core::{Aabb, Bvh, Node, Vec3};
use rt_cpu::Camera;

use crate::canvas::{Canvas, Color, Rect};

/// What a ray that hits a node costs in the first tree, in node visits and triangle tests: the mean
/// over the nodes with 2^i to 2^(i+1) - 1 triangles below.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TypicalCost([f32; 32]);

/// Number of primitives below a node, and the sum of [`Node::sah_term`] there.
type Below = (usize, f64);

impl TypicalCost {
    /// Takes the means of a tree. O(n).
    pub(crate) fn of(tree: &Bvh) -> Self {
        let mut sums = [(0.0, 0.0); 32];
        below(tree, tree.root(), &mut |node, (count, cost)| {
            let area = node.aabb().half_area_f64();
            if area > 0.0 {
                let sum = &mut sums[class(count)];
                *sum = (sum.0 + cost / area, sum.1 + 1.0);
            }
        });
        Self(sums.map(|(sum, count)| if count > 0.0 { (sum / count) as f32 } else { 0.0 }))
    }

    /// How many times as much a ray that hits a node costs as in the first tree; 1 where that says
    /// nothing.
    fn growth(&self, node: &Node, (count, cost): Below) -> f32 {
        let (area, typical) = (node.aabb().half_area_f64(), self.0[class(count)]);
        if area > 0.0 && typical > 0.0 { (cost / area) as f32 / typical } else { 1.0 }
    }
}

fn class(count: usize) -> usize {
    count.max(1).ilog2().min(31) as usize
}

/// What is below a node; calls `f` with every node on the way, children first. As deep as the tree
/// is high.
fn below(tree: &Bvh, node: &Node, f: &mut impl FnMut(&Node, Below)) -> Below {
    let sum = match tree.children(node) {
        Some([l, r]) => {
            let (l, r) = (below(tree, l, f), below(tree, r, f));
            (l.0 + r.0, l.1 + r.1 + node.sah_term())
        }
        None => (node.count(), node.sah_term()),
    };
    f(node, sum);
    sum
}

/// The boxes at a depth below the root, and the leaves above it, each with the growth of its cost.
/// O(n).
pub(crate) fn at_depth(tree: &Bvh, depth: u32, typical: &TypicalCost) -> Vec<(Aabb, f32)> {
    let mut nodes = vec![tree.root()];
    for _ in 0..depth {
        let children = |node| tree.children(node).map_or(vec![node], |pair| pair.iter().collect());
        nodes = nodes.into_iter().flat_map(children).collect();
    }
    let with_growth = |node: &Node| {
        let sum = below(tree, node, &mut |_, _| {});
        (node.aabb(), typical.growth(node, sum))
    };
    use rayon::prelude::*;
    nodes.into_par_iter().map(with_growth).collect()
}

/// The nodes from the root to the leaf of a primitive; empty if the tree has no such primitive.
pub(crate) fn path(tree: &Bvh, primitive: u32, aabb: &Aabb) -> Vec<Aabb> {
    fn find(tree: &Bvh, node: &Node, primitive: u32, aabb: &Aabb, path: &mut Vec<Aabb>) -> bool {
        if !node.aabb().contains(aabb) {
            return false;
        }
        path.push(node.aabb());
        let found = match tree.children(node) {
            Some(pair) => pair.iter().any(|child| find(tree, child, primitive, aabb, path)),
            None => tree.primitives(node).contains(&primitive),
        };
        if !found {
            path.pop();
        }
        found
    }
    let mut path = Vec::new();
    find(tree, tree.root(), primitive, aabb, &mut path);
    path
}

/// Where each node leads, so that a later look shows which nodes have changed places.
pub(crate) fn links(tree: &Bvh) -> Vec<u32> {
    tree.nodes().iter().map(link).collect()
}

fn link(node: &Node) -> u32 {
    (node.first() as u32) << 1 | u32::from(node.is_leaf())
}

/// Boxes of the nodes that have changed places since `before`, at most `most`, the largest.
pub(crate) fn rotated(tree: &Bvh, before: &[u32], most: usize) -> Vec<Aabb> {
    let changed = tree.nodes().iter().zip(before).filter(|&(node, &before)| link(node) != before);
    let mut boxes: Vec<Aabb> = changed.map(|(node, _)| node.aabb()).collect();
    if boxes.len() > most {
        boxes.select_nth_unstable_by(most, |a, b| b.half_area().total_cmp(&a.half_area()));
        boxes.truncate(most);
    }
    boxes
}

/// Green for a cost as in the first tree, over yellow to red for four times that.
pub(crate) fn growth_color(growth: f32) -> Color {
    let x = (growth.max(1e-3).log2() / 2.0).clamp(0.0, 1.0);
    [(510.0 * x).min(255.0) as u8, (510.0 * (1.0 - x)).min(220.0) as u8, 40]
}

/// From points in the scene to pixels, as a camera sees them.
pub(crate) struct Projection {
    eye: Vec3,
    to_pixels: Mat3,
    clip: Rect,
}

impl Projection {
    /// The projection onto the part `clip` of a canvas, which is of the camera's size.
    pub(crate) fn new(camera: &Camera, clip: Rect) -> Self {
        let &Camera { eye, corner, right, down, .. } = camera;
        Self { eye, to_pixels: Mat3::from_cols(right, down, corner).inverse(), clip }
    }

    /// Draws the edges of a box.
    pub(crate) fn draw(&self, canvas: &mut Canvas, aabb: &Aabb, color: Color, alpha: f32) {
        let corner = |i: usize| {
            let end = |k: usize| if i >> k & 1 == 0 { aabb.min[k] } else { aabb.max[k] };
            self.to_pixels * (Vec3::new(end(0), end(1), end(2)) - self.eye)
        };
        for i in 0..8 {
            for bit in [1, 2, 4].into_iter().filter(|bit| i & bit == 0) {
                self.line(canvas, corner(i), corner(i | bit), color, alpha);
            }
        }
    }

    /// Draws a line between points whose third coordinate is depth.
    fn line(&self, canvas: &mut Canvas, mut a: Vec3, mut b: Vec3, color: Color, alpha: f32) {
        const NEAR: f32 = 1e-3;
        if a.z > b.z {
            std::mem::swap(&mut a, &mut b);
        }
        // Not so for NaN either.
        if !(b.z > NEAR && a.is_finite() && b.is_finite()) {
            return;
        }
        if a.z < NEAR {
            a = a.lerp(b, (NEAR - a.z) / (b.z - a.z));
        }
        let pixel = |p: Vec3| [p.x / p.z + self.clip.x as f32, p.y / p.z + self.clip.y as f32];
        canvas.line(pixel(a), pixel(b), self.clip, color, alpha);
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};

    use super::*;

    fn boxes(time: f32) -> Vec<Aabb> {
        let corner =
            |i: usize| Vec3::new(i as f32 + time * (i * 7 % 64) as f32, (i % 5) as f32, (i % 3) as f32);
        (0..64).map(|i| Aabb::new(corner(i), corner(i) + Vec3::ONE)).collect()
    }

    #[test]
    fn boxes_that_are_dragged_apart_show_growth() {
        let mut tree = build(&boxes(0.0), Builder::Sweep).expect("few");
        let typical = TypicalCost::of(&tree);
        let mean = |tree: &Bvh| {
            let boxes = at_depth(tree, 2, &typical);
            assert_eq!(boxes.len(), 4);
            boxes.iter().map(|(_, growth)| growth).sum::<f32>() / 4.0
        };
        assert!((mean(&tree) - 1.0).abs() < 0.01, "alone in its class, each is typical");
        bvh_update::refit(&mut tree, &boxes(20.0)).expect("same count");
        assert!(mean(&tree) > 1.3, "{}", mean(&tree));
    }

    #[test]
    fn paths_lead_from_the_root_to_the_leaf() {
        let boxes = boxes(0.0);
        let tree = build(&boxes, Builder::Sweep).expect("few");
        for (p, aabb) in boxes.iter().enumerate() {
            let path = path(&tree, p as u32, aabb);
            assert!(path.len() > 1 && path[0] == tree.root().aabb() && path.last().unwrap().contains(aabb));
            assert!(path.windows(2).all(|pair| pair[0].contains(&pair[1])));
        }
        assert!(path(&tree, 99, &boxes[0]).is_empty());
    }

    #[test]
    fn only_nodes_that_changed_places_are_rotated() {
        let mut tree = build(&boxes(0.0), Builder::Sweep).expect("few");
        let before = links(&tree);
        bvh_update::refit(&mut tree, &boxes(1.0)).expect("same count");
        assert!(rotated(&tree, &before, 99).is_empty());
        let update = bvh_update::refit_and_rotate(&mut tree, &boxes(1.0)).expect("same count");
        let changed = rotated(&tree, &before, 99);
        assert!(update.rotations_applied() > 0 && !changed.is_empty());
        let largest = changed.iter().map(Aabb::half_area).fold(0.0, f32::max);
        assert_eq!(rotated(&tree, &before, 1).iter().map(Aabb::half_area).collect::<Vec<_>>(), [largest]);
    }

    #[test]
    fn points_lie_where_the_camera_sees_them() {
        let camera = Camera::look_at(Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, Vec3::Y, 0.8, 40, 30);
        let clip = Rect { x: 0, y: 0, width: 40, height: 30 };
        let projection = Projection::new(&camera, clip);
        let mut canvas = Canvas::new(40, 30);
        canvas.rgba.fill(0);
        let point = camera.eye + camera.ray(11, 17).direction() * 3.0;
        projection.draw(&mut canvas, &Aabb::new(point, point), [255; 3], 1.0);
        let lit: Vec<_> = (0..1200).filter(|i| canvas.rgba[4 * i] > 0).map(|i| (i % 40, i / 40)).collect();
        assert_eq!(lit, [(11, 17)]);
        // Behind the eye, around it, and not finite.
        let behind = camera.eye * 2.0;
        canvas.rgba.fill(0);
        for aabb in [Aabb::new(behind, behind), Aabb::EMPTY, Aabb { min: Vec3::NAN, max: Vec3::ONE }] {
            projection.draw(&mut canvas, &aabb, [255; 3], 1.0);
        }
        assert!(canvas.rgba.iter().all(|&c| c == 0));
    }
}
