//! Colours as 8-bit sRGB by a table, with the bytes of the formula.

use rt_cpu::srgb;

/// A table that encodes as [`srgb`] does, in less time: for pictures that are shown as they are
/// made. 34 KB.
pub(crate) struct SrgbTable {
    /// The byte of the first number of each bucket. A bucket holds the numbers whose upper 17 bits
    /// are equal. Within it numbers differ by at most 0.4 %, and bytes by at most 1.
    first: Vec<u8>,
    /// For each byte the least number that has a greater one.
    next: [f32; 256],
}

const SHIFT: u32 = 15;

impl SrgbTable {
    /// Makes the table.
    pub(crate) fn new() -> Self {
        let one = 1f32.to_bits();
        let next = std::array::from_fn(|byte| {
            // The bits of positive numbers are in the order of the numbers.
            let (mut low, mut high) = (0, one + 1);
            while low < high {
                let middle = low + (high - low) / 2;
                if usize::from(srgb(f32::from_bits(middle))) > byte {
                    high = middle;
                } else {
                    low = middle + 1;
                }
            }
            f32::from_bits(low)
        });
        let first = (0..=one >> SHIFT).map(|bucket| srgb(f32::from_bits(bucket << SHIFT))).collect();
        Self { first, next }
    }

    /// Encodes one channel; the byte of [`srgb`].
    #[inline]
    pub(crate) fn encode(&self, linear: f32) -> u8 {
        // NaN becomes 0.
        let c = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
        let byte = self.first[(c.to_bits() >> SHIFT) as usize];
        byte + u8::from(c >= self.next[usize::from(byte)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_encodes_as_the_formula_does() {
        let table = SrgbTable::new();
        let check = |c: f32| assert_eq!(table.encode(c), srgb(c), "{c:e}");
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 1.0, 2.0, 1e-45].into_iter().for_each(check);
        // Both ends of every bucket, where bytes change, and numbers between.
        for bucket in 0..1f32.to_bits() >> SHIFT {
            for inside in [0, 1, 77, 12_345, 0x7ffe, 0x7fff] {
                check(f32::from_bits(bucket << SHIFT | inside));
            }
        }
        for bits in table.next[..255].iter().map(|c| c.to_bits()) {
            [bits - 1, bits, bits + 1].map(f32::from_bits).into_iter().for_each(check);
        }
    }
}
