//! Random numbers that depend on the seed, the pixel and the sample, and on nothing else. Not from a
//! crate: pictures depend on the numbers, and threads ask for any of them, in any order.

use bvh_core::Vec3;

/// All bits of number `n` of a sequence ([`uniform`]).
pub(crate) fn splitmix(seed: u64, n: u64) -> u64 {
    mix(seed.wrapping_add(n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

/// Numbers of [`splitmix`], any of them at once.
#[derive(Clone, Copy, bytemuck::Zeroable)]
pub(crate) struct Stream(u64);

impl Stream {
    /// That of a pixel.
    pub(crate) fn new(seed: u64, x: u32, y: u32) -> Self {
        Self(mix(mix(seed) ^ (u64::from(y) << 32 | u64::from(x))))
    }

    /// One for each number `n`, independent of this one.
    pub(crate) fn split(self, n: u32) -> Self {
        Self(mix(self.0 ^ mix(u64::from(n) + 1)))
    }

    /// Number `n`, from 0 to less than 1.
    pub(crate) fn uniform(self, n: u32) -> f32 {
        fraction(splitmix(self.0, n.into()))
    }

    /// Point `n` of a sequence that fills the unit square evenly, moved about by numbers 0 and 1 of
    /// this stream: the additive recurrence of Roberts, *The Unreasonable Effectiveness of
    /// Quasirandom Sequences*, 2018, in two dimensions.
    pub(crate) fn even(self, n: u64) -> [f32; 2] {
        [0, 1].map(|k| fraction(splitmix(self.0, k).wrapping_add(n.wrapping_mul(PLASTIC[k as usize]))))
    }
}

/// Where in a pixel sample `n` is taken: the middle for the first, the same for all pixels. Other
/// steps than those of [`Stream::even`]: with the same, a place in the pixel would have one
/// direction, and no number of samples would give the mean over both.
pub(crate) fn in_pixel(n: u32) -> [f32; 2] {
    FOURTH.map(|step| fraction((1u64 << 63).wrapping_add(u64::from(n).wrapping_mul(step))))
}

/// 2^64 times the reciprocals of the plastic number (x^3 = x + 1) and of its square.
const PLASTIC: [u64; 2] = [0xc13f_a9a9_02a6_328f, 0x91e1_0da5_c79e_7b1c];
/// 2^64 times the last two steps in four dimensions: x^-3 and x^-4 where x^5 = x + 1.
const FOURTH: [u64; 2] = [0xa0f2_ec75_a1fe_1575, 0x89e1_8285_7d9e_d688];

fn mix(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Returns number `n`, from 0 to less than 1, of a sequence that looks random; each `seed` has
/// another. These are the upper bits of SplitMix64 (Steele, Lea, Flood, *Fast Splittable
/// Pseudorandom Number Generators*, 2014), a hash of a counter.
#[must_use]
pub fn uniform(seed: u64, n: u64) -> f32 {
    fraction(splitmix(seed, n))
}

/// The upper bits as a number from 0 to less than 1.
fn fraction(bits: u64) -> f32 {
    (bits >> 40) as f32 / (1 << 24) as f32
}

/// A direction on the side of the unit vector `normal`, as likely as the cosine of the angle
/// between them is large, if the numbers are uniform in the unit square.
pub(crate) fn cosine_direction(normal: Vec3, [a, b]: [f32; 2]) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let (sin, cos) = libm::sincosf(std::f32::consts::TAU * b);
    let radius = a.sqrt();
    x * (radius * cos) + y * (radius * sin) + normal * (1.0 - a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_sample_is_in_the_middle_and_the_rest_is_even() {
        assert_eq!(in_pixel(0), [0.5, 0.5]);
        let mut cells = [0; 16];
        for n in 0..1600 {
            let [x, y] = in_pixel(n);
            cells[(x * 4.0) as usize * 4 + (y * 4.0) as usize] += 1;
        }
        assert!(cells.iter().all(|&c| (95..=105).contains(&c)), "{cells:?}");
    }

    /// The half of a pixel and the half of the directions: a quarter of all.
    #[test]
    fn places_in_a_pixel_and_directions_are_independent() {
        const SAMPLES: u32 = 4096;
        for pixel in 0..100 {
            let stream = Stream::new(7, pixel, 3);
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let is_in = |&n: &u32| in_pixel(n)[i] < 0.5 && stream.even(n.into())[j] < 0.5;
                let part = (0..SAMPLES).filter(is_in).count() as f32 / SAMPLES as f32;
                assert!((part - 0.25).abs() < 0.01, "{part} of pixel {pixel}, {i} and {j}");
            }
        }
    }

    #[test]
    fn directions_are_unit_vectors_with_the_cosine_as_their_density() {
        let stream = Stream::new(7, 3, 4);
        for normal in [Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
            let (mut mean, mut square) = (Vec3::ZERO, 0.0);
            for n in 0..4000 {
                let d = cosine_direction(normal, [stream.uniform(2 * n), stream.uniform(2 * n + 1)]);
                assert!((d.length() - 1.0).abs() < 1e-5 && d.dot(normal) > 0.0);
                mean += d / 4000.0;
                square += d.dot(normal).powi(2) / 4000.0;
            }
            // Means of cos and cos^2 under cos / pi.
            assert!((mean - normal * (2.0 / 3.0)).length() < 0.03, "{mean}");
            assert!((square - 0.5).abs() < 0.02, "{square}");
        }
    }
}
