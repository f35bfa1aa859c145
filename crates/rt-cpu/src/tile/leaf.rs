//! Testing the triangles of a leaf against rays that enter it.

use std::hint::black_box;

use bvh_core::triangle::intersect;
use bvh_core::{Node, Ray, Triangles, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, mask32x16};

use super::Context;
use super::packet::{GROUP, GROUP_MASK, LANES, Packet};
use crate::simd::{bits, load, load3, max};
use crate::wide::{Slab, V, WideTest};

/// Tests the triangles of a leaf against those of the `N` rays from `at` on that are in `mask`:
/// they enter its box, at `near` if that is known.
#[inline(always)]
pub(super) fn test_leaf<S: Simd, T: WideTest, const ANY: bool, const N: usize>(
    context: Context<'_, S>,
    leaf: &Node,
    near: Option<V<S>>,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    for slot in leaf.first()..leaf.first() + leaf.count() {
        let p = context.scene.primitive(slot);
        let mask = mask & packet.active(at);
        if mask == 0 {
            return;
        }
        let Some(corners) = corners(context.scene.triangles, p) else { continue };
        for i in (0..N).step_by(GROUP) {
            let lanes = mask >> i & GROUP_MASK;
            if lanes != 0 {
                test_group::<S, T, ANY>(context, leaf, near, corners, p, lanes, at + i, packet);
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

/// Coordinates that are the same in all lanes.
#[inline(always)]
fn single(corner: &Vec3) -> &[[f32; 1]; 3] {
    let coordinates: &[f32; 3] = corner.as_ref();
    bytemuck::cast_ref(coordinates)
}

/// Tests one triangle against the lanes `mask` of the group at `at`.
#[inline(always)]
fn test_group<S: Simd, T: WideTest, const ANY: bool>(
    Context { simd, octant, .. }: Context<'_, S>,
    leaf: &Node,
    near: Option<V<S>>,
    corners: [&Vec3; 3],
    primitive: u32,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    let [a, b, c] = corners;
    let found = T::wide(simd, &packet.rays(simd, octant, at), [single(a), single(b), single(c)], mask);
    if found.unsure != 0 {
        test_each::<T, ANY>(octant.origin, corners, primitive, found.unsure, at, packet);
    }
    if found.lanes == 0 {
        return;
    }
    let best: V<S> = load(simd, &packet.t, at);
    // In a tree that is up to date, the box of a leaf with one triangle is the triangle's.
    let alone = leaf.count() == 1;
    let (near, lanes) = match near {
        Some(near) if alone => (near, found.lanes),
        _ => {
            let slab = if alone {
                Slab::of(simd, leaf, octant)
            } else {
                // A corner that is not finite makes the triangle's box empty.
                if (*a * 0.0 + *b * 0.0) + *c * 0.0 != Vec3::ZERO {
                    return;
                }
                Slab::around(simd, &[*a, *b, *c], octant)
            };
            let (near, inside) = slab.enter(load3(simd, &packet.inverse, at), best);
            (near, found.lanes & inside.to_bitmask())
        }
    };
    let t = max(found.t, near);
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
    let closer = mask32x16::from_bitmask(simd, closer);
    write(simd, closer, t, &mut packet.t, at);
    write(simd, closer, found.u, &mut packet.u, at);
    write(simd, closer, found.v, &mut packet.v, at);
    write(simd, closer, V::simd_from(simd, f32::from_bits(primitive)), &mut packet.primitive, at);
}

/// Replaces the lanes in `mask`.
#[inline(always)]
fn write<S: Simd>(simd: S, mask: mask32x16<S>, new: V<S>, to: &mut [f32; LANES], at: usize) {
    let mut old: V<S> = load(simd, to, at);
    if S::f32s::LEN == 8 {
        // Else the compiler stores with AVX2's masks, for which AMD's processors take many cycles:
        // primary rays took 8 to 15 % longer on Zen 4 (`compare trace`, row `pivot avx2`).
        old = black_box(old);
    }
    mask.select(new, old).store_slice(&mut to[at..at + GROUP]);
}

/// Tests one triangle against the lanes `mask` of the group at `at`, one by one.
#[cold]
#[inline(never)]
fn test_each<T: WideTest, const ANY: bool>(
    origin: Vec3,
    corners: [&Vec3; 3],
    primitive: u32,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    for i in bits(mask) {
        let lane = at + i;
        let [x, y, z] = [0, 1, 2].map(|k| packet.direction[k][lane]);
        let ray = Ray::new(origin, Vec3::new(x, y, z));
        let best = packet.t[lane];
        let hit = intersect(&ray, &T::new(&ray), &corners.map(|&c| c), primitive, best);
        let Some(hit) = hit.filter(|h| ANY || h.is_before(best, packet.primitive[lane].to_bits())) else {
            continue;
        };
        if ANY {
            packet.end(at, 1 << i);
        }
        packet.note_hits(at, 1 << i);
        (packet.t[lane], packet.u[lane], packet.v[lane]) = (hit.t, hit.u, hit.v);
        packet.primitive[lane] = f32::from_bits(primitive);
    }
}
