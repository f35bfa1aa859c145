//! Rays of a tile of 32 x 32 pixels: the scheme of [`packet`](crate::packet), reworked.
//!
//! ```text
//! cut: open the largest node of the tree's top that the whole tile's beam meets, until there are 48 subtrees
//! for each packet of 64 rays, in four groups of 16, for each subtree in the cut that the packet's beam meets, front
//! to back:
//!   at a node, with a mask of the rays that entered its parent:
//!     mask of the rays that enter, if any   -> go down
//!     all of them in one group, or few, which are gathered into one
//!                                           -> go down with the group, testing both children at once
//!   at a leaf, test the rays in the mask
//! ```
//!
//! Departures from Wald, Boulos and Shirley 2007: masks in place of first active rays; beams of slopes in place
//! of interval arithmetic on reciprocals, so that rays may go both ways along two axes; the cut, which
//! shares the top of the tree among 16 packets (in the spirit of Reshetov, Soupikov and Hurley,
//! *Multi-Level Ray Tracing Algorithm*, 2005); groups, so that rays which have drifted apart cost what
//! they would in small packets.

mod cut;
mod packet;
mod walk;

use bvh_core::{Bvh, MAX_HEIGHT, Triangles, Vec3};
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use self::cut::Cut;
use self::packet::{GROUP, Kinds, PACKET, Packet};
use crate::beam::{Beam, Frame};
use crate::bundle::{Bundle, Hits, RAYS};
use crate::packet::Query;
use crate::simd::{bits, load, load3, max, min};
use crate::single::Work;
use crate::wide::{Way, WideTest};

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
        let Kinds { negative, longest } = scratch.packet.load(simd, bundle, at, present);
        // Rays that go the same way along every axis, and are longest along the same, together: mostly all of them.
        let mut left = scratch.packet.active(0);
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
            || walk::walk::<S, T, ANY>(simd, scene, way, along, 0, mask, scratch, work),
        );
        return;
    };
    for i in bits(met) {
        if scratch.cut.near[i] > scratch.packet.farthest(simd, mask) || scratch.packet.active(0) & mask == 0 {
            return;
        }
        let root = scratch.cut.node[i];
        simd.vectorize(
            #[inline(always)]
            || walk::walk::<S, T, ANY>(simd, scene, way, along, root, mask, scratch, work),
        );
    }
}
