//! Counts heap allocations. A program that uses this crate allocates through its counting
//! allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Passes requests on to the system's allocator, and counts them.
struct Counting;

static OF_PROCESS: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // Constant and without a destructor, so that no access to it allocates.
    static OF_THREAD: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every block comes from the system's allocator and goes back to it with the layout that it
// was asked for with. Counting neither allocates nor unwinds.
#[expect(unsafe_code, reason = "an allocator is unsafe to write")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        OF_PROCESS.fetch_add(1, Relaxed);
        OF_THREAD.set(OF_THREAD.get() + 1);
        // SAFETY: the caller promises the same.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: the caller promises the same, and `start` is from `System.alloc`.
        unsafe { System.dealloc(start, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns how often the process allocates during `work`, in any of its threads, and the result of
/// `work`.
pub fn of_process<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = OF_PROCESS.load(Relaxed);
    let result = work();
    (OF_PROCESS.load(Relaxed) - before, result)
}

/// Returns how often this thread allocates during `work`, and the result of `work`.
pub fn of_thread<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = OF_THREAD.get();
    let result = work();
    (OF_THREAD.get() - before, result)
}

#[test]
fn allocations_are_counted_by_process_and_by_thread() {
    // The compiler may leave out blocks that nothing looks at.
    let vector = |length: usize| std::hint::black_box(vec![1_u8; length]);
    assert_eq!(of_thread(|| vector(0)).0, 0);
    // To grow is to ask for another block.
    assert_eq!(of_thread(|| vector(9).reserve_exact(1000)).0, 2);
    // A thread that starts another allocates, but does not count what the other one does.
    let in_another = || std::thread::scope(|scope| scope.spawn(|| of_thread(|| vector(9)).0).join());
    let (of_process, (of_thread, of_the_other)) = of_process(|| of_thread(in_another));
    assert_eq!(of_the_other.expect("no panic"), 1);
    assert!(of_process > of_thread, "{of_process} of the process, {of_thread} of the thread");
}
