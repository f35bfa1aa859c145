//! Cache prefetch: the only unsafe block of this crate outside of tests.

/// Asks the processor to load the cache line of the first byte of `slice[i]`.
///
/// A hint without effect on results; `i` may be out of range. Does nothing where the target has no
/// such instruction.
#[doc(hidden)]
#[inline]
pub fn prefetch<T>(slice: &[T], i: usize) {
    prefetch_at(slice.as_ptr(), i);
}

/// Does what [`prefetch`] does for an array that starts at `start`. Any pointer will do.
#[doc(hidden)]
#[inline]
pub fn prefetch_at<T>(start: *const T, i: usize) {
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "prefetching needs a pointer")]
    // SAFETY: a prefetch reads nothing architecturally and faults at no address. `wrapping_add`
    // makes no claim about the address it gives. SSE is part of x86-64.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(i).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (start, i);
}
