//! Larger leaves: subtrees become leaves where that costs less.

use bvh_core::{COST_INTERSECT, COST_TRAVERSE, MAX_LEAF_SIZE, Node};

/// Makes a leaf of every subtree of at most `max` primitives that the SAH finds no cheaper than one
/// leaf, and closes the gaps; gives the number of node slots still in use.
///
/// Decided from the leaves up, so it is the best of all ways to cut the tree off. `nodes` must be
/// depth first, each subtree over neighbouring slots.
pub(crate) fn merge(nodes: &mut [Node], max: u32) -> usize {
    let max = max.min(MAX_LEAF_SIZE) as usize;
    if max <= 1 {
        return nodes.len();
    }
    cut(nodes, 0, max);
    let mut used = 2;
    pack(nodes, 0, &mut used);
    used
}

/// Cost of a subtree after cutting, its first slot, and its number of primitives.
fn cut(nodes: &mut [Node], at: usize, max: usize) -> (f64, usize, usize) {
    let node = nodes[at];
    let area = node.aabb().half_area_f64();
    if node.is_leaf() {
        return (COST_INTERSECT * area * node.count() as f64, node.first(), node.count());
    }
    let (left, first, n) = cut(nodes, node.first(), max);
    let (right, _, m) = cut(nodes, node.first() + 1, max);
    let apart = COST_TRAVERSE * area + left + right;
    let together = COST_INTERSECT * area * (n + m) as f64;
    if n + m <= max && together <= apart {
        nodes[at] = Node::leaf(node.aabb(), first as u32, (n + m) as u32);
        (together, first, n + m)
    } else {
        (apart, first, n + m)
    }
}

/// Moves the pairs below a node down to `next` and on. Pairs are met in the order in which they
/// lie, so none is overwritten before it has been moved.
fn pack(nodes: &mut [Node], at: usize, next: &mut usize) {
    let node = nodes[at];
    if node.is_leaf() {
        return;
    }
    let pair = *next;
    nodes.copy_within(node.first()..node.first() + 2, pair);
    *next += 2;
    pack(nodes, pair, next);
    pack(nodes, pair + 1, next);
    nodes[at] = Node::parent(&nodes[pair], &nodes[pair + 1], pair as u32);
}

#[cfg(test)]
mod tests {
    use bvh_core::{Aabb, Bvh, Vec3, sah_cost};

    use crate::{BuildOptions, Builder, build_with};

    #[test]
    fn close_pairs_share_a_leaf_and_distant_ones_do_not() {
        let at = |x: f32| Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 1.0, 1.0));
        let boxes = [at(0.0), at(0.1), at(100.0), at(150.0)];
        let options = BuildOptions::default().with_max_leaf_size(4);
        let bvh: Bvh = build_with(&boxes[..], Builder::Sweep, &options).expect("few");
        let mut sizes = Vec::new();
        bvh.visit(|_, node, _| {
            if node.is_leaf() {
                sizes.push(node.count());
            }
        });
        assert_eq!(sizes, [2, 1, 1]);
        assert!(sah_cost(&bvh) < 4.0);
        // Together they cost 4 areas of the whole.
        let options = options.with_max_leaf_size(u32::MAX);
        let one = build_with([at(0.0); 9].as_slice(), Builder::Binned, &options).expect("few");
        assert_eq!((one.root().count(), one.nodes().len()), (9, 2));
    }
}
