//! Walking a subtree with the rays of a packet, and with those of one group.

use std::hint::black_box;

use bvh_core::{Node, Primitives, Vec3, prefetch};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use super::context::{Context, Scratch};
use super::leaf::test_leaf;
use super::packet::{GROUP, Packet};
use crate::frustum::Sides;
use crate::scene::Scene;
use crate::simd::{load, load3, vectorize};
use crate::wave::PACKET;
use crate::wide::{RayOctant, Slab, V, WideTest};

/// Inner nodes of a subtree that rays of several groups visit before the packet's frustum is
/// tested, too: good trees do without it, through bad ones of dragon, museum and lion it saves 3 to
/// 19 % of the time, as much after 2, 8 or 16 nodes (`docs/BENCHMARKS.md`, bad trees).
const NODES_BEFORE_FRUSTUM: u32 = 4;

/// Walks the subtree at `root` with the rays in `mask`.
#[inline(always)]
pub(super) fn walk<S: Simd, T: WideTest, const ANY: bool>(
    context: Context<'_, S>,
    root: u32,
    mask: u64,
    scratch: &mut Scratch,
) {
    let Context { simd, scene, octant, .. } = context;
    let nodes = scene.bvh.nodes();
    let (mut top, mut visited) = (0, 0);
    let mut n = root as usize;
    let whole = std::array::from_ref(&nodes[n]);
    let [mut mask] = enter(simd, &scratch.packet, whole, octant, mask & scratch.packet.active(0));
    if nodes[n].is_leaf() {
        return test_leaf::<S, T, ANY, PACKET>(context, &nodes[n], None, mask, 0, &mut scratch.packet);
    }
    loop {
        if mask == 0 {
            // No ray enters the root, or those that were put off have hit something since.
        } else if let Some((at, lanes)) = scratch.packet.group_of::<S, ANY>(simd, mask) {
            walk_group::<S, T, ANY>(context, n, lanes, at, scratch);
            if at == PACKET {
                scratch.packet.scatter::<ANY>(mask);
            }
        } else {
            scratch.nodes += 1;
            let (first, children) = open(scene, &nodes[n]);
            visited += 1;
            let mut entered = if visited <= NODES_BEFORE_FRUSTUM {
                enter(simd, &scratch.packet, children, octant, mask)
            } else {
                enter_met(context, scratch, children, mask)
            };
            for (rays, child) in entered.iter_mut().zip(children) {
                if *rays != 0 && child.is_leaf() {
                    test_leaf::<S, T, ANY, PACKET>(context, child, None, *rays, 0, &mut scratch.packet);
                    *rays = 0;
                }
            }
            let active = scratch.packet.active(0);
            let entered = [entered[0] & active, entered[1] & active];
            let [near, far] = near_and_far(children, first, octant.along, entered);
            if far.1 != 0 {
                scratch.stack[top] = far;
                top += 1;
            }
            if near.1 != 0 {
                (n, mask) = (near.0 as usize, near.1);
                continue;
            }
        }
        if top == 0 {
            return;
        }
        top -= 1;
        (n, mask) = (scratch.stack[top].0 as usize, scratch.stack[top].1 & scratch.packet.active(0));
    }
}

/// The two children, numbered from `first` on, each with the mask of the rays that enter it: first
/// the one to visit now, then the one to put off. If rays enter only one, that comes first and the
/// other's mask is 0; if rays enter both, the nearer along `along` comes first.
///
/// Branches on purpose: what is guessed right is fetched while boxes are still tested, which saves
/// 4 to 6 % of the time of primary and shadow rays (`compare trace`, row `pivot avx512`). The
/// compiler would sooner compute which child comes next; `black_box` keeps it from that.
#[inline(always)]
fn near_and_far(children: &[Node; 2], first: usize, along: Vec3, [l, r]: [u64; 2]) -> [(u32, u64); 2] {
    let (left, right) = ((first as u32, l), (first as u32 + 1, r));
    if l == 0 {
        black_box(());
        return [right, left];
    }
    if r == 0 {
        black_box(());
        return [left, right];
    }
    let [l, r] = children;
    let step = (r.aabb().min + r.aabb().max) - (l.aabb().min + l.aabb().max);
    if step.dot(along) < 0.0 {
        black_box(());
        return [right, left];
    }
    [left, right]
}

/// The children of an inner node and the number of the first; what visiting them will need is asked
/// for.
#[inline(always)]
fn open<'a>(scene: Scene<'a>, node: &Node) -> (usize, &'a [Node; 2]) {
    let first = node.first();
    let children = scene.bvh.children(node).unwrap_or(&[Node::NOTHING; 2]);
    fetch(scene, &children[0]);
    fetch(scene, &children[1]);
    (first, children)
}

/// Asks for what visiting a node will need first.
#[inline(always)]
fn fetch(scene: Scene<'_>, node: &Node) {
    if node.is_leaf() {
        scene.triangles.prefetch_data(scene.primitive(node.first()) as usize);
    } else {
        prefetch(scene.bvh.nodes(), node.first());
    }
}

/// Asks for the pairs behind that of a node's children, which trees in depth-first order visit
/// next, if rays enter it.
///
/// Six pairs save 1 to 6 % of the time of primary and shadow rays, three pairs about two thirds of
/// that.
#[inline(always)]
fn fetch_subtree(nodes: &[Node], node: &Node, mask: u64) {
    if mask != 0 && !node.is_leaf() {
        (1..=6).for_each(|i| prefetch(nodes, node.first() + 2 * i));
    }
}

/// The rays in `mask` that enter the boxes of these nodes.
#[inline(always)]
fn enter<S: Simd, const N: usize>(
    simd: S,
    packet: &Packet,
    nodes: &[Node; N],
    octant: &RayOctant,
    mask: u64,
) -> [u64; N] {
    // Kernels do without `array::map`: see `simd`.
    let mut slabs = [Slab::<S, S::f32s>::of(simd, &nodes[0], octant); N];
    for (slab, node) in slabs.iter_mut().zip(nodes).skip(1) {
        *slab = Slab::of(simd, node, octant);
    }
    let mut entered = [0; N];
    for at in (0..PACKET).step_by(S::f32s::LEN) {
        let group = mask >> at & ((1 << S::f32s::LEN) - 1);
        if group == 0 {
            continue;
        }
        let (inverse, t) = (load3(simd, &packet.inverse, at), load(simd, &packet.t, at));
        for (entered, slab) in entered.iter_mut().zip(&slabs) {
            *entered |= (slab.enter(inverse, t).1.to_bitmask() & group) << at;
        }
    }
    entered
}

/// As [`enter`], after a test of the packet's frustum against both boxes.
///
/// Out of line: with this in its loop good trees' rays took 2 to 6 % longer (the yardstick's
/// scenes, trial builds of 42be85f, Zen 4, 2026-11-28).
#[cold]
#[inline(never)]
fn enter_met<S: Simd>(
    Context { simd, octant, frustum, .. }: Context<'_, S>,
    Scratch { packet, sides, .. }: &mut Scratch,
    siblings: &[Node; 2],
    mask: u64,
) -> [u64; 2] {
    if let Some((frame, frustum)) = frustum.filter(|_| sides.are_unknown()) {
        *sides = Sides::new(frame, frustum);
    }
    vectorize!(simd, {
        let (met, mut entered) = (sides.meet(simd, siblings), [0; 2]);
        for (side, node) in siblings.iter().enumerate() {
            if met >> side & 1 == 1 {
                [entered[side]] = enter(simd, packet, std::array::from_ref(node), octant, mask);
            }
        }
        entered
    })
}

/// Walks the subtree at an inner node with rays of the group at `at`, all of which enter it.
#[inline(always)]
fn walk_group<S: Simd, T: WideTest, const ANY: bool>(
    context: Context<'_, S>,
    root: usize,
    mask: u64,
    at: usize,
    scratch: &mut Scratch,
) {
    let Context { simd, scene, octant, .. } = context;
    let nodes = scene.bvh.nodes();
    let packet = &mut scratch.packet;
    let inverse: [V<S>; 3] = load3(simd, &packet.inverse, at);
    let mut top = 0;
    let (mut n, mut mask) = (root, mask);
    loop {
        scratch.nodes += 1;
        let (first, children) = open(scene, &nodes[n]);
        let [l, r] = children;
        let t = load(simd, &packet.t, at);
        let (tl, ml) = Slab::of(simd, l, octant).enter(inverse, t);
        let (tr, mr) = Slab::of(simd, r, octant).enter(inverse, t);
        let (mut ml, mut mr) = (ml.to_bitmask() & mask, mr.to_bitmask() & mask);
        if ml != 0 && l.is_leaf() {
            test_leaf::<S, T, ANY, GROUP>(context, l, Some(tl), ml, at, packet);
            ml = 0;
        }
        if mr != 0 && r.is_leaf() {
            test_leaf::<S, T, ANY, GROUP>(context, r, Some(tr), mr, at, packet);
            mr = 0;
        }
        fetch_subtree(nodes, l, ml);
        fetch_subtree(nodes, r, mr);
        if ANY {
            (ml, mr) = (ml & packet.active(at), mr & packet.active(at));
        }
        let [near, far] = near_and_far(children, first, octant.along, [ml, mr]);
        if far.1 != 0 {
            scratch.group_stack[top] = far;
            top += 1;
        }
        if near.1 != 0 {
            (n, mask) = (near.0 as usize, near.1);
            continue;
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            (n, mask) = (scratch.group_stack[top].0 as usize, scratch.group_stack[top].1 & packet.active(at));
            if mask != 0 {
                break;
            }
        }
    }
}
