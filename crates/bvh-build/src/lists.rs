//! Memory of lists: its size, and growing it with all threads.

use rayon::prelude::*;

/// Fewest entries of a list for a thread to write; not tuned.
const ROOM: usize = 4096;

/// Gives a list `n` entries of any content. Where its memory grows, all threads write it first, so
/// that they share the page faults (`docs/TUNING.md`, first builds). Not on WebAssembly, where the
/// code for it is a hundredth of the viewer's page.
pub(crate) fn make_room<T: Copy + Send + Sync>(list: &mut Vec<T>, n: usize, value: T, threads: usize) {
    if cfg!(not(target_family = "wasm")) && threads > 1 && list.capacity() < n {
        rayon::iter::repeat_n(value, n).with_min_len(ROOM).collect_into_vec(list);
    } else {
        list.resize(n, value);
    }
}

/// Memory of a list, used or not.
pub(crate) fn bytes_of<T>(list: &Vec<T>) -> usize {
    list.capacity() * size_of::<T>()
}
