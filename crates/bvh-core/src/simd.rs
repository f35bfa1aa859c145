//! SIMD levels, chosen at run time so that a plain `cargo build --release` is the fast build.

/// A set of vector instructions that kernels are instantiated for; variants are in ascending order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SimdLevel {
    /// What every target has (SSE2 on x86-64).
    Baseline,
    /// AVX2, FMA, BMI1, BMI2 and POPCNT (x86-64 processors since 2013).
    Avx2,
    /// AVX-512 F, VL, BW and DQ.
    Avx512,
}

crate::named!(SimdLevel, "SIMD level", Baseline = "baseline", Avx2 = "avx2", Avx512 = "avx512");

impl SimdLevel {
    /// Returns whether this machine has the level.
    #[must_use]
    pub fn is_available(self) -> bool {
        self <= Self::best()
    }

    /// Returns the levels of this machine, lowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|level| level.is_available())
    }

    /// Returns the highest level of this machine.
    #[must_use]
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt")
        {
            let has_avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq");
            return if has_avx512 { Self::Avx512 } else { Self::Avx2 };
        }
        Self::Baseline
    }
}
