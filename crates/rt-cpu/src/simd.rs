//! Instruction sets, and the few vector operations whose exact meaning matters here.
//!
//! Kernels are written once over vectors of [`fearless_simd`] and compiled for every level. They add, subtract,
//! multiply and divide, never fuse, and reduce nothing but minima, maxima and masks: each lane computes the same
//! bits at every level, and those of the scalar code.

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd};

/// An instruction set that kernels are compiled for. Results do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SimdLevel {
    /// What every processor of the target has: SSE2 on x86-64, Neon on 64-bit ARM.
    Baseline,
    /// AVX2 and FMA (x86-64-v3); FMA itself is not used.
    Avx2,
    /// AVX-512 as in Ice Lake and Zen 4.
    Avx512,
}

impl SimdLevel {
    /// All levels, whether this machine has them or not.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Name on a command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        ["baseline", "avx2", "avx512"][self as usize]
    }

    /// The best level that this machine has.
    #[must_use]
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        match Level::new() {
            Level::Avx512(_) => return Self::Avx512,
            Level::Avx2(_) => return Self::Avx2,
            _ => {}
        }
        Self::Baseline
    }

    /// The levels that this machine has.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|&l| l <= Self::best())
    }

    /// This level, or the best that the machine has if that is less.
    pub(crate) fn detected(self) -> Level {
        let level = Level::new();
        #[cfg(target_arch = "x86_64")]
        {
            let lower = match self {
                Self::Baseline => level.as_sse2().map(Simd::level),
                Self::Avx2 => level.as_avx2().map(Simd::level),
                Self::Avx512 => None,
            };
            lower.unwrap_or(level)
        }
        #[cfg(not(target_arch = "x86_64"))]
        level
    }
}

/// Lanes of single precision numbers.
pub(crate) trait Lanes<S: Simd>: SimdFloat<S, Element = f32> {}

impl<S: Simd, V: SimdFloat<S, Element = f32>> Lanes<S> for V {}

/// The greater; `b` if `a` is NaN.
#[inline(always)]
pub(crate) fn max<S: Simd, V: Lanes<S>>(a: V, b: V) -> V {
    // The x86 instruction gives its second operand if either is NaN; that is one instruction in place of three.
    if cfg!(target_arch = "x86_64") { a.max(b) } else { a.max_precise(b) }
}

/// The lesser; `b` if `a` is NaN.
#[inline(always)]
pub(crate) fn min<S: Simd, V: Lanes<S>>(a: V, b: V) -> V {
    if cfg!(target_arch = "x86_64") { a.min(b) } else { a.min_precise(b) }
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
