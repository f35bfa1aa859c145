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
use crate::simd::{bits, load, load3, max, min};
use crate::single::Work;
use crate::wide::{Rays, Slab, Way, WideTest};

/// Rays of a packet.
const PACKET: usize = 64;

/// Rays in one vector: once no more are left, they are walked with by themselves.
const GROUP: usize = 16;

/// The groups of a packet; behind them one for rays gathered from several, and room for vectors that reach beyond.
const LANES: usize = PACKET + 2 * GROUP;

type V<S> = fearless_simd::f32x16<S>;

/// Rays in a form to be tested, with their best hits so far.
#[repr(C, align(64))]
struct Packet {
    direction: [[f32; LANES]; 3],
    inverse: [[f32; LANES]; 3],
    shear: [[f32; LANES]; 2],
    t: [f32; LANES],
    u: [f32; LANES],
    v: [f32; LANES],
    /// Bits of the numbers of primitives, to be moved about in the same registers.
    primitive: [f32; LANES],
    /// Masks of the rays that still look for a hit: those of the packet, then those gathered.
    active: [u64; 2],
}

impl Packet {
    fn new() -> Self {
        let zero = [0.0; LANES];
        Self {
            direction: [zero; 3],
            inverse: [zero; 3],
            shear: [zero; 2],
            t: zero,
            u: zero,
            v: zero,
            primitive: zero,
            active: [0; 2],
        }
    }

    #[inline(always)]
    fn inverse<S: Simd>(&self, simd: S, at: usize) -> [V<S>; 3] {
        load3(simd, &self.inverse, at)
    }

    /// Rays that are longest along `axis`.
    #[inline(always)]
    fn rays<S: Simd>(&self, simd: S, axis: usize, at: usize) -> Rays<V<S>> {
        Rays {
            direction: load3(simd, &self.direction, at),
            shear: [
                load(simd, &self.shear[0], at),
                load(simd, &self.shear[1], at),
                load(simd, &self.inverse[axis], at),
            ],
        }
    }

    #[inline(always)]
    fn t<S: Simd>(&self, simd: S, at: usize) -> V<S> {
        load(simd, &self.t, at)
    }
}

/// The part of masks that begins with lane `at`.
#[inline(always)]
fn from(masks: [u64; 2], at: usize) -> u64 {
    masks[at / PACKET] >> (at % PACKET)
}

/// What is needed again and again; a tile's worth of it.
pub(crate) struct Scratch {
    packet: Packet,
    stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    group_stack: [(u32, u64); MAX_HEIGHT as usize + 1],
    group_near: [[f32; GROUP]; MAX_HEIGHT as usize + 1],
    cut: Cut,
}

impl Scratch {
    pub(crate) fn new() -> Self {
        Self {
            packet: Packet::new(),
            stack: [(0, 0); MAX_HEIGHT as usize + 1],
            group_stack: [(0, 0); MAX_HEIGHT as usize + 1],
            group_near: [[0.0; GROUP]; MAX_HEIGHT as usize + 1],
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
        scratch.cut.fill(simd, scene.bvh.nodes(), frame, &whole, bundle.t_max, work);
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
        let Kinds { negative, longest } = prepare(simd, bundle, at, present, &mut scratch.packet);
        // Rays that go the same way along every axis together: nearly always all of them.
        let mut left = scratch.packet.active[0];
        while left != 0 {
            let lane = left.trailing_zeros();
            let signs = negative.map(|n| n >> lane & 1 == 1);
            let axis = (0..2).find(|&k| longest[k] >> lane & 1 == 1).unwrap_or(2);
            let same = left & longest[axis];
            let same = (0..3).fold(same, |m, k| m & if signs[k] { negative[k] } else { !negative[k] });
            left &= !same;
            let along = Vec3::from([0, 1, 2].map(|k| bundle.direction[k][at + lane as usize]));
            let way = Way::new(bundle.origin, signs, axis);
            trace_packet::<S, T, ANY>(simd, scene, &way, along, met, same, scratch, work);
        }
        let p = &scratch.packet;
        if !ANY {
            hits.t[at..at + PACKET].copy_from_slice(&p.t[..PACKET]);
            hits.u[at..at + PACKET].copy_from_slice(&p.u[..PACKET]);
            hits.v[at..at + PACKET].copy_from_slice(&p.v[..PACKET]);
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
    Beam {
        x: [least[0].reduce_min(), greatest[0].reduce_max()],
        y: [least[1].reduce_min(), greatest[1].reduce_max()],
    }
}

/// Masks of the rays of a packet that go backwards along each axis, and of those that are longest along it.
struct Kinds {
    negative: [u64; 3],
    longest: [u64; 3],
}

/// Loads the packet that begins with ray `at`.
#[inline(always)]
fn prepare<S: Simd>(simd: S, bundle: &Bundle, at: usize, present: u64, packet: &mut Packet) -> Kinds {
    let zero = S::f32s::simd_from(simd, 0.0);
    let one = S::f32s::simd_from(simd, 1.0);
    let n = S::f32s::LEN;
    let (mut negative, mut longest) = ([0; 3], [0; 3]);
    let mut valid = 0;
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
                longest[k] |= mask << i;
                shear[0] = lanes.select(d[(k + 1) % 3] / d[k], shear[0]);
                shear[1] = lanes.select(d[(k + 2) % 3] / d[k], shear[1]);
            }
        }
        shear[0].store_slice(&mut packet.shear[0][i..i + n]);
        shear[1].store_slice(&mut packet.shear[1][i..i + n]);
    }
    packet.active[0] = if bundle.origin.is_finite() && bundle.t_max >= 0.0 { present & valid } else { 0 };
    packet.primitive = [f32::from_bits(Hits::NONE); LANES];
    // No hit is infinitely far.
    packet.t = [bundle.t_max.min(f32::MAX); LANES];
    for i in bits(!packet.active[0]) {
        packet.t[i] = -1.0;
    }
    Kinds { negative, longest }
}

#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
fn trace_packet<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    along: Vec3,
    met: Option<u64>,
    mask: u64,
    scratch: &mut Scratch,
    work: &mut Work,
) {
    let Some(met) = met else {
        simd.vectorize(
            #[inline(always)]
            || walk::<S, T, ANY>(simd, scene, way, along, 0, mask, scratch, work),
        );
        return;
    };
    for i in bits(met) {
        if scratch.cut.near[i] > farthest(simd, &scratch.packet) || scratch.packet.active[0] & mask == 0 {
            return;
        }
        let root = scratch.cut.node[i];
        simd.vectorize(
            #[inline(always)]
            || walk::<S, T, ANY>(simd, scene, way, along, root, mask, scratch, work),
        );
    }
}

/// The greatest distance at which a ray of the packet still looks for a hit, or more.
#[inline(always)]
fn farthest<S: Simd>(simd: S, packet: &Packet) -> f32 {
    let mut t = packet.t(simd, 0);
    for at in (GROUP..PACKET).step_by(GROUP) {
        t = max(t, packet.t(simd, at));
    }
    t.reduce_max()
}

/// Walks the subtree at `root` with the rays in `mask`, one of which goes along `along`.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
fn walk<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    along: Vec3,
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
        let entered = enter(simd, &scratch.packet, node, way, mask & scratch.packet.active[0]);
        if entered != 0 {
            if node.is_leaf() {
                test_leaf::<S, T, ANY, PACKET>(simd, scene, way, node, entered, 0, &mut scratch.packet, work);
            } else if let Some((at, lanes)) = group_of(simd, &mut scratch.packet, entered) {
                work.regrouped += 1;
                walk_group::<S, T, ANY>(simd, scene, way, n, lanes, at, scratch, work);
                if at == PACKET {
                    scatter::<S, ANY>(simd, &mut scratch.packet, entered);
                }
            } else {
                work.nodes += 1;
                let first = node.first();
                let (l, r) = (&nodes[first], &nodes[first + 1]);
                fetch(scene, l);
                fetch(scene, r);
                let step = (r.aabb().min + r.aabb().max) - (l.aabb().min + l.aabb().max);
                let right_first = usize::from(step.dot(along) < 0.0);
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

/// Asks for what visiting a node will need first.
#[inline(always)]
fn fetch(scene: Scene<'_>, node: &Node) {
    if node.is_leaf() {
        if let Some(&p) = scene.bvh.primitives(node).first() {
            prefetch(scene.triangles.indices, p as usize);
        }
    } else {
        prefetch(scene.bvh.nodes(), node.first());
    }
}

/// The rays in `mask` that enter a node's box.
#[inline(always)]
fn enter<S: Simd>(simd: S, packet: &Packet, node: &Node, way: &Way, mask: u64) -> u64 {
    let slab = Slab::of(simd, node, way);
    let mut entered = 0;
    for at in (0..PACKET).step_by(GROUP) {
        if mask >> at & GROUP_MASK != 0 {
            let (_, lanes) = slab.enter(simd, packet.inverse(simd, at), packet.t(simd, at));
            entered |= lanes.to_bitmask() << at;
        }
    }
    entered & mask
}

const GROUP_MASK: u64 = (1 << GROUP) - 1;

/// The group in which all rays of a mask are, where it begins and which of its lanes they are: one of the packet's, or
/// the one behind it if there are few enough to be gathered there. The mask must not be 0.
#[inline(always)]
fn group_of<S: Simd>(simd: S, packet: &mut Packet, mask: u64) -> Option<(usize, u64)> {
    let at = mask.trailing_zeros() as usize / GROUP * GROUP;
    if mask & !(GROUP_MASK << at) == 0 {
        Some((at, mask >> at))
    } else if mask.count_ones() as usize <= GROUP {
        Some((PACKET, gather(simd, packet, mask)))
    } else {
        None
    }
}

/// Walks the subtree at an inner node with rays of the group at `at`, all of which enter it.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
fn walk_group<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
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
        let node = &nodes[n];
        if node.is_leaf() {
            test_leaf::<S, T, ANY, GROUP>(simd, scene, way, node, mask, at, packet, work);
        } else {
            work.nodes += 1;
            let first = node.first();
            let (l, r) = (&nodes[first], &nodes[first + 1]);
            fetch(scene, l);
            fetch(scene, r);
            let t = packet.t(simd, at);
            let (tl, ml) = Slab::of(simd, l, way).enter(simd, inverse, t);
            let (tr, mr) = Slab::of(simd, r, way).enter(simd, inverse, t);
            let (ml, mr) = (ml.to_bitmask() & mask, mr.to_bitmask() & mask);
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
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            let near = V::from_slice(simd, &scratch.group_near[top]);
            let ahead = near.simd_le(packet.t(simd, at)).to_bitmask() & from(packet.active, at);
            (n, mask) = (scratch.group_stack[top].0 as usize, scratch.group_stack[top].1 & ahead);
            if mask != 0 {
                break;
            }
        }
    }
}

/// Copies the rays in `mask`, no more than a group, behind the packet, and gives the mask of the copies.
#[inline(always)]
fn gather<S: Simd>(simd: S, packet: &mut Packet, mask: u64) -> u64 {
    let all = (1 << mask.count_ones()) - 1;
    packet.active[1] = all;
    let mut to = PACKET;
    for at in (0..PACKET).step_by(S::f32s::LEN) {
        let lanes = mask >> at & ((1 << S::f32s::LEN) - 1);
        if lanes == 0 {
            continue;
        }
        for k in 0..3 {
            squeeze(simd, lanes, &mut packet.direction[k], at, to);
            squeeze(simd, lanes, &mut packet.inverse[k], at, to);
        }
        squeeze(simd, lanes, &mut packet.shear[0], at, to);
        squeeze(simd, lanes, &mut packet.shear[1], at, to);
        squeeze(simd, lanes, &mut packet.t, at, to);
        squeeze(simd, lanes, &mut packet.u, at, to);
        squeeze(simd, lanes, &mut packet.v, at, to);
        squeeze(simd, lanes, &mut packet.primitive, at, to);
        to += lanes.count_ones() as usize;
    }
    all
}

/// Copies the chosen lanes of the vector at `at` to where `to` is, side by side.
#[inline(always)]
fn squeeze<S: Simd>(simd: S, chosen: u64, lanes: &mut [f32; LANES], at: usize, to: usize) {
    if S::f32s::LEN < 8 {
        for (j, i) in bits(chosen).enumerate() {
            lanes[to + j] = lanes[at + i];
        }
        return;
    }
    let chosen = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, chosen);
    let all: S::f32s = load(simd, lanes, at);
    all.compress(chosen).store_slice(&mut lanes[to..to + S::f32s::LEN]);
}

/// Copies the hits of gathered rays back.
#[inline(always)]
fn scatter<S: Simd, const ANY: bool>(simd: S, packet: &mut Packet, mask: u64) {
    if ANY {
        packet.active[0] &= !spread_bits(!packet.active[1], mask);
    }
    let mut from = PACKET;
    for at in (0..PACKET).step_by(S::f32s::LEN) {
        let lanes = mask >> at & ((1 << S::f32s::LEN) - 1);
        if lanes == 0 {
            continue;
        }
        spread(simd, lanes, &mut packet.primitive, from, at);
        if !ANY {
            spread(simd, lanes, &mut packet.t, from, at);
            spread(simd, lanes, &mut packet.u, from, at);
            spread(simd, lanes, &mut packet.v, from, at);
        }
        from += lanes.count_ones() as usize;
    }
}

/// Copies what lies side by side where `from` is to the chosen lanes of the vector at `at`.
#[inline(always)]
fn spread<S: Simd>(simd: S, chosen: u64, lanes: &mut [f32; LANES], from: usize, at: usize) {
    if S::f32s::LEN < 8 {
        for (j, i) in bits(chosen).enumerate() {
            lanes[at + i] = lanes[from + j];
        }
        return;
    }
    let chosen = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, chosen);
    let new: S::f32s = load(simd, lanes, from);
    let old: S::f32s = load(simd, lanes, at);
    new.expand_merge(chosen, old).store_slice(&mut lanes[at..at + S::f32s::LEN]);
}

/// Bits that lie side by side, moved to where those of `mask` are.
#[inline]
fn spread_bits(from: u64, mask: u64) -> u64 {
    bits(mask).enumerate().fold(0, |all, (j, i)| all | (from >> j & 1) << i)
}

/// Tests the triangles of a leaf against `N` rays from `at` on, those in `mask`.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inlined into one loop")]
fn test_leaf<S: Simd, T: WideTest, const ANY: bool, const N: usize>(
    simd: S,
    scene: Scene<'_>,
    way: &Way,
    leaf: &Node,
    mask: u64,
    at: usize,
    packet: &mut Packet,
    work: &mut Work,
) {
    for &p in scene.bvh.primitives(leaf) {
        let Some(corners) = corners(scene.triangles, p) else { continue };
        work.triangles += 1;
        let mask = mask & from(packet.active, at);
        for i in (0..N).step_by(GROUP) {
            let lanes = mask >> i & GROUP_MASK;
            if lanes != 0 {
                test_group::<S, T, ANY>(simd, way, corners, p, lanes, at + i, packet);
            }
        }
    }
}

/// The corners of a triangle; `None` if it is not there or one is not finite.
#[inline(always)]
fn corners<'a>(triangles: &Triangles<'a>, i: u32) -> Option<[&'a Vec3; 3]> {
    let &[a, b, c] = triangles.indices.get(i as usize)?;
    let (a, b, c) = (
        triangles.positions.get(a as usize)?,
        triangles.positions.get(b as usize)?,
        triangles.positions.get(c as usize)?,
    );
    // NaN unless all are finite.
    let zero = (*a * 0.0 + *b * 0.0) + *c * 0.0;
    (zero == Vec3::ZERO).then_some([a, b, c])
}

/// Tests one triangle against the lanes `mask` of the group at `at`.
#[inline(always)]
fn test_group<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    way: &Way,
    corners: [&Vec3; 3],
    primitive: u32,
    mask: u64,
    at: usize,
    packet: &mut Packet,
) {
    let found = T::wide(simd, &packet.rays(simd, way.axes[2], at), corners, way, mask);
    if found.lanes == 0 {
        return;
    }
    let best = packet.t(simd, at);
    let [&a, &b, &c] = corners;
    let (near, inside) = Slab::around(simd, &[a, b, c], way).enter(simd, packet.inverse(simd, at), best);
    let t = max(found.t, near);
    let lanes = found.lanes & inside.to_bitmask();
    if ANY {
        let hit = lanes & t.simd_le(best).to_bitmask();
        packet.active[at / PACKET] &= !(hit << (at % PACKET));
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
