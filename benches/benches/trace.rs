//! Tracing primary and shadow rays through fresh trees, on one thread.

mod contest;

use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pivot_benches::{Contest, Soup, field};
use rt_cpu::Pixel;

/// Pixels on each side of the picture.
const SIZE: u32 = 256;

fn trace(criterion: &mut Criterion) {
    let pool = contest::one_thread();
    let soup = Soup::new(contest::TRIANGLES);
    let positions = soup.positions(0.0);
    let view = Soup::view(SIZE);
    let mut pixels = vec![Pixel::default(); (SIZE * SIZE) as usize];
    let device = contest::embree();
    let mut group = criterion.benchmark_group("trace");
    group.throughput(Throughput::Elements(u64::from(SIZE * SIZE)));
    for entry in field(Contest::Trace, device.as_ref()) {
        let mut contestant = entry.make(&soup.triangles(&positions)).expect("made");
        pool.install(|| {
            contestant.update().expect("built");
            contest::check(&*contestant, &entry.name);
        });
        let mut run = |count: u64| {
            let start = Instant::now();
            (0..count).for_each(|_| contestant.cast(&view, &mut pixels));
            start.elapsed()
        };
        group.bench_function(&entry.name, |b| b.iter_custom(|count| pool.install(|| run(count))));
    }
}

criterion_group!(benches, trace);
criterion_main!(benches);
