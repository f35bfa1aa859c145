//! Cache prefetch: the only unsafe code of this crate.

/// Asks the processor to bring `slice[i]` (its first byte's cache line) into the cache.
///
/// A hint without effect on results; does nothing if `i` is out of range or the target has no such
/// instruction.
#[inline]
pub fn prefetch<T>(slice: &[T], i: usize) {
    #[cfg(target_arch = "x86_64")]
    if i < slice.len() {
        #[expect(unsafe_code, reason = "prefetching needs a pointer")]
        // SAFETY: `i` is in range, so the pointer is to a live element; and prefetch instructions read
        // nothing architecturally, so even that is more than they need. SSE is part of x86-64.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T0>(slice.as_ptr().add(i).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, i);
}
