//! Shadow rays in the order in which they leave the light.
//!
//! Neighbouring pixels of a shattered scene see surfaces far apart: packets of their shadow rays
//! overlap as seen from the light, and each walks much the same part of the tree. Sorted by
//! direction they do not.

use bytemuck::Zeroable;
use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::frustum::Frustum;
use crate::simd::load3;
use crate::tile::{common_frame, frustum_of};
use crate::wave::{Coordinates, PACKET, RAYS, Wave};

/// Sorting pays from packets on that overlap this often: 20 to 25 % of the time of shadow rays on
/// shattered scenes; on cloth, always sorting costs 30 %.
const MIN_OVERLAP: f32 = 1.5;

/// Cells along one axis.
const CELLS: usize = 16;

/// Memory for sorting.
#[derive(Zeroable)]
pub(crate) struct Sorter {
    keys: [u8; RAYS],
    unsorted: Coordinates,
    unsorted_pixels: [u16; RAYS],
}

impl Sorter {
    /// Sorts rays, and the numbers that go with them, by the cell of their slopes along a curve, if
    /// their packets overlap.
    #[inline(always)]
    pub(crate) fn sort_if_scattered<S: Simd>(&mut self, simd: S, wave: &mut Wave, pixels: &mut [u16; RAYS]) {
        let count = wave.count;
        let whole = count / PACKET * PACKET;
        if whole <= PACKET {
            return;
        }
        let Some(frame) = common_frame(simd, wave, (0, whole)) else { return };
        let area = |Frustum([x, y]): &Frustum| (x[1] - x[0]) * (y[1] - y[0]);
        let mut all = Frustum::NONE;
        let mut sum = 0.0;
        for at in (0..whole).step_by(PACKET) {
            let frustum = frustum_of(simd, &frame, wave, at);
            sum += area(&frustum);
            all = all.union(&frustum);
        }
        let overlap = sum / area(&all);
        if overlap <= MIN_OVERLAP || overlap.is_nan() {
            return;
        }
        let cell = |slope: f32, [least, greatest]: [f32; 2]| {
            // Out of range and NaN go to the ends.
            let i = (slope - least) / (greatest - least) * CELLS as f32;
            let i = i.clamp(0.0, CELLS as f32 - 1.0) as usize;
            // Bits at every other place: two such numbers make a place on a Morton curve.
            (i & 1) | (i & 2) << 1 | (i & 4) << 2 | (i & 8) << 3
        };
        let mut ends = [0u16; CELLS * CELLS];
        for at in (0..count).step_by(S::f32s::LEN) {
            let [x, y] = frame.slopes::<S, S::f32s>(simd, load3(simd, &wave.direction, at));
            for i in 0..S::f32s::LEN.min(count - at) {
                let key = cell(x[i], all.0[0]) | cell(y[i], all.0[1]) << 1;
                self.keys[at + i] = key as u8;
                ends[key] += 1;
            }
        }
        ends.iter_mut().fold(0, |sum, end| {
            *end += sum;
            *end
        });
        self.unsorted = wave.direction;
        self.unsorted_pixels = *pixels;
        for i in (0..count).rev() {
            let end = &mut ends[usize::from(self.keys[i])];
            *end -= 1;
            let to = *end as usize % RAYS;
            for k in 0..3 {
                wave.direction[k][to] = self.unsorted[k][i];
            }
            pixels[to] = self.unsorted_pixels[i];
        }
    }
}
