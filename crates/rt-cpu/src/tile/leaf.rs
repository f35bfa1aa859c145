//! Testing the triangles of a leaf against rays that enter it.

use std::hint::black_box;

use bvh_core::triangle::intersect;
use bvh_core::{Node, Ray, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, mask32x16};

use super::context::Context;
use super::packet::{GROUP, GROUP_MASK, LANES, Packet};
use crate::simd::{bits, load, load3, max};
use crate::wide::{self, Slab, V, WideTest};

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
        let mask = mask & packet.active(at);
        if mask == 0 {
            return;
        }
        let Some(triangle) = Triangle::new::<T>(context, slot) else { continue };
        for i in (0..N).step_by(GROUP) {
            let lanes = mask >> i & GROUP_MASK;
            if lanes != 0 {
                test_group::<S, T, ANY>(context, leaf, near, &triangle, lanes, at + i, packet);
            }
        }
    }
}

/// A triangle to be tested.
struct Triangle<'a, S: Simd> {
    primitive: u32,
    corners: [&'a Vec3; 3],
    /// See [`wide::corners`].
    lanes: [[V<S>; 3]; 3],
}

impl<'a, S: Simd> Triangle<'a, S> {
    /// The triangle at a slot of a tree, unless it is not there.
    #[inline(always)]
    fn new<T: WideTest>(Context { simd, scene, octant, .. }: Context<'a, S>, slot: usize) -> Option<Self> {
        let primitive = scene.primitive(slot);
        let &[a, b, c] = scene.triangles.indices.get(primitive as usize)?;
        let positions = scene.triangles.positions;
        let corners = [positions.get(a as usize)?, positions.get(b as usize)?, positions.get(c as usize)?];
        let [a, b, c] = corners.map(single);
        Some(Self { primitive, corners, lanes: wide::corners::<S, T, _, _>(simd, octant, [a, b, c]) })
    }
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
    &Triangle { primitive, corners, ref lanes }: &Triangle<'_, S>,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    let alone = leaf.count() == 1;
    // Of the groups that reach a leaf of one, three to seven in ten hit its triangle, so a wrong
    // guess costs more than what nobody needs. On Zen 4 rays took 3 to 5 % less time through leaves
    // of one without the branches (AVX-512; 0 to 2 % with AVX2), and 1 to 6 % less through leaves
    // of up to four with them (counted and timed in trial builds of 95455d4, 2026-11-28).
    let may_end = !alone;
    let found = T::wide(simd, &packet.rays(simd, octant, at), lanes, mask, may_end);
    if found.unsure != 0 {
        test_each::<T, ANY>(octant.origin, corners, primitive, found.unsure, at, packet);
    }
    if may_end && found.lanes == 0 {
        return;
    }
    let best: V<S> = load(simd, &packet.t, at);
    // In a tree that is up to date, the box of a leaf with one triangle is the triangle's.
    let (near, lanes) = match near {
        Some(near) if alone => (near, found.lanes),
        _ => {
            let slab = if alone {
                Slab::of(simd, leaf, octant)
            } else {
                // A corner that is not finite makes the triangle's box empty.
                let [a, b, c] = corners;
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
        let hit = mask32x16::from_bitmask(simd, hit);
        write(simd, hit, V::simd_from(simd, f32::from_bits(primitive)), &mut packet.primitive, at);
        return;
    }
    let mut closer = lanes & t.simd_lt(best).to_bitmask();
    for i in bits(lanes & t.simd_eq(best).to_bitmask()) {
        closer |= u64::from(primitive < packet.primitive[at + i].to_bits()) << i;
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
