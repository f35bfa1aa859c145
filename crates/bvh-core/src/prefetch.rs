//! Cache prefetch: the only unsafe blocks of this crate.

/// Asks the processor to bring the first byte's cache line of `slice[i]` into the cache.
///
/// A hint without effect on results; `i` may be out of range. Does nothing where the target has no such instruction.
#[inline]
pub fn prefetch<T>(slice: &[T], i: usize) {
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "prefetching needs a pointer")]
    // SAFETY: a prefetch reads nothing architecturally and faults at no address, and `wrapping_add` makes no claim
    // about the one it gives. SSE is part of x86-64.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(slice.as_ptr().wrapping_add(i).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, i);
}
