//! Shadow rays in the order in which they leave the light.
//!
//! Neighbouring pixels of a shattered scene see surfaces far apart: packets of their shadow rays overlap as seen
//! from the light, and each walks much the same part of the tree. Sorted by direction they do not.

use fearless_simd::Simd;
use fearless_simd::prelude::*;

use crate::bundle::{Bundle, RAYS};
use crate::frustum::Frustum;
use crate::packet::SIZE;
use crate::simd::load3;
use crate::tile::{common_frame, frustum_of};

/// Sorting pays from packets on that overlap this often: 20 to 25 % of the time of shadow rays on shattered scenes; on
/// cloth, always sorting costs 30 %.
const MIN_OVERLAP: f32 = 1.5;

/// Cells along one axis.
const CELLS: usize = 16;

/// Memory for sorting.
pub(crate) struct Sorter {
    slopes: [[f32; RAYS]; 2],
    unsorted: Box<Bundle>,
    unsorted_pixels: [u16; RAYS],
}

impl Sorter {
    pub(crate) fn new() -> Self {
        Self { slopes: [[0.0; RAYS]; 2], unsorted: Box::new(Bundle::new()), unsorted_pixels: [0; RAYS] }
    }

    /// Sorts rays, and the numbers that go with them, by the cell of their slopes along a curve, if their packets
    /// overlap.
    #[inline(always)]
    pub(crate) fn sort_if_scattered<S: Simd>(
        &mut self,
        simd: S,
        rays: &mut Bundle,
        pixels: &mut [u16; RAYS],
    ) {
        let count = rays.count;
        let whole = count / SIZE * SIZE;
        if whole <= SIZE {
            return;
        }
        let Some(frame) = common_frame(simd, rays, (0, whole)) else { return };
        let area = |f: &Frustum| (f.x[1] - f.x[0]) * (f.y[1] - f.y[0]);
        let mut all = Frustum::NONE;
        let mut sum = 0.0;
        for at in (0..whole).step_by(SIZE) {
            let frustum = frustum_of(simd, &frame, rays, at);
            sum += area(&frustum);
            all = all.union(&frustum);
        }
        let overlap = sum / area(&all);
        if overlap <= MIN_OVERLAP || overlap.is_nan() {
            return;
        }
        let n = S::f32s::LEN;
        for at in (0..count).step_by(n) {
            let slopes = frame.slopes::<S, S::f32s>(simd, load3(simd, &rays.direction, at));
            slopes[0].store_slice(&mut self.slopes[0][at..at + n]);
            slopes[1].store_slice(&mut self.slopes[1][at..at + n]);
        }
        let cell = |slope: f32, [least, greatest]: [f32; 2]| {
            // Out of range and NaN go to the ends.
            ((slope - least) / (greatest - least) * CELLS as f32).clamp(0.0, CELLS as f32 - 1.0) as usize
        };
        let key =
            |i: usize| CURVE[cell(self.slopes[0][i], all.x)] | CURVE[cell(self.slopes[1][i], all.y)] << 1;
        let mut ends = [0u16; CELLS * CELLS];
        for i in 0..count {
            ends[key(i)] += 1;
        }
        let mut sum = 0;
        for end in &mut ends {
            sum += *end;
            *end = sum;
        }
        let from = &mut *self.unsorted;
        for k in 0..3 {
            from.direction[k][..count].copy_from_slice(&rays.direction[k][..count]);
        }
        self.unsorted_pixels[..count].copy_from_slice(&pixels[..count]);
        for i in (0..count).rev() {
            let end = &mut ends[key(i)];
            *end -= 1;
            let to = *end as usize % RAYS;
            for k in 0..3 {
                rays.direction[k][to] = from.direction[k][i];
            }
            pixels[to] = self.unsorted_pixels[i];
        }
    }
}

/// The bits of a cell's number at every other place: two of them make a place on a Morton curve.
const CURVE: [usize; CELLS] = {
    let mut curve = [0; CELLS];
    let mut i = 0;
    while i < CELLS {
        curve[i] = (i & 1) | (i & 2) << 1 | (i & 4) << 2 | (i & 8) << 3;
        i += 1;
    }
    curve
};
