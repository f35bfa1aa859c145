//! Rays of a packet in the form in which they are tested, four groups of 16, and gathering of what
//! is left into one.

use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::simd::{bits, load, load3, max, store_chosen};
use crate::wave::{PACKET, Wave};
use crate::wide::{RayOctant, Rays, V};

/// Rays in one [`V`]: once no more are left, they are walked with by themselves.
pub(super) const GROUP: usize = 16;

pub(super) const GROUP_MASK: u64 = (1 << GROUP) - 1;

/// The groups of a packet; behind them one for rays compacted from several, and room for vectors
/// that reach beyond.
pub(super) const LANES: usize = PACKET + 2 * GROUP;

/// Rays in a form to be tested, with their best hits so far.
#[repr(C, align(64))]
#[derive(Zeroable)]
pub(super) struct Packet {
    pub(super) direction: [[f32; LANES]; 3],
    /// Minus one over the direction; see [`Slab::enter`](crate::wide::Slab::enter).
    pub(super) inverse: [[f32; LANES]; 3],
    pub(super) shear: [[f32; LANES]; 2],
    pub(super) t: [f32; LANES],
    pub(super) u: [f32; LANES],
    pub(super) v: [f32; LANES],
    /// Bits of the numbers of primitives, to be moved about in the same registers.
    pub(super) primitive: [f32; LANES],
    /// Masks of the rays that still look for a hit: those of the packet, then those compacted.
    active: [u64; 2],
    /// Masks of the rays that have hit something; of those compacted, since they were.
    hit: [u64; 2],
}

impl Packet {
    /// The rays of the group at `at`, if they are all of this octant.
    #[inline(always)]
    pub(super) fn rays<S: Simd>(&self, simd: S, octant: &RayOctant, at: usize) -> Rays<V<S>> {
        Rays {
            octant: *octant,
            direction: load3(simd, &self.direction, at),
            shear: [
                load(simd, &self.shear[0], at),
                load(simd, &self.shear[1], at),
                load(simd, &self.inverse[octant.axes[2]], at),
            ],
        }
    }

    /// The rays of the group at `at` that still look for a hit, and those of the groups behind it.
    #[inline(always)]
    pub(super) fn active(&self, at: usize) -> u64 {
        self.active[at / PACKET] >> (at % PACKET)
    }

    /// These of the group at `at` look for a hit no more.
    #[inline(always)]
    pub(super) fn end(&mut self, at: usize, lanes: u64) {
        self.active[at / PACKET] &= !(lanes << (at % PACKET));
    }

    /// These of the group at `at` have hit something.
    #[inline(always)]
    pub(super) fn note_hits(&mut self, at: usize, lanes: u64) {
        self.hit[at / PACKET] |= lanes << (at % PACKET);
    }

    /// Whether some ray in `mask` that looks for a hit has none yet.
    #[inline(always)]
    pub(super) fn some_see_nothing(&self, mask: u64) -> bool {
        self.active[0] & !self.hit[0] & mask != 0
    }

    /// Loads the packet that begins with ray `at`. Gives the masks of the rays that go backwards
    /// along each axis, and of those that are longest along it.
    #[inline(always)]
    pub(super) fn load<S: Simd>(
        &mut self,
        simd: S,
        wave: &Wave,
        at: usize,
        present: u64,
    ) -> ([u64; 3], [u64; 3]) {
        let zero = S::f32s::simd_from(simd, 0.0);
        let minus_one = S::f32s::simd_from(simd, -1.0);
        let n = S::f32s::LEN;
        let (mut negative, mut longest) = ([0; 3], [0; 3]);
        let mut valid = 0;
        for i in (0..PACKET).step_by(n) {
            let d: [S::f32s; 3] = load3(simd, &wave.direction, at + i);
            let inverse = [minus_one / d[0], minus_one / d[1], minus_one / d[2]];
            let finite = d[0].is_finite() & d[1].is_finite() & d[2].is_finite();
            let nowhere = d[0].simd_eq(zero) & d[1].simd_eq(zero) & d[2].simd_eq(zero);
            valid |= (finite & !nowhere).to_bitmask() << i;
            // As `Vec3::max_position` decides: the first of equals.
            let [x, y, z] = [d[0].abs(), d[1].abs(), d[2].abs()];
            let first = x.simd_ge(y) & x.simd_ge(z);
            let second = !first & y.simd_ge(z);
            let third = !first & !second;
            for k in 0..3 {
                d[k].store_slice(&mut self.direction[k][i..i + n]);
                inverse[k].store_slice(&mut self.inverse[k][i..i + n]);
                negative[k] |= d[k].is_sign_negative().to_bitmask() << i;
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
            shear[0].store_slice(&mut self.shear[0][i..i + n]);
            shear[1].store_slice(&mut self.shear[1][i..i + n]);
        }
        self.active[0] = if wave.origin.is_finite() && wave.t_max >= 0.0 { present & valid } else { 0 };
        self.hit[0] = 0;
        self.primitive = [f32::from_bits(Wave::NO_HIT); LANES];
        // No hit is infinitely far.
        self.t = [wave.t_max.min(f32::MAX); LANES];
        for i in bits(!self.active[0]) {
            self.t[i] = -1.0;
        }
        (negative, longest)
    }

    /// The greatest distance at which a ray in `mask`, or another of its group, still looks for a
    /// hit; or more.
    #[inline(always)]
    pub(super) fn farthest<S: Simd>(&self, simd: S, mask: u64) -> f32 {
        let mut t = V::<S>::simd_from(simd, -1.0);
        for at in (0..PACKET).step_by(GROUP) {
            if mask >> at & GROUP_MASK != 0 {
                t = max(t, load(simd, &self.t, at));
            }
        }
        t.reduce_max()
    }

    /// The group in which all rays of a mask are, where it begins and which of its lanes they are:
    /// one of the packet's, or the one behind it if there are few enough to be compacted there. The
    /// mask must not be 0.
    #[inline(always)]
    pub(super) fn group_of<S: Simd, const ANY: bool>(&mut self, simd: S, mask: u64) -> Option<(usize, u64)> {
        let at = mask.trailing_zeros() as usize / GROUP * GROUP;
        if mask & !(GROUP_MASK << at) == 0 {
            Some((at, mask >> at))
        } else if mask.count_ones() as usize <= GROUP {
            Some((PACKET, self.gather::<S, ANY>(simd, mask)))
        } else {
            None
        }
    }

    /// Copies the rays in `mask`, no more than a group, behind the packet, and gives the mask of
    /// the copies. For `ANY` hit they have none yet, or would not be looked at.
    #[inline(always)]
    fn gather<S: Simd, const ANY: bool>(&mut self, simd: S, mask: u64) -> u64 {
        let all = (1 << mask.count_ones()) - 1;
        (self.active[1], self.hit[1]) = (all, 0);
        let mut to = PACKET;
        for at in (0..PACKET).step_by(S::f32s::LEN) {
            let lanes = mask >> at & ((1 << S::f32s::LEN) - 1);
            if lanes == 0 {
                continue;
            }
            for k in 0..3 {
                squeeze(simd, lanes, &mut self.direction[k], at, to);
                squeeze(simd, lanes, &mut self.inverse[k], at, to);
            }
            squeeze(simd, lanes, &mut self.shear[0], at, to);
            squeeze(simd, lanes, &mut self.shear[1], at, to);
            squeeze(simd, lanes, &mut self.t, at, to);
            if !ANY {
                squeeze(simd, lanes, &mut self.primitive, at, to);
            }
            to += lanes.count_ones() as usize;
        }
        all
    }

    /// Copies the hits of compacted rays back.
    #[inline(always)]
    pub(super) fn scatter<const ANY: bool>(&mut self, mask: u64) {
        let (mut mask, mut from, mut hits) = (mask, PACKET, self.hit[1]);
        while hits != 0 {
            // Skips the rays before the next that hit.
            let skipped = hits.trailing_zeros();
            for _ in 0..skipped {
                mask &= mask - 1;
            }
            let to = mask.trailing_zeros() as usize % PACKET;
            from += skipped as usize;
            self.hit[0] |= 1 << to;
            self.primitive[to] = self.primitive[from];
            if ANY {
                self.active[0] &= !(1 << to);
            } else {
                (self.t[to], self.u[to], self.v[to]) = (self.t[from], self.u[from], self.v[from]);
            }
            mask &= mask - 1;
            from += 1;
            hits = hits >> skipped >> 1;
        }
    }
}

/// Copies the chosen lanes of the vector at `at` to where `to` is, side by side.
#[inline(always)]
fn squeeze<S: Simd>(simd: S, chosen: u64, lanes: &mut [f32; LANES], at: usize, to: usize) {
    let all = load(simd, lanes, at);
    store_chosen::<S>(simd, all, chosen, &mut lanes[to..]);
}
