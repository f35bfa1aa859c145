//! Parts of a tree that are to be rewired: trees over kept subtrees, what a part costs, and paths.

use bvh_build::{BuildError, Builder, build};
use bvh_core::{Aabb, Branch, Bvh};

/// The shape that a builder gives a tree over the subtrees in these slots, each of which counts as
/// one primitive; its root is the last branch.
pub(crate) fn tree_over(bvh: &Bvh, kept: &[usize], builder: Builder) -> Result<Vec<Branch>, BuildError> {
    let boxes: Vec<Aabb> = kept.iter().map(|&n| bvh.nodes()[n].aabb()).collect();
    let top = build(&boxes, builder)?;
    let (mut order, mut place) = (Vec::new(), vec![0; top.nodes().len()]);
    top.visit(|n, _, _| {
        place[n] = order.len();
        order.push(n);
    });
    // Children in front of their parents.
    let at = |n: usize| order.len() - 1 - place[n];
    let branch = |&n: &usize| {
        let node = &top.nodes()[n];
        match top.primitives(node) {
            &[i] => Branch::Kept(kept[i as usize]),
            _ => Branch::Inner(at(node.first()), at(node.first() + 1)),
        }
    };
    Ok(order.iter().rev().map(branch).collect())
}

/// Sum of the half areas of the inner branches of a shape.
pub(crate) fn area_of(bvh: &Bvh, shape: &[Branch]) -> f64 {
    let mut boxes: Vec<Aabb> = Vec::with_capacity(shape.len());
    let mut sum = 0.0;
    for &branch in shape {
        let aabb = match branch {
            Branch::Kept(n) => bvh.nodes()[n].aabb(),
            Branch::Inner(l, r) => boxes[l].union(boxes[r]),
        };
        sum += if matches!(branch, Branch::Inner(..)) { aabb.half_area_f64() } else { 0.0 };
        boxes.push(aabb);
    }
    sum
}

/// A path continued to a child of its end.
pub(crate) fn step(path: &[usize], n: usize) -> Vec<usize> {
    path.iter().copied().chain([n]).collect()
}
