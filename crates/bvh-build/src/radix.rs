//! Sorting keys by their bits, on one thread or several: by their highest bits, least significant
//! digit first, and then the few that agree in these among themselves.

use std::ops::BitXor;

use rayon::prelude::*;

use crate::raw::Scatter;

/// Bits of a digit, and how many digits are sorted by.
const DIGIT: u32 = 11;
const DIGITS: u32 = 3;

/// How many keys have each digit; later where the next of them goes.
pub(crate) type Counts = [u32; 1 << DIGIT];

/// Fewest keys for a thread to sort.
// Half and double: docs/TUNING.md.
const PART: usize = 8192;

/// Fewer keys are sorted by comparing them: counting takes as long for ten as for a thousand
/// (LBVH over 1000 boxes: 32 us by counting, 27 by comparing; over 16: 8.8, 0.5. `cargo run
/// --release -p pivot-benches --example small_trees`, EPYC Zen 3, 2026-11-28).
const FEW: usize = 1024;

/// A code, and below it in the same integer the number of what has this code.
pub(crate) trait Key: Copy + Ord + Send + Sync + BitXor<Output = Self> {
    /// Bits of the number.
    const LOW: u32;
    /// Bits of the code on each of three axes.
    const AXIS: u32;
    const MAX: Self;
    fn new(code: u64, number: u32) -> Self;
    fn number(self) -> u32;
    /// The lowest 64 bits of the key from `bit` on.
    fn bits_from(self, bit: u32) -> u64;
    /// Position of the highest bit; 0 if there is none.
    fn highest(self) -> u32;
}

macro_rules! key {
    ($int:ty, $low:expr) => {
        impl Key for $int {
            const LOW: u32 = $low;
            const AXIS: u32 = if $low < 64 { (Self::BITS - $low) / 3 } else { 21 };
            const MAX: Self = <$int>::MAX;
            #[inline]
            fn new(code: u64, number: u32) -> Self {
                Self::from(code) << $low | Self::from(number)
            }
            #[inline]
            fn number(self) -> u32 {
                self as u32 & u32::MAX >> 32u32.saturating_sub($low)
            }
            #[inline]
            fn bits_from(self, bit: u32) -> u64 {
                (self >> bit) as u64
            }
            #[inline]
            fn highest(self) -> u32 {
                self.checked_ilog2().unwrap_or(0)
            }
        }
    };
}
key!(u64, 24);
key!(u128, 64);

/// Sorts keys whose numbers are in order by their codes; equal codes stay in the order of their
/// numbers.
///
/// Most codes differ in their highest bits. Sorting the few runs that agree in them in place takes
/// less time than passes over all keys by the lower digits. The sort is written here because it
/// must reuse memory from build to build, on several threads; crates for radix sorts allocate in
/// each call.
///
/// `spare` and `counts` are memory to use.
pub(crate) fn sort<K: Key>(keys: &mut Vec<K>, spare: &mut Vec<K>, counts: &mut Vec<Counts>, threads: usize) {
    if keys.len() < FEW {
        return keys.sort_unstable();
    }
    crate::lists::make_room(spare, keys.len(), K::MAX, threads);
    // With more than `PART` parts there may be fewer chunks than parts, and counts of an earlier
    // digit would remain.
    let parts = (keys.len() / PART).clamp(1, threads.min(PART));
    counts.resize(parts, [0; 1 << DIGIT]);
    let end = K::LOW + 3 * K::AXIS;
    let lowest = end.saturating_sub(DIGITS * DIGIT).max(K::LOW);
    for bit in (lowest..end).step_by(DIGIT as usize) {
        if pass(keys, spare, counts, bit) {
            std::mem::swap(keys, spare);
        }
    }
    if lowest > K::LOW {
        sort_runs(keys, lowest, threads > 1);
    }
}

/// Sorts keys that are in order but for the bits below `bit`.
fn sort_runs<K: Key>(keys: &mut [K], bit: u32, parallel: bool) {
    let high = |key: &K| key.bits_from(bit);
    if !parallel || keys.len() <= PART {
        let mut after = 1;
        // Most runs are of one key, or in order by chance: to look for the others can be predicted.
        while let Some(i) = (after..keys.len()).find(|&i| keys[i] < keys[i - 1]) {
            let of_run = |key: &&K| high(key) == high(&keys[i]);
            let start = i - keys[..i].iter().rev().take_while(of_run).count();
            let end = i + keys[i..].iter().take_while(of_run).count();
            keys[start..end].sort_unstable();
            after = end + 1;
        }
        return;
    }
    let middle = high(&keys[keys.len() / 2]);
    let (left, rest) = keys.split_at_mut(keys.partition_point(|key| high(key) < middle));
    let (run, right) = rest.split_at_mut(rest.partition_point(|key| high(key) == middle));
    let sides = || rayon::join(|| sort_runs(left, bit, true), || sort_runs(right, bit, true));
    rayon::join(|| run.par_sort_unstable(), sides);
}

#[inline]
fn digit<K: Key>(key: K, bit: u32) -> usize {
    key.bits_from(bit) as usize & ((1 << DIGIT) - 1)
}

/// Sorts `keys` into `sorted` by one digit; false, and nothing done, if all have the same.
fn pass<K: Key>(keys: &[K], sorted: &mut [K], counts: &mut [Counts], bit: u32) -> bool {
    let part = keys.len().div_ceil(counts.len());
    // One part stays on this thread: rayon hands nothing on where there is nothing to divide.
    keys.par_chunks(part).zip(&mut *counts).for_each(|(keys, counts)| count(keys, counts, bit));
    let mut start = 0;
    for digit in 0..1 << DIGIT {
        let before = start;
        for counts in &mut *counts {
            start += std::mem::replace(&mut counts[digit], start);
        }
        if (start - before) as usize == keys.len() {
            return false;
        }
    }
    // SAFETY: a part's places for a digit follow those of the parts before and end where those of
    // the next begin, as they have been counted on the same keys: each place is written once.
    #[expect(unsafe_code, reason = "threads write to all places")]
    let sorted = unsafe { Scatter::new(sorted) };
    let parts = keys.par_chunks(part).zip(counts);
    parts.for_each(|(keys, next)| scatter(keys, next, bit, &sorted));
    true
}

#[inline(never)]
fn count<K: Key>(keys: &[K], counts: &mut Counts, bit: u32) {
    counts.fill(0);
    keys.iter().for_each(|&key| counts[digit(key, bit)] += 1);
}

/// Writes keys where the next of their digit goes.
#[inline(never)]
fn scatter<K: Key>(keys: &[K], next: &mut Counts, bit: u32, sorted: &Scatter<'_, K>) {
    for &key in keys {
        let next = &mut next[digit(key, bit)];
        sorted.write(*next as usize, key);
        *next += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_sorted_by_code_then_number_for_every_number_of_parts() {
        let n = 5 * PART as u64 + 3;
        // A multiplicative hash, since codes of any number are asked for again and again.
        let code = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 50) * 0x1_2345_6789;
        let mut expected: Vec<u128> = (0..n).map(|i| Key::new(code(i), i as u32)).collect();
        let keys = expected.clone();
        expected.sort_unstable();
        let short: Vec<u64> =
            keys.iter().map(|k| Key::new(k.bits_from(64) & 0x3fff_ffff, k.number())).collect();
        let mut short_expected = short.clone();
        short_expected.sort_unstable();
        for threads in [1, 2, 3, 8] {
            let (mut spare, mut counts) = (Vec::new(), Vec::new());
            let mut sorted = keys.clone();
            sort(&mut sorted, &mut spare, &mut counts, threads);
            assert!(sorted == expected, "{threads} parts");
            let mut sorted = short.clone();
            sort(&mut sorted, &mut Vec::new(), &mut counts, threads);
            assert!(sorted == short_expected, "{threads} parts");
            // Most are in one run.
            let mut sorted: Vec<u128> = (0..n).map(|i| Key::new(code(i) >> (i % 4 * 12), i as u32)).collect();
            let mut expected = sorted.clone();
            expected.sort_unstable();
            sort(&mut sorted, &mut spare, &mut counts, threads);
            assert!(sorted == expected, "{threads} parts, long runs");
        }
    }

    #[test]
    fn equal_codes_and_no_keys_are_left_alone() {
        for n in [100, 2 * FEW as u32] {
            let mut keys: Vec<u64> = (0..n).map(|i| Key::new(7, i)).collect();
            let expected = keys.clone();
            sort(&mut keys, &mut Vec::new(), &mut Vec::new(), 1);
            assert_eq!(keys, expected);
        }
        let mut none: Vec<u64> = Vec::new();
        sort(&mut none, &mut Vec::new(), &mut Vec::new(), 3);
        assert!(none.is_empty());
    }
}
