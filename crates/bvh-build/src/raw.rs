//! The unsafe parts: trees that are trusted to be trees, when built and when changed, and values
//! that several threads scatter over one slice.

use std::marker::PhantomData;

use bvh_core::{Bvh, Node, Pair};

use crate::neighbor_search::Window;

/// Lets a builder write a tree of one or more primitives a leaf: its pairs and its order.
pub(crate) fn write(bvh: &mut Bvh, fill: impl FnOnce(&mut Vec<Pair>, &mut Vec<u32>)) {
    // SAFETY: builders write nodes by `SubtreeSlot` alone, which gives out each pair and each slot
    // once, and takes heights from the children; `leaves::merge` keeps this up. `rebuild` gives the
    // lists one pair and one slot a primitive, and cuts off only pairs that `merge` has emptied.
    // Tests build the same tree by `Bvh::new`, which checks everything.
    #[expect(unsafe_code, reason = "promises a valid tree")]
    unsafe {
        bvh.replace_with(fill);
    }
}

/// Lets `f` move nodes within a tree, and recomputes the static area.
pub(crate) fn edit<T>(bvh: &mut Bvh, f: impl FnOnce(&mut [Node]) -> T) -> T {
    // SAFETY: `climb`, `layout` and `reinsert` swap whole subtrees and refit all nodes above, to
    // the root. Tests build the same tree by `Bvh::new`, which checks everything.
    #[expect(unsafe_code, reason = "promises a valid tree")]
    let parts = unsafe { bvh.parts_mut() };
    let result = f(parts.nodes);
    let structure = &mut parts.state.changes.structure;
    *structure = structure.wrapping_add(1);
    bvh.sum_static_area();
    result
}

/// A slice whose places are written by several threads, each place by one.
pub(crate) struct Scatter<'a, T> {
    start: *mut T,
    len: usize,
    places: PhantomData<&'a mut [T]>,
}

// SAFETY: sharing one lets threads write values into a slice that is borrowed mutably for as long,
// which is sound if values may be sent and, as `new` demands, no place is written by two threads.
#[expect(unsafe_code, reason = "threads share the slice")]
unsafe impl<T: Send> Sync for Scatter<'_, T> {}

impl<'a, T: Copy> Scatter<'a, T> {
    /// # Safety
    /// While this lives, no place may be written by more than one thread.
    #[expect(unsafe_code, reason = "a promise that the compiler cannot check")]
    pub(crate) unsafe fn new(places: &'a mut [T]) -> Self {
        Self { start: places.as_mut_ptr(), len: places.len(), places: PhantomData }
    }

    #[inline]
    pub(crate) fn write(&self, i: usize, prim: T) {
        assert!(i < self.len, "place out of range");
        // SAFETY: in range by the assertion; not written elsewhere by the promise to `new`, and not
        // read while borrowed.
        #[expect(unsafe_code, reason = "writes the shared slice")]
        unsafe {
            self.start.add(i).write(prim);
        }
    }
}

/// [`Window::search`] with the best instructions that the machine has; the results are the same.
pub(crate) fn search(window: &mut Window, from: usize, nearest: &mut [u32]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn avx2(window: &mut Window, from: usize, nearest: &mut [u32]) {
            window.search(from, nearest);
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the machine has AVX2.
            #[expect(unsafe_code, reason = "calls code compiled for AVX2")]
            return unsafe { avx2(window, from, nearest) };
        }
    }
    window.search(from, nearest);
}

#[cfg(test)]
mod tests {
    use bvh_core::Vec3;

    use super::*;
    use crate::prim_ref::{Bounds, PrimRef};

    #[test]
    fn all_levels_find_the_same() {
        let place = |i: u32| Vec3::new((i % 7) as f32, (i % 11) as f32 * 0.3, (i / 5) as f32 * 0.1);
        let upper = |p: Vec3| p + Vec3::new(0.1, 0.2, 0.3);
        let bounds = |p: Vec3| Bounds { min: p.extend(0.0), max: upper(p).extend(0.0) };
        let clusters: Vec<_> = (0..300).map(|i| PrimRef::cluster(bounds(place(i)), i, 1)).collect();
        let mut window = Window::new(8);
        window.fill(&clusters[..290], 1000);
        let [mut here, mut anywhere] = [[0; 250]; 2];
        search(&mut window, 1020, &mut here);
        window.search(1020, &mut anywhere);
        assert_eq!(here, anywhere);
    }
}
