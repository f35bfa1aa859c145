//! Making nodes of eight children out of those of a binary tree.
//!
//! ```text
//! plan, from the leaves up, for each pair of siblings:
//!   how many of i children the left sibling gets, for all i
//!   what that comes to in nodes of eight and in blocks
//! fill, from the root down, for each node of eight:
//!   collect its children from the pairs
//!   its children's nodes side by side, and behind them what is below the first of them, below the second and so on
//! ```
//!
//! What is below a node has its place in the arrays before it is made, so threads share out
//! subtrees, and the arrays are the same for any number of threads.

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use arrayvec::ArrayVec;
use bvh_core::{Aabb, Bvh, Node, Primitives, Triangles};
use rayon::Scope;

use super::block::{Block, SIZE};
use super::node::{LEAF, Node8, WIDTH};

/// Height from which on the two sides of a binary node are planned at the same time: some thousand
/// nodes in a good tree.
const TALL: u32 = 14;
/// Blocks from which on subtrees are filled at the same time.
const LARGE: u32 = 512;

/// How to make the subtree below a pair of siblings into nodes of eight. Threads write plans of
/// different pairs and read them after they have met.
#[derive(Debug, Default)]
pub(super) struct Plan {
    /// Its size if it becomes a node of eight: nodes in the upper half, blocks in the lower.
    size: AtomicU64,
    /// Byte `i - 1`: how many of `i` children the left sibling gets; 0 where a node of eight is
    /// best. Byte 0: how many of that node's children.
    left: AtomicU64,
}

impl Plan {
    fn size(&self) -> Size {
        let size = self.size.load(Relaxed);
        Size { nodes: (size >> 32) as u32, blocks: size as u32 }
    }

    /// How many of up to eight children the left sibling gets.
    fn left(&self, room: usize) -> usize {
        usize::from(self.left.load(Relaxed).to_le_bytes()[room - 1])
    }
}

/// Nodes of eight, those at its top included, and blocks of a part of the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Size {
    nodes: u32,
    blocks: u32,
}

impl Size {
    /// That of some primitives.
    fn of(count: u32) -> Self {
        if count <= SIZE as u32 {
            return Self { nodes: 0, blocks: 1 };
        }
        let each = share(count);
        let rest = if count.is_multiple_of(each) { Self::default() } else { Self::of(count % each) };
        let (full, one) = (count / each, Self::of(each));
        Self { nodes: 1 + full * one.nodes + rest.nodes, blocks: full * one.blocks + rest.blocks }
    }
}

/// Primitives that a child gets of a leaf which is too large for a block: whole blocks' worth.
fn share(count: u32) -> u32 {
    count.div_ceil(WIDTH as u32).next_multiple_of(SIZE as u32)
}

/// What planning a subtree gives to the one above: entry `i - 1` is for making it into `i`
/// children.
struct Below {
    /// In units of half area.
    costs: [f32; WIDTH],
    nodes: [u32; WIDTH],
    blocks: u32,
    count: u32,
}

impl Below {
    /// Of what is one child in any case.
    fn one(area: f32, count: u32, size: Size) -> Self {
        Self { costs: [area; WIDTH], nodes: [size.nodes; WIDTH], blocks: size.blocks, count }
    }
}

/// What becomes a child of a node of eight.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// The subtree of the binary node of this number.
    Node(u32),
    /// First slot and number of slots, of a leaf or of part of one.
    Slots(u32, u32),
}

/// The parts that become one node's children, and their boxes.
type Parts = ArrayVec<(Aabb, Part), WIDTH>;

/// Where nodes and blocks go, and the numbers of the first of them.
struct Place<'a> {
    nodes: &'a mut [Node8],
    first_node: u32,
    blocks: &'a mut [Block],
    first_block: u32,
}

impl<'a> Place<'a> {
    /// Takes room for `size` off the front.
    fn take(&mut self, size: Size) -> Place<'a> {
        let nodes = self.nodes.split_off_mut(..size.nodes as usize).unwrap_or_default();
        let blocks = self.blocks.split_off_mut(..size.blocks as usize).unwrap_or_default();
        let taken = Place { nodes, blocks, ..*self };
        self.first_node += size.nodes;
        self.first_block += size.blocks;
        taken
    }
}

/// The tree that is made into another.
struct Source<'a> {
    bvh: &'a Bvh,
    triangles: &'a Triangles<'a>,
    plans: &'a [Plan],
}

/// Replaces `nodes` and `blocks` by those of `bvh`. `plans` is scratch memory.
pub(super) fn collapse(
    bvh: &Bvh,
    triangles: &Triangles<'_>,
    plans: &mut Vec<Plan>,
    nodes: &mut Vec<Node8>,
    blocks: &mut Vec<Block>,
) {
    plans.resize_with(bvh.nodes().len() / 2, Plan::default);
    let source = Source { bvh, triangles, plans };
    source.plan(bvh.root());
    let root = source.part(0);
    let size = source.size(root);
    nodes.resize(size.nodes.max(1) as usize, Node8::EMPTY);
    blocks.resize(size.blocks as usize, Block::EMPTY);
    let mut place = Place { nodes, first_node: 0, blocks, first_block: 0 };
    let top = place.take(Size { nodes: 1, blocks: 0 });
    rayon::scope(|scope| source.fill(scope, root, &mut top.nodes[0], place));
}

impl Source<'_> {
    /// Finds the cheapest way to make a subtree into up to eight children, from the bottom up.
    fn plan(&self, node: &Node) -> Below {
        let area = node.aabb().half_area();
        let Some([l, r]) = self.bvh.children(node) else {
            let count = node.count() as u32;
            return Below::one(area, count, Size::of(count));
        };
        let (l, r) = if node.height() >= TALL {
            rayon::join(|| self.plan(l), || self.plan(r))
        } else {
            (self.plan(l), self.plan(r))
        };
        let plan = &self.plans[node.first() / 2];
        let count = l.count.saturating_add(r.count);
        if count <= SIZE as u32 {
            plan.size.store(1, Relaxed);
            return Below::one(area, count, Size { nodes: 0, blocks: 1 });
        }
        // Moved right by as many places as the left sibling gets, beyond which nothing can be
        // cheapest.
        let mut moved = ([f32::INFINITY; 2 * WIDTH], [0; 2 * WIDTH]);
        moved.0[WIDTH..].copy_from_slice(&r.costs);
        moved.1[WIDTH..].copy_from_slice(&r.nodes);
        let (mut costs, mut nodes, mut left) = ([f32::INFINITY; WIDTH], [0; WIDTH], [1; WIDTH]);
        for i in 0..WIDTH {
            costs[i] = l.costs[0] + moved.0[WIDTH - 1 + i];
            nodes[i] = l.nodes[0] + moved.1[WIDTH - 1 + i];
        }
        for given in 2..WIDTH {
            for i in 0..WIDTH {
                let cost = l.costs[given - 1] + moved.0[WIDTH - given + i];
                let better = cost < costs[i];
                costs[i] = if better { cost } else { costs[i] };
                nodes[i] = if better { l.nodes[given - 1] + moved.1[WIDTH - given + i] } else { nodes[i] };
                left[i] = if better { given as u32 } else { left[i] };
            }
        }
        // Or all eight children are those of a node of its own, at the price of that node.
        let own = (costs[WIDTH - 1] + area, nodes[WIDTH - 1] + 1, left[WIDTH - 1]);
        for i in 0..WIDTH {
            let better = i == 0 || own.0 <= costs[i];
            costs[i] = if better { own.0 } else { costs[i] };
            nodes[i] = if better { own.1 } else { nodes[i] };
            left[i] = if better { 0 } else { left[i] };
        }
        left[0] = own.2;
        let blocks = l.blocks + r.blocks;
        plan.size.store(u64::from(own.1) << 32 | u64::from(blocks), Relaxed);
        plan.left.store(left.iter().rev().fold(0, |all, &l| all << 8 | u64::from(l)), Relaxed);
        Below { costs, nodes, blocks, count }
    }

    fn node(&self, n: u32) -> &Node {
        &self.bvh.nodes()[n as usize]
    }

    /// The binary node of number `n` as a part.
    fn part(&self, n: u32) -> Part {
        let node = self.node(n);
        if node.is_leaf() { Part::Slots(node.first() as u32, node.count() as u32) } else { Part::Node(n) }
    }

    fn size(&self, part: Part) -> Size {
        match part {
            Part::Node(n) => self.plans[self.node(n).first() / 2].size(),
            Part::Slots(_, count) => Size::of(count),
        }
    }

    /// Makes a part into the node of eight `to`, with what is below it at `place`.
    fn fill<'s>(&'s self, scope: &Scope<'s>, part: Part, to: &mut Node8, mut place: Place<'s>) {
        let parts = self.children(part);
        *to = Node8::EMPTY;
        let inner = parts.iter().filter(|&&(_, part)| self.size(part).nodes > 0).count();
        let mut tops = place.take(Size { nodes: inner as u32, blocks: 0 });
        for (i, (aabb, part)) in parts.into_iter().enumerate() {
            let size = self.size(part);
            if size.nodes > 0 {
                to.set(i, &aabb, tops.first_node);
                let top = tops.take(Size { nodes: 1, blocks: 0 });
                let at = place.take(Size { nodes: size.nodes - 1, ..size });
                if size.blocks >= LARGE {
                    scope.spawn(move |scope| self.fill(scope, part, &mut top.nodes[0], at));
                } else {
                    self.fill(scope, part, &mut top.nodes[0], at);
                }
            } else {
                let at = place.take(size);
                let mut few = ArrayVec::new();
                self.primitives(part, &mut few);
                at.blocks[0] = Block::new(self.triangles, &few);
                if !at.blocks[0].is_empty() {
                    to.set(i, &aabb, LEAF | at.first_block);
                }
            }
        }
    }

    /// The children of a part as a node of eight.
    fn children(&self, part: Part) -> Parts {
        let mut parts = Parts::new();
        match part {
            Part::Node(n) if self.size(part).nodes > 0 => {
                self.collect(n, self.plans[self.node(n).first() / 2].left(1), WIDTH, &mut parts);
            }
            Part::Slots(first, count) if count > SIZE as u32 => {
                let order = &self.bvh.order()[first as usize..(first + count) as usize];
                for (i, order) in order.chunks(share(count) as usize).enumerate() {
                    let there = order.iter().filter(|&&p| (p as usize) < self.triangles.len());
                    let aabb = there.fold(Aabb::EMPTY, |b, &p| b.union(self.triangles.aabb(p as usize)));
                    parts.push((aabb, Part::Slots(first + i as u32 * share(count), order.len() as u32)));
                }
            }
            // Only the root may be as small as that.
            _ => parts.push((self.bvh.root().aabb(), part)),
        }
        parts
    }

    /// Collects the parts, `room` at most, that the binary node of number `n` is made into, `left`
    /// of them from its left child; it is one itself if that is 0.
    fn collect(&self, n: u32, left: usize, room: usize, parts: &mut Parts) {
        let pair = self.node(n).first() as u32;
        if left == 0 {
            return parts.push((self.node(n).aabb(), self.part(n)));
        }
        for (n, room) in [(pair, left), (pair + 1, room - left)] {
            let node = self.node(n);
            let may = room > 1 && !node.is_leaf() && self.size(Part::Node(n)).nodes > 0;
            let left = if may { self.plans[node.first() / 2].left(room) } else { 0 };
            self.collect(n, left, room, parts);
        }
    }

    /// The primitives of what fits into a block.
    fn primitives(&self, part: Part, few: &mut ArrayVec<u32, SIZE>) {
        match part {
            Part::Node(n) => {
                let pair = self.node(n).first() as u32;
                [pair, pair + 1].into_iter().for_each(|n| self.primitives(self.part(n), few));
            }
            Part::Slots(first, count) => {
                few.extend(self.bvh.order()[first as usize..(first + count) as usize].iter().copied());
            }
        }
    }
}
