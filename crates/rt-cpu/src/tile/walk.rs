//! Walking a subtree with the rays of a packet, and with those of one group.

use bvh_core::{Node, Primitives, Triangles, Vec3, prefetch};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use super::Scratch;
use super::packet::{GROUP, GROUP_MASK, LANES, PACKET, Packet};
use crate::scene::{Scene, Work};
use crate::simd::{bits, load, max};
use crate::wide::{RayOctant, Slab, V, WideTest};

/// Walks the subtree at `root` with the rays in `mask`, one of which goes along `along`.
#[inline(always)]
pub(super) fn walk<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    octant: &RayOctant,
    along: Vec3,
    root: u32,
    mask: u64,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let nodes = scene.bvh.nodes();
    let mut top = 0;
    let mut n = root as usize;
    let mut mask = enter(simd, &scratch.packet, &nodes[n], octant, mask & scratch.packet.active(0));
    if nodes[n].is_leaf() {
        let packet = &mut scratch.packet;
        return test_leaf::<S, T, ANY, PACKET>(simd, scene, octant, &nodes[n], mask, 0, packet);
    }
    loop {
        if mask == 0 {
            // Another ray's hit came in between.
        } else if let Some((at, lanes)) = scratch.packet.group_of::<S, ANY>(simd, mask) {
            walk_group::<S, T, ANY>(simd, scene, octant, n, lanes, at, scratch, work);
            if at == PACKET {
                scratch.packet.scatter::<ANY>(mask);
            }
        } else {
            let (first, children) = open(scene, &nodes[n], work);
            let met = scratch.planes.meets(simd, children);
            let mut entered = [0; 2];
            for (side, child) in children.iter().enumerate() {
                if met >> side & 1 != 0 {
                    entered[side] = enter(simd, &scratch.packet, child, octant, mask);
                }
            }
            for (side, child) in children.iter().enumerate() {
                if entered[side] != 0 && child.is_leaf() {
                    let packet = &mut scratch.packet;
                    test_leaf::<S, T, ANY, PACKET>(simd, scene, octant, child, entered[side], 0, packet);
                    entered[side] = 0;
                }
            }
            let [l, r] = children;
            let step = (r.aabb().min + r.aabb().max) - (l.aabb().min + l.aabb().max);
            let near = usize::from(step.dot(along) < 0.0);
            if entered[near] != 0 {
                if entered[1 - near] != 0 {
                    scratch.stack[top] = ((first + 1 - near) as u32, entered[1 - near]);
                    top += 1;
                }
                (n, mask) = (first + near, entered[near] & scratch.packet.active(0));
                continue;
            }
            if entered[1 - near] != 0 {
                (n, mask) = (first + 1 - near, entered[1 - near] & scratch.packet.active(0));
                continue;
            }
        }
        if top == 0 {
            return;
        }
        top -= 1;
        (n, mask) = (scratch.stack[top].0 as usize, scratch.stack[top].1 & scratch.packet.active(0));
        if !ANY {
            scratch.look_up_to_farthest(simd);
        }
    }
}

/// The children of an inner node and the number of the first; what visiting them will need is asked for.
#[inline(always)]
fn open<'a>(scene: Scene<'a>, node: &Node, work: &mut Work) -> (usize, &'a [Node; 2]) {
    work.nodes += 1;
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

/// Asks for the pairs behind that of a node's children, which trees in depth-first order visit next, if rays enter it.
///
/// Six pairs save 1 to 6 % of the time of primary and shadow rays, three pairs about two thirds of that.
#[inline(always)]
fn fetch_subtree(nodes: &[Node], node: &Node, mask: u64) {
    if mask != 0 && !node.is_leaf() {
        (1..=6).for_each(|i| prefetch(nodes, node.first() + 2 * i));
    }
}

/// The rays in `mask` that enter a node's box.
#[inline(always)]
fn enter<S: Simd>(simd: S, packet: &Packet, node: &Node, octant: &RayOctant, mask: u64) -> u64 {
    let slab = Slab::of(simd, node, octant);
    let mut entered = 0;
    for at in (0..PACKET).step_by(GROUP) {
        if mask >> at & GROUP_MASK != 0 {
            let (_, lanes) = slab.enter(simd, packet.inverse(simd, at), packet.t(simd, at));
            entered |= lanes.to_bitmask() << at;
        }
    }
    entered & mask
}

/// Walks the subtree at an inner node with rays of the group at `at`, all of which enter it.
#[inline(always)]
fn walk_group<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    octant: &RayOctant,
    root: usize,
    mask: u64,
    at: usize,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let nodes = scene.bvh.nodes();
    let packet = &mut scratch.packet;
    let inverse = packet.inverse(simd, at);
    let mut top = 0;
    let (mut n, mut mask) = (root, mask);
    loop {
        let (first, [l, r]) = open(scene, &nodes[n], work);
        let t = packet.t(simd, at);
        let (tl, ml) = Slab::of(simd, l, octant).enter(simd, inverse, t);
        let (tr, mr) = Slab::of(simd, r, octant).enter(simd, inverse, t);
        let (mut ml, mut mr) = (ml.to_bitmask() & mask, mr.to_bitmask() & mask);
        if ml != 0 && l.is_leaf() {
            test_leaf::<S, T, ANY, GROUP>(simd, scene, octant, l, ml, at, packet);
            ml = 0;
        }
        if mr != 0 && r.is_leaf() {
            test_leaf::<S, T, ANY, GROUP>(simd, scene, octant, r, mr, at, packet);
            mr = 0;
        }
        fetch_subtree(nodes, l, ml);
        fetch_subtree(nodes, r, mr);
        if ANY {
            (ml, mr) = (ml & packet.active(at), mr & packet.active(at));
        }
        if ml != 0 && mr != 0 {
            // The child that more of the rays which enter both enter first.
            let both = ml & mr;
            let left = (tl.simd_le(tr).to_bitmask() & both).count_ones();
            let right_first = 2 * left < both.count_ones();
            let (near, far) = if right_first { (mr, (ml, tl)) } else { (ml, (mr, tr)) };
            scratch.group_stack[top] = ((first + usize::from(!right_first)) as u32, far.0);
            far.1.store_slice(&mut scratch.group_near[top]);
            top += 1;
            (n, mask) = (first + usize::from(right_first), near);
            continue;
        }
        if ml | mr != 0 {
            (n, mask) = (first + usize::from(ml == 0), ml | mr);
            continue;
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            let near = V::from_slice(simd, &scratch.group_near[top]);
            let ahead = near.simd_le(packet.t(simd, at)).to_bitmask() & packet.active(at);
            (n, mask) = (scratch.group_stack[top].0 as usize, scratch.group_stack[top].1 & ahead);
            if mask != 0 {
                break;
            }
        }
    }
}

/// Tests the triangles of a leaf against `N` rays from `at` on, those in `mask`.
#[inline(always)]
fn test_leaf<S: Simd, T: WideTest, const ANY: bool, const N: usize>(
    simd: S,
    scene: Scene<'_>,
    octant: &RayOctant,
    leaf: &Node,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    for slot in leaf.first()..leaf.first() + leaf.count() {
        let p = scene.primitive(slot);
        let mask = mask & packet.active(at);
        if ANY && mask == 0 {
            return;
        }
        let Some(corners) = corners(scene.triangles, p) else { continue };
        for i in (0..N).step_by(GROUP) {
            let lanes = mask >> i & GROUP_MASK;
            if lanes != 0 {
                test_group::<S, T, ANY>(simd, octant, corners, p, lanes, at + i, packet);
            }
        }
    }
}

/// The corners of a triangle, unless it is not there.
#[inline(always)]
fn corners<'a>(triangles: &Triangles<'a>, i: u32) -> Option<[&'a Vec3; 3]> {
    let &[a, b, c] = triangles.indices.get(i as usize)?;
    let positions = triangles.positions;
    Some([positions.get(a as usize)?, positions.get(b as usize)?, positions.get(c as usize)?])
}

/// Tests one triangle against the lanes `mask` of the group at `at`.
#[inline(always)]
fn test_group<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    octant: &RayOctant,
    corners: [&Vec3; 3],
    primitive: u32,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    let found = T::wide(simd, &packet.rays(simd, octant.axes[2], at), corners, octant, mask);
    if found.lanes == 0 {
        return;
    }
    let best = packet.t(simd, at);
    let [&a, &b, &c] = corners;
    // A corner that is not finite makes the triangle's box empty.
    if (a * 0.0 + b * 0.0) + c * 0.0 != Vec3::ZERO {
        return;
    }
    let (near, inside) = Slab::around(simd, &[a, b, c], octant).enter(simd, packet.inverse(simd, at), best);
    let t = max(found.t, near);
    let lanes = found.lanes & inside.to_bitmask();
    if ANY {
        let hit = lanes & t.simd_le(best).to_bitmask();
        packet.end(at, hit);
        packet.note_hits(at, hit);
        for i in bits(hit) {
            packet.primitive[at + i] = f32::from_bits(primitive);
        }
        return;
    }
    let mut closer = lanes & t.simd_lt(best).to_bitmask();
    for i in bits(lanes & t.simd_eq(best).to_bitmask()) {
        closer |= u64::from(primitive < packet.primitive[at + i].to_bits()) << i;
    }
    if closer == 0 {
        return;
    }
    packet.note_hits(at, closer);
    let closer = fearless_simd::mask32x16::from_bitmask(simd, closer);
    write(simd, closer, t, &mut packet.t, at);
    write(simd, closer, found.u, &mut packet.u, at);
    write(simd, closer, found.v, &mut packet.v, at);
    write(simd, closer, V::simd_from(simd, f32::from_bits(primitive)), &mut packet.primitive, at);
}

/// Replaces the lanes in `mask`.
#[inline(always)]
fn write<S: Simd>(simd: S, mask: fearless_simd::mask32x16<S>, new: V<S>, to: &mut [f32; LANES], at: usize) {
    mask.select(new, load(simd, to, at)).store_slice(&mut to[at..at + GROUP]);
}
