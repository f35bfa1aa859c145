//! Instruction sets, and the few vector operations whose exact meaning matters here.
//!
//! Each kernel is written once, over vectors of [`fearless_simd`], and compiled for every level.
//! Kernels add, subtract, multiply and divide, never fuse, and reduce nothing but minima, maxima
//! and masks: each lane computes the same bits at every level, and those of the scalar code.
//!
//! Whatever handles vectors has to be inlined up to where `vectorize` turns the instructions on.
//! Closures and `array::map` are not, in general; kernels do without.

use bvh_core::{SimdLevel, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd};

/// The vector types of a level, or of the best that the machine has if that is less.
///
/// Processors with AVX-512 of before Ice Lake count as AVX2 here.
pub(crate) fn detected(level: SimdLevel) -> Level {
    let best = Level::new();
    #[cfg(target_arch = "x86_64")]
    let lower = match level {
        SimdLevel::Baseline => best.as_sse2().map(Simd::level),
        SimdLevel::Avx2 => best.as_avx2().map(Simd::level),
        SimdLevel::Avx512 => None,
    };
    #[cfg(not(target_arch = "x86_64"))]
    let lower = (level != SimdLevel::Baseline).then_some(best);
    lower.unwrap_or(best)
}

/// Runs `$body` with the instructions of `$simd`. Without `inline(always)` the closure is compiled
/// on its own, without them.
macro_rules! vectorize {
    ($simd:expr, $body:expr) => {
        fearless_simd::Simd::vectorize(
            $simd,
            #[inline(always)]
            || $body,
        )
    };
}

/// Runs `$body` compiled for the level, with `$simd` the token of its vector types: as
/// `fearless_simd::dispatch`, but SSE4.2 runs the kernels of SSE2. Kernels of its own are no faster
/// (`compare trace`, row `pivot baseline`) and take a sixth of the time to compile this crate.
macro_rules! dispatch {
    ($level:expr, $simd:ident => $body:expr) => {{
        match $level {
            #[cfg(target_arch = "x86_64")]
            fearless_simd::Level::Avx512($simd) => $crate::simd::vectorize!($simd, $body),
            #[cfg(target_arch = "x86_64")]
            fearless_simd::Level::Avx2($simd) => $crate::simd::vectorize!($simd, $body),
            #[cfg(target_arch = "x86_64")]
            level => {
                // Always there on x86-64.
                let $simd = level.as_sse2().expect("SSE2");
                $crate::simd::vectorize!($simd, $body)
            }
            #[cfg(not(target_arch = "x86_64"))]
            level => fearless_simd::dispatch!(level, $simd => $body),
        }
    }};
}
pub(crate) use bvh_core::pick::{max, min};
pub(crate) use {dispatch, vectorize};

/// Lanes of single precision numbers.
pub(crate) trait Lanes<S: Simd>: SimdFloat<S, Element = f32> {}

impl<S: Simd, V: SimdFloat<S, Element = f32>> Lanes<S> for V {}

/// Lanes of `from` that begin at `at`.
#[inline(always)]
pub(crate) fn load<S: Simd, V: Lanes<S>, const N: usize>(simd: S, from: &[f32; N], at: usize) -> V {
    V::from_slice(simd, &from[at..at + V::LEN])
}

/// [`load`] of three coordinates.
#[inline(always)]
pub(crate) fn load3<S: Simd, V: Lanes<S>, const N: usize>(
    simd: S,
    from: &[[f32; N]; 3],
    at: usize,
) -> [V; 3] {
    [load(simd, &from[0], at), load(simd, &from[1], at), load(simd, &from[2], at)]
}

/// Stores three coordinates from place `at` on.
#[inline(always)]
pub(crate) fn store3<S: Simd, V: Lanes<S>, const N: usize>(from: [V; 3], to: &mut [[f32; N]; 3], at: usize) {
    for (k, from) in from.into_iter().enumerate() {
        from.store_slice(&mut to[k][at..at + V::LEN]);
    }
}

/// Stores the chosen lanes side by side at the start of `to`, which must have room for a whole
/// vector; what is behind them in that room is overwritten.
#[inline(always)]
pub(crate) fn store_chosen<S: Simd>(simd: S, lanes: S::f32s, chosen: u64, to: &mut [f32]) {
    let to = &mut to[..S::f32s::LEN];
    if S::f32s::LEN < 8 {
        // Below AVX2 compression is emulated, and slower than this.
        for (to, i) in to.iter_mut().zip(bits(chosen)) {
            *to = lanes[i];
        }
    } else {
        let chosen = <S::f32s as SimdBase<S>>::Mask::from_bitmask(simd, chosen);
        lanes.compress(chosen).store_slice(to);
    }
}

/// A vector in all lanes.
#[inline(always)]
pub(crate) fn splat3<S: Simd, V: Lanes<S>>(simd: S, a: Vec3) -> [V; 3] {
    [V::simd_from(simd, a.x), V::simd_from(simd, a.y), V::simd_from(simd, a.z)]
}

#[inline(always)]
pub(crate) fn cross<S: Simd, V: Lanes<S>>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[inline(always)]
pub(crate) fn dot<S: Simd, V: Lanes<S>>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Unit vectors, and the lanes where there are such: without overflow or underflow.
#[inline(always)]
pub(crate) fn normalize<S: Simd, V: Lanes<S>>(simd: S, a: [V; 3]) -> ([V; 3], u64) {
    let square = dot(a, a);
    let unit = square.simd_gt(f32::MIN_POSITIVE) & square.simd_lt(f32::INFINITY);
    let inverse = V::simd_from(simd, 1.0) / square.sqrt();
    ([a[0] * inverse, a[1] * inverse, a[2] * inverse], unit.to_bitmask())
}

/// The numbers of the bits that are set.
#[inline(always)]
pub(crate) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = mask.trailing_zeros() as usize;
        let some = mask != 0;
        mask &= mask.wrapping_sub(1);
        some.then_some(lowest)
    })
}
