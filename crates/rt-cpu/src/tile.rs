//! Rays of a tile of 32 x 32 pixels: the scheme of [`packet`](crate::packet), reworked.
//!
//! ```text
//! cut: open the largest node of the tree's top that the whole tile's beam meets, until there are 48 subtrees
//! for each packet of 64 rays, for each subtree in the cut that the packet's beam meets, front to back:
//!   at a node, with a mask of the rays that entered its parent:
//!     mask of the rays that enter, if any -> go down
//!     few of them                         -> gather these and go down with one set of vectors,
//!                                            testing both children at once
//!   at a leaf, test the rays in the mask
//! ```
//!
//! Departures from Wald, Boulos and Shirley 2007: masks in place of first active rays; beams of slopes in place
//! of interval arithmetic on reciprocals, so that rays may go both ways along two axes; the cut, which
//! shares the top of the tree among 16 packets (in the spirit of Reshetov, Soupikov and Hurley,
//! *Multi-Level Ray Tracing Algorithm*, 2005); gathering, so that rays which have drifted apart cost what
//! they would in small packets.

mod cut;

use bvh_core::{Bvh, MAX_HEIGHT, Node, Triangles, Vec3, prefetch};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use self::cut::Cut;
use crate::beam::{Beam, Frame};
use crate::bundle::{Bundle, Hits, RAYS};
use crate::packet::Query;
use crate::simd::{Lanes, bits, load, load3, max, min};
use crate::single::Work;
use crate::wide::{Corners, Rays, Slab, WideTest};

/// Rays of a packet.
const PACKET: usize = 64;

/// Rays that are gathered once no more are left.
const FEW: usize = 16;

/// Rays in a form to be tested, with their best hits so far.
#[repr(C, align(64))]
struct Packet<const N: usize> {
    direction: [[f32; N]; 3],
    inverse: [[f32; N]; 3],
    shear: [[f32; N]; 2],
    t: [f32; N],
    u: [f32; N],
    v: [f32; N],
    /// Bits of the numbers of primitives, to be moved about in the same registers.
    primitive: [f32; N],
    /// Masks of the rays that are longest along each axis.
    axes: [u64; 3],
    /// Mask of the rays that still look for a hit.
    active: u64,
}

impl<const N: usize> Packet<N> {
    fn new() -> Self {
        let zero = [0.0; N];
        Self {
            direction: [zero; 3],
            inverse: [zero; 3],
            shear: [zero; 2],
            t: zero,
            u: zero,
            v: zero,
            primitive: zero,
            axes: [0; 3],
            active: 0,
        }
    }

    #[inline(always)]
    fn rays<S: Simd, V: Lanes<S>>(&self, simd: S, at: usize) -> Rays<V> {
        Rays {
            direction: load3(simd, &self.direction, at),
            inverse: load3(simd, &self.inverse, at),
            shear: [load(simd, &self.shear[0], at), load(simd, &self.shear[1], at)],
        }
    }

    #[inline(always)]
    fn t<S: Simd, V: Lanes<S>>(&self, simd: S, at: usize) -> V {
        load(simd, &self.t, at)
    }
}

/// What is needed again and again; a tile's worth of it.
pub(crate) struct Scratch {
    packet: Packet<PACKET>,
    few: Packet<FEW>,
    stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    few_stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    few_near: [[f32; FEW]; MAX_HEIGHT as usize + 1],
    cut: Cut,
}

impl Scratch {
    pub(crate) fn new() -> Self {
        Self {
            packet: Packet::new(),
            few: Packet::new(),
            stack: [(0, 0); MAX_HEIGHT as usize + 1],
            few_stack: [(0, 0); MAX_HEIGHT as usize + 1],
            few_near: [[0.0; FEW]; MAX_HEIGHT as usize + 1],
            cut: Cut::new(),
        }
    }
}

/// What is traced.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) bvh: &'a Bvh,
    pub(crate) triangles: &'a Triangles<'a>,
}

/// What the rays of a packet that are traced together have in common.
#[derive(Clone, Copy)]
struct Way {
    origin: Vec3,
    negative: [bool; 3],
    /// The direction of one of them.
    along: Vec3,
    /// Bits of the subtrees of the cut that the packet's beam meets, if there is a cut.
    met: Option<u64>,
}

/// Traces a bundle. For [`Query::Any`] hits are any, not the closest, and only the primitives count.
#[inline(always)]
pub(crate) fn trace<S: Simd, T: WideTest>(
    simd: S,
    scene: Scene<'_>,
    query: Query,
    bundle: &mut Bundle,
    hits: &mut Hits,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    match query {
        Query::Closest => trace_bundle::<S, T, false>(simd, scene, bundle, hits, scratch, work),
        Query::Any => trace_bundle::<S, T, true>(simd, scene, bundle, hits, scratch, work),
    }
}

#[inline(always)]
fn trace_bundle<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    bundle: &mut Bundle,
    hits: &mut Hits,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let Some(last) = bundle.count.checked_sub(1) else {
        return;
    };
    let packets = bundle.count.div_ceil(PACKET);
    for d in &mut bundle.direction {
        let padding = d[last];
        d[last + 1..packets * PACKET].fill(padding);
    }
    let frame = common_frame(simd, bundle, packets);
    let mut beams = [Beam::NONE; RAYS / PACKET];
    if let Some(frame) = &frame {
        for (i, beam) in beams[..packets].iter_mut().enumerate() {
            *beam = beam_of(simd, frame, bundle, i * PACKET);
        }
        let whole = beams.iter().fold(Beam::NONE, |a, b| a.union(b));
        scratch.cut.fill(scene.bvh.nodes(), frame, &whole, bundle.t_max, work);
        if scratch.cut.count == 0 {
            hits.primitive[..packets * PACKET].fill(Hits::NONE);
            return;
        }
    }
    for (i, beam) in beams[..packets].iter().enumerate() {
        let at = i * PACKET;
        let present = if bundle.count - at >= PACKET { !0 } else { (1 << (bundle.count - at)) - 1 };
        let met = if frame.is_some() { Some(scratch.cut.met(simd, beam)) } else { None };
        if met == Some(0) {
            hits.primitive[at..at + PACKET].fill(Hits::NONE);
            continue;
        }
        let negative = prepare(simd, bundle, at, present, &mut scratch.packet);
        // Rays that go the same way along every axis together: nearly always all of them.
        let mut left = scratch.packet.active;
        while left != 0 {
            let lane = left.trailing_zeros();
            let signs = negative.map(|n| n >> lane & 1 == 1);
            let same = (0..3).fold(left, |m, k| m & if signs[k] { negative[k] } else { !negative[k] });
            left &= !same;
            let along = Vec3::from([0, 1, 2].map(|k| bundle.direction[k][at + lane as usize]));
            let way = Way { origin: bundle.origin, negative: signs, along, met };
            trace_packet::<S, T, ANY>(simd, scene, &way, same, scratch, work);
        }
        let p = &scratch.packet;
        if !ANY {
            hits.t[at..at + PACKET].copy_from_slice(&p.t);
            hits.u[at..at + PACKET].copy_from_slice(&p.u);
            hits.v[at..at + PACKET].copy_from_slice(&p.v);
        }
        for (to, from) in hits.primitive[at..at + PACKET].iter_mut().zip(&p.primitive) {
            *to = from.to_bits();
        }
    }
}

/// A frame for all rays.
#[inline(always)]
fn common_frame<S: Simd>(simd: S, bundle: &Bundle, packets: usize) -> Option<Frame> {
    let mut least = Vec3::ZERO;
    let mut greatest = Vec3::ZERO;
    for k in 0..3 {
        let mut a = S::f32s::simd_from(simd, f32::INFINITY);
        let mut b = -a;
        for at in (0..packets * PACKET).step_by(S::f32s::LEN) {
            let d = load(simd, &bundle.direction[k], at);
            (a, b) = (min(d, a), max(d, b));
        }
        (least[k], greatest[k]) = (a.reduce_min(), b.reduce_max());
    }
    Frame::new(bundle.origin, least, greatest)
}

/// The beam of the packet that begins with ray `at`.
#[inline(always)]
fn beam_of<S: Simd>(simd: S, frame: &Frame, bundle: &Bundle, at: usize) -> Beam {
    let infinity = S::f32s::simd_from(simd, f32::INFINITY);
    let mut least = [infinity; 2];
    let mut greatest = [-infinity; 2];
    for at in (at..at + PACKET).step_by(S::f32s::LEN) {
        let slopes = frame.slopes::<S, S::f32s>(load3(simd, &bundle.direction, at));
        for i in 0..2 {
            least[i] = min(slopes[i], least[i]);
            greatest[i] = max(slopes[i], greatest[i]);
        }
    }
    let range = |i: usize| [least[i].reduce_min(), greatest[i].reduce_max()];
    Beam { x: range(0), y: range(1) }
}

/// Loads the packet that begins with ray `at`; gives masks of the rays that go backwards along each axis.
#[inline(always)]
fn prepare<S: Simd>(
    simd: S,
    bundle: &Bundle,
    at: usize,
    present: u64,
    packet: &mut Packet<PACKET>,
) -> [u64; 3] {
    let zero = S::f32s::simd_from(simd, 0.0);
    let one = S::f32s::simd_from(simd, 1.0);
    let n = S::f32s::LEN;
    let mut negative = [0; 3];
    let mut valid = 0;
    packet.axes = [0; 3];
    for i in (0..PACKET).step_by(n) {
        let d: [S::f32s; 3] = load3(simd, &bundle.direction, at + i);
        let inverse = [one / d[0], one / d[1], one / d[2]];
        let finite = d[0].is_finite() & d[1].is_finite() & d[2].is_finite();
        let nowhere = d[0].simd_eq(zero) & d[1].simd_eq(zero) & d[2].simd_eq(zero);
        valid |= (finite & !nowhere).to_bitmask() << i;
        // As `longest_axis` decides.
        let [x, y, z] = [max(d[0], -d[0]), max(d[1], -d[1]), max(d[2], -d[2])];
        let first = x.simd_ge(y) & x.simd_ge(z);
        let second = !first & y.simd_ge(z);
        let third = !first & !second;
        for k in 0..3 {
            d[k].store_slice(&mut packet.direction[k][i..i + n]);
            inverse[k].store_slice(&mut packet.inverse[k][i..i + n]);
            negative[k] |= inverse[k].is_sign_negative().to_bitmask() << i;
        }
        let mut shear = [zero; 2];
        for (k, lanes) in [first, second, third].into_iter().enumerate() {
            let mask = lanes.to_bitmask();
            if mask != 0 {
                packet.axes[k] |= mask << i;
                shear[0] = lanes.select(d[(k + 1) % 3] / d[k], shear[0]);
                shear[1] = lanes.select(d[(k + 2) % 3] / d[k], shear[1]);
            }
        }
        shear[0].store_slice(&mut packet.shear[0][i..i + n]);
        shear[1].store_slice(&mut packet.shear[1][i..i + n]);
    }
    packet.active = if bundle.origin.is_finite() && bundle.t_max >= 0.0 { present & valid } else { 0 };
    packet.primitive = [f32::from_bits(Hits::NONE); PACKET];
    // No hit is infinitely far.
    packet.t = [bundle.t_max.min(f32::MAX); PACKET];
    for i in bits(!packet.active) {
        packet.t[i] = -1.0;
    }
    negative
}

#[inline(always)]
fn trace_packet<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    mask: u64,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let Some(met) = way.met else {
        simd.vectorize(
            #[inline(always)]
            || walk::<S, T, ANY>(simd, scene, way, 0, mask, scratch, work),
        );
        return;
    };
    for i in bits(met) {
        if scratch.cut.near[i] > farthest(simd, &scratch.packet) || scratch.packet.active & mask == 0 {
            return;
        }
        let root = scratch.cut.node[i];
        simd.vectorize(
            #[inline(always)]
            || walk::<S, T, ANY>(simd, scene, way, root, mask, scratch, work),
        );
    }
}

/// The greatest distance at which a ray of the packet still looks for a hit, or more.
#[inline(always)]
fn farthest<S: Simd>(simd: S, packet: &Packet<PACKET>) -> f32 {
    let mut t = packet.t::<S, S::f32s>(simd, 0);
    for at in (0..PACKET).step_by(S::f32s::LEN) {
        t = max(t, packet.t(simd, at));
    }
    t.reduce_max()
}

/// Walks the subtree at `root` with the rays in `mask`.
#[inline(always)]
fn walk<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    root: u32,
    mask: u64,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let nodes = scene.bvh.nodes();
    let mut top = 0;
    let (mut n, mut mask) = (root as usize, mask);
    loop {
        let node = &nodes[n];
        let slab = Slab::new(&node.aabb(), way.origin, way.negative);
        let entered = enter(simd, &scratch.packet, &slab, mask & scratch.packet.active);
        if entered != 0 {
            if node.is_leaf() {
                test_leaf::<S, Lanes16<S>, T, ANY, PACKET>(
                    simd,
                    scene,
                    way,
                    node,
                    entered,
                    &mut scratch.packet,
                    work,
                );
            } else if entered.count_ones() as usize <= FEW {
                gather(&scratch.packet, entered, &mut scratch.few);
                work.regrouped += 1;
                walk_few::<S, T, ANY>(simd, scene, way, n, scratch, work);
                scatter::<ANY>(&scratch.few, entered, &mut scratch.packet);
            } else {
                work.nodes += 1;
                let first = node.first();
                let (l, r) = (&nodes[first], &nodes[first + 1]);
                prefetch(nodes, l.first());
                prefetch(nodes, r.first());
                let step = (r.aabb().min + r.aabb().max) - (l.aabb().min + l.aabb().max);
                let right_first = usize::from(step.dot(way.along) < 0.0);
                scratch.stack[top] = ((first + 1 - right_first) as u32, entered);
                top += 1;
                (n, mask) = (first + right_first, entered);
                continue;
            }
        }
        if top == 0 {
            return;
        }
        top -= 1;
        (n, mask) = (scratch.stack[top].0 as usize, scratch.stack[top].1);
    }
}

type Lanes16<S> = fearless_simd::f32x16<S>;

/// The rays in `mask` that enter a box.
#[inline(always)]
fn enter<S: Simd>(simd: S, packet: &Packet<PACKET>, slab: &Slab, mask: u64) -> u64 {
    let n = Lanes16::<S>::LEN;
    let mut entered = 0;
    for at in (0..PACKET).step_by(n) {
        if mask >> at & ((1 << n) - 1) != 0 {
            let rays = packet.rays::<S, Lanes16<S>>(simd, at);
            let (_, lanes) = slab.enter(simd, rays.inverse, packet.t(simd, at));
            entered |= lanes.to_bitmask() << at;
        }
    }
    entered & mask
}

/// Walks the subtree at an inner node with few rays, all of which enter it.
#[inline(always)]
fn walk_few<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    root: usize,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    type V<S> = Lanes16<S>;
    let nodes = scene.bvh.nodes();
    let few = &mut scratch.few;
    let rays = few.rays::<S, V<S>>(simd, 0);
    let mut top = 0;
    let (mut n, mut mask) = (root, few.active);
    loop {
        let node = &nodes[n];
        if node.is_leaf() {
            test_leaf::<S, V<S>, T, ANY, FEW>(simd, scene, way, node, mask, few, work);
            if ANY && few.active == 0 {
                return;
            }
        } else {
            work.nodes += 1;
            let first = node.first();
            let (l, r) = (&nodes[first], &nodes[first + 1]);
            prefetch(nodes, l.first());
            prefetch(nodes, r.first());
            let t = few.t::<S, V<S>>(simd, 0);
            let (tl, ml) = Slab::new(&l.aabb(), way.origin, way.negative).enter(simd, rays.inverse, t);
            let (tr, mr) = Slab::new(&r.aabb(), way.origin, way.negative).enter(simd, rays.inverse, t);
            let (ml, mr) = (ml.to_bitmask() & mask, mr.to_bitmask() & mask);
            if ml != 0 && mr != 0 {
                // The child that more of the rays which enter both enter first.
                let both = ml & mr;
                let left = (tl.simd_le(tr).to_bitmask() & both).count_ones();
                let right_first = 2 * left < both.count_ones();
                let (near, far) = if right_first { (mr, (ml, tl)) } else { (ml, (mr, tr)) };
                scratch.few_stack[top] = ((first + usize::from(!right_first)) as u32, far.0);
                far.1.store_slice(&mut scratch.few_near[top]);
                top += 1;
                (n, mask) = (first + usize::from(right_first), near);
                continue;
            }
            if ml | mr != 0 {
                (n, mask) = (first + usize::from(ml == 0), ml | mr);
                continue;
            }
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            let near = V::from_slice(simd, &scratch.few_near[top]);
            let ahead = near.simd_le(few.t::<S, V<S>>(simd, 0)).to_bitmask();
            (n, mask) = (scratch.few_stack[top].0 as usize, scratch.few_stack[top].1 & ahead & few.active);
            if mask != 0 {
                break;
            }
        }
    }
}

/// Copies the rays in `mask`.
#[inline(always)]
fn gather(from: &Packet<PACKET>, mask: u64, to: &mut Packet<FEW>) {
    to.axes = [0; 3];
    to.active = (1 << mask.count_ones()) - 1;
    for (j, i) in bits(mask).enumerate().take(FEW) {
        for k in 0..3 {
            to.direction[k][j] = from.direction[k][i];
            to.inverse[k][j] = from.inverse[k][i];
            to.axes[k] |= (from.axes[k] >> i & 1) << j;
        }
        to.shear[0][j] = from.shear[0][i];
        to.shear[1][j] = from.shear[1][i];
        to.t[j] = from.t[i];
        to.primitive[j] = from.primitive[i];
        to.u[j] = from.u[i];
        to.v[j] = from.v[i];
    }
}

/// Copies hits back.
#[inline(always)]
fn scatter<const ANY: bool>(from: &Packet<FEW>, mask: u64, to: &mut Packet<PACKET>) {
    for (j, i) in bits(mask).enumerate().take(FEW) {
        to.t[i] = from.t[j];
        to.u[i] = from.u[j];
        to.v[i] = from.v[j];
        to.primitive[i] = from.primitive[j];
        if ANY && from.active >> j & 1 == 0 {
            to.active &= !(1 << i);
        }
    }
}

/// Tests the triangles of a leaf against the rays in `mask`.
#[inline(always)]
fn test_leaf<S: Simd, V: Lanes<S>, T: WideTest, const ANY: bool, const N: usize>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    leaf: &Node,
    mask: u64,
    packet: &mut Packet<N>,
    work: &mut Work,
) {
    for &p in scene.bvh.primitives(leaf) {
        if p as usize >= scene.triangles.indices.len() {
            continue;
        }
        work.triangles += 1;
        let triangle = Corners::new(scene.triangles, p, way.origin);
        for axis in 0..3 {
            let mask = mask & packet.axes[axis] & packet.active;
            if mask == 0 {
                continue;
            }
            for at in (0..N).step_by(V::LEN) {
                let lanes = mask >> at & ((1 << V::LEN) - 1);
                if lanes != 0 {
                    test_lanes::<S, V, T, ANY, N>(simd, way, &triangle, p, axis, lanes, at, packet);
                }
            }
        }
    }
}

/// Tests one triangle against the lanes `mask` of the rays from `at` on.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
fn test_lanes<S: Simd, V: Lanes<S>, T: WideTest, const ANY: bool, const N: usize>(
    simd: S,
    way: &Way,
    triangle: &Corners,
    primitive: u32,
    axis: usize,
    mask: u64,
    at: usize,
    packet: &mut Packet<N>,
) {
    let rays = packet.rays::<S, V>(simd, at);
    let found = T::wide(simd, &rays, triangle, axis, mask);
    if found.lanes == 0 {
        return;
    }
    let best = packet.t::<S, V>(simd, at);
    let aabb = bvh_core::Aabb::around(&triangle.corners);
    let (near, inside) = Slab::new(&aabb, way.origin, way.negative).enter(simd, rays.inverse, best);
    let t = max(found.t, near);
    let lanes = found.lanes & inside.to_bitmask();
    if ANY {
        let hit = lanes & t.simd_le(best).to_bitmask();
        packet.active &= !(hit << at);
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
    let closer = V::Mask::from_bitmask(simd, closer);
    write(simd, closer, t, &mut packet.t, at);
    write(simd, closer, found.u, &mut packet.u, at);
    write(simd, closer, found.v, &mut packet.v, at);
    write(simd, closer, V::simd_from(simd, f32::from_bits(primitive)), &mut packet.primitive, at);
}

/// Replaces the lanes in `mask`.
#[inline(always)]
fn write<S: Simd, V: Lanes<S>, const N: usize>(simd: S, mask: V::Mask, new: V, to: &mut [f32; N], at: usize) {
    mask.select(new, load(simd, to, at)).store_slice(&mut to[at..at + V::LEN]);
}
