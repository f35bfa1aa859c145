//! Trees at the greatest height: whatever would make them higher is left undone.

use bvh_core::{Aabb, Bvh, MAX_HEIGHT, Node, SimdLevel, Vec3};
use bvh_update::{Decision, PartialRebuild, Rotate, Strategy, Updater, plain};

/// A box of side 1.
fn at(x: f32) -> Aabb {
    Aabb::new(Vec3::X * x, Vec3::X * x + 1.0)
}

/// A tree under construction; leaves hold the primitives in the order in which they come.
struct Nodes {
    nodes: Vec<Node>,
    boxes: Vec<Aabb>,
}

impl Nodes {
    fn new() -> Self {
        Self { nodes: vec![Node::NOTHING; 2], boxes: Vec::new() }
    }

    fn leaf(&mut self, aabb: Aabb) -> Node {
        self.boxes.push(aabb);
        Node::leaf(aabb, self.boxes.len() as u32 - 1, 1)
    }

    fn parent(&mut self, l: Node, r: Node) -> Node {
        self.nodes.extend([l, r]);
        Node::parent(&l, &r, self.nodes.len() as u32 - 2)
    }

    /// `levels` parents above `end`, each with one more box, at the origin.
    fn chain(&mut self, end: Node, levels: u32) -> Node {
        (0..levels).fold(end, |rest, _| {
            let side = self.leaf(at(0.0));
            self.parent(side, rest)
        })
    }

    fn tree(mut self, root: Node) -> (Bvh, Vec<Aabb>) {
        self.nodes[0] = root;
        let order = (0..self.boxes.len() as u32).collect();
        (Bvh::new(&self.nodes, order).expect("a tree"), self.boxes)
    }
}

/// Beside a chain stands a pair of a near and a far box, and it would pay to push the chain down in
/// exchange for the far one.
#[test]
fn rotations_keep_to_the_bound_as_those_of_the_plain_pass() {
    let rotate = Rotate::default();
    for (above, below) in [(0, MAX_HEIGHT - 1), (0, MAX_HEIGHT - 2), (50, MAX_HEIGHT - 51)] {
        let mut nodes = Nodes::new();
        let end = nodes.leaf(at(0.0));
        let chain = nodes.chain(end, below);
        let (far, near) = (nodes.leaf(at(1000.0)), nodes.leaf(at(0.0)));
        let pair = nodes.parent(far, near);
        let node = nodes.parent(pair, chain);
        let root = nodes.chain(node, above);
        let (start, boxes) = nodes.tree(root);
        let mut expected = start.clone();
        let applied = plain::update(&mut expected, &boxes, Some(rotate));
        assert!(above > 0 || applied.iter().sum::<u64>() == u64::from(start.height() < MAX_HEIGHT));
        assert_eq!(expected.height(), MAX_HEIGHT);
        for level in SimdLevel::available() {
            let (mut bvh, mut updater) =
                (start.clone(), Updater::with_level(Strategy::RefitRotate(rotate), level));
            let done = updater.update(&mut bvh, &boxes).expect("same count");
            bvh.validate(&boxes).expect("valid");
            assert_eq!((bvh.fingerprint(), done.rotations), (expected.fingerprint(), applied), "{level}");
        }
    }
}

/// A high chain stays as it is, while what is beside it spreads out so far that the best tree above
/// is high, too.
#[test]
fn a_repair_that_would_be_too_high_is_a_rebuild() {
    const CLUSTERS: usize = 20;
    const SIZE: usize = 10;
    let play = |height: u32| {
        let mut nodes = Nodes::new();
        let end = nodes.leaf(at(0.0));
        let chain = nodes.chain(end, height);
        let mut beside = nodes.leaf(at(0.0));
        for cluster in 1..=CLUSTERS {
            let mut all = nodes.leaf(at(cluster as f32));
            for _ in 1..SIZE {
                let one = nodes.leaf(at(cluster as f32));
                all = nodes.parent(one, all);
            }
            beside = nodes.parent(all, beside);
        }
        let root = nodes.parent(beside, chain);
        let (mut bvh, mut boxes) = nodes.tree(root);
        let partial = PartialRebuild::default().with_rotate(None);
        let mut updater = Updater::new(Strategy::PartialRebuild(partial));
        updater.update(&mut bvh, &boxes).expect("same count");
        for (i, aabb) in boxes[height as usize + 2..].iter_mut().enumerate() {
            *aabb = at(16f32.powi((i / SIZE * 7 % CLUSTERS) as i32));
        }
        let done = updater.update(&mut bvh, &boxes).expect("same count");
        bvh.validate(&boxes).expect("valid");
        done.decision
    };
    assert!(matches!(play(40), Decision::PartialRebuild { .. }));
    assert!(matches!(play(78), Decision::Rebuild { .. }));
}
