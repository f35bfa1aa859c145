//! Builders allocate nothing once their scratch memory is large enough.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, Vec3};

/// Counts what is asked of the system's allocator.
struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: passes everything on to the system's allocator.
#[expect(unsafe_code, reason = "an allocator is unsafe to write")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(start, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn builds_after_the_first_allocate_nothing() {
    let corner = |i: u32| Vec3::new((i % 97) as f32, (i % 89) as f32 * 1.3, (i / 97) as f32 * 0.3);
    let mut boxes: Vec<Aabb> = (0..20_000).map(corner).map(|p| Aabb::new(p, p + Vec3::ONE)).collect();
    boxes[17] = Aabb::EMPTY;
    // One box far away, so that all others have equal short codes.
    let mut clustered = boxes.clone();
    clustered[0] = Aabb::new(Vec3::splat(1e7), Vec3::splat(1e7));
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        for builder in Builder::PER_FRAME.into_iter().filter(|&b| b != Builder::Sweep) {
            for boxes in [&boxes, &clustered] {
                let options = BuildOptions::default().with_max_leaf_size(4);
                let (mut bvh, mut scratch) = (Bvh::default(), BuildScratch::default());
                let mut counted = || {
                    let before = ALLOCATIONS.load(Relaxed);
                    rebuild(&mut bvh, boxes, builder, &options, &mut scratch).expect("few enough");
                    ALLOCATIONS.load(Relaxed) - before
                };
                let counts = pool.install(|| {
                    assert!(counted() > 0);
                    // A thread that steals for the first time in its life allocates, whenever that
                    // may be.
                    let more = if threads > 1 { 10 } else { 1 };
                    (0..more).map(|_| counted()).min()
                });
                assert_eq!(counts, Some(0), "{} on {threads} threads", builder.name());
            }
        }
    }
}
