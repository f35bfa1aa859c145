//! Nodes in depth-first order: pairs lie behind their parents, subtrees together.

use bvh_core::Node;

/// Moves the pairs of a tree into depth-first order, left before right, from node 2 on, and sets
/// the rest to [`Node::NOTHING`]. Leaves keep their slots. O(n); `spare` is memory to use.
pub(crate) fn depth_first(nodes: &mut [Node], spare: &mut Vec<Node>) {
    spare.clear();
    spare.resize(nodes.len(), Node::NOTHING);
    spare[0] = nodes[0];
    let mut used = 2;
    let mut todo = vec![0];
    while let Some(n) = todo.pop() {
        let node: Node = spare[n];
        if node.is_leaf() {
            continue;
        }
        let (l, r) = (nodes[node.first()], nodes[node.first() + 1]);
        (spare[used], spare[used + 1]) = (l, r);
        spare[n] = Node::parent(&l, &r, used as u32);
        spare[n].set_aabb(node.aabb());
        spare[n].set_reference(node.reference());
        todo.extend([used + 1, used]);
        used += 2;
    }
    nodes.copy_from_slice(spare);
}

/// Gives the leaves of a tree in depth-first order their slots in that order, each of one
/// primitive.
pub(crate) fn slots_in_order(nodes: &mut [Node], order: &mut [u32]) {
    let before = order.to_vec();
    let mut todo = vec![0];
    let mut next = 0;
    while let Some(n) = todo.pop() {
        let node = nodes[n];
        if node.is_leaf() {
            order[next] = before[node.first()];
            nodes[n] = Node::leaf(node.aabb(), next as u32, 1);
            next += 1;
        } else {
            todo.extend([node.first() + 1, node.first()]);
        }
    }
}
