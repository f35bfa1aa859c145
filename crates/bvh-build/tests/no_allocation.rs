//! Builders allocate nothing once their scratch memory is large enough.

use bvh_build::{BuildOptions, BuildScratch, Builder, rebuild};
use bvh_core::{Aabb, Bvh, Vec3};
use pivot_allocations::of_process;

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
                    let (count, built) =
                        of_process(|| rebuild(&mut bvh, boxes, builder, &options, &mut scratch));
                    built.expect("few enough");
                    count
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
