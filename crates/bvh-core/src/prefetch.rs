//! Cache prefetch: the only unsafe block of this crate.

/// Asks the processor to load the cache line of the first byte of `slice[i]`.
///
/// A hint without effect on results; `i` may be out of range. Does nothing where the target has no
/// such instruction.
#[doc(hidden)]
#[inline]
pub fn prefetch<T>(slice: &[T], i: usize) {
    prefetch_at(slice.as_ptr(), i);
}

/// [`prefetch`], for an array that starts at `start`. Any pointer will do.
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

/// Iterates over `list` and calls `hint` with the element that comes `distance` later (at least 1),
/// to prefetch what that one needs.
///
/// ```
/// let hints = std::cell::RefCell::new(Vec::new());
/// let seen: Vec<_> = bvh_core::prefetch_ahead(0..4, 3, |i| hints.borrow_mut().push(i)).collect();
/// assert_eq!((seen, hints.into_inner()), (vec![0, 1, 2, 3], vec![3]));
/// ```
#[doc(hidden)]
#[inline]
pub fn prefetch_ahead<I: Iterator + Clone>(
    list: I,
    distance: usize,
    hint: impl Fn(I::Item),
) -> impl Iterator<Item = I::Item> {
    let mut later = list.clone();
    later.nth(distance.saturating_sub(1));
    list.inspect(move |_| later.next().into_iter().for_each(&hint))
}
