//! Tests of making a tree from nodes: heights, memory, order, and the reason why malformed nodes
//! are refused.

use super::*;
use crate::{Aabb, Malformed, Vec3};

pub(crate) const BOX: Aabb = Aabb::new(Vec3::ZERO, Vec3::ONE);

/// Root over an inner node (children at 4) and a leaf.
pub(crate) fn three() -> [Node; 6] {
    [
        Node::inner(BOX, 2),
        Node::NOTHING,
        Node::inner(BOX, 4),
        Node::leaf(BOX, 2, 1),
        Node::leaf(BOX, 0, 1),
        Node::leaf(BOX, 1, 1),
    ]
}

#[test]
fn heights_of_a_valid_tree_are_computed() {
    let bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
    assert_eq!((bvh.height(), bvh.nodes()[2].height(), bvh.nodes()[3].height()), (2, 1, 0));
    assert_eq!(bvh.primitives(&bvh.nodes()[4]), [2]);
    assert!(!bvh.is_in_order());
    assert!(bvh.primitives(bvh.root()).is_empty());
    assert_eq!(bvh.nodes().as_ptr().addr() % 64, 0);
}

#[test]
fn leaf_heights_and_unused_slots_are_reset() {
    let mut nodes = [three().as_slice(), &[Node::inner(BOX, 2), Node::leaf(BOX, 0, 1)]].concat();
    nodes[1] = Node::inner(BOX, 100);
    // A leaf of height 2, as safe code can make one.
    let (l, r) = (Node::parent(&nodes[4], &nodes[5], 4), nodes[4]);
    nodes[3].refit(&l, &r);
    nodes[3].set_aabb(BOX);
    assert_eq!(nodes[3].height(), 2);
    let bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
    assert_eq!((bvh.height(), bvh.nodes()[3]), (2, Node::leaf(BOX, 2, 1)));
    assert_eq!([1, 6, 7].map(|n| bvh.nodes()[n]), [Node::NOTHING; 3]);
}

#[test]
fn trees_know_whether_their_leaves_have_one_primitive_each() {
    let tree = |nodes: &[Node], n| Bvh::new(nodes, (0..n).collect()).expect("valid");
    let pair = |l, r| tree(&[Node::inner(BOX, 2), Node::NOTHING, l, r], 2);
    let leaf = |first, count| Node::leaf(BOX, first, count);
    let unused = [leaf(0, 2); 2];
    let of_one = [
        Bvh::default(),
        tree(&[leaf(0, 1), Node::NOTHING], 1),
        tree(&three(), 3),
        tree(&[three().as_slice(), &unused].concat(), 3),
        pair(leaf(0, 1), leaf(1, 1)),
        // A leaf without primitives is nothing.
        tree(&[three()[0], Node::NOTHING, three()[2], leaf(2, 0), leaf(0, 1), leaf(1, 1)], 2),
    ];
    let others = [tree(&[leaf(0, 2), Node::NOTHING], 2), pair(leaf(0, 2), leaf(2, 0))];
    assert!(of_one.iter().all(Bvh::has_leaves_of_one) && !others.iter().any(Bvh::has_leaves_of_one));
    let mut copy = others[0].clone();
    assert!(!copy.has_leaves_of_one());
    copy.clone_from(&of_one[1]);
    assert!(copy.has_leaves_of_one());
}

#[test]
fn boxes_that_are_not_finite_are_empty() {
    let mut nodes = three();
    nodes[4].set_aabb(Aabb { min: Vec3::NAN, max: Vec3::ONE });
    let mut bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
    assert_eq!(bvh.nodes()[4].aabb(), Aabb::EMPTY);
    bvh.set_dynamic(|_| false);
    assert!(bvh.static_area().is_finite());
}

#[test]
fn replace_with_reuses_memory_and_empties_the_tree_on_panic() {
    let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
    let rebuild = |bvh: &mut Bvh, fill: fn(&mut Vec<Pair>, &mut Vec<u32>)| {
        // SAFETY: what is written is a tree.
        #[expect(unsafe_code, reason = "writes a tree by hand")]
        unsafe {
            bvh.replace_with(fill);
        }
    };
    let memory = bvh.nodes().as_ptr();
    rebuild(&mut bvh, |pairs, order| {
        pairs.truncate(1);
        pairs[0].0[0] = Node::leaf(BOX, 0, 2);
        order.truncate(2);
        order.copy_from_slice(&[1, 0]);
    });
    let fresh = Bvh::new(&[Node::leaf(BOX, 0, 2), Node::NOTHING], vec![1, 0]).expect("valid");
    assert_eq!((bvh.root(), bvh.order(), bvh.is_in_order()), (fresh.root(), fresh.order(), false));
    assert_eq!(bvh.nodes().as_ptr(), memory);
    let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        rebuild(&mut bvh, |pairs, _| {
            pairs[0].0[0] = Node::inner(BOX, 100);
            panic!("half way");
        });
    }));
    assert!(caught.is_err());
    assert_eq!((bvh.nodes(), bvh.len()), (&[Node::NOTHING; 2][..], 0));
}

#[test]
fn clone_from_copies_everything_into_the_memory_there_is() {
    let mut from = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
    from.set_dynamic(|p| p == 1);
    from.update_state.words[3] = 7;
    let mut to = Bvh::new(&[three().as_slice(), &[Node::NOTHING; 2]].concat(), vec![0, 1, 2]).expect("valid");
    let memory = (to.nodes().as_ptr(), to.order().as_ptr());
    to.clone_from(&from);
    assert_eq!((to.nodes(), to.order()), (from.nodes(), from.order()));
    assert_eq!((to.nodes().as_ptr(), to.order().as_ptr()), memory);
    assert_eq!((to.is_in_order(), to.all_dynamic()), (false, false));
    assert!(to.static_area() == from.static_area() && to.static_area() > 0.0);
    assert!(to.update_state() == from.update_state());
}

#[test]
fn malformed_trees_are_refused_with_the_reason() {
    let with = |i: usize, node| {
        let mut nodes = three();
        nodes[i] = node;
        Bvh::new(&nodes, vec![0, 1, 2]).map(|_| ()).expect_err("malformed")
    };
    assert_eq!(with(2, Node::inner(BOX, 2)), Malformed::SharedChild(2));
    assert_eq!(with(2, Node::inner(BOX, 0)), Malformed::ChildOutOfRange { node: 2, child: 0 });
    assert_eq!(with(2, Node::inner(BOX, 6)), Malformed::ChildOutOfRange { node: 2, child: 6 });
    assert_eq!(with(3, Node::leaf(BOX, 0, 1)), Malformed::LeafSlots(3));
    assert_eq!(with(3, Node::leaf(BOX, 2, 9)), Malformed::LeafSlots(3));
    assert_eq!(with(3, Node::leaf(BOX, 2, 0)), Malformed::UncoveredSlots(1));
    assert_eq!(Bvh::new(&three(), vec![0, 1, 1]).unwrap_err(), Malformed::Order(2));
    assert_eq!(Bvh::new(&three(), vec![0, 1, 3]).unwrap_err(), Malformed::Order(2));
    assert_eq!(Bvh::new(&three()[..5], vec![]).unwrap_err(), Malformed::NodeCount(5));
    assert_eq!(Bvh::new(&[], vec![]).unwrap_err(), Malformed::NodeCount(0));
}

#[test]
fn pairs_may_lie_in_any_order_and_unused() {
    let nodes = [
        Node::inner(BOX, 6),
        Node::NOTHING,
        Node::leaf(BOX, 0, 1),
        Node::leaf(BOX, 1, 1),
        Node::inner(BOX, 2),
        Node::inner(BOX, 2),
        Node::leaf(BOX, 2, 1),
        Node::inner(BOX, 2),
    ];
    let bvh = Bvh::new(&nodes, vec![2, 0, 1]).expect("valid");
    assert_eq!((bvh.height(), bvh.nodes()[6].height(), bvh.nodes()[7].height()), (2, 0, 1));
    // A pair below itself.
    let ring = [Node::inner(BOX, 2), Node::NOTHING, Node::inner(BOX, 2), Node::leaf(BOX, 0, 1)];
    assert_eq!(Bvh::new(&ring, vec![0]).unwrap_err(), Malformed::SharedChild(2));
}

#[test]
fn a_chain_beyond_the_bound_is_refused() {
    let chain = |height: usize| {
        let mut nodes = vec![Node::inner(BOX, 2), Node::NOTHING];
        for i in 1..=height {
            let deeper = Node::inner(BOX, 2 * i as u32 + 2);
            let last = Node::leaf(BOX, height as u32, 1);
            nodes.push(Node::leaf(BOX, i as u32 - 1, 1));
            nodes.push(if i < height { deeper } else { last });
        }
        Bvh::new(&nodes, (0..=height as u32).collect())
    };
    assert_eq!(chain(MAX_HEIGHT as usize).map(|b| b.height()), Ok(MAX_HEIGHT));
    assert_eq!(chain(97).map(|b| b.height()), Err(Malformed::TooHigh(97)));
}

#[test]
fn reordering_keeps_the_leaves_and_gives_the_old_numbers() {
    let mut bvh = Bvh::new(&three(), vec![2, 0, 1]).expect("valid");
    assert_eq!(bvh.reorder_primitives(), [2, 0, 1]);
    assert!(bvh.is_in_order());
    assert_eq!(bvh.order(), [0, 1, 2]);
}

#[test]
fn the_fingerprint_depends_on_nodes_and_order() {
    let a = Bvh::new(&three(), vec![0, 1, 2]).expect("valid");
    let b = Bvh::new(&three(), vec![0, 2, 1]).expect("valid");
    let mut c = a.clone();
    assert_eq!(a.fingerprint(), c.fingerprint());
    c.set_dynamic(|p| p == 0);
    assert!(a.fingerprint() != b.fingerprint() && a.fingerprint() != c.fingerprint());
}

/// Updates do not visit such leaves.
#[test]
fn a_leaf_without_primitives_has_no_box() {
    let nodes = [Node::parent(&Node::leaf(BOX, 0, 1), &Node::leaf(BOX, 1, 0), 2), Node::NOTHING];
    let nodes = [&nodes[..], &[Node::leaf(BOX, 0, 1), Node::leaf(BOX, 1, 0)]].concat();
    let mut bvh = Bvh::new(&nodes, vec![0]).expect("a tree");
    bvh.set_dynamic(|_| true);
    assert!(bvh.nodes()[3].aabb().is_empty());
    bvh.validate(&[BOX]).expect("tight");
}

/// Nor do they visit the nodes above.
#[test]
fn a_node_over_nothing_has_no_box() {
    let nodes = [Node::inner(BOX, 2), Node::NOTHING, Node::leaf(BOX, 0, 1), Node::inner(BOX, 4)];
    let bvh = Bvh::new(&[&nodes[..], &[Node::NOTHING; 2]].concat(), vec![0]).expect("a tree");
    assert!(bvh.nodes()[3].aabb().is_empty());
    bvh.validate(&[BOX]).expect("tight");
}
