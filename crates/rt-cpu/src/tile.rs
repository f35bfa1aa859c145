//! Rays of a tile of 32 x 32 pixels: the scheme of [`packet`](crate::packet), reworked.
//!
//! ```text
//! cut: open the largest node of the tree's top that the whole tile's frustum meets, until there are 48 subtrees
//! for each packet of 64 rays, in four groups of 16, for each subtree in the cut that the packet's frustum meets,
//! front to back:
//!   at a leaf, test the rays that entered it
//!   at an inner node, with a mask of the rays that entered it:
//!     all of them in one group, or few, which are compacted into one -> go down with the group alone
//!     otherwise -> go down into each child with the rays that enter it,
//!                  from the fifth node on only if the packet's frustum meets the child
//! ```
//!
//! Departures from Wald, Boulos and Shirley 2007: masks in place of first active rays; the cut,
//! which shares the top of the tree among 16 packets (in the spirit of Reshetov, Soupikov and
//! Hurley, *Multi-Level Ray Tracing Algorithm*, 2005); frusta of slopes in place of interval
//! arithmetic on reciprocals, so that rays may go both ways along two axes; groups, so that rays
//! which have drifted apart cost what they would in small packets.
//!
//! Below the cut a packet tests its frustum from its fifth node of a subtree on: few packets get
//! that far in good trees, where testing it at every node costs time (`docs/BENCHMARKS.md`, bad
//! trees).

mod context;
mod cut;
mod leaf;
mod packet;
mod walk;

use bvh_core::Vec3;
use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use self::context::Context;
pub(crate) use self::context::Scratch;
use crate::frustum::{Frame, Frustum, Sides};
use crate::scene::Scene;
use crate::simd::{bits, load, load3, max, min, vectorize};
use crate::wave::{PACKET, Wave};
use crate::wide::{RayOctant, WideTest};

/// Rays that share a cut: those of 32 x 32 pixels.
const SHARED: usize = 1024;

/// Traces a wave. For `ANY` hits are any, not the closest, and only the primitives count.
#[inline(always)]
pub(crate) fn trace<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    wave: &mut Wave,
    scratch: &mut Scratch,
) {
    let Some(last) = wave.count.checked_sub(1) else {
        return;
    };
    let end = wave.count.next_multiple_of(PACKET);
    for d in &mut wave.direction {
        let padding = d[last];
        d[last + 1..end].fill(padding);
    }
    for start in (0..end).step_by(SHARED) {
        let range = (start, end.min(start + SHARED));
        trace_shared::<S, T, ANY>(simd, scene, wave, range, scratch);
    }
}

/// Traces the rays from `start` to `end` with one cut.
#[inline(always)]
fn trace_shared<S: Simd, T: WideTest, const ANY: bool>(
    simd: S,
    scene: Scene<'_>,
    wave: &mut Wave,
    (start, end): (usize, usize),
    scratch: &mut Scratch,
) {
    let frame = common_frame(simd, wave, (start, end));
    let mut frusta = [Frustum::NONE; SHARED / PACKET];
    if let Some(frame) = &frame {
        for (frustum, at) in frusta.iter_mut().zip((start..end).step_by(PACKET)) {
            *frustum = frustum_of(simd, frame, wave, at);
        }
        let whole = frusta.iter().fold(Frustum::NONE, |a, b| a.union(b));
        scratch.nodes += scratch.cut.fill(simd, scene.bvh.nodes(), frame, &whole, wave.t_max);
    } else {
        // The tree as a whole.
        (scratch.cut.node[0], scratch.cut.near[0]) = (0, 0.0);
    }
    for (frustum, at) in frusta.iter().zip((start..end).step_by(PACKET)) {
        let met = if frame.is_some() { scratch.cut.met(simd, frustum) } else { 1 };
        if met == 0 {
            wave.primitive[at..at + PACKET].fill(Wave::NO_HIT);
            continue;
        }
        let frustum = frame.as_ref().map(|frame| (frame, frustum));
        scratch.sides = Sides::zeroed();
        let present = if wave.count - at >= PACKET { !0 } else { (1 << (wave.count - at)) - 1 };
        let (negative, longest) = scratch.packet.load(simd, wave, at, present);
        // Rays of one octant that are longest along the same axis, together: mostly all of them.
        let mut left = scratch.packet.active(0);
        while left != 0 {
            let lane = left.trailing_zeros();
            let signs = negative.map(|n| n >> lane & 1 == 1);
            let axis = (0..2).find(|&k| longest[k] >> lane & 1 == 1).unwrap_or(2);
            let same = left & longest[axis];
            let same = (0..3).fold(same, |m, k| m & if signs[k] { negative[k] } else { !negative[k] });
            left &= !same;
            let along = Vec3::from([0, 1, 2].map(|k| wave.direction[k][at + lane as usize]));
            let octant = RayOctant::new(wave.origin, along, signs, axis);
            let context = Context { simd, scene, octant: &octant, frustum };
            trace_packet::<S, T, ANY>(context, met, same, scratch);
        }
        let p = &scratch.packet;
        if !ANY {
            wave.t[at..at + PACKET].copy_from_slice(&p.t[..PACKET]);
            wave.u[at..at + PACKET].copy_from_slice(&p.u[..PACKET]);
            wave.v[at..at + PACKET].copy_from_slice(&p.v[..PACKET]);
        }
        for (to, from) in wave.primitive[at..at + PACKET].iter_mut().zip(&p.primitive) {
            *to = from.to_bits();
        }
    }
}

/// A frame for the rays from `start` to `end`, whole packets.
#[inline(always)]
pub(crate) fn common_frame<S: Simd>(simd: S, wave: &Wave, (start, end): (usize, usize)) -> Option<Frame> {
    let mut least = Vec3::ZERO;
    let mut greatest = Vec3::ZERO;
    for k in 0..3 {
        let mut a = S::f32s::simd_from(simd, f32::INFINITY);
        let mut b = -a;
        for at in (start..end).step_by(S::f32s::LEN) {
            let d = load(simd, &wave.direction[k], at);
            (a, b) = (min(d, a), max(d, b));
        }
        (least[k], greatest[k]) = (a.reduce_min(), b.reduce_max());
    }
    Frame::new(wave.origin, least, greatest)
}

/// The frustum of the packet that begins with ray `at`.
#[inline(always)]
pub(crate) fn frustum_of<S: Simd>(simd: S, frame: &Frame, wave: &Wave, at: usize) -> Frustum {
    let infinity = S::f32s::simd_from(simd, f32::INFINITY);
    let mut least = [infinity; 2];
    let mut greatest = [-infinity; 2];
    for at in (at..at + PACKET).step_by(S::f32s::LEN) {
        let slopes = frame.slopes::<S, S::f32s>(simd, load3(simd, &wave.direction, at));
        for i in 0..2 {
            least[i] = min(slopes[i], least[i]);
            greatest[i] = max(slopes[i], greatest[i]);
        }
    }
    Frustum([
        [least[0].reduce_min(), greatest[0].reduce_max()],
        [least[1].reduce_min(), greatest[1].reduce_max()],
    ])
}

#[inline(always)]
fn trace_packet<S: Simd, T: WideTest, const ANY: bool>(
    context: Context<'_, S>,
    met: u64,
    mask: u64,
    scratch: &mut Scratch,
) {
    let simd = context.simd;
    let mut farthest = scratch.packet.farthest(simd, mask);
    for i in bits(met) {
        if scratch.cut.near[i] > farthest || scratch.packet.active(0) & mask == 0 {
            return;
        }
        let root = scratch.cut.node[i];
        vectorize!(simd, walk::walk::<S, T, ANY>(context, root, mask, scratch));
        if !ANY && !scratch.packet.some_see_nothing(mask) {
            farthest = scratch.packet.farthest(simd, mask);
        }
    }
}
