//! Choosing lanes by number, which `fearless_simd` does not offer in one instruction: the only
//! unsafe blocks of this crate.

use fearless_simd::Simd;

/// Sets lane `i` to `from[lanes[i]]`. Every number must be of the same half of eight as its lane.
#[inline(always)]
pub(crate) fn permute<S: Simd>(simd: S, from: &[f32; 16], lanes: &[u32; 16]) -> [f32; 16] {
    let mut to = [0.0; 16];
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "instructions beyond the baseline")]
    {
        use fearless_simd::Level;
        use std::arch::x86_64::*;
        match simd.level() {
            Level::Avx512(_) => {
                // SAFETY: the token of the level proves that the processor has AVX-512; all arrays
                // have 16 lanes.
                unsafe {
                    let lanes = _mm512_loadu_si512(lanes.as_ptr().cast());
                    let chosen = _mm512_permutexvar_ps(lanes, _mm512_loadu_ps(from.as_ptr()));
                    _mm512_storeu_ps(to.as_mut_ptr(), chosen);
                }
                return to;
            }
            Level::Avx2(_) => {
                for half in [0, 8] {
                    // SAFETY: the token of the level proves that the processor has AVX2; each half
                    // has 8 lanes, and the instruction takes numbers modulo 8.
                    unsafe {
                        let lanes = _mm256_loadu_si256(lanes.as_ptr().add(half).cast());
                        let from = _mm256_loadu_ps(from.as_ptr().add(half));
                        _mm256_storeu_ps(to.as_mut_ptr().add(half), _mm256_permutevar8x32_ps(from, lanes));
                    }
                }
                return to;
            }
            _ => {}
        }
    }
    let _ = simd;
    for (to, &lane) in to.iter_mut().zip(lanes) {
        *to = from[lane as usize & 15];
    }
    to
}

#[cfg(test)]
mod tests {
    use bvh_core::SimdLevel;

    use super::permute;
    use crate::simd::detected;

    #[test]
    fn every_level_chooses_the_same_lanes() {
        let from = std::array::from_fn(|i| i as f32 + 100.0);
        let lanes: [u32; 16] = std::array::from_fn(|i| (i as u32 & 8) + (i as u32 * 5 + 3) % 8);
        for level in SimdLevel::available() {
            let to = crate::simd::dispatch!(detected(level), simd => permute(simd, &from, &lanes));
            assert_eq!(to, lanes.map(|lane| from[lane as usize]), "{level:?}");
        }
    }
}
